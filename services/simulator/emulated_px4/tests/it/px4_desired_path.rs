//! What PX4 asks its companion: TRAJECTORY_REPRESENTATION_WAYPOINTS, field by field. Every rule was observed on a real PX4.

#![allow(deprecated)]

use crate::support;
use crate::support::{Answer, Flight};
use jink_emulated_autopilot::{Autopilot, script};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

type Desired = TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;

fn last(flight: &Flight) -> Desired {
    flight.desired.clone().expect("a question").1
}

fn position(desired: &Desired, index: usize) -> [f32; 3] {
    [desired.pos_x[index], desired.pos_y[index], desired.pos_z[index]]
}

/// Velocities and accelerations unset everywhere (except a vertical velocity in point 0), points 3 and 4 unset altogether.
fn assert_unset_elsewhere(desired: &Desired) {
    for i in 0..5 {
        let fields = [
            desired.vel_x[i],
            desired.vel_y[i],
            desired.acc_x[i],
            desired.acc_y[i],
            desired.acc_z[i],
        ];
        assert!(fields.iter().all(|f| f.is_nan()), "point {i}");
        assert!(i == 0 || desired.vel_z[i].is_nan());
        if i >= 3 {
            assert!(position(desired, i).iter().all(|f| f.is_nan()));
            assert!(desired.pos_yaw[i].is_nan() && desired.vel_yaw[i].is_nan());
        }
    }
    assert_eq!(&desired.command[2..], &[u16::MAX; 3]);
}

#[test]
fn the_stream_has_5_hz_in_every_automatic_mode_and_none_elsewhere() {
    let mut flight = Flight::with(&[]);
    flight.run(4.0);
    assert_eq!(flight.questions, 0, "MANUAL");
    flight.set_mode(NavMode::Hold);
    for mode in [NavMode::Hold, NavMode::Land, NavMode::Return, NavMode::Takeoff] {
        flight.set_mode(mode);
        let before = flight.questions;
        flight.run(4.0);
        assert_eq!(flight.questions - before, 20, "{mode}");
    }
    let mut times = Vec::new();
    flight.run_until(4.0, |f| {
        if let Some((at, _)) = f.desired {
            times.push(at);
        }
        false
    });
    times.dedup();
    for pair in times.windows(2) {
        assert!((0.193..=0.207).contains(&(pair[1] - pair[0])), "{pair:?}");
    }
}

#[test]
fn the_first_message_comes_a_fiftieth_of_a_second_after_mode_entry() {
    let mut flight = Flight::with(&[]);
    flight.run(3.3);
    flight.set_mode(NavMode::Hold);
    let entered_s = flight.now_s();
    assert!(flight.run_until(1.0, |f| f.questions > 0));
    assert!((0.0..=0.024).contains(&(flight.now_s() - entered_s)));
}

#[test]
fn the_rate_can_be_changed() {
    let mut flight = Flight::with(&[]);
    flight.run(2.0);
    flight.set_mode(NavMode::Hold);
    flight.companion(196, script::message_interval(332, 20_000.0));
    flight.run(0.1);
    let before = flight.questions;
    flight.run(4.0);
    assert!((199..=201).contains(&(flight.questions - before)));
}

#[test]
fn quirk_disarmed_in_loiter_only_point_0_and_no_time() {
    let mut flight = Flight::with(&[]);
    flight.run(2.0);
    flight.set_mode(NavMode::Hold);
    flight.run(1.0);
    let desired = last(&flight);
    assert_eq!((desired.time_usec, desired.valid_points), (0, 1));
    assert!(position(&desired, 0).iter().all(|f| f.abs() < 0.05));
    assert!(position(&desired, 1).iter().all(|f| f.is_nan()));
    assert_eq!(&desired.command[..2], &[17, u16::MAX]);
    assert_unset_elsewhere(&desired);
}

#[test]
fn a_take_off_says_22_and_its_next_point_is_its_own() {
    let mut flight = Flight::with(&[]);
    flight.begin_take_off();
    flight.run(5.0);
    let desired = last(&flight);
    assert_eq!(desired.valid_points, 3);
    assert_eq!(&desired.command[..2], &[22, 22]);
    for index in 0..3 {
        assert!((position(&desired, index)[2] + 2.5).abs() < 0.05);
    }
    assert!(desired.pos_yaw[0].is_nan() && desired.vel_yaw[0].is_nan());
    assert_unset_elsewhere(&desired);
}

