//! What PX4 makes of a companion's Bezier curves. Every rule was observed on a real PX4.

#![allow(deprecated)]

use crate::support::{Answer, Flight, no_waypoint, waypoint};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_px4::{Firmware, HoldCause, Px4Config, Variant};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

/// A curve of five points from (x0, y0) to (x1, y1) at 5 m, starting and ending at rest.
fn curve(from: [f64; 2], to: [f64; 2], duration_s: f32, time_usec: u64) -> MavMessage {
    let share = [0.0, 0.0, 0.5, 1.0, 1.0];
    let along = |axis: usize| share.map(|s| (from[axis] + s * (to[axis] - from[axis])) as f32);
    MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(TRAJECTORY_REPRESENTATION_BEZIER_DATA {
        time_usec,
        pos_x: along(0),
        pos_y: along(1),
        pos_z: [-5.0; 5],
        delta: [9.0, 9.0, 9.0, 9.0, duration_s],
        pos_yaw: [0.0; 5],
        valid_points: 5,
    })
}

/// Holding at 5 m in AUTO.MISSION by mirrored waypoints, then curves may come: one message without points has been sent.
fn ready(variant: Variant) -> Flight {
    let mut flight = Flight::new(Px4Config {
        firmware: Firmware::Trajectory(variant),
        parameters: vec![("MIS_TAKEOFF_ALT".to_owned(), 5.0)],
        ..Px4Config::default()
    });
    flight.run(2.5);
    flight.upload(&[[300.0, 0.0, -5.0]]);
    flight.set_mode(NavMode::Hold);
    flight.take_off();
    flight.answer = Answer::Silent;
    flight
}

