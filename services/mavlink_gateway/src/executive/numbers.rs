//! What the numbers of a mission mean, row by row: each is flown as the autopilot itself would fly it, or held.
//!
//! The oracle of each row is the autopilot's own source. ArduCopter 4.7-dev and PX4 main of August 2026 have flown or
//! refused each of them on their own, PX4 without a speed of 5 cm/s, a heading of 90 degrees and a take-off at 15 m; docs/missions.md says where they do otherwise.

use super::client::Item;
use super::georeference::Georeference;
use super::{Executive, Part, Scene};
use crate::demand::Demand;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{ITEM_HELD, JUMP_NOWHERE};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA, MavCmd, MavFrame};
use nalgebra::{Vector2, Vector3};

const ORIGIN: GlobalPoint = GlobalPoint {
    latitude_deg: 47.3977419,
    longitude_deg: 8.5455938,
};
/// Height of the local origin, and of home, above the sea (m).
const SEA_M: f64 = 488.0;
/// Step (s).
const STEP_S: f64 = 0.02;
/// The vehicle's own speed (m/s).
const OWN_MPS: f64 = 5.0;

use MavCmd::{
    MAV_CMD_DO_CHANGE_SPEED as SPEED, MAV_CMD_DO_JUMP as JUMP, MAV_CMD_DO_JUMP_TAG as JUMP_TO_TAG,
    MAV_CMD_JUMP_TAG as TAG, MAV_CMD_NAV_LAND as LAND, MAV_CMD_NAV_LOITER_TIME as LOITER_TIME,
    MAV_CMD_NAV_LOITER_TO_ALT as LOITER_TO_ALT, MAV_CMD_NAV_RETURN_TO_LAUNCH as RETURN,
    MAV_CMD_NAV_SPLINE_WAYPOINT as SPLINE, MAV_CMD_NAV_TAKEOFF as TAKEOFF, MAV_CMD_NAV_WAYPOINT as WAYPOINT,
};

/// An item at a place north and east of home (m); `None`: latitude and longitude are zero. Height above home (m).
fn at(command: MavCmd, place: Option<(f64, f64)>, up_m: f32) -> Item {
    let (x, y) = place.map_or((0, 0), |(north, east)| {
        Projection::new(ORIGIN)
            .to_global(Vector2::new(north, east))
            .to_e7()
    });
    Item {
        sequence: 0,
        command,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
        params: [0.0, 0.0, 0.0, f32::NAN],
        x,
        y,
        z_m: up_m,
        autocontinue: true,
    }
}

/// A waypoint.
fn to(north: f64, east: f64, up_m: f32) -> Item {
    at(WAYPOINT, Some((north, east)), up_m)
}

fn in_frame(frame: MavFrame, item: Item) -> Item {
    Item { frame, ..item }
}

/// An item without a place.
fn with(command: MavCmd, first: f32, second: f32) -> Item {
    Item {
        params: [first, second, 0.0, 0.0],
        ..at(command, None, 0.0)
    }
}

