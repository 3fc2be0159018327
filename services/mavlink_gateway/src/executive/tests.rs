use super::client::Item;
use super::go_to::GoTo;
use super::record::Record;
use super::{Executive, FlightGoal, Intent, Part, Scene, SpeedCommand};
use crate::demand::Demand;
use crate::landed_state::LandedState;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, Event};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{MavCmd, MavFrame};
use nalgebra::Vector3;

fn item(sequence: u16, command: MavCmd, north_m: i32) -> Item {
    Item {
        sequence,
        command,
        frame: MavFrame::MAV_FRAME_LOCAL_NED,
        params: [0.0, 0.0, 0.0, f32::NAN],
        x: north_m,
        y: 0,
        z_m: -5.0,
        autocontinue: true,
    }
}

/// Take-off, two waypoints with a change of speed between them, a landing.
fn mission() -> Vec<Item> {
    let mut speed = item(2, MavCmd::MAV_CMD_DO_CHANGE_SPEED, 0);
    speed.params = [1.0, 2.5, -1.0, 0.0];
    vec![
        item(0, MavCmd::MAV_CMD_NAV_TAKEOFF, 0),
        item(1, MavCmd::MAV_CMD_NAV_WAYPOINT, 20),
        speed,
        item(3, MavCmd::MAV_CMD_NAV_WAYPOINT, 40),
        item(4, MavCmd::MAV_CMD_NAV_LAND, 40),
    ]
}

/// The same, and a take-off behind the landing.
fn mission_with_more_behind_its_landing() -> Vec<Item> {
    let mut items = mission();
    items.push(item(5, MavCmd::MAV_CMD_NAV_TAKEOFF, 40));
    items
}

fn place(item: &Item, _: Vector3<f64>) -> Option<Vector3<f64>> {
    Some(Vector3::new(f64::from(item.x), 0.0, f64::from(item.z_m)))
}

/// A mission that was taken over just now.
fn taken_over(items: &[Item]) -> (Executive, Scene<'_>) {
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(items);
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Follow));
    seen.mode = NavMode::Offboard;
    (executive, seen)
}

/// Goes on for so long and notes what is asked for and reported on the way.
fn go_on(
    executive: &mut Executive,
    seen: &mut Scene<'_>,
    seconds: f64,
) -> (Vec<Demand>, Vec<&'static Event>) {
    let (mut asked, mut reported) = (Vec::new(), Vec::new());
    for _ in 0..(seconds * 50.0) as u32 {
        seen.now = seen.now.plus_seconds(0.02);
        seen.read_at = seen.now;
        let intent = executive.step(seen, place);
        asked.extend(intent.demand);
        reported.extend(intent.update.map(|update| update.event));
    }
    asked.dedup();
    (asked, reported)
}

fn goal_m(intent: &Intent) -> Option<f64> {
    intent.path.map(|path| path.points[1].position.x_m)
}

fn scene(items: &[Item]) -> Scene<'_> {
    Scene {
        now: Timestamp::from_seconds(50.0),
        mode: NavMode::Mission,
        armed: true,
        in_air: true,
        position: Some(Vector3::new(1.0, 0.0, -5.0)),
        speed_mps: 2.0,
        level_mps: 2.0,
        is_reading: false,
        items: Some(items),
        version: 1,
        read_at: Timestamp::from_seconds(1e6),
        current: Some(1),
        make: AutopilotType::Px4,
        home: Some(Vector3::zeros()),
        is_located: true,
        go_to: None,
        speed_command: None,
        lets_fly_unguarded: false,
        ready: true,
        on_plan: true,
    }
}

fn at(north_m: f64) -> Option<Vector3<f64>> {
    Some(Vector3::new(north_m, 0.0, -5.0))
}

