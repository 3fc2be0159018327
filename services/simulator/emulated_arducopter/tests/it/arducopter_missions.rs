//! What the mission is to ArduCopter: which item is current, what others receive of it, and items that are no plain
//! waypoints.

#![allow(deprecated)]

use crate::support::copter::{CopterFlight, PVA, at, item, level, setpoint, square};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_autopilot::modes::arducopter::Mode;
use mavlink::dialect::*;
use nalgebra::Vector3;

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const SET_CURRENT: MavCmd = MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT;

fn first(param: f32) -> [f32; 7] {
    [param, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// MISSION_CURRENT as the companion receives it: item, items, state.
fn current(flight: &mut CopterFlight) -> (u16, u16, MissionState) {
    flight.ask(MavCmd::MAV_CMD_REQUEST_MESSAGE, first(42.0));
    let reported = flight.received.iter().find_map(|packet| match &packet.message {
        MavMessage::MISSION_CURRENT(current) => Some(current.clone()),
        _ => None,
    });
    let reported = reported.expect("MISSION_CURRENT");
    assert_eq!(reported.mission_id, 0, "it never reports which mission");
    (reported.seq, reported.total, reported.mission_state)
}

fn in_guided() -> CopterFlight {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    flight.upload(&square());
    flight.lifted(5.0)
}

#[test]
fn before_the_mission_begins_item_0_is_current_in_the_air_too() {
    use MissionState as S;
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    assert_eq!(current(&mut flight), (0, 0, S::MISSION_STATE_NO_MISSION));
    flight.upload(&square());
    assert_eq!(current(&mut flight), (0, 4, S::MISSION_STATE_NOT_STARTED));
    let mut flight = flight.lifted(5.0);
    assert_eq!(current(&mut flight), (0, 4, S::MISSION_STATE_NOT_STARTED));
    flight.set_mode(Mode::Auto);
    flight.step();
    assert_eq!(current(&mut flight), (1, 4, S::MISSION_STATE_ACTIVE));
    flight.set_mode(Mode::Guided);
    assert_eq!(current(&mut flight), (1, 4, S::MISSION_STATE_NOT_STARTED));
}

#[test]
fn an_item_can_be_chosen_before_the_mission_begins_and_item_0_is_the_first() {
    let mut flight = in_guided();
    assert_eq!(flight.ask(SET_CURRENT, first(3.0)), ACCEPTED);
    assert_eq!(current(&mut flight).0, 3);
    assert_eq!(flight.ask(SET_CURRENT, first(9.0)), MavResult::MAV_RESULT_DENIED);
    assert_eq!(flight.ask(SET_CURRENT, first(0.0)), ACCEPTED);
    assert_eq!(current(&mut flight).0, 1);
    flight.ask(SET_CURRENT, first(3.0));
    flight.set_mode(Mode::Auto);
    flight.run(1.0);
    assert_eq!(current(&mut flight).0, 3);
}

#[test]
fn mis_restart_begins_at_the_first_item_whenever_auto_is_entered() {
    let mut flight = in_guided();
    flight.ask(SET_CURRENT, first(3.0));
    flight.set("MIS_RESTART", 1.0);
    flight.step();
    for _ in 0..3 {
        flight.set_mode(Mode::Auto);
        flight.step();
        assert_eq!(current(&mut flight).0, 1);
        flight.set_mode(Mode::Guided);
        flight.ask(SET_CURRENT, first(3.0));
        assert_eq!(current(&mut flight).0, 3);
    }
}

/// What the link of who has not sent it carries is the same before and after.
#[test]
fn another_mission_of_the_same_length_is_reported_to_its_sender_only() {
    let mut flight = in_guided();
    flight.ask(SET_CURRENT, first(3.0));
    let before = current(&mut flight);
    let other: Vec<_> = square()
        .into_iter()
        .map(|item| MISSION_ITEM_INT_DATA {
            y: item.y + 4_000,
            ..item
        })
        .collect();
    flight.texts.clear();
    let mut received = Vec::new();
    flight.upload(&other);
    received.extend(
        flight
            .received
            .iter()
            .filter(|p| p.link == Link::Companion)
            .cloned(),
    );
    let texts = received
        .iter()
        .filter(|packet| matches!(packet.message, MavMessage::STATUSTEXT(_)))
        .count();
    assert_eq!(texts, 0);
    assert_eq!(flight.texts, ["Flight plan received"]);
    assert_eq!(current(&mut flight), before);
}

#[test]
fn a_mission_that_is_flown_takes_another_one_at_once_and_cannot_be_cleared() {
    let mut flight = in_guided();
    flight.ask(SET_CURRENT, first(2.0));
    flight.set_mode(Mode::Auto);
    assert!(flight.run_until(20.0, |f| f.position().x > 8.0).is_some());
    flight.station(MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
    }));
    flight.step();
    let refused = flight.received.iter().any(|packet| {
        matches!(&packet.message, MavMessage::MISSION_ACK(ack) if ack.mavtype == MavMissionResult::MAV_MISSION_ERROR)
    });
    assert!(refused);
    assert_eq!(current(&mut flight).1, 4);
    let other: Vec<_> = square()
        .into_iter()
        .map(|item| MISSION_ITEM_INT_DATA {
            x: item.x - 7_000,
            ..item
        })
        .collect();
    flight.upload(&other);
    assert!(
        flight
            .texts
            .contains(&"Auto mission changed, restarted command".to_owned())
    );
    flight.run(8.0);
    // 60 m north became 18 m south.
    assert!(flight.position().x < 0.0, "{}", flight.position());
}

