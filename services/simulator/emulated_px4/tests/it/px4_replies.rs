//! What PX4 makes of a companion's waypoints, and of their absence. Every rule was observed on a real PX4.

#![allow(deprecated)]

use crate::support::{Answer, cruising, north_east, reply, speed, waypoint};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

const UNSET: [f32; 3] = [f32::NAN; 3];
const NO_YAW: [f32; 2] = [f32::NAN; 2];

#[test]
fn a_mirrored_mission_is_flown_like_one_without_companion() {
    let mut flight = cruising();
    flight.run(8.0);
    assert!((4.6..=5.05).contains(&speed(&flight)), "{}", speed(&flight));
    assert!(flight.autopilot.truth().position.y_m.abs() < 0.1);
    assert_eq!(flight.autopilot.hold_count(), 0);
}

#[test]
fn sender_and_time_stamp_are_not_checked() {
    for (system, component, link) in [
        (1, 191, Link::Companion),
        (2, 196, Link::Companion),
        (255, 190, Link::GroundStation),
    ] {
        let mut flight = cruising();
        flight.answer = Answer::Silent;
        for _ in 0..60 {
            let mut message = waypoint([0.0, 20.0, -5.0], UNSET, NO_YAW);
            if let MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(m) = &mut message {
                m.time_usec = 0xdead_beef;
            }
            flight.from(link, system, component, message);
            flight.run(0.1);
        }
        assert_eq!(flight.autopilot.mode(), NavMode::Mission, "{system}/{component}");
        assert!(north_east(&flight).1 > 8.0);
    }
}

#[test]
fn position_velocity_and_every_mixture_of_them_is_flown() {
    let mut flight = cruising();
    reply(&mut flight, 10.0, |_| waypoint([10.0, 10.0, -5.0], UNSET, NO_YAW));
    let (north, east) = north_east(&flight);
    assert!(
        (north - 10.0).abs() < 0.5 && (east - 10.0).abs() < 0.5,
        "position: {north} {east}"
    );

    let mut flight = cruising();
    reply(&mut flight, 6.0, |_| waypoint(UNSET, [1.0, -1.0, 0.0], NO_YAW));
    let velocity = flight.autopilot.truth().velocity;
    assert!(
        (velocity.x_mps - 1.0).abs() < 0.1 && (velocity.y_mps + 1.0).abs() < 0.1,
        "velocity: {velocity:?}"
    );

    let mut flight = cruising();
    reply(&mut flight, 6.0, |_| {
        waypoint([f32::NAN, f32::NAN, -8.0], [0.0, 2.0, f32::NAN], NO_YAW)
    });
    let truth = flight.autopilot.truth();
    assert!(
        (truth.velocity.y_mps - 2.0).abs() < 0.15,
        "height and level velocity: {truth:?}"
    );
    assert!((truth.position.z_m + 8.0).abs() < 0.3);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
}

#[test]
fn a_velocity_given_with_a_position_is_added_to_the_approach() {
    let chase = |ahead: f32, velocity: f32| {
        let mut flight = cruising();
        let start = north_east(&flight).0 as f32;
        let mut t = 0.0;
        reply(&mut flight, 8.0, |_| {
            t += 0.1;
            waypoint([start + 2.0 * t + ahead, 0.0, -5.0], [velocity, 0.0, 0.0], NO_YAW)
        });
        f64::from(start + 2.0 * t) - north_east(&flight).0
    };
    assert!(chase(0.0, 2.0).abs() < 0.6, "with velocity it keeps up");
    assert!(
        chase(0.0, f32::NAN) > 1.5,
        "without, the distance is the speed command"
    );
}