#[test]
fn a_mission_is_taken_over_at_its_first_plain_waypoint_when_all_is_ready() {
    let items = mission();
    for hindrance in 0..7 {
        let mut seen = scene(&items);
        match hindrance {
            0 => {
                seen.current = Some(0);
                seen.position = Some(Vector3::new(1.0, 0.0, -2.0));
            }
            1 => seen.armed = false,
            2 => seen.in_air = false,
            3 => seen.ready = false,
            4 => seen.items = None,
            5 => seen.position = None,
            _ => {
                seen.current = Some(4);
                seen.position = at(40.2);
            }
        }
        let intent = Executive::new(Part::TakesOver).step(&seen, place);
        // Nobody looks for obstacles while jink is not ready.
        let demand = (!seen.ready).then_some(Demand::Hold);
        assert_eq!(
            (intent.path, intent.demand),
            (None, demand),
            "hindrance {hindrance}"
        );
    }
    let mut seen = scene(&items);
    seen.on_plan = false;
    let intent = Executive::new(Part::TakesOver).step(&seen, place);
    assert_eq!(intent.path.unwrap().points[1].position.x_m, 20.0);
    assert_eq!(intent.demand, None, "the way is planned first");
    let intent = Executive::new(Part::TakesOver).step(&scene(&items), place);
    assert_eq!(intent.demand, Some(Demand::Follow));
    let intent = Executive::new(Part::WhenChosen).step(&scene(&items), place);
    assert_eq!(intent.demand, None, "nobody has asked for it");
}

/// Behind it the autopilot gathers speed at once.
#[test]
fn a_take_off_is_taken_over_just_before_its_end() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.current = Some(0);
    (seen.speed_mps, seen.level_mps, seen.on_plan) = (1.2, 0.1, false);
    for (height_m, demand) in [(2.0, None), (4.3, Some(Demand::Follow))] {
        seen.position = Some(Vector3::new(0.3, 0.0, -height_m));
        let intent = executive.step(&seen, place);
        assert_eq!(intent.demand, demand, "at {height_m} m");
        assert_eq!(goal_m(&intent), demand.map(|_| 0.3), "straight up");
    }
}

#[test]
fn demands_without_effect_are_repeated_and_not_for_ever() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    let mut demands = 0;
    for _ in 0..1000 {
        seen.now = seen.now.plus_seconds(0.02);
        demands += u32::from(executive.step(&seen, place).demand.is_some());
    }
    // Five attempts: to follow three or four times, then to hold.
    assert!((20..=35).contains(&demands), "{demands}");
    assert_eq!(executive.step(&seen, place), Intent::default());
}

#[test]
fn a_mission_that_cannot_be_taken_over_in_motion_is_taken_over_from_rest() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.on_plan = false;
    let mut asked = Vec::new();
    while asked.is_empty() {
        seen.now = seen.now.plus_seconds(0.02);
        asked.extend(executive.step(&seen, place).demand);
    }
    assert_eq!(asked, [Demand::Hold]);
    seen.mode = NavMode::Hold;
    let intent = executive.step(&seen, place);
    assert!(intent.path.is_some() && intent.demand.is_none(), "{intent:?}");
    (seen.speed_mps, seen.level_mps) = (0.5, 0.5);
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Follow));
    // While it is not ready, it waits there, and says so.
    seen.ready = false;
    let intent = executive.step(&seen, place);
    assert_eq!(
        intent.update.map(|update| update.event),
        Some(&events::MISSION_WAITS)
    );
    assert_eq!((intent.path, intent.demand), (None, None));
    seen.ready = true;
    // Somebody else's Hold is his.
    let mut executive = Executive::new(Part::TakesOver);
    seen.mode = NavMode::Mission;
    seen.on_plan = true;
    executive.step(&seen, place);
    seen.mode = NavMode::Hold;
    assert_eq!(executive.step(&seen, place), Intent::default());
}

#[test]
fn a_mission_that_is_flown_while_jink_is_not_ready_is_reported_once() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.ready = false;
    let mut reported = 0;
    for _ in 0..500 {
        seen.now = seen.now.plus_seconds(0.02);
        let update = executive.step(&seen, place).update;
        reported += u32::from(update.is_some_and(|update| update.event == &events::UNGUARDED));
    }
    assert_eq!(reported, 1);
    // A landing is the autopilot's, and so is what is not to be taken over.
    for (part, current) in [(Part::TakesOver, 4), (Part::WhenChosen, 1)] {
        let mut executive = Executive::new(part);
        seen.current = Some(current);
        seen.position = at(40.0);
        for _ in 0..500 {
            seen.now = seen.now.plus_seconds(0.02);
            assert_eq!(executive.step(&seen, place).update, None);
        }
    }
}

