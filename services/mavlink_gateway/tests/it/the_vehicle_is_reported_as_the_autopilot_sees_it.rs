//! From the autopilot's messages to `vehicle/state` and `vehicle/desired_path`.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

use crate::support::*;
use jink_shared_types::vehicle::{
    COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF, NavMode, VehicleState,
};
use mavlink::dialect::*;
use nalgebra::Vector3;
use proptest::prelude::*;

fn newest(bench: &Bench) -> VehicleState {
    bench.states.last().expect("a state was published").0
}

fn receive_all(bench: &mut Bench) {
    bench.receive_heartbeat(MODE_HOLD, true);
    bench.receive_position(Vector3::new(1.0, 2.0, -3.0), Vector3::new(2.0, 0.0, 0.0));
    bench.receive_attitude(0.5);
}

#[test]
fn every_attitude_gives_one_state_with_the_position_carried_to_its_time() {
    let mut bench = Bench::new();
    let velocity = Vector3::new(3.0, -1.0, 0.5);
    bench.fly(2.0, |bench, t| {
        let tick = (t * 100.0).round() as u32;
        if tick.is_multiple_of(3) {
            bench.receive_position(velocity * t, velocity);
        }
        if tick.is_multiple_of(2) {
            bench.receive_attitude(0.5);
        }
    });
    assert_eq!(bench.states.len(), 100);
    for (state, capture) in &bench.states[1..] {
        let expected = velocity * capture.seconds_since(at(0.0));
        assert!((state.position.vector() - expected).norm() < 1e-3, "{state:?}");
        assert_eq!(state.velocity.vector(), velocity);
        assert!((state.attitude.yaw_rad() - 0.5).abs() < 1e-6);
        let propagated_s = capture.seconds_since(state.position_time);
        assert!((-1e-9..0.03 + 1e-9).contains(&propagated_s), "{propagated_s} s");
        assert!(state.position_valid.is_set() && state.autopilot_alive.is_set());
        assert_eq!(state.system_id, SYSTEM);
    }
    assert!(bench.states.windows(2).all(|pair| pair[0].1 < pair[1].1));
}

#[test]
fn slow_messages_fill_in_the_rest() {
    let mut bench = Bench::new();
    receive_all(&mut bench);
    bench.step();
    let state = newest(&bench);
    assert!(state.home_down_m.is_nan() && state.ground_distance_m.is_nan() && !state.landed.is_set());
    assert_eq!(state.mode, NavMode::Hold);
    bench.receive(MavMessage::HOME_POSITION(HOME_POSITION_DATA {
        z: 0.75,
        ..HOME_POSITION_DATA::default()
    }));
    bench.receive(MavMessage::ALTITUDE(ALTITUDE_DATA {
        bottom_clearance: 4.5,
        ..ALTITUDE_DATA::default()
    }));
    bench.receive(MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
        landed_state: MavLandedState::MAV_LANDED_STATE_ON_GROUND,
        ..EXTENDED_SYS_STATE_DATA::default()
    }));
    receive_all(&mut bench);
    bench.step();
    let state = newest(&bench);
    assert_eq!((state.home_down_m, state.ground_distance_m), (0.75, 4.5));
    assert!(state.landed.is_set() && state.armed.is_set());
    for unknown in [f32::NAN, -1.0] {
        bench.receive(MavMessage::ALTITUDE(ALTITUDE_DATA {
            bottom_clearance: unknown,
            ..ALTITUDE_DATA::default()
        }));
        receive_all(&mut bench);
        bench.step();
        assert!(newest(&bench).ground_distance_m.is_nan());
    }
}

