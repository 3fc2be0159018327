//! What a ground station does while PX4 of 2021 flies: places to go to, missions, items, modes; and what a companion is asked then.

#![allow(deprecated)]

use crate::support::{Flight, position, reposition, speed};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_px4::{Pace, Px4Config};
use jink_shared_types::geo::Projection;
use jink_shared_types::vehicle::{COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, NavMode};
use mavlink::dialect::*;
use nalgebra::{Vector2, Vector3};

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;

/// Command and place of point 0 of the last question.
fn asked(flight: &Flight) -> (u16, Vector3<f64>) {
    let (_, desired) = flight.desired.as_ref().expect("a question");
    let place = [desired.pos_x[0], desired.pos_y[0], desired.pos_z[0]].map(f64::from);
    (desired.command[0], Vector3::from(place))
}

fn holding() -> Flight {
    holding_with(&[])
}

fn holding_with(parameters: &[(&str, f64)]) -> Flight {
    let mut flight = Flight::with(parameters);
    flight.run(2.5);
    assert_eq!(flight.set_mode(NavMode::Hold), ACCEPTED);
    flight.take_off();
    flight
}

fn current(flight: &mut Flight) -> Option<u16> {
    let mut last = None;
    flight.run_until(1.1, |f| {
        for packet in f.received.iter().filter(|p| p.link == Link::Companion) {
            if let MavMessage::MISSION_CURRENT(current) = &packet.message {
                last = Some(current.seq);
            }
        }
        false
    });
    last
}

#[test]
fn a_place_to_go_to_in_hold_is_asked_about_as_a_loiter_and_flown_to_at_cruise_speed() {
    let mut flight = holding();
    let place = Vector3::new(20.0, 10.0, -4.0);
    flight.from(Link::GroundStation, 255, 190, reposition(place, 1.0));
    flight.run(0.3);
    let (command, target) = asked(&flight);
    assert_eq!(command, COMMAND_LOITER);
    assert!((target - place).norm() < 0.02, "{target}");
    let mut fastest = 0.0f64;
    let arrived = flight.run_until(20.0, |f| {
        fastest = fastest.max(speed(f));
        (position(f) - place).norm() < 0.2
    });
    assert!(arrived && flight.autopilot.mode() == NavMode::Hold);
    assert!((4.6..5.1).contains(&fastest), "{fastest}");
}

#[test]
fn a_place_to_go_to_given_elsewhere_is_kept_until_hold() {
    let mut flight = holding();
    flight.upload(&[[30.0, 0.0, -2.5]]);
    flight.set_mode(NavMode::Mission);
    flight.run(3.0);
    flight.from(
        Link::GroundStation,
        255,
        190,
        reposition(Vector3::new(0.0, 8.0, -2.5), 0.0),
    );
    flight.run(0.5);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    flight.set_mode(NavMode::Hold);
    flight.run(15.0);
    assert!((position(&flight) - Vector3::new(0.0, 8.0, -2.5)).norm() < 0.3);
}

/// Point 0 becomes a loiter at the last waypoint, NAV_ACC_RAD before it, and the mode stays.
#[test]
fn within_the_acceptance_radius_of_the_last_waypoint_the_mission_is_a_loiter_in_the_same_mode() {
    let goal = Vector3::new(30.0, 0.0, -2.5);
    for radius_m in [2.0, 10.0] {
        let mut flight = Flight::with(&[("NAV_ACC_RAD", radius_m)]);
        flight.start_mission(&[goal.into()]);
        flight.run(1.0);
        assert!(flight.run_until(30.0, |f| asked(f).0 == COMMAND_LOITER));
        let away_m = (position(&flight) - goal).norm();
        assert!((away_m - radius_m).abs() < 1.1, "{radius_m} {away_m}");
        assert!((asked(&flight).1 - goal).norm() < 0.02);
        assert_eq!(flight.autopilot.mode(), NavMode::Mission);
        flight.run(10.0);
        assert_eq!(flight.autopilot.mode(), NavMode::Mission);
        assert!((position(&flight) - goal).norm() < 0.3);
    }
}