#[test]
fn waypoint_by_waypoint_to_the_landing_which_is_the_autopilots() {
    let items = mission_with_more_behind_its_landing();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    executive.step(&seen, place);
    seen.mode = NavMode::Offboard;
    let wanted = executive.step(&seen, place).path.unwrap();
    assert_eq!(
        (wanted.points[1].position.x_m, wanted.points[2].position.x_m),
        (20.0, 40.0)
    );
    assert!(wanted.mission_speed_mps.is_nan());
    assert!(wanted.points[0].position.is_finite());

    // Reached: the next one is wanted in the same step, and the autopilot is notified.
    seen.position = at(19.5);
    let intent = executive.step(&seen, place);
    assert_eq!(intent.path.unwrap().points[1].position.x_m, 40.0);
    assert_eq!(intent.path.unwrap().mission_speed_mps, 2.5);
    assert_eq!(intent.demand, Some(Demand::Current(3)));
    seen.current = Some(3);
    assert_eq!(executive.step(&seen, place).demand, None);

    // The last waypoint before the landing: to rest above its place, then the landing is made current once the mission was read
    // again, then the mission is given back.
    seen.position = at(39.4);
    let intent = executive.step(&seen, place);
    assert_eq!(
        (goal_m(&intent), intent.demand),
        (Some(40.0), Some(Demand::Current(4)))
    );
    seen.position = at(39.9);
    assert_eq!(executive.step(&seen, place).demand, None, "it still moves");
    seen.speed_mps = 0.05;
    seen.now = seen.now.plus_seconds(0.1);
    seen.read_at = seen.now.plus_seconds(-1.0);
    let intent = executive.step(&seen, place);
    assert_eq!(
        (intent.path, intent.demand, intent.read_again),
        (None, None, true)
    );
    seen.read_at = seen.now;
    assert_eq!(
        executive.step(&seen, place).demand,
        None,
        "it has just been asked for"
    );
    seen.current = Some(4);
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Mission));
    seen.mode = NavMode::Mission;
    let after = executive.step(&seen, place);
    assert_eq!(
        (after.path, after.demand),
        (None, None),
        "the landing is the autopilot's"
    );
}

#[test]
fn a_plan_that_the_autopilot_has_flown_away_from_is_dropped_and_made_anew() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.on_plan = false;
    let wishes: Vec<_> = (0..400)
        .map(|_| {
            seen.now = seen.now.plus_seconds(0.01);
            executive.step(&seen, place).path.is_some()
        })
        .collect();
    let changes = wishes.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert!(wishes[0] && (3..=4).contains(&changes), "{changes} changes");
}

#[test]
fn after_the_last_waypoint_the_autopilot_finishes_its_mission_and_keeps_it() {
    let items = &mission()[..4];
    let (mut executive, mut seen) = taken_over(items);
    seen.current = Some(3);
    seen.position = at(40.0);
    assert_eq!(executive.step(&seen, place).demand, None, "it still moves");
    seen.speed_mps = 0.0;
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Mission));
    seen.mode = NavMode::Mission;
    for _ in 0..100 {
        seen.now = seen.now.plus_seconds(0.02);
        assert_eq!(executive.step(&seen, place), Intent::default());
    }
    seen.mode = NavMode::Hold;
    executive.step(&seen, place);
    seen.mode = NavMode::Mission;
    seen.current = Some(1);
    assert!(
        executive.step(&seen, place).path.is_some(),
        "begun anew by somebody"
    );
}

#[test]
fn a_waypoint_with_a_delay_is_waited_at() {
    let mut items = mission();
    items[1].params[0] = 3.0;
    let (mut executive, mut seen) = taken_over(&items);
    seen.position = at(20.0);
    assert_eq!(
        executive.step(&seen, place).path.unwrap().points[1].position.x_m,
        20.0
    );
    seen.now = seen.now.plus_seconds(2.9);
    assert_eq!(
        executive.step(&seen, place).path.unwrap().points[1].position.x_m,
        20.0
    );
    seen.now = seen.now.plus_seconds(0.2);
    assert_eq!(
        executive.step(&seen, place).path.unwrap().points[1].position.x_m,
        40.0
    );
}

