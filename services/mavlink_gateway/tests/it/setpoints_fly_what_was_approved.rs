//! What is flown, and what never is, in every situation of the table in `profile/pilot.rs`.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

use crate::support::*;
use jink_mavlink_gateway::GatewayConfig;
use jink_shared_types::motion::{Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::vehicle::{COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF};
use jink_shared_types::{Coded, Stage};
use mavlink::dialect::*;
use nalgebra::Vector3;

const HERE: Vector3<f64> = Vector3::new(4.0, -2.0, -3.0);
const FAR: Vector3<f64> = Vector3::new(40.0, 0.0, -5.0);

fn still() -> Vector3<f64> {
    Vector3::zeros()
}

/// A bench whose vehicle has stood at `HERE` in `custom_mode` for a while, with the autopilot's wish given.
fn in_mode(custom_mode: u32, wanted: Option<MavMessage>) -> Bench {
    let mut bench = Bench::new();
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, custom_mode, HERE, still());
        if ((t * 100.0).round() as u32).is_multiple_of(20)
            && let Some(wanted) = &wanted
        {
            bench.receive(wanted.clone());
        }
        bench.approve(Verdict::Passed, mirror());
    });
    bench
}

fn assert_constant_at(bench: &Bench, place: Vector3<f64>, tolerance_m: f64) {
    let curve = bench.last_curve();
    for point in control_points(&curve) {
        assert!(
            (point - place).norm() < tolerance_m,
            "{point:?} instead of {place:?}"
        );
    }
}

fn path_to(target: Vector3<f64>, command: u16) -> MavMessage {
    wish([(target, command); 3])
}

#[test]
fn every_setpoint_keeps_the_rules_of_its_fields() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    bench.approve(
        Verdict::Passed,
        flight(7, bench.now, HERE, Vector3::new(5.0, 0.0, 0.0), 4.0),
    );
    bench.fly(2.0, |bench, t| {
        bench.telemetry(t, MODE_MISSION, HERE, still());
        bench.approved.as_mut().unwrap().header.publish = bench.now;
    });
    let curves = bench.curves();
    assert!(curves.len() > 55, "{}", curves.len());
    for (time, curve) in curves {
        assert_eq!(curve.valid_points, 5);
        assert_eq!(curve.delta[..4], [0.0; 4]);
        assert!(
            (0.3..=0.8 + 1e-6).contains(&f64::from(curve.delta[4])),
            "{:?}",
            curve.delta
        );
        let points = control_points(&curve);
        assert!(points.iter().all(|p| p.iter().all(|c| c.is_finite())));
        assert!(curve.pos_yaw.iter().all(|yaw| yaw.is_finite()));
        let age_us = time.ns / 1000 - curve.time_usec;
        assert!((9_400..=11_000).contains(&age_us), "back-dated by {age_us} us");
    }
}

#[test]
fn before_the_first_curve_an_old_waypoint_is_taken_back_and_none_is_ever_sent() {
    for mode in [MODE_TAKEOFF, MODE_HOLD, MODE_LAND, MODE_MISSION, MODE_POSITION] {
        let bench = in_mode(mode, Some(path_to(FAR, COMMAND_LOITER)));
        let setpoints = bench.sent.iter().filter(|sent| is_setpoint(&sent.message));
        let setpoints: Vec<_> = setpoints.map(|sent| &sent.message).collect();
        let MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(first) = setpoints[0] else {
            panic!("{:?}", setpoints[0]);
        };
        assert_eq!(first.valid_points, 0);
        assert!(first.pos_x.iter().all(|x| x.is_nan()));
        let curve =
            |message: &&MavMessage| matches!(message, MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_));
        assert!(setpoints.len() > 1 && setpoints[1..].iter().all(curve));
    }
}