/// 2.8 m past it at 3 m/s, and back.
#[test]
fn hold_at_speed_is_the_place_where_it_was_commanded_and_the_vehicle_comes_back_to_it() {
    let mut flight = holding_with(&[("MPC_XY_CRUISE", 3.0)]);
    flight.upload(&[[60.0, 0.0, -2.5]]);
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(30.0, |f| position(f).x > 17.0));
    assert!(speed(&flight) > 2.8);
    flight.command(
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        [332.0, 50_000.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
    flight.run(0.3);
    let at_m = position(&flight).x;
    flight.set_mode(NavMode::Hold);
    let mut furthest_m = 0.0f64;
    flight.run_until(10.0, |f| {
        furthest_m = furthest_m.max(position(f).x);
        false
    });
    assert!((2.0..3.6).contains(&(furthest_m - at_m)), "{furthest_m}");
    assert!((position(&flight).x - at_m).abs() < 0.4, "{}", position(&flight));
}

#[test]
fn a_landing_elsewhere_is_a_waypoint_at_the_present_height_first() {
    let mut flight = holding();
    let origin = Projection::new(Px4Config::default().origin);
    let item = |command, north: f64, east: f64, z: f32| {
        let (x, y) = origin.to_global(Vector2::new(north, east)).to_e7();
        MISSION_ITEM_INT_DATA {
            command,
            frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            x,
            y,
            z,
            param4: f32::NAN,
            autocontinue: 1,
            ..MISSION_ITEM_INT_DATA::default()
        }
    };
    flight.upload_items(&[
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, 5.0, 0.0, 4.0),
        item(MavCmd::MAV_CMD_NAV_LAND, 5.0, -30.0, 0.0),
    ]);
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(30.0, |f| f.autopilot.mission().current == 1));
    flight.run(0.5);
    let (command, target) = asked(&flight);
    assert_eq!(command, COMMAND_NONE);
    let height_m = -position(&flight).z;
    assert!(
        (target.y + 30.0).abs() < 0.1 && (target.z + height_m).abs() < 0.5,
        "{target}"
    );
    assert!(flight.run_until(30.0, |f| asked(f).0 == COMMAND_LAND));
    assert!((position(&flight).y + 30.0).abs() < 2.1);
}

#[test]
fn without_a_mission_no_item_is_reported_and_only_the_message_chooses_one() {
    let mut flight = holding();
    assert_eq!(current(&mut flight), None);
    flight.upload(&[[30.0, 0.0, -2.5], [40.0, 0.0, -2.5]]);
    assert_eq!(current(&mut flight), Some(0));
    let message = MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
        seq: 1,
        target_system: 1,
        target_component: 1,
    });
    flight.from(Link::GroundStation, 255, 190, message);
    assert_eq!(current(&mut flight), Some(1));
}

/// The leg to the first item of another mission begins where the vehicle is.
#[test]
fn another_mission_in_flight_is_flown_at_once_from_its_first_item() {
    let mut flight = holding();
    flight.upload(&[[60.0, 0.0, -2.5]]);
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(30.0, |f| position(f).x > 15.0));
    flight.upload(&[[15.0, 20.0, -2.5]]);
    assert_eq!(current(&mut flight), Some(0));
    flight.run(15.0);
    assert!((position(&flight) - Vector3::new(15.0, 20.0, -2.5)).norm() < 0.5);
}

#[test]
fn a_mission_cleared_in_flight_is_held_where_the_vehicle_was() {
    let mut flight = holding();
    flight.upload(&[[60.0, 0.0, -2.5]]);
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(30.0, |f| position(f).x > 15.0));
    flight.clear_mission();
    flight.run(12.0);
    assert!((position(&flight).x - 15.0).abs() < 0.5, "{}", position(&flight));
    assert_eq!(asked(&flight).0, COMMAND_LOITER);
}

/// Its time stands still while its log is opened; nothing is lost on the way.
#[test]
fn at_arming_it_stands_still_for_a_moment_and_then_goes_on() {
    let mut flight = Flight::new(Px4Config {
        pace: Pace {
            arming_stall_s: 0.12,
            ..Pace::default()
        },
        ..Px4Config::default()
    });
    flight.run(2.5);
    flight.set_mode(NavMode::Hold);
    flight.run(1.0);
    assert_eq!(flight.arm(), ACCEPTED);
    let (mut silent, mut longest) = (0, 0);
    for _ in 0..250 {
        flight.step();
        silent = if flight.received.is_empty() { silent + 1 } else { 0 };
        longest = longest.max(silent);
    }
    assert!((30..45).contains(&longest), "{longest} steps of 4 ms");
    assert!(flight.autopilot.is_armed());
}