#[test]
fn a_mission_that_is_not_flown_can_be_cleared_and_auto_is_refused_then() {
    let mut flight = in_guided();
    flight.ask(SET_CURRENT, first(3.0));
    flight.station(MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
    }));
    flight.step();
    let none = (0, 0, MissionState::MISSION_STATE_NO_MISSION);
    assert_eq!(current(&mut flight), none);
    assert_eq!(flight.set_mode(Mode::Auto), MavResult::MAV_RESULT_FAILED);
    assert_eq!(
        flight.texts.last().unwrap(),
        "Mode change to AUTO failed: init failed"
    );
}

/// At full speed, on a straight line, level: only then it descends.
#[test]
fn a_landing_elsewhere_is_flown_to_at_the_present_height_at_full_speed() {
    let mut flight = in_guided();
    let mut items = square();
    items[4] = item(MavCmd::MAV_CMD_NAV_LAND, -40.0, 30.0, 0.0);
    flight.upload(&items);
    flight.ask(SET_CURRENT, first(4.0));
    flight.set_mode(Mode::Auto);
    let (mut fastest, mut lowest_m) = (0.0f64, f64::INFINITY);
    let over = Vector3::new(-40.0, 30.0, -5.0);
    let arrived = flight.run_until(40.0, |f| {
        fastest = fastest.max(f.speed());
        lowest_m = lowest_m.min(-f.position().z);
        (f.position() - over).norm() < 0.5
    });
    assert!(arrived.is_some());
    assert!(fastest > 7.5, "{fastest}");
    assert!(lowest_m > 4.8, "{lowest_m}");
    assert!(flight.run_until(30.0, |f| !f.copter.is_armed()).is_some());
    assert!((flight.position().xy() - over.xy()).norm() < 0.5);
    assert_eq!(current(&mut flight).0, 1, "it would begin again");
}

#[test]
fn splines_and_turns_are_items_that_lead_somewhere() {
    let mut flight = in_guided();
    let mut items = square();
    items[2] = item(MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT, 20.0, 20.0, 5.0);
    items[3] = item(MavCmd::MAV_CMD_NAV_LOITER_TURNS, 20.0, 40.0, 5.0);
    items[3].param1 = 1.0;
    assert_eq!(flight.upload(&items), MavMissionResult::MAV_MISSION_ACCEPTED);
    flight.ask(SET_CURRENT, first(2.0));
    flight.set_mode(Mode::Auto);
    for (item, place) in [(3, at(20.0, 20.0)), (4, at(20.0, 40.0))] {
        assert!(
            flight
                .run_until(60.0, |f| f.copter.mission().current == item)
                .is_some()
        );
        assert!(
            (flight.position() - place).norm() < 2.5,
            "{item} {}",
            flight.position()
        );
    }
}

