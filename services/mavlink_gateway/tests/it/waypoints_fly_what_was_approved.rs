//! The other representation: every setpoint is a TRAJECTORY_REPRESENTATION_WAYPOINTS with one valid point.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

use crate::support::*;
use jink_mavlink_gateway::{GatewayConfig, Representation};
use jink_shared_types::Timestamp;
use jink_shared_types::motion::Verdict;
use jink_shared_types::vehicle::{COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF};
use mavlink::dialect::*;
use nalgebra::Vector3;
use proptest::prelude::*;

type Waypoints = TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;

const HERE: Vector3<f64> = Vector3::new(4.0, -2.0, -3.0);
const FAR: Vector3<f64> = Vector3::new(40.0, 0.0, -5.0);

fn bench() -> Bench {
    Bench::with(GatewayConfig {
        representation: Representation::Waypoints,
        ..GatewayConfig::default()
    })
}

/// Stands at `HERE` in `custom_mode` for a second; the autopilot asks for `wanted`.
fn in_mode(custom_mode: u32, wanted: Option<&Waypoints>) -> Bench {
    let mut bench = bench();
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, custom_mode, HERE, Vector3::zeros());
        if ((t * 100.0).round() as u32).is_multiple_of(20)
            && let Some(wanted) = wanted
        {
            bench.receive(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(wanted.clone()));
        }
        bench.approve(Verdict::Passed, mirror());
    });
    bench
}

fn sent(bench: &Bench) -> Vec<(Timestamp, Waypoints)> {
    let waypoints = bench.sent.iter().filter_map(|sent| match &sent.message {
        MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(data) => Some((sent.time, data.clone())),
        MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_) => panic!("the two are never mixed"),
        _ => None,
    });
    waypoints.collect()
}

/// Every field rule that holds for every setpoint.
fn assert_rules(waypoints: &Waypoints) {
    assert_eq!(waypoints.valid_points, 1);
    assert_eq!(waypoints.command, [COMMAND_NONE; 5]);
    let Waypoints {
        pos_x,
        pos_y,
        pos_z,
        vel_x,
        vel_y,
        vel_z,
        ..
    } = waypoints;
    for (position, velocity) in [(pos_x, vel_x), (pos_y, vel_y), (pos_z, vel_z)] {
        assert!(
            position[0].is_finite() || velocity[0].is_finite(),
            "an axis without anything"
        );
        assert!(
            position[1..]
                .iter()
                .chain(&velocity[1..])
                .all(|unused| unused.is_nan())
        );
    }
    let Waypoints {
        acc_x,
        acc_y,
        acc_z,
        pos_yaw,
        vel_yaw,
        ..
    } = waypoints;
    assert!([acc_x, acc_y, acc_z].into_iter().flatten().all(|a| a.is_nan()));
    assert!(
        pos_yaw[1..]
            .iter()
            .chain(&vel_yaw[1..])
            .all(|unused| unused.is_nan())
    );
}

#[test]
fn an_approved_trajectory_is_sent_as_its_position_and_velocity_at_the_moment() {
    let wanted = waypoints([(FAR, COMMAND_NONE); 3]);
    let mut bench = in_mode(MODE_MISSION, Some(&wanted));
    let begin = bench.now;
    let plan = flight(7, begin, HERE, Vector3::new(5.0, 0.0, 0.0), 4.0);
    bench.approve(Verdict::Passed, plan);
    bench.fly(2.0, |bench, t| {
        bench.telemetry(t, MODE_MISSION, HERE, Vector3::zeros());
        bench.approved.as_mut().unwrap().header.publish = bench.now;
    });
    let mut flown = 0;
    for (time, waypoints) in sent(&bench) {
        assert_rules(&waypoints);
        if time.seconds_since(begin) < 0.1 {
            continue;
        }
        let there = plan.at(time).unwrap();
        let position = Vector3::new(waypoints.pos_x[0], waypoints.pos_y[0], waypoints.pos_z[0]);
        let velocity = Vector3::new(waypoints.vel_x[0], waypoints.vel_y[0], waypoints.vel_z[0]);
        assert!((position.cast() - there.position.vector()).norm() < 1e-4);
        assert!((velocity.cast() - there.velocity.vector()).norm() < 1e-4);
        flown += 1;
    }
    assert!(flown > 35, "{flown}");
}