#[test]
fn a_restarted_autopilot_is_sent_again_that_no_old_waypoint_counts() {
    let mut bench = Bench::new();
    bench.boot_ms_at_zero = 3_600_000;
    let telemetry = |bench: &mut Bench, t: f64| bench.telemetry(t, MODE_HOLD, HERE, still());
    bench.fly(2.0, telemetry);
    let restart = bench.now;
    bench.boot_ms_at_zero = 0;
    bench.fly(2.0, telemetry);
    let firsts = [at(0.0), restart].map(|since| {
        let later = bench.sent.iter().filter(|sent| sent.time > since);
        later
            .map(|sent| &sent.message)
            .find(|message| is_setpoint(message))
            .unwrap()
            .clone()
    });
    for first in firsts {
        let MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(first) = first else {
            panic!("{first:?}");
        };
        assert_eq!(first.valid_points, 0);
    }
}

fn is_setpoint(message: &MavMessage) -> bool {
    matches!(
        message,
        MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(_) | MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_)
    )
}

#[test]
fn setpoints_come_unasked_disarmed_and_in_every_mode() {
    for mode in [MODE_POSITION, MODE_HOLD, 0, 1 << 16, 6 << 16] {
        let mut bench = Bench::new();
        bench.fly(2.0, |bench, t| {
            let tick = (t * 100.0).round() as u32;
            if tick.is_multiple_of(100) {
                bench.receive_heartbeat(mode, false);
            }
            if tick.is_multiple_of(3) {
                bench.receive_position(HERE, still());
            }
        });
        assert!(
            bench.curves().len() >= 36,
            "{} in mode {mode:#x}",
            bench.curves().len()
        );
        assert_constant_at(&bench, HERE, 1e-5);
    }
}

#[test]
fn an_approved_trajectory_is_followed_within_two_centimetres_and_held_at_its_end() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    let way = Vector3::new(8.0, 3.0, -1.0);
    let plan = flight(7, bench.now, HERE, way, 4.0);
    bench.approve(Verdict::Passed, plan);
    bench.fly(6.0, |bench, t| {
        let there = plan.at(bench.now).unwrap();
        bench.telemetry(t, MODE_MISSION, there.position.vector(), there.velocity.vector());
        bench.approved.as_mut().unwrap().header.publish = bench.now;
        if let Some((_, curve)) = bench.curves().pop()
            && t > 0.1
        {
            let error_m = (evaluate(&curve, bench.now).unwrap() - there.position.vector()).norm();
            assert!(error_m < 0.022, "{error_m} m at {t} s");
        }
    });
    assert_constant_at(&bench, HERE + way, 1e-5);
    assert_eq!(bench.last_curve().pos_yaw, [0.3; 5]);
}

#[test]
fn a_new_trajectory_does_not_wait_for_the_beat_and_its_latency_is_counted() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    let mut arrivals = Vec::new();
    for i in 0..30u64 {
        bench.idle_until(bench.now.plus_seconds(0.033));
        let way = Vector3::new(5.0, 0.0, 0.0);
        bench.approve(Verdict::Passed, flight(100 + i, bench.now, HERE, way, 4.0));
        let header = &mut bench.approved.as_mut().unwrap().header;
        header.capture = bench.now.plus_seconds(-0.012);
        header.publish = bench.now.plus_seconds(-0.001);
        header.stages[Stage::Guard as usize].end = header.publish;
        arrivals.push((bench.now, bench.curves().len()));
        bench.step();
    }
    for (time, before) in &arrivals {
        let (sent, _) = bench.curves()[*before];
        assert!(
            sent.seconds_since(*time) < 0.001,
            "waited {} s",
            sent.seconds_since(*time)
        );
    }
    bench.idle_until(bench.now.plus_seconds(0.3));
    let status = bench.status.unwrap();
    let gateway = &status.stages[Stage::Gateway as usize];
    assert_eq!(gateway.count, 30);
    assert_eq!((gateway.max_us, status.capture_to_wire.max_us), (1000, 12_000));
}