/// A click on the map: others on the link see nothing of it but the target that is reported.
#[test]
fn a_place_to_go_to_is_taken_in_guided_and_shows_in_the_reported_target_only() {
    let mut flight = in_guided();
    let place = item(MavCmd::MAV_CMD_DO_REPOSITION, 10.0, 10.0, 5.0);
    let go_to = |flags: f32| {
        MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            target_system: 1,
            target_component: 1,
            frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            command: MavCmd::MAV_CMD_DO_REPOSITION,
            param1: -1.0,
            param2: flags,
            param4: f32::NAN,
            x: place.x,
            y: place.y,
            z: 5.0,
            ..COMMAND_INT_DATA::default()
        })
    };
    flight.station(go_to(0.0));
    flight.step();
    let forwarded = flight
        .received
        .iter()
        .any(|packet| packet.link == Link::Companion && matches!(packet.message, MavMessage::COMMAND_INT(_)));
    assert!(!forwarded);
    let target = flight.target();
    assert_eq!(target.type_mask.bits(), 3_576);
    assert!((f64::from(target.x) - 10.0).abs() < 0.05 && (f64::from(target.y) - 10.0).abs() < 0.05);
    flight.run(10.0);
    assert!((flight.position() - at(10.0, 10.0)).norm() < 0.3);
    // Outside GUIDED only with the wish for that mode.
    flight.set_mode(Mode::Brake);
    flight.station(go_to(0.0));
    flight.step();
    assert_eq!(flight.copter.flight_mode(), Mode::Brake);
    flight.station(go_to(1.0));
    flight.step();
    assert_eq!(flight.copter.flight_mode(), Mode::Guided);
}

#[test]
fn a_setpoint_of_a_station_passes_to_other_links_only_if_no_component_is_named() {
    let mut flight = in_guided();
    for (component, passes) in [(1, false), (0, true)] {
        let mut message = setpoint(PVA, at(0.0, 3.0), level(0.0, 0.0), level(0.0, 0.0));
        if let MavMessage::SET_POSITION_TARGET_LOCAL_NED(message) = &mut message {
            message.target_component = component;
        }
        flight.station(message);
        flight.step();
        let passed = flight.received.iter().any(|packet| {
            packet.link == Link::Companion
                && matches!(packet.message, MavMessage::SET_POSITION_TARGET_LOCAL_NED(_))
        });
        assert_eq!(passed, passes, "component {component}");
        assert_eq!(flight.target().type_mask.bits(), 3_072);
    }
}

#[test]
fn a_take_off_reports_a_target_of_zeros_and_goes_on_reporting_it_at_its_height() {
    let mut flight = in_guided();
    let target = flight.target();
    assert_eq!(target.type_mask.bits(), 3_576);
    assert_eq!((target.x, target.y, target.z), (0.0, 0.0, 0.0));
    let before = flight.position();
    flight.run(5.0);
    assert!((flight.position() - before).norm() < 0.1);
}

#[test]
fn the_landed_state_is_reported_through_a_take_off_in_guided() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    let state = |flight: &mut CopterFlight| {
        flight.ask(MavCmd::MAV_CMD_REQUEST_MESSAGE, first(245.0));
        let reported = flight.received.iter().find_map(|packet| match &packet.message {
            MavMessage::EXTENDED_SYS_STATE(state) => Some(state.landed_state),
            _ => None,
        });
        reported.expect("EXTENDED_SYS_STATE")
    };
    assert_eq!(state(&mut flight), MavLandedState::MAV_LANDED_STATE_ON_GROUND);
    flight.set_mode(Mode::Guided);
    flight.arm();
    flight.take_off(5.0);
    assert!(flight.run_until(10.0, |f| f.position().z < -1.0).is_some());
    assert_eq!(state(&mut flight), MavLandedState::MAV_LANDED_STATE_TAKEOFF);
    flight.run(12.0);
    assert_eq!(state(&mut flight), MavLandedState::MAV_LANDED_STATE_IN_AIR);
}

/// The option that keeps a companion's messages off the telemetry radio keeps its heartbeats off it, too.
#[test]
fn a_link_that_does_not_forward_keeps_everything_of_the_companion_to_itself() {
    for (options, expected) in [(0.0, 1), (2.0, 0)] {
        let mut flight = CopterFlight::with(&[("MAV2_OPTIONS", options)]);
        flight.run(6.0);
        // Read at the start only.
        flight.set("MAV2_OPTIONS", 2.0 - options as f32);
        flight.step();
        flight.from(
            Link::Companion,
            1,
            196,
            MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()),
        );
        flight.step();
        let received = flight
            .received
            .iter()
            .filter(|packet| packet.link == Link::GroundStation && packet.header.component_id == 196)
            .count();
        assert_eq!(received, expected, "options {options}");
    }
}