#[test]
fn heading_is_held_if_given_turned_if_a_rate_and_along_the_motion_otherwise() {
    let mut flight = cruising();
    reply(&mut flight, 6.0, |_| {
        waypoint([60.0, 0.0, -5.0], UNSET, [1.2, f32::NAN])
    });
    assert!((flight.autopilot.truth().attitude.yaw_rad() - 1.2).abs() < 0.05);

    let mut flight = cruising();
    reply(&mut flight, 6.0, |_| waypoint(UNSET, [0.0, 2.0, 0.0], NO_YAW));
    assert!((flight.autopilot.truth().attitude.yaw_rad() - std::f64::consts::FRAC_PI_2).abs() < 0.1);

    let mut flight = cruising();
    reply(&mut flight, 2.0, |_| waypoint(UNSET, [0.0; 3], [f32::NAN, 0.5]));
    let before = flight.autopilot.truth().attitude.yaw_rad();
    reply(&mut flight, 2.0, |_| waypoint(UNSET, [0.0; 3], [f32::NAN, 0.5]));
    let turned = flight.autopilot.truth().attitude.yaw_rad() - before;
    assert!((turned - 1.0).abs() < 0.1, "{turned}");
}

#[test]
fn speed_is_clipped_to_cruise() {
    let mut flight = cruising();
    let mut setpoint_max: f32 = 0.0;
    let mut peak: f64 = 0.0;
    flight.answer = Answer::Silent;
    for _ in 0..120 {
        flight.companion(196, waypoint(UNSET, [8.0, 0.0, 0.0], NO_YAW));
        for _ in 0..25 {
            flight.step();
            for packet in &flight.received {
                if let MavMessage::POSITION_TARGET_LOCAL_NED(target) = &packet.message {
                    setpoint_max = setpoint_max.max(target.vx.hypot(target.vy));
                }
            }
            peak = peak.max(speed(&flight));
        }
    }
    assert!((setpoint_max - 5.0).abs() < 0.01, "{setpoint_max}");
    assert!((4.9..6.0).contains(&peak), "{peak}");
    assert!((speed(&flight) - 5.0).abs() < 0.15);
}

#[test]
fn velocity_zero_stops_within_two_seconds_and_falls_back_a_little() {
    let mut flight = cruising();
    flight.run(8.0);
    assert!(speed(&flight) > 4.6);
    reply(&mut flight, 2.0, |_| waypoint(UNSET, [0.0; 3], NO_YAW));
    assert!(speed(&flight) < 1.2, "{}", speed(&flight));
    let mut furthest = north_east(&flight).0;
    reply(&mut flight, 5.0, |f| {
        furthest = furthest.max(north_east(f).0);
        waypoint(UNSET, [0.0; 3], NO_YAW)
    });
    let fall_back = furthest - north_east(&flight).0;
    assert!((0.05..1.0).contains(&fall_back), "{fall_back}");
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
}

#[test]
fn the_worst_reply_nothing_but_nan_is_accepted_and_the_vehicle_sinks() {
    let mut flight = cruising();
    flight.run(6.0);
    let before = flight.autopilot.truth().position.z_m;
    reply(&mut flight, 4.0, |_| waypoint(UNSET, UNSET, NO_YAW));
    let truth = *flight.autopilot.truth();
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    assert_eq!(flight.autopilot.hold_count(), 0);
    assert!(
        (0.2..0.8).contains(&truth.velocity.z_mps),
        "sinking and growing: {}",
        truth.velocity.z_mps
    );
    assert!(truth.position.z_m > before + 0.3);
    assert!(speed(&flight) > 1.0, "nobody stops it");
}

#[test]
fn an_axis_without_position_and_velocity_goes_to_the_controller_raw() {
    let mut flight = cruising();
    reply(&mut flight, 3.0, |_| {
        waypoint(UNSET, [1.0, 1.0, f32::NAN], NO_YAW)
    });
    let mut target = None;
    flight.run_until(0.3, |f| {
        target = f.received.iter().find_map(|p| match &p.message {
            MavMessage::POSITION_TARGET_LOCAL_NED(t) => Some(t.clone()),
            _ => None,
        });
        target.is_some()
    });
    assert!(target.expect("a target").x.is_nan());
    let velocity = flight.autopilot.truth().velocity;
    assert!((velocity.x_mps - 1.0).abs() < 0.7 && (velocity.y_mps - 1.0).abs() < 0.7);
    assert!(velocity.z_mps > 0.05, "it sinks");
}
