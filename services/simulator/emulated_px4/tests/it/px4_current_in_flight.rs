//! What a ground station does while current PX4 flies, and what others see of it.

#![allow(deprecated)]

use crate::support;
use crate::support::current::{ask_for, holding, staying};
use crate::support::{Flight, position, reposition};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_px4::{Pace, Px4Config};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;
use nalgebra::Vector3;

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;

/// DO_REPOSITION, and its answer.
fn go_to(flight: &mut Flight, place: Vector3<f64>, flags: f32) -> Option<MavResult> {
    flight.from(Link::GroundStation, 255, 190, reposition(place, flags));
    flight.step();
    flight.received.iter().find_map(|packet| match &packet.message {
        MavMessage::COMMAND_ACK(ack) => Some(ack.result),
        _ => None,
    })
}

/// The last message within a second and a bit, as `pick` picks it on the companion's link.
fn last<T>(flight: &mut Flight, pick: impl Fn(&MavMessage) -> Option<T>) -> Option<T> {
    let mut last = None;
    flight.run_until(1.1, |f| {
        for packet in f.received.iter().filter(|p| p.link == Link::Companion) {
            last = pick(&packet.message).or(last.take());
        }
        false
    });
    last
}

fn current(flight: &mut Flight) -> MISSION_CURRENT_DATA {
    let reported = last(flight, |message| match message {
        MavMessage::MISSION_CURRENT(current) => Some(current.clone()),
        _ => None,
    });
    reported.expect("MISSION_CURRENT at 1 Hz")
}

/// The waypoint being flown as POSITION_TARGET_GLOBAL_INT reports it, north and east (m).
fn reported_target(flight: &mut Flight) -> Option<(f64, f64)> {
    let origin = Projection::new(Px4Config::default().origin);
    last(flight, |message| match message {
        MavMessage::POSITION_TARGET_GLOBAL_INT(target) => {
            let at = origin.to_local(GlobalPoint::from_e7(target.lat_int, target.lon_int));
            Some((at.x, at.y))
        }
        _ => None,
    })
}

#[test]
fn a_place_to_go_to_shows_as_the_global_target_and_in_offboard_there_is_none() {
    let mut flight = holding(&[]);
    let place = Vector3::new(15.0, 10.0, -4.0);
    assert_eq!(go_to(&mut flight, place, 1.0), Some(ACCEPTED));
    let (north, east) = reported_target(&mut flight).expect("a target");
    assert!((north - 15.0).abs() < 0.05 && (east - 10.0).abs() < 0.05);
    flight.run(12.0);
    assert!((position(&flight) - place).norm() < 0.3);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    let mut flight = staying(&[]);
    let (mut targets, place) = (0, support::current::here(&flight));
    support::current::stream(&mut flight, &place, 0.05, 0.5);
    for packet in &flight.received {
        targets += usize::from(matches!(
            packet.message,
            MavMessage::POSITION_TARGET_GLOBAL_INT(_)
        ));
    }
    assert_eq!((targets, flight.autopilot.mode()), (0, NavMode::Offboard));
}

#[test]
fn a_place_to_go_to_outside_hold_needs_the_wish_for_that_mode() {
    let mut flight = staying(&[]);
    let place = Vector3::new(15.0, 10.0, -4.0);
    assert_eq!(go_to(&mut flight, place, 0.0), Some(MavResult::MAV_RESULT_DENIED));
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
    assert_eq!(go_to(&mut flight, place, 1.0), Some(ACCEPTED));
    flight.run(14.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    assert!((position(&flight) - place).norm() < 0.4, "{}", position(&flight));
}

#[test]
fn an_orbit_is_a_mode_of_its_own_that_flies_straight_to_its_circle() {
    let mut flight = holding(&[]);
    let centre = Vector3::new(30.0, 0.0, -5.0);
    let MavMessage::COMMAND_INT(place) = reposition(centre, 0.0) else {
        panic!("a place is sent as COMMAND_INT")
    };
    let orbit = COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_DO_ORBIT,
        param1: 5.0,
        param2: 2.0,
        ..place
    };
    flight.from(Link::GroundStation, 255, 190, MavMessage::COMMAND_INT(orbit));
    let mut fastest = 0.0f64;
    let at_circle = flight.run_until(20.0, |f| {
        fastest = fastest.max(f.autopilot.truth().velocity.vector().norm());
        (position(f) - centre).xy().norm() < 5.5
    });
    assert!(at_circle && fastest > 4.0, "{fastest}");
    assert_eq!(flight.autopilot.mode(), NavMode::Orbit);
    let mut quarters = [false; 4];
    flight.run_until(25.0, |f| {
        let from = (position(f) - centre).xy();
        assert!((3.5..7.5).contains(&from.norm()), "{from}");
        quarters[usize::from(from.x > 0.0) + 2 * usize::from(from.y > 0.0)] = true;
        false
    });
    assert_eq!(quarters, [true; 4]);
}

#[test]
fn every_mission_has_an_identity_of_its_own() {
    let mut flight = holding(&[]);
    assert_eq!(current(&mut flight).mission_id, 0);
    flight.upload(&[[30.0, 0.0, -5.0], [40.0, 0.0, -5.0]]);
    let first = current(&mut flight).mission_id;
    flight.upload(&[[30.0, 0.0, -5.0], [40.0, 1.0, -5.0]]);
    let second = current(&mut flight).mission_id;
    flight.upload(&[[30.0, 0.0, -5.0], [40.0, 0.0, -5.0]]);
    assert!(first != 0 && first != second);
    assert_eq!(current(&mut flight).mission_id, first);
}

/// What it says of a mission is what its navigator did last, whatever that was.
#[test]
fn a_take_off_that_is_over_counts_as_a_mission_that_is_done() {
    let mut flight = support::current::on_ground(&[]);
    flight.run(2.5);
    flight.upload(&[[30.0, 0.0, -5.0], [40.0, 0.0, -5.0]]);
    let waiting = current(&mut flight).mission_state;
    assert_eq!(waiting, MissionState::MISSION_STATE_NOT_STARTED);
    support::current::lift(&mut flight);
    let after = current(&mut flight).mission_state;
    assert_eq!(after, MissionState::MISSION_STATE_COMPLETE);
    flight.set_mode(NavMode::Mission);
    let flying = current(&mut flight).mission_state;
    assert_eq!(flying, MissionState::MISSION_STATE_ACTIVE);
}

#[test]
fn a_mission_cleared_in_flight_is_hold_where_the_vehicle_was() {
    let mut flight = holding(&[]);
    flight.upload(&[[60.0, 0.0, -5.0]]);
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(30.0, |f| position(f).x > 15.0));
    flight.clear_mission();
    flight.run(12.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    assert!((position(&flight).x - 15.0).abs() < 0.6, "{}", position(&flight));
}

#[test]
fn its_clock_runs_slower_than_the_boards_where_its_simulation_does() {
    let mut flight = Flight::new(Px4Config {
        pace: Pace {
            rate: 0.988,
            ..Pace::default()
        },
        ..Px4Config::current(0.1)
    });
    flight.heartbeat = None;
    flight.run(100.0);
    assert!((flight.now_s() - 98.8).abs() < 0.01, "{}", flight.now_s());
    assert_eq!(ask_for(&mut flight, 32, 0.02), ACCEPTED);
}