#[test]
fn a_pilot_who_takes_the_mission_back_keeps_it() {
    let items = mission();
    for taken_to in [NavMode::Hold, NavMode::Position, NavMode::Return] {
        let (mut executive, mut seen) = taken_over(&items);
        executive.step(&seen, place);
        seen.mode = taken_to;
        for _ in 0..200 {
            seen.now = seen.now.plus_seconds(0.02);
            assert_eq!(executive.step(&seen, place), Intent::default(), "{taken_to:?}");
        }
    }
}

#[test]
fn a_mission_chosen_out_of_the_mode_is_taken_over_again_unless_that_is_repeated() {
    let items = mission();
    let (mut executive, mut seen) = taken_over(&items);
    go_on(&mut executive, &mut seen, 2.0);
    seen.mode = NavMode::Mission;
    let (asked, reported) = go_on(&mut executive, &mut seen, 0.1);
    assert_eq!(
        (asked, reported),
        (vec![Demand::Follow], vec![&events::TAKEN_AGAIN])
    );
    seen.mode = NavMode::Offboard;
    go_on(&mut executive, &mut seen, 2.0);
    seen.mode = NavMode::Mission;
    let (asked, reported) = go_on(&mut executive, &mut seen, 5.0);
    assert_eq!((asked, reported), (vec![], vec![&events::LEFT_ALONE]));
}

#[test]
fn a_gateway_that_starts_in_flight_goes_on_with_what_was_flown_before() {
    let items = mission();
    let (mut before, mut seen) = taken_over(&items);
    seen.current = Some(3);
    seen.position = at(30.0);
    before.step(&seen, place);
    let record = before.record(seen.now, LandedState::InAir);
    let record = Record::of_bytes(&record.to_bytes()).unwrap();
    assert!(record.is_valid(seen.now.plus_seconds(1.0)) && !record.is_valid(seen.now.plus_seconds(100.0)));
    let mut executive = Executive::new(Part::TakesOver);
    executive.resume(&record);
    assert_eq!(goal_m(&executive.step(&seen, place)), Some(40.0));
    // Without a record nobody has asked for a flight.
    let mut executive = Executive::new(Part::TakesOver);
    assert_eq!(goal_m(&executive.step(&seen, place)), None);
    assert_eq!(Record::of_bytes(&record.to_bytes()[1..]), None);
}

#[test]
fn a_go_to_survives_a_restart_too() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.mode = NavMode::Offboard;
    seen.go_to = Some(GoTo {
        place: Vector3::new(7.0, 1.0, -4.0),
        serial: 1,
    });
    assert_eq!(goal_m(&executive.step(&seen, place)), Some(7.0));
    let record = Record::of_bytes(&executive.record(seen.now, LandedState::InAir).to_bytes()).unwrap();
    assert_eq!(record.flight_goal, FlightGoal::GoTo(Vector3::new(7.0, 1.0, -4.0)));
}

#[test]
fn nothing_that_nobody_asked_for_is_flown() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.mode = NavMode::Position;
    executive.step(&seen, place);
    seen.mode = NavMode::Offboard;
    let (asked, reported) = go_on(&mut executive, &mut seen, 5.0);
    assert_eq!((asked, reported), (vec![], vec![&events::NO_GOAL]));
    assert_eq!(executive.step(&seen, place).path, None);
    // Where missions are flown when the mode is chosen, home is none.
    let mut executive = Executive::new(Part::WhenChosen);
    seen.make = AutopilotType::ArduPilot;
    for (current, goal) in [(0, None), (1, Some(20.0))] {
        seen.mode = NavMode::Position;
        executive.step(&seen, place);
        seen.mode = NavMode::Offboard;
        seen.current = Some(current);
        assert_eq!(goal_m(&executive.step(&seen, place)), goal, "item {current}");
    }
}

#[test]
fn the_item_that_somebody_chooses_is_flown_to() {
    let items = mission();
    let (mut executive, mut seen) = taken_over(&items);
    go_on(&mut executive, &mut seen, 2.0);
    seen.current = Some(3);
    let (asked, reported) = go_on(&mut executive, &mut seen, 0.1);
    assert_eq!((asked, reported), (vec![], vec![&events::ITEM_CHOSEN]));
    assert_eq!(goal_m(&executive.step(&seen, place)), Some(40.0));
    seen.current = Some(1);
    assert_eq!(
        goal_m(&executive.step(&seen, place)),
        Some(20.0),
        "and back again"
    );
    // What jink has asked for itself is nobody's choice, however late it shows.
    seen.position = at(20.0);
    let (asked, _) = go_on(&mut executive, &mut seen, 1.0);
    assert_eq!(asked, [Demand::Current(3)]);
    seen.current = Some(3);
    let (_, reported) = go_on(&mut executive, &mut seen, 1.0);
    assert!(reported.is_empty(), "{reported:?}");
}