fn enter_mission(flight: &mut Flight) {
    assert_eq!(flight.set_mode(NavMode::Mission), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn a_curve_is_flown_from_start_to_end_with_its_heading() {
    let mut flight = ready(Variant::A);
    flight.companion(196, no_waypoint());
    flight.companion(196, curve([0.0, 0.0], [6.0, 3.0], 6.0, 0));
    enter_mission(&mut flight);
    flight.run(3.0);
    let middle = flight.autopilot.truth().position;
    assert!(
        (middle.x_m - 3.0).abs() < 1.2 && (middle.y_m - 1.5).abs() < 0.8,
        "{middle:?}"
    );
    flight.run(2.9);
    let end = flight.autopilot.truth().position;
    assert!(
        (end.x_m - 6.0).abs() < 1.0 && (end.y_m - 3.0).abs() < 0.6,
        "{end:?}"
    );
    assert!(flight.autopilot.truth().attitude.yaw_rad().abs() < 0.05);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
}

#[test]
fn only_the_last_delta_counts_and_hold_comes_exactly_at_it() {
    let mut flight = ready(Variant::A);
    flight.companion(196, no_waypoint());
    flight.companion(196, curve([0.0, 0.0], [4.0, 0.0], 4.0, 0));
    let sent_s = flight.now_s();
    enter_mission(&mut flight);
    assert!(flight.run_until(6.0, |f| f.autopilot.mode() == NavMode::Hold));
    let after_s = flight.now_s() - sent_s;
    assert!((4.0..=4.05).contains(&after_s), "{after_s}");
    assert_eq!(flight.autopilot.holds()[0].cause, HoldCause::CurveExpired);
}

#[test]
fn more_points_than_five_are_five() {
    let mut flight = ready(Variant::A);
    flight.companion(196, no_waypoint());
    let mut message = curve([0.0, 0.0], [4.0, 0.0], 4.0, 0);
    if let MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(m) = &mut message {
        m.valid_points = 200;
    }
    flight.companion(196, message);
    enter_mission(&mut flight);
    flight.run(3.9);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    assert!((flight.autopilot.truth().position.x_m - 4.0).abs() < 1.0);
}

#[test]
fn precedence_trap_stale_waypoints_win_over_curves_in_variant_a_only() {
    for (variant, trapped) in [(Variant::A, true), (Variant::B, false)] {
        let mut flight = ready(variant);
        flight.companion(196, waypoint([60.0, 0.0, -5.0], [f32::NAN; 3], [f32::NAN; 2]));
        flight.companion(196, curve([0.0, 0.0], [0.0, 4.0], 8.0, 0));
        enter_mission(&mut flight);
        flight.run(5.0);
        let position = flight.autopilot.truth().position;
        assert_eq!(flight.autopilot.mode(), NavMode::Mission);
        assert_eq!(position.x_m > 10.0, trapped, "{variant:?} {position:?}");
    }
}

#[test]
fn an_empty_waypoints_message_opens_the_trap() {
    let mut flight = ready(Variant::A);
    flight.companion(196, waypoint([60.0, 0.0, -5.0], [f32::NAN; 3], [f32::NAN; 2]));
    flight.companion(196, no_waypoint());
    flight.companion(196, curve([0.0, 0.0], [0.0, 4.0], 5.0, 0));
    enter_mission(&mut flight);
    flight.run(4.9);
    let position = flight.autopilot.truth().position;
    assert!(
        position.x_m.abs() < 0.5 && (position.y_m - 4.0).abs() < 0.8,
        "{position:?}"
    );
}

#[test]
fn before_500_answers_to_timesync_the_stamp_is_ignored() {
    let mut flight = ready(Variant::A);
    flight.companion(196, no_waypoint());
    for stamp in [0, 1, u64::MAX / 2] {
        flight.companion(196, curve([0.0, 0.0], [1.0, 0.0], 2.0, stamp));
        enter_mission(&mut flight);
        flight.run(1.5);
        assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    }
}

/// With the companion's clock known to the autopilot: 7000 s ahead of its own.
fn synchronised() -> (Flight, i64) {
    const AHEAD_US: i64 = 7_000_000_000;
    let mut flight = ready(Variant::A);
    flight.clock_ahead_us = Some(AHEAD_US);
    flight.answer = Answer::Stream(0.1);
    flight.run(51.0);
    assert!(flight.autopilot.timesync_converged(Link::Companion));
    flight.answer = Answer::Silent;
    (flight, AHEAD_US)
}

/// Curves of 1 s at 20 Hz for `seconds`, stamped `offset_s` from the companion's present; back at the mode at the end.
fn stamped(flight: &mut Flight, ahead_us: i64, offset_s: f64, seconds: f64) -> Option<f64> {
    flight.companion(196, no_waypoint());
    let position = flight.autopilot.truth().position;
    let from_s = flight.now_s();
    enter_mission(flight);
    while flight.now_s() - from_s < seconds {
        let stamp_us = (flight.now_s() * 1e6) as i64 + ahead_us + (offset_s * 1e6) as i64;
        let here = [position.x_m, position.y_m];
        flight.companion(196, curve(here, here, 1.0, stamp_us as u64));
        flight.run(0.05);
        if flight.autopilot.mode() == NavMode::Hold {
            return Some(flight.now_s() - from_s);
        }
    }
    None
}

#[test]
fn after_500_answers_the_companions_clock_counts() {
    let (mut flight, ahead_us) = synchronised();
    assert_eq!(stamped(&mut flight, ahead_us, 0.0, 3.0), None, "now");
    flight.set_mode(NavMode::Hold);
    flight.run(0.5);
    assert_eq!(
        stamped(&mut flight, ahead_us, -0.5, 3.0),
        None,
        "half a second ago"
    );
    flight.set_mode(NavMode::Hold);
    flight.run(0.5);
    // The empty waypoints message keeps the mission's own setpoint flying for half a second, then it is Hold.
    let fallen_s = stamped(&mut flight, ahead_us, 0.5, 3.0).expect("Hold");
    assert!((0.5..=0.7).contains(&fallen_s), "{fallen_s}");
    assert_eq!(flight.autopilot.holds()[0].cause, HoldCause::CurveInFuture);
    // Stamps of zero and of the autopilot's own clock lie long before boot.
    for ahead_us in [-(flight.now_s() * 1e6) as i64, 0] {
        flight.run(2.0);
        let fallen_s = stamped(&mut flight, ahead_us, 0.0, 3.0).expect("Hold");
        assert!((0.5..=0.7).contains(&fallen_s), "{fallen_s}");
    }
}

#[test]
fn hole_2_an_expired_curve_with_fresh_empty_waypoints_flies_the_unchecked_mission() {
    for variant in [Variant::A, Variant::B] {
        let mut flight = ready(variant);
        flight.companion(196, no_waypoint());
        flight.companion(196, curve([0.0, 0.0], [0.0, 0.0], 0.5, 0));
        enter_mission(&mut flight);
        for _ in 0..60 {
            flight.companion(196, no_waypoint());
            flight.run(0.1);
        }
        assert_eq!(flight.autopilot.mode(), NavMode::Mission, "{variant:?}");
        assert!(
            flight.autopilot.truth().position.x_m > 10.0,
            "nobody checked this way"
        );
        assert_eq!(flight.autopilot.hold_count(), 0);
    }
}