#[test]
fn an_old_ground_distance_is_not_reported() {
    let mut bench = Bench::new();
    bench.receive(MavMessage::ALTITUDE(ALTITUDE_DATA {
        bottom_clearance: 4.5,
        ..ALTITUDE_DATA::default()
    }));
    bench.fly(2.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, Vector3::zeros(), Vector3::zeros());
    });
    assert!(newest(&bench).ground_distance_m.is_nan());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_jump_that_the_velocity_does_not_explain_counts_as_a_reset(
        velocity in -8.0..8.0f64, acceleration in -6.0..6.0f64, jump in prop_oneof![Just(0.0), 0.6..20.0f64, -20.0..-0.6f64],
        lost in 0u32..20,
    ) {
        let mut bench = Bench::new();
        let state = |t: f64| (velocity * t + acceleration * t * t / 2.0, velocity + acceleration * t);
        for i in 0..60u32 {
            let t = f64::from(i) / 30.0;
            bench.now = at(t);
            let (x, v) = state(t);
            let jumped = if i >= 30 { jump } else { 0.0 };
            // Some messages are lost, but not those around the jump.
            if !(5..5 + lost).contains(&i) {
                bench.receive_position(Vector3::new(x + jumped, 0.0, 0.0), Vector3::new(v, 0.0, 0.0));
                bench.receive_attitude(0.0);
            }
            bench.step();
        }
        prop_assert_eq!(newest(&bench).estimator_resets, u32::from(jump != 0.0));
    }
}

#[test]
fn nonsense_never_becomes_a_state() {
    let mut bench = Bench::new();
    receive_all(&mut bench);
    bench.step();
    let before = newest(&bench);
    for bad in [f64::NAN, f64::INFINITY, 1e9] {
        bench.now = bench.now.plus_seconds(0.02);
        bench.receive_position(Vector3::new(bad, 0.0, 0.0), Vector3::zeros());
        bench.receive_position(Vector3::zeros(), Vector3::new(0.0, bad, 0.0));
        bench.receive(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms: bench.boot_ms(bench.now),
            q1: bad as f32,
            ..ATTITUDE_QUATERNION_DATA::default()
        }));
        bench.step();
    }
    assert_eq!(bench.states.len(), 1);
    bench.receive_attitude(0.5);
    bench.step();
    assert_eq!(newest(&bench).position_time, before.position_time);
}

#[test]
fn an_old_position_is_no_longer_valid() {
    let mut bench = Bench::new();
    receive_all(&mut bench);
    bench.step();
    assert!(newest(&bench).position_valid.is_set());
    bench.now = at(0.6);
    bench.receive_attitude(0.5);
    bench.step();
    assert!(!newest(&bench).position_valid.is_set());
    let carried_m = newest(&bench).position.x_m - 1.0;
    assert!(carried_m <= 2.0 * 0.5 + 1e-6, "carried on by {carried_m} m");
}

#[test]
fn the_loss_of_the_autopilot_is_reported_once_and_its_return_too() {
    let mut bench = Bench::new();
    receive_all(&mut bench);
    bench.step();
    let reported = bench.states.len();
    bench.idle_until(at(5.0));
    assert_eq!(bench.states.len(), reported + 1);
    let (state, _) = bench.states[reported];
    assert!(!state.autopilot_alive.is_set() && !state.position_valid.is_set());
    assert!(!bench.status.unwrap().autopilot_alive.is_set());
    receive_all(&mut bench);
    bench.step();
    assert!(newest(&bench).autopilot_alive.is_set());
    // A loss is never said late; the return is, so that a loss can be said at once again.
    for second in 6..36 {
        bench.idle_until(at(f64::from(second)));
        receive_all(&mut bench);
        bench.step();
    }
    let lines: Vec<_> = bench
        .sent
        .iter()
        .filter_map(|sent| match &sent.message {
            MavMessage::STATUSTEXT(line) => line.text.to_str().ok(),
            _ => None,
        })
        .collect();
    assert_eq!(
        lines,
        [
            "jink: autopilot connected, system 1",
            "jink: autopilot lost",
            "jink: autopilot connected, system 1"
        ]
    );
}