#[test]
fn a_mission_that_was_changed_is_flown_as_it_is_now_and_one_that_was_cleared_is_not() {
    let items = mission();
    let (mut executive, mut seen) = taken_over(&items);
    go_on(&mut executive, &mut seen, 1.0);
    let mut other = mission();
    other[1].x = 27;
    let mut seen = Scene {
        items: Some(&other),
        version: 2,
        ..seen
    };
    let (_, reported) = go_on(&mut executive, &mut seen, 0.1);
    assert_eq!(reported, [&events::MISSION_CHANGED]);
    assert_eq!(goal_m(&executive.step(&seen, place)), Some(27.0));
    let mut seen = Scene {
        items: Some(&[]),
        version: 3,
        current: Some(0),
        ..seen
    };
    let (asked, reported) = go_on(&mut executive, &mut seen, 2.0);
    assert!(
        asked.is_empty() && reported.contains(&&events::MISSION_CLEARED),
        "{reported:?}"
    );
    assert_eq!(goal_m(&executive.step(&seen, place)), None);
}

#[test]
fn a_landing_elsewhere_is_flown_to_at_this_height_and_given_back_above() {
    let mut items = mission();
    items[4].x = 90;
    items[4].z_m = 0.0;
    let (mut executive, mut seen) = taken_over(&items);
    seen.position = at(40.0);
    seen.current = Some(3);
    let wanted = executive.step(&seen, place).path.unwrap();
    assert_eq!(
        (wanted.points[1].position.x_m, wanted.points[1].position.z_m),
        (90.0, -5.0)
    );
    seen.speed_mps = 0.0;
    let (asked, _) = go_on(&mut executive, &mut seen, 2.0);
    assert_eq!(asked, [Demand::Current(4)], "it is not there yet");
    seen.position = at(90.1);
    seen.current = Some(4);
    let (asked, _) = go_on(&mut executive, &mut seen, 0.2);
    assert_eq!(asked, [Demand::Land]);
    // An autopilot that is on its way there is taken over, too.
    let mut executive = Executive::new(Part::TakesOver);
    seen.mode = NavMode::Mission;
    seen.position = at(50.0);
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Follow));
}

#[test]
fn what_nobody_could_guard_is_held_and_reported_unless_it_is_allowed() {
    let mut above_terrain = item(3, MavCmd::MAV_CMD_NAV_WAYPOINT, 40);
    above_terrain.frame = MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT;
    let others = [
        item(3, MavCmd::MAV_CMD_NAV_LOITER_TURNS, 40),
        item(3, MavCmd::MAV_CMD_NAV_PAYLOAD_PLACE, 40),
        above_terrain,
    ];
    for other in others {
        let mut items = mission();
        items[3] = other;
        let (mut executive, mut seen) = taken_over(&items);
        go_on(&mut executive, &mut seen, 2.0);
        seen.position = at(20.0);
        seen.speed_mps = 0.0;
        let (asked, reported) = go_on(&mut executive, &mut seen, 5.0);
        assert_eq!((asked, reported), (vec![], vec![&events::ITEM_HELD]), "{other:?}");
        seen.lets_fly_unguarded = true;
        let (asked, reported) = go_on(&mut executive, &mut seen, 3.0);
        assert_eq!(asked, [Demand::Current(3), Demand::Mission], "{other:?}");
        assert_eq!(reported, [&events::ITEM_UNGUARDED]);
        // In its mission it is held before it begins.
        let mut executive = Executive::new(Part::TakesOver);
        seen.mode = NavMode::Mission;
        seen.current = Some(3);
        let (asked, _) = go_on(&mut executive, &mut seen, 1.0);
        assert!(asked.is_empty(), "{asked:?}");
        seen.lets_fly_unguarded = false;
        let (asked, _) = go_on(&mut executive, &mut seen, 1.0);
        assert_eq!(asked, [Demand::Hold]);
    }
}