/// Flies it from ten metres above home; the places that were wanted with the speed and the heading that were asked for, and how it ended.
fn flown(make: AutopilotType, mission: &[Item]) -> String {
    // Item 0 of ArduCopter is home, PX4's own.
    let first = match make {
        AutopilotType::Px4 => at(TAKEOFF, Some((0.0, 0.0)), 10.0),
        AutopilotType::ArduPilot => in_frame(MavFrame::MAV_FRAME_GLOBAL, to(0.0, 0.0, SEA_M as f32)),
    };
    let items: Vec<Item> = std::iter::once(first)
        .chain(mission.iter().copied())
        .enumerate()
        .map(|(sequence, item)| Item {
            sequence: sequence as u16,
            ..item
        })
        .collect();
    let mut georeference = Georeference::default();
    for boot_ms in [1000, 2000, 3000, 4000] {
        let (lat, lon) = ORIGIN.to_e7();
        georeference.take_local(&LOCAL_POSITION_NED_DATA {
            time_boot_ms: boot_ms,
            ..LOCAL_POSITION_NED_DATA::default()
        });
        georeference.take_global(&GLOBAL_POSITION_INT_DATA {
            time_boot_ms: boot_ms,
            lat,
            lon,
            alt: (SEA_M * 1e3) as i32,
            ..GLOBAL_POSITION_INT_DATA::default()
        });
    }
    let mut executive = Executive::new(Part::TakesOver);
    let mut position = Vector3::new(0.0, 0.0, -10.0);
    let mut seen = Scene {
        now: Timestamp::from_seconds(50.0),
        mode: NavMode::Mission,
        armed: true,
        in_air: true,
        position: Some(position),
        speed_mps: 0.0,
        level_mps: 0.0,
        is_reading: false,
        items: Some(&items),
        version: 1,
        read_at: Timestamp::from_seconds(50.0),
        current: Some(1),
        make,
        home: Some(Vector3::zeros()),
        is_located: true,
        go_to: None,
        speed_command: None,
        lets_fly_unguarded: false,
        ready: true,
        on_plan: true,
    };
    let mut log: Vec<String> = Vec::new();
    for _ in 0..6_000 {
        if log.len() > 12 {
            return format!("{} ...", log[..6].join(" "));
        }
        seen.now = seen.now.plus_seconds(STEP_S);
        seen.read_at = seen.now;
        let intent = executive.step(&seen, |item, from| georeference.place(make, item, from));
        match intent.demand {
            Some(Demand::Follow) => seen.mode = NavMode::Offboard,
            Some(Demand::Current(item)) => seen.current = Some(item),
            Some(Demand::Land) => {
                log.push("lands".into());
                return log.join(" ");
            }
            Some(Demand::Mission) => {
                log.push("ends".into());
                return log.join(" ");
            }
            Some(Demand::Hold) | None => {}
        }
        let held = intent
            .update
            .filter(|update| [&ITEM_HELD, &JUMP_NOWHERE].contains(&update.event));
        if let Some(held) = held {
            let what = if held.event == &JUMP_NOWHERE {
                "jumps nowhere"
            } else {
                held.name
            };
            log.push(format!("held: {what}"));
            return log.join(" ");
        }
        let Some(path) = intent.path.filter(|_| seen.mode == NavMode::Offboard) else {
            (seen.speed_mps, seen.level_mps) = (0.0, 0.0);
            continue;
        };
        let goal = path.points[1].position.vector();
        let place = goal.map(|metres| (metres * 10.0).round() / 10.0 + 0.0);
        let speed = match path.mission_speed_mps.is_nan() {
            true => String::new(),
            false => format!("@{:.1}", path.mission_speed_mps),
        };
        let heading = match path.points[1].yaw_rad.to_degrees() {
            degrees if degrees.is_nan() => String::new(),
            degrees => format!("^{degrees:.0}"),
        };
        let entry = format!("{},{},{}{speed}{heading}", place.x, place.y, 0.0 - place.z);
        if log.last() != Some(&entry) {
            log.push(entry);
        }
        let way = goal - position;
        let step_m = (OWN_MPS * STEP_S).min(way.norm());
        position += way.try_normalize(1e-9).unwrap_or_default() * step_m;
        seen.position = Some(position);
        seen.speed_mps = step_m / STEP_S;
        seen.level_mps = seen.speed_mps;
    }
    log.push("flies on".into());
    log.join(" ")
}

/// What is in the mission behind item 1, a waypoint at 20/0, 10 m up; whose source says what becomes of it; what PX4 and ArduCopter fly.
struct Row {
    what: &'static str,
    items: Vec<Item>,
    oracle: &'static str,
    px4: &'static str,
    copter: &'static str,
}

const PLACES: &str = "ModeAuto::loc_from_cmd | MissionBlock::mission_item_to_position_setpoint";
const JUMPS: &str = "AP_Mission::get_next_cmd | MissionBase::getNonJumpItem";
const SPEEDS: &str =
    "ModeAuto::do_change_speed, AC_WPNav::set_speed_xy | Navigator::run, VEHICLE_CMD_DO_CHANGE_SPEED";
const HEADINGS: &str =
    "AP_Mission::mavlink_int_to_mission_cmd | MavlinkMissionManager::parse_mavlink_mission_item";
const LANDS: &str = "ModeAuto::do_land | Mission::handleLanding";

fn row(
    what: &'static str,
    items: Vec<Item>,
    oracle: &'static str,
    px4: &'static str,
    copter: &'static str,
) -> Row {
    Row {
        what,
        items,
        oracle,
        px4,
        copter,
    }
}