#[test]
fn a_mission_names_the_target_itself_and_the_next_waypoint() {
    let mut flight = Flight::with(&[]);
    flight.start_mission(&[[30.0, 0.0, -5.0], [30.0, 20.0, -5.0]]);
    flight.run(3.0);
    let desired = last(&flight);
    let lag_s = flight.now_s() - desired.time_usec as f64 * 1e-6;
    assert!((0.0..0.25).contains(&lag_s), "boot time in microseconds");
    assert_eq!(desired.valid_points, 3);
    assert_eq!(position(&desired, 0), [30.0, 0.0, -5.0]);
    assert_eq!(position(&desired, 1), [30.0, 0.0, -5.0]);
    assert_eq!(position(&desired, 2), [30.0, 20.0, -5.0]);
    assert_eq!(desired.command, [u16::MAX; 5]);
    assert!(desired.pos_yaw[0].is_nan());
    assert!(desired.pos_yaw[1].is_finite() && desired.vel_yaw[1].abs() < 1e-2);
    assert_unset_elsewhere(&desired);
    assert!(flight.run_until(20.0, |f| f.autopilot.mission().current == 1));
    flight.run(0.5);
    let desired = last(&flight);
    assert_eq!(position(&desired, 1), [30.0, 20.0, -5.0]);
    assert_eq!(
        position(&desired, 2),
        position(&desired, 1),
        "the last one is its own next"
    );
}

#[test]
fn holding_says_17_at_the_place() {
    let mut flight = Flight::with(&[]);
    flight.start_mission(&[[80.0, 0.0, -5.0]]);
    flight.run(4.0);
    flight.set_mode(NavMode::Hold);
    let place = flight.autopilot.truth().position;
    flight.run(1.0);
    let desired = last(&flight);
    assert_eq!(&desired.command[..2], &[17, 17]);
    assert!((f64::from(desired.pos_x[0]) - place.x_m).abs() < 0.2);
    assert_eq!(position(&desired, 2), position(&desired, 1));
    assert_unset_elsewhere(&desired);
}

#[test]
fn quirk_landing_asks_for_a_descent_and_names_the_sea_as_its_height() {
    let mut flight = Flight::with(&[("MIS_TAKEOFF_ALT", 14.0)]);
    flight.run(2.0);
    flight.set_mode(NavMode::Hold);
    flight.take_off();
    assert!(flight.autopilot.truth().position.z_m < -13.0);
    flight.set_mode(NavMode::Land);
    flight.run(0.3);
    let desired = last(&flight);
    assert_eq!(desired.valid_points, 3);
    assert_eq!(&desired.command[..2], &[21, 21]);
    assert!(desired.pos_z[0].is_nan());
    assert_eq!(desired.vel_z[0], 1.0);
    assert_eq!(&desired.pos_z[1..3], &[488.0, 488.0]);
    assert!(desired.pos_x[0].abs() < 0.5 && desired.pos_y[0].abs() < 0.5);
    assert_unset_elsewhere(&desired);
    // Mirrored back it lands.
    assert!(flight.run_until(60.0, |f| !f.autopilot.is_armed()));
    assert!(flight.autopilot.truth().on_ground);
}

#[test]
fn a_return_is_plain_waypoints_until_it_lands() {
    let mut flight = Flight::with(&[]);
    flight.start_mission(&[[40.0, 0.0, -5.0]]);
    flight.run(6.0);
    flight.set_mode(NavMode::Return);
    flight.run(1.0);
    let desired = last(&flight);
    assert_eq!(&desired.command[..2], &[u16::MAX; 2]);
    assert!((desired.pos_z[1] + 30.0).abs() < 0.1);
    assert!(flight.run_until(120.0, |f| last(f).command[0] == 21));
    assert!(flight.run_until(120.0, |f| !f.autopilot.is_armed()));
    assert!(flight.autopilot.truth().position.vector().xy().norm() < 2.0);
    assert_eq!(flight.autopilot.hold_count(), 0);
}

#[test]
fn far_off_the_leg_point_0_is_the_nearest_point_of_the_leg() {
    let mut flight = Flight::with(&[]);
    flight.start_mission(&[[80.0, 0.0, -5.0]]);
    flight.run(4.0);
    flight.answer = Answer::Silent;
    let aside = |f: &mut Flight| {
        let here = f.autopilot.truth().position.x_m as f32;
        f.companion(
            196,
            support::waypoint([here + 3.0, 8.0, -5.0], [f32::NAN; 3], [f32::NAN; 2]),
        );
    };
    for _ in 0..100 {
        aside(&mut flight);
        flight.run(0.1);
    }
    let desired = last(&flight);
    assert!(flight.autopilot.truth().position.y_m > 5.0);
    assert!(desired.pos_y[0].abs() < 0.1);
    assert!(f64::from(desired.pos_x[0]) < 79.0);
    assert_eq!(position(&desired, 1), [80.0, 0.0, -5.0]);
}