#[test]
fn an_autopilot_that_starts_its_mission_anew_is_put_right_and_never_flies_a_second_lap() {
    let items = mission_with_more_behind_its_landing();
    let (mut executive, mut seen) = taken_over(&items);
    seen.position = at(40.0);
    seen.current = Some(3);
    seen.speed_mps = 0.0;
    executive.step(&seen, place);
    seen.current = Some(4);
    let (asked, _) = go_on(&mut executive, &mut seen, 0.5);
    assert_eq!(asked, [Demand::Mission]);
    let mut stubborn = executive.clone();
    seen.mode = NavMode::Mission;
    seen.current = Some(0);
    let (asked, _) = go_on(&mut executive, &mut seen, 0.1);
    assert_eq!(asked, [Demand::Current(4)]);
    seen.current = Some(4);
    let (asked, reported) = go_on(&mut executive, &mut seen, 5.0);
    assert!(asked.is_empty() && reported.is_empty(), "{asked:?} {reported:?}");
    // One that does not let itself be put right holds, and is left alone.
    seen.current = Some(1);
    let (asked, reported) = go_on(&mut stubborn, &mut seen, 8.0);
    assert_eq!(asked, [Demand::Current(4), Demand::Hold]);
    assert_eq!(reported[0], &events::NOT_GIVEN_BACK);
    seen.mode = NavMode::Hold;
    let (asked, _) = go_on(&mut stubborn, &mut seen, 5.0);
    assert!(asked.is_empty(), "{asked:?}");
}

#[test]
fn an_item_that_is_not_shown_outside_of_the_mission_does_not_keep_it_from_being_given_back() {
    let items = mission_with_more_behind_its_landing();
    let (mut executive, mut seen) = taken_over(&items);
    seen.position = at(40.0);
    executive.step(&seen, place);
    executive.skip();
    seen.speed_mps = 0.0;
    let (asked, _) = go_on(&mut executive, &mut seen, 5.0);
    assert_eq!(asked.last(), Some(&Demand::Mission), "{asked:?}");
}

#[test]
fn jumps_are_taken_as_often_as_they_say() {
    let mut jump = item(4, MavCmd::MAV_CMD_DO_JUMP, 0);
    jump.params = [1.0, 2.0, 0.0, 0.0];
    let mut items = mission();
    items[4] = jump;
    items.push(item(5, MavCmd::MAV_CMD_NAV_WAYPOINT, 60));
    let (mut executive, mut seen) = taken_over(&items);
    let mut flown = Vec::new();
    for _ in 0..20 {
        let Some(goal) = goal_m(&executive.step(&seen, place)) else {
            break;
        };
        flown.push(goal);
        seen.position = at(goal);
    }
    flown.dedup();
    assert_eq!(flown, [20.0, 40.0, 20.0, 40.0, 20.0, 40.0, 60.0]);
}

#[test]
fn a_return_is_flown_to_above_home_and_lands_there() {
    let mut items = mission();
    items[4] = item(4, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, 0);
    let (mut executive, mut seen) = taken_over(&items);
    seen.current = Some(3);
    seen.position = at(40.0);
    let wanted = executive.step(&seen, place).path.unwrap().points[1].position;
    assert_eq!((wanted.x_m, wanted.z_m), (0.0, -5.0));
    seen.position = at(0.0);
    seen.speed_mps = 0.0;
    let (asked, _) = go_on(&mut executive, &mut seen, 1.0);
    assert_eq!(asked.last(), Some(&Demand::Land));
}

#[test]
fn a_go_to_in_hold_is_taken_over_and_ends_in_hold() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.mode = NavMode::Hold;
    assert_eq!(executive.step(&seen, place), Intent::default());
    seen.go_to = Some(GoTo {
        place: Vector3::new(30.0, 0.0, -5.0),
        serial: 1,
    });
    let intent = executive.step(&seen, place);
    assert_eq!(
        (goal_m(&intent), intent.demand),
        (Some(30.0), Some(Demand::Follow))
    );
    seen.mode = NavMode::Offboard;
    assert_eq!(goal_m(&executive.step(&seen, place)), Some(30.0));
    seen.position = at(29.9);
    seen.speed_mps = 0.0;
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Hold));
    seen.mode = NavMode::Hold;
    let (asked, _) = go_on(&mut executive, &mut seen, 5.0);
    assert!(asked.is_empty(), "{asked:?}");
}