#[rustfmt::skip]
fn table() -> Vec<Row> {
    let global = MavFrame::MAV_FRAME_GLOBAL;
    let terrain = MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT;
    let land = || at(LAND, Some((40.0, 0.0)), 0.0);
    vec![
        row("height 0", vec![to(20.0, 15.0, 0.0), land()], PLACES,
            "20,15,0 40,0,0 lands", "20,15,10 40,0,10 lands"),
        row("height 0 twice", vec![to(20.0, 15.0, 0.0), to(0.0, 15.0, 0.0), land()], PLACES,
            "20,15,0 0,15,0 40,0,0 lands", "20,15,10 0,15,10 40,0,10 lands"),
        row("height of 4 mm", vec![to(20.0, 15.0, 0.004), land()], PLACES,
            "20,15,0 40,0,0 lands", "20,15,10 40,0,10 lands"),
        row("height 2 m below home", vec![to(20.0, 15.0, -2.0), land()], PLACES,
            "20,15,-2 40,0,-2 lands", "20,15,-2 40,0,-2 lands"),
        row("height 0 above the sea", vec![in_frame(global, to(20.0, 15.0, 0.0)), land()], PLACES,
            "20,15,-488 40,0,-488 lands", "20,15,10 40,0,10 lands"),
        row("height above the sea", vec![in_frame(global, to(20.0, 15.0, 500.0)), land()], PLACES,
            "20,15,12 40,0,12 lands", "20,15,12 40,0,12 lands"),
        row("height above terrain", vec![in_frame(terrain, to(20.0, 15.0, 12.0)), land()], PLACES,
            "held: above terrain", "held: above terrain"),
        row("heading 0", vec![Item { params: [0.0; 4], ..to(20.0, 15.0, 10.0) }, land()], HEADINGS,
            "20,15,10^0 40,0,10 lands", "20,15,10 40,0,10 lands"),
        row("heading 90", vec![Item { params: [0.0, 0.0, 0.0, 90.0], ..to(20.0, 15.0, 10.0) }, land()], HEADINGS,
            "20,15,10^90 40,0,10 lands", "20,15,10 40,0,10 lands"),
        row("latitude and longitude 0", vec![at(WAYPOINT, None, 15.0), land()], PLACES,
            "held: without place", "20,0,15 40,0,15 lands"),
        row("latitude, longitude and height 0", vec![at(WAYPOINT, None, 0.0), to(20.0, 15.0, 12.0), land()], PLACES,
            "held: without place", "20,15,12 40,0,12 lands"),
        row("loiter for a time, height 0", vec![at(LOITER_TIME, Some((20.0, 15.0)), 0.0), land()], PLACES,
            "20,15,0 40,0,0 lands", "20,15,10 40,0,10 lands"),
        row("spline, height 0", vec![at(SPLINE, Some((20.0, 15.0)), 0.0), land()], PLACES,
            "20,15,0 40,0,0 lands", "20,15,10 40,0,10 lands"),
        row("loiter to height 0", vec![at(LOITER_TO_ALT, Some((20.0, 15.0)), 0.0), land()], "ModeAuto::do_loiter_to_alt | MissionBlock",
            "20,15,0 40,0,0 lands", "20,15,0 40,0,0 lands"),
        row("take-off in the air, height 0", vec![at(TAKEOFF, None, 0.0), land()], "ModeAuto::takeoff_start | Mission::handleTakeoff",
            "40,0,10 lands", "40,0,10 lands"),
        row("take-off in the air, height 15", vec![at(TAKEOFF, None, 15.0), land()], "ModeAuto::takeoff_start | FeasibilityChecker::checkTakeoff",
            "40,0,10 lands", "20,0,15 40,0,15 lands"),
        row("landing, height 100", vec![at(LAND, Some((40.0, 0.0)), 100.0)], LANDS,
            "40,0,10 lands", "40,0,10 lands"),
        row("landing at 0/0", vec![at(LAND, None, 0.0)], LANDS,
            "held: without place", "lands"),
        row("landing, and more behind it", vec![land(), to(0.0, 0.0, 10.0)], LANDS,
            "40,0,10 ends", "40,0,10 ends"),
        row("return", vec![with(RETURN, 0.0, 0.0)], "ModeAuto::do_RTL | RtlDirect",
            "0,0,10 lands", "0,0,10 lands"),
        row("jump to item 0", vec![with(JUMP, 0.0, 1.0), land()], JUMPS,
            "0,0,10 20,0,10 40,0,10 lands", "held: jumps nowhere"),
        row("jump to item 0, 0 times", vec![with(JUMP, 0.0, 0.0), land()], JUMPS,
            "40,0,10 lands", "held: jumps nowhere"),
        row("jump to item -1", vec![with(JUMP, -1.0, 1.0), land()], JUMPS,
            "held: jumps nowhere", "held: jumps nowhere"),
        row("jump to item 65535", vec![with(JUMP, 65535.0, 1.0), land()], JUMPS,
            "held: jumps nowhere", "held: jumps nowhere"),
        row("jump behind the end", vec![with(JUMP, 4.0, 1.0), land()], JUMPS,
            "held: jumps nowhere", "held: jumps nowhere"),
        row("jump to no number", vec![with(JUMP, f32::NAN, 1.0), land()], JUMPS,
            "held: jumps nowhere", "held: jumps nowhere"),
        row("jump back, 0 times", vec![with(JUMP, 1.0, 0.0), land()], JUMPS,
            "40,0,10 lands", "40,0,10 lands"),
        row("jump back, once", vec![to(0.0, 15.0, 10.0), with(JUMP, 1.0, 1.0), land()], JUMPS,
            "0,15,10 20,0,10 0,15,10 40,0,10 lands", "0,15,10 20,0,10 0,15,10 40,0,10 lands"),
        row("jump back, -1 times", vec![to(0.0, 15.0, 10.0), with(JUMP, 1.0, -1.0), land()], JUMPS,
            "0,15,10 20,0,10 0,15,10 20,0,10 0,15,10 ...", "0,15,10 20,0,10 0,15,10 20,0,10 0,15,10 ..."),
        row("jump back, -2 times", vec![to(0.0, 15.0, 10.0), with(JUMP, 1.0, -2.0), land()], JUMPS,
            "0,15,10 20,0,10 0,15,10 20,0,10 0,15,10 ...", "0,15,10 40,0,10 lands"),
        row("jump to itself, 3 times", vec![with(JUMP, 2.0, 3.0), land()], JUMPS,
            "40,0,10 lands", "40,0,10 lands"),
        row("jump in a circle without a place", vec![with(SPEED, 1.0, 2.0), with(JUMP, 2.0, -1.0), land()], JUMPS,
            "held: jumps nowhere", "held: jumps nowhere"),
        row("jump to a tag", vec![to(0.0, 15.0, 10.0), with(TAG, 7.0, 0.0), to(20.0, 0.0, 10.0), to(0.0, 15.0, 10.0), with(JUMP_TO_TAG, 7.0, 1.0), land()], "AP_Mission::get_index_of_jump_tag | PX4 refuses the item",
            "0,15,10 20,0,10 0,15,10 20,0,10 0,15,10 40,0,10 lands", "0,15,10 20,0,10 0,15,10 20,0,10 0,15,10 40,0,10 lands"),
        row("jump to a tag that is none", vec![with(JUMP_TO_TAG, 7.0, 1.0), land()], "AP_Mission::get_index_of_jump_tag | PX4 refuses the item",
            "held: jumps nowhere", "held: jumps nowhere"),
        row("speed of type 0", vec![with(SPEED, 0.0, 1.0), land()], SPEEDS,
            "40,0,10@1.0 lands", "40,0,10@1.0 lands"),
        row("speed of type 1", vec![with(SPEED, 1.0, 1.0), land()], SPEEDS,
            "40,0,10@1.0 lands", "40,0,10@1.0 lands"),
        row("speed of type 2, climb", vec![with(SPEED, 2.0, 1.0), land()], SPEEDS,
            "40,0,10@1.0 lands", "40,0,10 lands"),
        row("speed of type 3, descent", vec![with(SPEED, 3.0, 1.0), land()], SPEEDS,
            "40,0,10@1.0 lands", "40,0,10 lands"),
        row("speed -1 behind one", vec![with(SPEED, 1.0, 2.0), with(SPEED, 1.0, -1.0), land()], SPEEDS,
            "40,0,10 lands", "40,0,10@2.0 lands"),
        row("speed -2 behind one", vec![with(SPEED, 1.0, 2.0), with(SPEED, 1.0, -2.0), land()], SPEEDS,
            "40,0,10 lands", "40,0,10@2.0 lands"),
        row("speed 0 behind one", vec![with(SPEED, 1.0, 2.0), with(SPEED, 1.0, 0.0), land()], SPEEDS,
            "40,0,10 lands", "40,0,10@2.0 lands"),
        row("speed of 5 cm/s", vec![with(SPEED, 1.0, 0.05), land()], SPEEDS,
            "40,0,10@0.1 lands", "40,0,10 lands"),
        row("speed of 100 m/s behind one", vec![with(SPEED, 1.0, 1.0), with(SPEED, 1.0, 100.0), land()], SPEEDS,
            "40,0,10@30.0 lands", "40,0,10@30.0 lands"),
        row("speed behind a jump back", vec![to(0.0, 15.0, 10.0), with(SPEED, 0.0, 2.0), to(0.0, 0.0, 10.0), with(JUMP, 2.0, 1.0), land()], SPEEDS,
            "0,15,10 0,0,10@2.0 0,15,10@2.0 0,0,10@2.0 40,0,10@2.0 lands",
            "0,15,10 0,0,10@2.0 0,15,10@2.0 0,0,10@2.0 40,0,10@2.0 lands"),
    ]
}

#[test]
fn each_number_is_flown_as_its_autopilot_flies_it_or_held() {
    let mut wrong = Vec::new();
    for row in table() {
        for (make, wanted) in [
            (AutopilotType::Px4, row.px4),
            (AutopilotType::ArduPilot, row.copter),
        ] {
            let items: Vec<Item> = std::iter::once(to(20.0, 0.0, 10.0))
                .chain(row.items.iter().copied())
                .collect();
            let flown = flown(make, &items);
            let wanted = format!("20,0,10 {wanted}");
            if flown != wanted {
                wrong.push(format!(
                    "{make:?}, {}: {flown}, not {wanted} ({})",
                    row.what, row.oracle
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