#[test]
fn a_restarted_autopilot_begins_a_new_clock_and_new_coordinates() {
    let mut bench = Bench::new();
    bench.boot_ms_at_zero = 3_600_000;
    let still = Vector3::zeros();
    let telemetry = |bench: &mut Bench, t: f64| bench.telemetry(t, MODE_HOLD, still, still);
    bench.fly(3.0, telemetry);
    assert_eq!(newest(&bench).estimator_resets, 0);
    bench.boot_ms_at_zero = 0;
    bench.fly(3.0, telemetry);
    let (state, capture) = *bench.states.last().unwrap();
    assert_eq!(state.estimator_resets, 1);
    let age_s = bench.now.seconds_since(capture);
    assert!((0.0..0.03).contains(&age_s), "{age_s} s old");
}

#[test]
fn late_packets_are_left_out() {
    let mut bench = Bench::new();
    receive_all(&mut bench);
    bench.step();
    let reported = bench.states.len();
    bench.boot_ms_at_zero -= 200;
    bench.receive_attitude(2.0);
    bench.receive_position(Vector3::new(50.0, 0.0, 0.0), Vector3::zeros());
    bench.step();
    assert_eq!(bench.states.len(), reported);
}

#[test]
fn time_stamps_are_mapped_through_timesync_once_it_has_converged() {
    let mut bench = Bench::new();
    let mut answered = 0;
    for i in 0..1000u32 {
        bench.idle_until(at(f64::from(i) / 100.0));
        // The attitude was taken 30 ms before it arrives: reception alone cannot know that.
        let time_boot_ms = bench.boot_ms(bench.now.plus_seconds(-0.030));
        bench.receive(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            q1: 1.0,
            ..ATTITUDE_QUATERNION_DATA::default()
        }));
        bench.receive(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms,
            ..LOCAL_POSITION_NED_DATA::default()
        }));
        // The autopilot answers so that its stamp lies in the middle between request and answer.
        let before = bench.sent.partition_point(|sent| sent.time < bench.now);
        let requests: Vec<_> = bench.sent[answered..before]
            .iter()
            .filter_map(|sent| match sent.message {
                MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1, .. }) => Some((sent.time, ts1)),
                _ => None,
            })
            .collect();
        for (asked, ts1) in requests {
            let middle_s = asked.seconds_since(at(0.0)) + 0.5 * bench.now.seconds_since(asked);
            bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: (f64::from(bench.boot_ms_at_zero) * 1e6 + middle_s * 1e9) as i64,
                ts1,
                ..TIMESYNC_DATA::default()
            }));
        }
        answered = before;
        bench.step();
    }
    let status = bench.status.unwrap();
    assert!(status.timesync_converged.is_set());
    // Ten a second until it has converged after twenty, then one: ten seconds in all.
    assert!(
        (26..=30).contains(&status.timesync_samples),
        "{}",
        status.timesync_samples
    );
    assert!(status.round_trip_us <= 10_001, "{}", status.round_trip_us);
    let truth_ns = f64::from(bench.boot_ms_at_zero) * 1e6 - at(0.0).ns as f64;
    assert!((status.clock_offset_ns as f64 - truth_ns).abs() < 1e3);
    let (_, capture) = *bench.states.last().unwrap();
    let age_s = at(9.99).seconds_since(capture);
    assert!((age_s - 0.030).abs() < 1e-3, "{age_s} s");
}

#[test]
fn the_desired_path_keeps_what_was_not_given_as_nan() {
    let mut bench = Bench::new();
    bench.receive_heartbeat(MODE_MISSION, true);
    let points = [1.0, 2.0, 3.0].map(|x| (Vector3::new(x, 0.0, -5.0), COMMAND_NONE));
    bench.receive(wish(points));
    bench.step();
    let (path, _) = bench.paths[0];
    assert_eq!(path.mode, NavMode::Mission);
    assert!(path.wants_planning() && path.mission_speed_mps.is_nan());
    for (i, point) in path.points.iter().enumerate() {
        assert_eq!(point.position.x_m, i as f64 + 1.0);
        assert!(point.velocity.x_mps.is_nan() && point.velocity.z_mps.is_nan());
        assert!(point.valid.is_set() && point.command == COMMAND_NONE);
        assert_eq!(point.yaw_rad.is_nan(), i != 1);
    }
    assert_eq!(bench.status.unwrap().desired_paths, 1);
}

