//! Whole flights of current PX4, alone and with a companion that takes OFFBOARD in between.

#![allow(deprecated)]

use crate::support::current::{here, holding, lift, on_ground, place, send, stream, with_drag};
use crate::support::tracking_current::{HEAVY, LIGHT};
use crate::support::{Flight, speed};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;

/// The last MISSION_CURRENT within a second and a bit.
fn mission_current(flight: &mut Flight) -> MISSION_CURRENT_DATA {
    let mut last = None;
    flight.run_until(1.1, |f| {
        for packet in f.received.iter().filter(|p| p.link == Link::Companion) {
            if let MavMessage::MISSION_CURRENT(current) = &packet.message {
                last = Some(current.clone());
            }
        }
        false
    });
    last.expect("MISSION_CURRENT at 1 Hz")
}

#[test]
fn a_mission_is_flown_from_take_off_to_landing_with_either_drag() {
    for (drag, expected) in [(LIGHT, 4.7..=5.4), (HEAVY, 3.9..=4.4)] {
        let mut flight = with_drag(drag, &[]);
        flight.run(2.0);
        flight.upload(&[[30.0, 0.0, -5.0], [30.0, 20.0, -5.0]]);
        assert_eq!(flight.set_mode(NavMode::Hold), ACCEPTED);
        flight.take_off();
        assert!((flight.autopilot.truth().position.z_m + 2.5).abs() < 0.2);
        assert_eq!(flight.set_mode(NavMode::Mission), ACCEPTED);
        let mut peak = 0.0f64;
        assert!(flight.run_until(60.0, |f| {
            peak = peak.max(speed(f));
            f.autopilot.mission().done
        }));
        assert!(expected.contains(&peak), "drag {drag}: {peak} m/s");
        // Heavy drag carries it past the end, and it comes back slowly.
        flight.run(10.0);
        assert_eq!(flight.autopilot.mode(), NavMode::Hold);
        assert_eq!(flight.set_mode(NavMode::Land), ACCEPTED);
        assert!(flight.run_until(30.0, |f| !f.autopilot.is_armed()));
        let end = flight.autopilot.truth().position;
        assert!((end.x_m - 30.0).hypot(end.y_m - 20.0) < 0.7, "{end:?}");
    }
}

#[test]
fn a_mission_goes_on_at_its_item_after_a_companion_has_flown_offboard() {
    let mut flight = holding(&[]);
    flight.upload(&[[20.0, 0.0, -5.0], [40.0, 0.0, -5.0], [40.0, 20.0, -5.0]]);
    assert_eq!(flight.set_mode(NavMode::Mission), ACCEPTED);
    assert!(flight.run_until(20.0, |f| f.autopilot.mission().current == 1));
    flight.run(1.0);
    let aside = place([25.0, 8.0, -5.0]);
    send(&mut flight, &aside);
    flight.step();
    assert_eq!(flight.set_mode(NavMode::Offboard), ACCEPTED);
    stream(&mut flight, &aside, 0.05, 8.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
    assert!((flight.autopilot.truth().position.y_m - 8.0).abs() < 0.3);
    assert_eq!(flight.autopilot.mission().current, 1);
    assert_eq!(flight.set_mode(NavMode::Mission), ACCEPTED);
    let mut reached = Vec::new();
    assert!(flight.run_until(40.0, |f| {
        for packet in f.received.iter().filter(|p| p.link == Link::Companion) {
            if let MavMessage::MISSION_ITEM_REACHED(item) = &packet.message {
                reached.push(item.seq);
            }
        }
        f.autopilot.mission().done
    }));
    flight.step();
    assert!(reached.starts_with(&[1]), "{reached:?}");
}

#[test]
fn mission_current_says_how_many_items_there_are_and_how_far_it_has_come() {
    let facts = |c: &MISSION_CURRENT_DATA| (c.seq, c.total, c.mission_state, c.mission_mode);
    let mut flight = holding(&[]);
    let empty = mission_current(&mut flight);
    assert_eq!(
        facts(&empty),
        (0, u16::MAX, MissionState::MISSION_STATE_NO_MISSION, 2)
    );
    flight.upload(&[[30.0, 0.0, -5.0], [40.0, 0.0, -5.0]]);
    let waiting = mission_current(&mut flight);
    assert_eq!(
        facts(&waiting),
        (0, 2, MissionState::MISSION_STATE_NOT_STARTED, 2)
    );
    flight.set_mode(NavMode::Mission);
    let flying = mission_current(&mut flight);
    assert_eq!(facts(&flying), (0, 2, MissionState::MISSION_STATE_ACTIVE, 1));
    flight.set_mode(NavMode::Hold);
    let left = mission_current(&mut flight);
    assert_eq!(facts(&left), (0, 2, MissionState::MISSION_STATE_NOT_STARTED, 2));
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(40.0, |f| f.autopilot.mission().current == 1));
    flight.set_mode(NavMode::Hold);
    let paused = mission_current(&mut flight);
    assert_eq!(facts(&paused), (1, 2, MissionState::MISSION_STATE_PAUSED, 2));
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(40.0, |f| f.autopilot.mission().done));
    let done = mission_current(&mut flight);
    assert_eq!(facts(&done), (1, 2, MissionState::MISSION_STATE_COMPLETE, 2));
}

