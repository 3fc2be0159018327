//! External avoidance as proposed for PX4: what a companion sends in a mission is taken in with EAV_EN, and not without.

#![allow(deprecated)]

use crate::support::Flight;
use crate::support::current::{NO_ACCELERATION, NO_POSITION, NO_YAW_RATE, holding, send, setpoint};
use jink_emulated_autopilot::Autopilot;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

/// YAW_IGNORE.
const NO_YAW: u16 = 0x400;

/// In a mission 60 m to the north, pushed east at 1 m/s for 4 s; how far east it is then (m).
fn pushed(parameters: &[(&str, f64)]) -> (Flight, f64) {
    let mut flight = holding(parameters);
    flight.upload(&[[60.0, 0.0, -5.0]]);
    assert_eq!(flight.set_mode(NavMode::Mission), MavResult::MAV_RESULT_ACCEPTED);
    flight.run(1.0);
    let push = setpoint(
        [f64::NAN; 3],
        [2.0, 1.0, 0.0],
        NO_POSITION | NO_ACCELERATION | NO_YAW | NO_YAW_RATE,
    );
    for _ in 0..80 {
        send(&mut flight, &push);
        flight.run(0.05);
    }
    let east_m = flight.autopilot.truth().position.y_m;
    (flight, east_m)
}

#[test]
fn setpoints_in_a_mission_change_nothing_unless_they_are_to_be_taken_in() {
    let (flight, east_m) = pushed(&[]);
    assert!(east_m.abs() < 0.3, "{east_m} m");
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    let (mut flight, east_m) = pushed(&[("EAV_EN", 1.0)]);
    assert!(east_m > 2.5, "{east_m} m");
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    // Silence: its own way again, to the waypoint.
    assert!(flight.run_until(60.0, |f| f.autopilot.mission().done));
    let end = flight.autopilot.truth().position;
    assert!((end.x_m - 60.0).hypot(end.y_m) < 2.5, "{end:?}");
}