#[test]
fn where_the_autopilot_flies_itself_it_is_shown_the_way_and_asked_for_nothing() {
    let items = mission();
    let mut executive = Executive::new(Part::ShowsTheWay);
    let mut seen = scene(&items);
    // A landing that begins away from its place is led there at this height.
    for (current, north_m, wanted) in [
        (1, 19.0, Some(20.0)),
        (3, 30.0, Some(40.0)),
        (4, 30.0, Some(40.0)),
        (4, 39.9, None),
    ] {
        seen.current = Some(current);
        seen.position = at(north_m);
        let intent = executive.step(&seen, place);
        let target = intent.path.map(|path| path.points[1].position.x_m);
        assert_eq!((target, intent.demand), (wanted, None));
    }
    seen.mode = NavMode::Offboard;
    seen.current = Some(1);
    assert_eq!(executive.step(&seen, place), Intent::default());
}

/// Above the landing that ends its mission, with the landing mode asked for, and in it.
fn landing(items: &[Item]) -> (Executive, Scene<'_>) {
    let (mut executive, mut seen) = taken_over(items);
    seen.current = Some(4);
    seen.position = at(40.1);
    seen.speed_mps = 0.0;
    seen.level_mps = 0.0;
    let (asked, reported) = go_on(&mut executive, &mut seen, 0.3);
    assert_eq!(asked, [Demand::Land]);
    assert_eq!(reported, [&events::MISSION_TAKEN, &events::ARRIVED]);
    seen.mode = NavMode::Land;
    (executive, seen)
}

/// Runs away with this acceleration for so long; what was asked for, what was told, and how far it has come (m).
fn run_away(
    executive: &mut Executive,
    seen: &mut Scene<'_>,
    mps2: f64,
) -> (Vec<Demand>, Vec<&'static Event>, f64) {
    let begun_m = seen.position.unwrap().x;
    for tick in 1..200 {
        seen.level_mps = mps2 * f64::from(tick) * 0.04;
        seen.position = Some(seen.position.unwrap() - Vector3::new(seen.level_mps * 0.04, 0.0, -0.04));
        // Two steps for each report of the autopilot's.
        let (asked, reported) = go_on(executive, seen, 0.04);
        if !asked.is_empty() {
            return (asked, reported, begun_m - seen.position.unwrap().x);
        }
    }
    (vec![], vec![], f64::INFINITY)
}

#[test]
fn a_landing_that_runs_away_is_held_and_told_within_a_metre() {
    let items = mission();
    let (executive, seen) = landing(&items);
    for mps2 in [3.0, 5.0] {
        let (mut executive, mut seen) = (executive.clone(), seen);
        let (asked, reported, away_m) = run_away(&mut executive, &mut seen, mps2);
        assert_eq!((asked, reported), (vec![Demand::Hold], vec![&events::STRAYED]));
        assert!(away_m < 1.0, "{away_m} m");
        // Who holds is left alone.
        seen.mode = NavMode::Hold;
        let (asked, _) = go_on(&mut executive, &mut seen, 5.0);
        assert!(asked.is_empty(), "{asked:?}");
        // Whoever chooses the landing mode himself lands where he wants.
        seen.mode = NavMode::Land;
        assert_eq!(run_away(&mut executive, &mut seen, mps2).0, []);
    }
    // Slowly it strays by its distance.
    let (mut executive, mut seen) = (executive, seen);
    seen.level_mps = 0.5;
    for _ in 0..200 {
        seen.position = Some(seen.position.unwrap() - Vector3::new(0.01, 0.0, -0.01));
        let (asked, _) = go_on(&mut executive, &mut seen, 0.02);
        let away_m = (seen.position.unwrap().x - 40.0).abs();
        assert!(away_m < 1.7 && (asked.is_empty() || away_m > 1.5), "{away_m} m");
        if !asked.is_empty() {
            return;
        }
    }
    panic!("never noticed");
}