#[test]
fn trajectories_at_the_rates_of_lidars_never_meet_a_setpoint_just_sent() {
    // 5, 10, 20 and 30 Hz; the stream's period is 50 ms. Each comes up to 2 ms sooner or later than the rate says.
    for period_s in [0.2, 0.1, 0.05, 1.0 / 30.0] {
        let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
        let begin = bench.now;
        for i in 1..40u64 {
            let off_s = 0.001 * (i * 7 % 5) as f64 - 0.002;
            bench.idle_until(begin.plus_seconds(i as f64 * period_s + off_s));
            let plan = flight(100 + i, bench.now, HERE, Vector3::new(5.0, 0.0, 0.0), 4.0);
            bench.approve(Verdict::Passed, plan);
            let (arrived, before) = (bench.now, bench.curves().len());
            bench.step();
            bench.idle_until(bench.now.plus_seconds(0.003));
            let (sent, _) = bench.curves()[before];
            // The first meets a stream that nothing new has set off yet.
            assert!(
                i == 1 || sent.seconds_since(arrived) < 1e-4,
                "{i} of every {period_s} s waited {} s",
                sent.seconds_since(arrived)
            );
        }
    }
}

#[test]
fn trajectories_that_come_in_a_hurry_do_not_flood_the_link() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    let before = bench.curves().len();
    for i in 0..1000u64 {
        bench.idle_until(bench.now.plus_seconds(0.001));
        bench.approve(
            Verdict::Passed,
            flight(100 + i, bench.now, HERE, Vector3::new(5.0, 0.0, 0.0), 4.0),
        );
        bench.step();
    }
    let all = bench.curves();
    let since_beat_s = all[before].0.seconds_since(all[before - 1].0);
    assert!(since_beat_s > 0.0024, "{since_beat_s} s behind the beat");
    let curves = &all[before..];
    assert!(curves.len() <= 101, "{} setpoints in a second", curves.len());
    for pair in curves.windows(2) {
        assert!(pair[1].0.seconds_since(pair[0].0) > 0.0099);
    }
}

#[test]
fn a_takeoff_is_mirrored_as_curves_that_stand_on_the_target() {
    let target = HERE + Vector3::new(0.0, 0.0, -2.5);
    let bench = in_mode(MODE_TAKEOFF, Some(path_to(target, COMMAND_TAKEOFF)));
    assert_constant_at(&bench, target, 1e-5);
    assert_eq!(
        bench.last_curve().pos_yaw,
        [1.0; 5],
        "the heading of point 1 was not taken"
    );
}

#[test]
fn without_a_wanted_heading_the_present_one_is_kept_and_drift_is_not_chased() {
    let mut data = waypoints([(HERE, COMMAND_LOITER); 3]);
    data.pos_yaw = [f32::NAN; 5];
    let wanted = MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(data);
    let mut bench = in_mode(MODE_HOLD, Some(wanted));
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, HERE, still());
        bench.receive_attitude(0.3 + t);
    });
    for yaw in bench.last_curve().pos_yaw {
        assert!((yaw - 0.3).abs() < 1e-5, "{yaw}");
    }
}

#[test]
fn a_landing_descends_at_exactly_the_wanted_speed_from_where_the_vehicle_is() {
    let mut data = waypoints([(Vector3::new(4.2, -2.2, 488.0), COMMAND_LAND); 3]);
    data.pos_z[0] = f32::NAN;
    data.vel_z[0] = 0.7;
    let mut bench = in_mode(
        MODE_LAND,
        Some(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(data)),
    );
    let down = Vector3::new(0.0, 0.0, 0.7);
    bench.fly(2.0, |bench, t| {
        bench.telemetry(t, MODE_LAND, HERE + down * t, down);
    });
    let curve = bench.last_curve();
    let points = control_points(&curve);
    let step_m = 0.7 * f64::from(curve.delta[4]) / 4.0;
    for pair in points.windows(2) {
        assert!((pair[1].z - pair[0].z - step_m).abs() < 1e-5);
        assert_eq!((pair[0].x, pair[0].y), (pair[1].x, pair[1].y));
    }
    assert!((points[0].x - 4.2).abs() < 1e-6 && (points[0].y + 2.2).abs() < 1e-6);
    let (sent, _) = *bench.curves().last().unwrap();
    let there_m = HERE.z + 0.7 * (2.0 - bench.now.seconds_since(sent));
    assert!((evaluate(&curve, sent).unwrap().z - there_m).abs() < 1e-4);
}