#[test]
fn what_is_not_planned_goes_back_bit_by_bit() {
    for (mode, command) in [(MODE_TAKEOFF, COMMAND_TAKEOFF), (MODE_LAND, COMMAND_LAND)] {
        let mut wanted = waypoints([(HERE + Vector3::new(0.1, 0.2, -2.5), command); 3]);
        wanted.pos_yaw[0] = f32::NAN;
        if mode == MODE_LAND {
            wanted.pos_z[0] = f32::NAN;
            wanted.vel_z[0] = 0.7;
        }
        let bench = in_mode(mode, Some(&wanted));
        let (_, last) = sent(&bench).pop().unwrap();
        assert_rules(&last);
        let bits = |w: &Waypoints| {
            [
                w.pos_x, w.pos_y, w.pos_z, w.vel_x, w.vel_y, w.vel_z, w.pos_yaw, w.vel_yaw,
            ]
            .map(|field| field[0].to_bits())
        };
        assert_eq!(bits(&last), bits(&wanted), "{mode:#x}");
    }
}

#[test]
fn a_number_that_is_infinite_is_not_given_and_never_goes_back() {
    for field in 0..8 {
        let mut wanted = waypoints([(HERE, COMMAND_LOITER); 3]);
        wanted.vel_x[0] = 0.1;
        let fields = [
            &mut wanted.pos_x,
            &mut wanted.pos_y,
            &mut wanted.pos_z,
            &mut wanted.vel_x,
            &mut wanted.vel_y,
            &mut wanted.vel_z,
            &mut wanted.pos_yaw,
            &mut wanted.vel_yaw,
        ];
        fields[field][0] = f32::NEG_INFINITY;
        let bench = in_mode(MODE_HOLD, Some(&wanted));
        let (_, last) = sent(&bench).pop().unwrap();
        assert_rules(&last);
        let all = [
            last.pos_x,
            last.pos_y,
            last.pos_z,
            last.vel_x,
            last.vel_y,
            last.vel_z,
            last.pos_yaw,
            last.vel_yaw,
        ];
        assert!(
            all.iter().flatten().all(|n| !n.is_infinite()),
            "field {field}: {last:?}"
        );
        let (path, _) = bench.paths.last().unwrap();
        let turn = [path.points[0].yaw_rad, path.points[0].yaw_rate_radps];
        assert!(turn.iter().all(|n| !n.is_infinite()), "field {field}: {turn:?}");
    }
}

proptest! {
    /// Whatever the autopilot leaves out, no axis of the answer is without position and velocity.
    #[test]
    fn no_reply_is_empty(left_out in proptest::collection::vec(any::<bool>(), 8), mode in 0..3usize) {
        let mut wanted = waypoints([(HERE, COMMAND_LOITER); 3]);
        let fields = [
            &mut wanted.pos_x, &mut wanted.pos_y, &mut wanted.pos_z,
            &mut wanted.vel_x, &mut wanted.vel_y, &mut wanted.vel_z,
            &mut wanted.pos_yaw, &mut wanted.vel_yaw,
        ];
        for (field, left_out) in fields.into_iter().zip(left_out) {
            if left_out {
                *field = [f32::NAN; 5];
            }
        }
        let bench = in_mode([MODE_TAKEOFF, MODE_HOLD, MODE_LAND][mode], Some(&wanted));
        let all = sent(&bench);
        prop_assert!(all.len() >= 15);
        for (_, waypoints) in &all {
            assert_rules(waypoints);
        }
    }
}