#[test]
fn a_landing_has_no_goal_far_below_the_ground() {
    let mut bench = Bench::new();
    bench.receive_heartbeat(MODE_LAND, true);
    let below = Vector3::new(1.0, 2.0, 488.0);
    let mut data = waypoints([(below, COMMAND_LAND); 3]);
    data.pos_z[0] = f32::NAN;
    data.vel_z[0] = 1.0;
    bench.receive(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(data));
    bench.step();
    let (path, _) = bench.paths[0];
    assert!(path.points.iter().all(|point| point.position.z_m.is_nan()));
    assert_eq!(path.points[0].velocity.z_mps, 1.0);
    assert_eq!(path.points[1].position.x_m, 1.0);
    assert!(!path.wants_planning());
}

#[test]
fn a_mode_is_known_before_the_heartbeat() {
    for (heartbeat, command, mode) in [
        (MODE_HOLD, COMMAND_NONE, NavMode::Mission),
        (MODE_HOLD, COMMAND_TAKEOFF, NavMode::Takeoff),
        (MODE_HOLD, COMMAND_LAND, NavMode::Land),
        (MODE_TAKEOFF, COMMAND_LOITER, NavMode::Hold),
        (MODE_POSITION, COMMAND_LOITER, NavMode::Hold),
        (MODE_MISSION, COMMAND_LOITER, NavMode::Mission),
    ] {
        let mut bench = Bench::new();
        bench.receive_heartbeat(heartbeat, true);
        bench.receive(wish([(Vector3::new(9.0, 0.0, -5.0), command); 3]));
        bench.receive_position(Vector3::zeros(), Vector3::zeros());
        bench.receive_attitude(0.0);
        bench.step();
        assert_eq!(bench.paths[0].0.mode, mode);
        assert_eq!(newest(&bench).mode, mode);
        // The heartbeat has the last word.
        bench.receive_heartbeat(heartbeat, true);
        bench.receive_attitude(0.0);
        bench.step();
        assert_eq!(newest(&bench).mode, jink_mode(heartbeat));
    }
}

/// PX4 reports a circle five times a second while it flies it, and its mode once a second.
#[test]
fn a_circle_is_known_by_its_report_and_a_late_report_does_not_bring_it_back() {
    let mut bench = Bench::new();
    let mode = |bench: &mut Bench, message: MavMessage| {
        bench.receive(message);
        bench.receive_position(Vector3::zeros(), Vector3::zeros());
        bench.receive_attitude(0.0);
        bench.step();
        newest(bench).mode
    };
    let report = || MavMessage::ORBIT_EXECUTION_STATUS(ORBIT_EXECUTION_STATUS_DATA::default());
    let hold = || heartbeat(MODE_HOLD, true);
    assert_eq!(mode(&mut bench, hold()), NavMode::Hold);
    assert_eq!(mode(&mut bench, report()), NavMode::Orbit);
    assert_eq!(
        mode(&mut bench, hold()),
        NavMode::Hold,
        "the heartbeat has the last word"
    );
    bench.idle_until(at(0.2));
    assert_eq!(mode(&mut bench, report()), NavMode::Hold, "it was on its way");
    bench.idle_until(at(1.0));
    assert_eq!(mode(&mut bench, report()), NavMode::Orbit);
}

fn jink_mode(custom_mode: u32) -> NavMode {
    match custom_mode {
        MODE_HOLD => NavMode::Hold,
        MODE_TAKEOFF => NavMode::Takeoff,
        MODE_POSITION => NavMode::Position,
        _ => NavMode::Mission,
    }
}