#[test]
fn a_landing_that_has_met_the_ground_presses_on_until_the_autopilot_has_noticed() {
    let mut data = waypoints([(HERE, COMMAND_LAND); 3]);
    data.pos_z[0] = f32::NAN;
    data.vel_z[0] = 0.7;
    let mut bench = in_mode(
        MODE_LAND,
        Some(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(data)),
    );
    bench.fly(4.0, |bench, t| bench.telemetry(t, MODE_LAND, HERE, still()));
    let lowest = control_points(&bench.last_curve())[0].z - HERE.z;
    assert!(lowest > 1.5, "{lowest} m below the vehicle");
}

#[test]
fn between_mode_entry_and_the_first_plan_the_raw_waypoint_is_never_flown() {
    // The heartbeat still says hold, or says mission already; approved says mirror, nothing, or is stale.
    for heartbeat in [MODE_HOLD, MODE_MISSION, MODE_POSITION] {
        for approval in 0..3 {
            let mut bench = in_mode(MODE_HOLD, Some(path_to(HERE, COMMAND_LOITER)));
            let entered = bench.now;
            bench.fly(1.0, |bench, t| {
                bench.telemetry(t, heartbeat, HERE, still());
                if ((t * 100.0).round() as u32).is_multiple_of(20) {
                    bench.receive(path_to(FAR, COMMAND_NONE));
                }
                match approval {
                    0 => bench.approve(Verdict::Passed, mirror()),
                    1 => bench.approve(Verdict::Hold, Trajectory::default()),
                    _ => {}
                }
            });
            for (_, curve) in bench.curves().iter().filter(|(time, _)| *time > entered) {
                for point in control_points(curve) {
                    assert!((point - HERE).norm() < 0.01, "{point:?}");
                }
            }
            bench.approve(Verdict::Passed, flight(3, bench.now, HERE, FAR - HERE, 20.0));
            bench.receive_heartbeat(MODE_MISSION, true);
            bench.receive(path_to(FAR, COMMAND_NONE));
            bench.step();
            bench.idle_until(bench.now.plus_seconds(0.1));
            let ahead = control_points(&bench.last_curve())[4] - HERE;
            assert!(ahead.norm() > 0.01, "the plan is not flown");
        }
    }
}

#[test]
fn a_mission_is_entered_at_the_last_target_if_that_is_near_else_where_the_vehicle_is() {
    for (target, expected) in [
        (
            HERE + Vector3::new(0.4, 0.0, 0.0),
            HERE + Vector3::new(0.4, 0.0, 0.0),
        ),
        (HERE + Vector3::new(0.0, 0.0, -30.0), HERE),
    ] {
        let mut bench = in_mode(MODE_TAKEOFF, Some(path_to(target, COMMAND_TAKEOFF)));
        assert_constant_at(&bench, target, 1e-5);
        bench.receive_heartbeat(MODE_MISSION, true);
        bench.receive(path_to(FAR, COMMAND_NONE));
        bench.step();
        bench.idle_until(bench.now.plus_seconds(0.12));
        assert_constant_at(&bench, expected, 1e-5);
    }
}