#[test]
fn both_ways_to_set_the_current_item_are_taken_and_answered_with_mission_current() {
    let mut flight = holding(&[]);
    flight.upload(&[[30.0, 0.0, -5.0], [40.0, 0.0, -5.0], [50.0, 0.0, -5.0]]);
    let reported = |f: &Flight| {
        f.received.iter().find_map(|p| match &p.message {
            MavMessage::MISSION_CURRENT(current) => Some(current.seq),
            _ => None,
        })
    };
    let set = MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT;
    assert_eq!(flight.ask(set, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), ACCEPTED);
    assert_eq!(reported(&flight), Some(2));
    assert_eq!(flight.autopilot.mission().current, 2);
    let message = MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
        seq: 1,
        target_system: 1,
        target_component: 1,
    });
    flight.from(Link::GroundStation, 255, 190, message);
    flight.step();
    assert_eq!(reported(&flight), Some(1));
    assert_eq!(flight.autopilot.mission().current, 1);
    assert_eq!(
        flight.ask(set, [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        MavResult::MAV_RESULT_DENIED
    );
}

#[test]
fn hold_begins_where_a_gentle_stop_ends_and_does_not_come_back() {
    let mut flight = holding(&[]);
    flight.upload(&[[200.0, 0.0, -5.0]]);
    flight.set_mode(NavMode::Mission);
    flight.run(8.0);
    let (start, from_mps) = (flight.autopilot.truth().position.x_m, speed(&flight));
    assert!(from_mps > 4.5);
    flight.set_mode(NavMode::Hold);
    let mut furthest = 0.0f64;
    flight.run_until(12.0, |f| {
        furthest = furthest.max(f.autopilot.truth().position.x_m - start);
        false
    });
    let expected = from_mps * (from_mps / 6.0 + 0.6);
    assert!((furthest - expected).abs() < 0.5, "{furthest} against {expected}");
    let end = flight.autopilot.truth().position.x_m - start;
    assert!((furthest - end).abs() < 0.5, "it stays there: {end}");
}

#[test]
fn a_flight_that_never_receives_setpoints_is_never_a_failsafe() {
    let mut flight = on_ground(&[]);
    lift(&mut flight);
    flight.run(20.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    let stay = here(&flight);
    stream(&mut flight, &stay, 0.05, 1.0);
    flight.run(5.0);
    assert_eq!(
        flight.autopilot.mode(),
        NavMode::Hold,
        "a stream of before means nothing"
    );
    assert!(!flight.texts.iter().any(|t| t.contains("Failsafe")));
}