#[test]
fn a_landing_in_gusts_is_left_alone_and_so_is_one_on_the_ground() {
    let items = mission();
    let (mut executive, mut seen) = landing(&items);
    for tick in 0..400 {
        let phase = f64::from(tick) * 0.05;
        seen.position = Some(Vector3::new(
            40.0 + 0.6 * phase.sin(),
            0.0,
            -5.0 + f64::from(tick) * 0.01,
        ));
        seen.level_mps = (1.5 * phase.cos()).abs();
        seen.level_mps = if tick % 40 == 0 {
            3.0
        } else {
            seen.level_mps.min(0.9)
        };
        let (asked, reported) = go_on(&mut executive, &mut seen, 0.02);
        assert!(asked.is_empty() && reported.is_empty(), "{asked:?} {reported:?}");
    }
    seen.in_air = false;
    assert_eq!(run_away(&mut executive, &mut seen, 3.0).0, []);
}

#[test]
fn a_mission_that_goes_on_behind_its_landing_is_watched_while_it_lands_only() {
    let items = mission_with_more_behind_its_landing();
    let (mut executive, mut seen) = taken_over(&items);
    seen.current = Some(4);
    seen.position = at(40.0);
    (seen.speed_mps, seen.level_mps) = (0.0, 0.0);
    let (asked, _) = go_on(&mut executive, &mut seen, 0.3);
    assert_eq!(asked, [Demand::Mission]);
    seen.mode = NavMode::Mission;
    let mut next = executive.clone();
    let (asked, reported, _) = run_away(&mut executive, &mut seen, 3.0);
    assert_eq!((asked, reported), (vec![Demand::Hold], vec![&events::STRAYED]));
    // The item behind it is another matter.
    seen.position = at(40.0);
    seen.current = Some(5);
    let (_, reported, _) = run_away(&mut next, &mut seen, 3.0);
    assert!(!reported.contains(&&events::STRAYED));
}

#[test]
fn a_speed_by_command_holds_until_the_mission_says_another() {
    let items = mission();
    let (mut executive, mut seen) = taken_over(&items);
    seen.make = AutopilotType::ArduPilot;
    go_on(&mut executive, &mut seen, 0.1);
    seen.speed_command = Some(SpeedCommand {
        kind: 1.0,
        speed_mps: 1.0,
        serial: 1,
    });
    let (_, reported) = go_on(&mut executive, &mut seen, 0.1);
    assert_eq!(reported, [&events::SPEED_COMMANDED]);
    let asked_mps = |executive: &mut Executive, seen: &Scene<'_>| {
        executive.step(seen, place).path.unwrap().mission_speed_mps
    };
    assert_eq!(asked_mps(&mut executive, &seen), 1.0);
    seen.position = at(20.0);
    assert_eq!(
        asked_mps(&mut executive, &seen),
        2.5,
        "the mission's own is the later one"
    );
    seen.go_to = Some(GoTo {
        place: Vector3::new(7.0, 1.0, -4.0),
        serial: 1,
    });
    assert_eq!(asked_mps(&mut executive, &seen), 1.0, "no mission's");
}

#[test]
fn what_becomes_of_a_mission_is_told_once_each() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut held = mission();
    held[3].command = MavCmd::MAV_CMD_NAV_LOITER_TURNS;
    let mut seen = scene(&held);
    (seen.armed, seen.in_air, seen.mode) = (false, false, NavMode::Position);
    let (_, reported) = go_on(&mut executive, &mut seen, 1.0);
    assert_eq!(reported, [&events::MISSION_READ, &events::ITEM_WILL_HOLD]);
    (seen.items, seen.version) = (Some(&items[..]), 2);
    let (_, reported) = go_on(&mut executive, &mut seen, 1.0);
    assert_eq!(reported, [&events::MISSION_READ]);
    (seen.armed, seen.in_air) = (true, true);
    for (index, told) in [&events::MISSION_TAKEN, &events::MISSION_RESUMED]
        .into_iter()
        .enumerate()
    {
        seen.mode = NavMode::Mission;
        go_on(&mut executive, &mut seen, 20.0 * index as f64);
        let mut reported = go_on(&mut executive, &mut seen, 0.1).1;
        seen.mode = NavMode::Offboard;
        reported.extend(go_on(&mut executive, &mut seen, 3.0).1);
        assert_eq!(reported, [told]);
    }
}