#[test]
fn when_guard_and_planner_die_the_last_trajectory_is_flown_to_its_end_and_held_there() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    let way = Vector3::new(6.0, 0.0, 0.0);
    let plan = flight(7, bench.now, HERE, way, 4.0);
    bench.approve(Verdict::Passed, plan);
    // Nothing is published after this.
    bench.fly(6.0, |bench, t| {
        let there = plan.at(bench.now).unwrap();
        bench.telemetry(t, MODE_MISSION, there.position.vector(), there.velocity.vector());
        if ((t * 100.0).round() as u32).is_multiple_of(20) {
            bench.receive(path_to(FAR, COMMAND_NONE));
        }
        if t > 0.1 {
            let (_, curve) = bench.curves().pop().unwrap();
            let error_m = (evaluate(&curve, bench.now).unwrap() - there.position.vector()).norm();
            assert!(error_m < 0.022, "{error_m} m at {t} s");
        }
    });
    assert_constant_at(&bench, HERE + way, 1e-5);
}

#[test]
fn a_brake_replaces_the_plan_at_once_and_a_guard_without_anything_changes_nothing() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    let plan = flight(7, bench.now, HERE, Vector3::new(6.0, 0.0, 0.0), 4.0);
    bench.approve(Verdict::Passed, plan);
    bench.step();
    bench.approve(Verdict::Hold, Trajectory::default());
    bench.idle_until(bench.now.plus_seconds(1.0));
    let on_the_way = evaluate(&bench.last_curve(), bench.now).unwrap();
    assert!((on_the_way - plan.at(bench.now).unwrap().position.vector()).norm() < 0.022);
    let mut brake = flight(8, bench.now, on_the_way, Vector3::new(0.5, 0.0, 0.0), 1.0);
    brake.mode = Coded::new(TrajectoryMode::Brake);
    bench.approve(Verdict::Braked, brake);
    bench.step();
    bench.idle_until(bench.now.plus_seconds(2.0));
    assert_constant_at(&bench, on_the_way + Vector3::new(0.5, 0.0, 0.0), 1e-3);
}

#[test]
fn a_trajectory_of_a_flight_that_is_over_is_never_begun() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    let old = flight(7, bench.now, HERE, Vector3::new(6.0, 0.0, 0.0), 4.0);
    bench.approve(Verdict::Passed, old);
    bench.step();
    let elsewhere = HERE + Vector3::new(-50.0, 0.0, 0.0);
    let renew = |bench: &mut Bench| bench.approved.as_mut().unwrap().header.publish = bench.now;
    bench.fly(5.0, |bench, t| {
        bench.telemetry(t, MODE_POSITION, elsewhere, still());
        renew(bench);
    });
    let entered = bench.now;
    bench.fly(2.0, |bench, t| {
        bench.telemetry(t, MODE_MISSION, elsewhere, still());
        bench.receive(path_to(FAR, COMMAND_NONE));
        renew(bench);
    });
    for (_, curve) in bench.curves().iter().filter(|(time, _)| *time >= entered) {
        assert!((control_points(curve)[4] - elsewhere).norm() < 1e-3);
    }
}

#[test]
fn while_the_pilot_flies_the_streamed_point_stays_within_half_a_metre_of_the_vehicle() {
    let mut bench = Bench::new();
    let place = |t: f64| Vector3::new(3.0 * t, 0.2 * (9.0 * t).sin(), -2.0);
    bench.fly(4.0, |bench, t| {
        bench.telemetry(t, MODE_POSITION, place(t), Vector3::new(3.0, 0.0, 0.0));
    });
    for (time, curve) in bench.curves().iter().skip(2) {
        let points = control_points(curve);
        let t = time.seconds_since(at(0.0));
        assert!((points[0] - place(t)).norm() < 0.65, "{:?} at {t}", points[0]);
        assert_eq!(points, [points[0]; 5]);
    }
    // Drift within the half metre is not chased.
    let distinct = bench
        .curves()
        .windows(2)
        .filter(|pair| pair[0].1.pos_x[0] != pair[1].1.pos_x[0])
        .count();
    assert!((10..40).contains(&distinct), "{distinct}");
}

