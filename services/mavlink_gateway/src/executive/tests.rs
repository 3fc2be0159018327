use super::client::Item;
use super::{Demand, Executive, Intent, Part, Scene};
use jink_shared_types::Timestamp;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialects::ardupilotmega::{MavCmd, MavFrame};
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

fn place(item: &Item) -> Option<Vector3<f64>> {
    Some(Vector3::new(f64::from(item.x), 0.0, f64::from(item.z_m)))
}

fn scene(items: &[Item]) -> Scene<'_> {
    Scene {
        now: Timestamp::from_seconds(50.0),
        mode: NavMode::Mission,
        armed: true,
        in_air: true,
        position: Some(Vector3::new(1.0, 0.0, -5.0)),
        speed_mps: 2.0,
        items: Some(items),
        current: Some(1),
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
            0 => seen.current = Some(0),
            1 => seen.armed = false,
            2 => seen.in_air = false,
            3 => seen.ready = false,
            4 => seen.items = None,
            5 => seen.position = None,
            _ => seen.current = Some(4),
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
    seen.speed_mps = 0.5;
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Follow));
    // While it is not ready, it waits there.
    seen.ready = false;
    assert_eq!(executive.step(&seen, place), Intent::default());
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
fn a_mission_that_is_flown_while_jink_is_not_ready_is_told_once() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.ready = false;
    let mut told = 0;
    for _ in 0..500 {
        seen.now = seen.now.plus_seconds(0.02);
        told += u32::from(executive.step(&seen, place).unguarded);
    }
    assert_eq!(told, 1);
    // A landing is the autopilot's, and so is what is not to be taken over.
    for (part, current) in [(Part::TakesOver, 4), (Part::WhenChosen, 1)] {
        let mut executive = Executive::new(part);
        seen.current = Some(current);
        for _ in 0..500 {
            seen.now = seen.now.plus_seconds(0.02);
            assert!(!executive.step(&seen, place).unguarded);
        }
    }
}

#[test]
fn waypoint_by_waypoint_to_the_landing_which_is_the_autopilots() {
    let items = mission();
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

    // Reached: the next one is wanted in the same step, and the autopilot is told.
    seen.position = at(19.5);
    let intent = executive.step(&seen, place);
    assert_eq!(intent.path.unwrap().points[1].position.x_m, 40.0);
    assert_eq!(intent.path.unwrap().mission_speed_mps, 2.5);
    assert_eq!(intent.demand, Some(Demand::Current(3)));
    seen.current = Some(3);
    assert_eq!(executive.step(&seen, place).demand, None);

    // The last waypoint before the landing: to rest, then the landing is made current, then the mission is given back.
    seen.position = at(39.9);
    assert_eq!(executive.step(&seen, place).path, None);
    seen.now = seen.now.plus_seconds(0.1);
    assert_eq!(executive.step(&seen, place).demand, None, "it still moves");
    seen.speed_mps = 0.05;
    assert_eq!(executive.step(&seen, place).demand, Some(Demand::Current(4)));
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
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(items);
    seen.mode = NavMode::Offboard;
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
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.mode = NavMode::Offboard;
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
    for taken_to in [
        NavMode::Mission,
        NavMode::Hold,
        NavMode::Position,
        NavMode::Return,
    ] {
        let mut executive = Executive::new(Part::TakesOver);
        let mut seen = scene(&items);
        seen.mode = NavMode::Offboard;
        executive.step(&seen, place);
        seen.mode = taken_to;
        for _ in 0..200 {
            seen.now = seen.now.plus_seconds(0.02);
            assert_eq!(executive.step(&seen, place), Intent::default(), "{taken_to:?}");
        }
    }
}

#[test]
fn a_gateway_that_starts_in_flight_goes_on_at_the_current_item() {
    let items = mission();
    let mut executive = Executive::new(Part::TakesOver);
    let mut seen = scene(&items);
    seen.mode = NavMode::Offboard;
    seen.current = Some(3);
    let wanted = executive.step(&seen, place).path.unwrap();
    assert_eq!(wanted.points[1].position.x_m, 40.0);
    seen.items = None;
    assert_eq!(
        Executive::new(Part::TakesOver).step(&seen, place).path,
        None,
        "not read yet: hold"
    );
}

#[test]
fn where_the_autopilot_flies_itself_it_is_shown_the_way_and_asked_for_nothing() {
    let items = mission();
    let mut executive = Executive::new(Part::ShowsTheWay);
    let mut seen = scene(&items);
    for (current, wanted) in [(1, Some(20.0)), (3, Some(40.0)), (4, None)] {
        seen.current = Some(current);
        seen.position = at(39.9);
        let intent = executive.step(&seen, place);
        let target = intent.path.map(|path| path.points[1].position.x_m);
        assert_eq!((target, intent.demand), (wanted, None));
    }
    seen.mode = NavMode::Offboard;
    seen.current = Some(1);
    assert_eq!(executive.step(&seen, place), Intent::default());
}