#[test]
fn with_a_position_and_nothing_else_the_first_place_is_held() {
    let mut bench = Bench::new();
    bench.fly(3.0, |bench, t| {
        let drift = Vector3::new(0.1 * t, 0.0, 0.0);
        bench.telemetry(t, 4 << 16 | 4 << 24, HERE + drift, still());
    });
    for (_, curve) in bench.curves() {
        assert!((control_points(&curve)[0] - HERE).norm() < 0.02);
    }
}

#[test]
fn a_held_point_keeps_its_place_in_the_world_when_the_coordinates_jump() {
    let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
    let jump = Vector3::new(-7.0, 3.0, 1.5);
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, MODE_MISSION, HERE + jump, still());
    });
    assert_constant_at(&bench, HERE + jump, 1e-4);
}

#[test]
fn a_restarted_gateway_goes_on_with_the_flight_without_braking_first() {
    // The first position arrives before the guard's next sample, and no heartbeat has come yet.
    let mut bench = Bench::new();
    let plan = flight(7, at(-2.0), HERE, Vector3::new(9.0, 0.0, 0.0), 6.0);
    bench.fly(1.0, |bench, t| {
        let there = plan.at(bench.now).unwrap();
        let tick = (t * 100.0).round() as u32;
        if tick.is_multiple_of(3) {
            bench.receive_position(there.position.vector(), there.velocity.vector());
        }
        if tick >= 3 {
            bench.approve(Verdict::Passed, plan);
        }
    });
    let (first, _) = bench.curves()[0];
    assert!(first.seconds_since(at(0.0)) < 0.1);
    for (time, curve) in bench.curves() {
        let error_m = (evaluate(&curve, time).unwrap() - plan.at(time).unwrap().position.vector()).norm();
        assert!(error_m < 0.022, "{error_m} m");
    }
}

#[test]
fn a_new_gateway_without_a_guard_holds_after_listening_for_a_moment() {
    let mut bench = Bench::new();
    bench.fly(1.0, |bench, t| bench.telemetry(t, MODE_MISSION, HERE, still()));
    let (first, _) = bench.curves()[0];
    let waited_s = first.seconds_since(at(0.0));
    assert!((0.14..0.21).contains(&waited_s), "{waited_s} s");
    assert_constant_at(&bench, HERE, 1e-5);
}

#[test]
fn unflyable_approvals_are_not_flown() {
    let start = at(1.0);
    let sound = flight(7, start, HERE, Vector3::new(5.0, 0.0, 0.0), 4.0);
    let spoil: [fn(&mut Trajectory); 6] = [
        |t| t.pieces[0].position[2].x_m = f64::NAN,
        |t| t.pieces[1].position[5].y_m = 1e12,
        |t| t.pieces[0].yaw_rad[1] = f64::INFINITY,
        |t| t.pieces[0].duration_s = 1e-300,
        |t| t.len = 0,
        |t| t.len = u32::MAX,
    ];
    for spoil in spoil {
        let mut bench = in_mode(MODE_MISSION, Some(path_to(FAR, COMMAND_NONE)));
        let mut bad = sound;
        spoil(&mut bad);
        bench.approve(Verdict::Passed, bad);
        bench.fly(1.0, |bench, t| {
            bench.telemetry(t, MODE_MISSION, HERE, still());
            bench.approved.as_mut().unwrap().header.publish = bench.now;
        });
        assert_constant_at(&bench, HERE, 1e-4);
    }
}

#[test]
fn slow_streams_get_curves_that_outlast_three_periods() {
    let mut bench = Bench::with(GatewayConfig {
        setpoint_rate_hz: 5.0,
        horizon_s: 0.3,
        ..GatewayConfig::default()
    });
    bench.fly(2.0, |bench, t| bench.telemetry(t, MODE_HOLD, HERE, still()));
    assert!(bench.last_curve().delta[4] >= 0.599);
}
