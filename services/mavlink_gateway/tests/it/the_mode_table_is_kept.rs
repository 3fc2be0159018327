//! What PX4 is answered in each of its modes, in curves and in waypoints, row by row; and whose clock a curve starts in.
//!
//! | mode, item | answered |
//! |---|---|
//! | take-off and landing (z not given) at the vehicle's place, also as items of a mission or a return | the autopilot's own target: in waypoints to the bit |
//! | a finite target in any automatic mode: a waypoint, a go-to, a place to hold, a landing elsewhere; a plan is approved | the plan |
//! | the same at the goal | the goal |
//! | the same without a path | the place, for as long as it takes |
//! | offboard, position, manual | the vehicle's place, which nobody flies |
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

use crate::support::*;
use jink_mavlink_gateway::{GatewayConfig, Representation};
use jink_shared_types::Timestamp;
use jink_shared_types::motion::{Trajectory, Verdict};
use jink_shared_types::vehicle::{COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF};
use mavlink::dialect::*;
use nalgebra::Vector3;

const HERE: Vector3<f64> = Vector3::new(3.0, 4.0, -5.0);
const FAR: Vector3<f64> = Vector3::new(60.0, 0.0, -5.0);
const MODE_RETURN: u32 = 4 << 16 | 5 << 24;
const MODE_MANUAL: u32 = 1 << 16;
const MODE_OFFBOARD: u32 = 6 << 16;
/// The longest silence that a beat of 20 Hz allows (s).
const GAP_S: f64 = 0.075;
/// Every way in which PX4 asks for a target to the side.
const TARGETS: [(u32, u16); 7] = [
    (MODE_MISSION, COMMAND_NONE),
    (MODE_MISSION, COMMAND_LOITER),
    (MODE_RETURN, COMMAND_NONE),
    (MODE_RETURN, COMMAND_LOITER),
    (MODE_HOLD, COMMAND_LOITER),
    (MODE_LAND, COMMAND_LAND),
    (MODE_MISSION, COMMAND_LAND),
];
const REPRESENTATIONS: [Representation; 2] = [Representation::Bezier, Representation::Waypoints];

type Waypoints = TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;
/// What the guard says at every step.
type Guard = fn(&mut Bench);

/// A setpoint as PX4 takes it at the moment it comes: position and velocity (NaN: not given).
#[derive(Debug)]
struct Taken {
    time: Timestamp,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    /// Point 0, where it came in waypoints.
    waypoints: Option<Waypoints>,
}

/// Every setpoint, after a look at what holds for all of them.
fn taken(bench: &Bench, representation: Representation) -> Vec<Taken> {
    let mut all: Vec<Taken> = Vec::new();
    for sent in &bench.sent {
        let time = sent.time;
        let one = match &sent.message {
            MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(curve) => {
                assert_eq!((representation, curve.valid_points), (Representation::Bezier, 5));
                let later = time.plus_seconds(1e-3);
                let (now, soon) = (evaluate(curve, time).unwrap(), evaluate(curve, later).unwrap());
                Taken {
                    time,
                    position: now,
                    velocity: (soon - now) / 1e-3,
                    waypoints: None,
                }
            }
            // The one that takes back what another companion has left.
            MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(announcement)
                if announcement.valid_points == 0 =>
            {
                assert!(representation == Representation::Bezier && all.is_empty());
                continue;
            }
            MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(point) => {
                assert_eq!(
                    (representation, point.valid_points),
                    (Representation::Waypoints, 1)
                );
                Taken {
                    time,
                    position: Vector3::new(point.pos_x[0], point.pos_y[0], point.pos_z[0]).cast(),
                    velocity: Vector3::new(point.vel_x[0], point.vel_y[0], point.vel_z[0]).cast(),
                    waypoints: Some(point.clone()),
                }
            }
            _ => continue,
        };
        if let Some(before) = all.last() {
            let gap_s = time.seconds_since(before.time);
            assert!(gap_s <= GAP_S, "silent for {gap_s} s");
        }
        all.push(one);
    }
    all
}

/// A vehicle at `HERE` in `custom_mode` for `duration_s`; the wish, where there is one, comes at 5 Hz, the guard says the same all
/// the time.
fn answered<'a>(
    representation: Representation,
    custom_mode: u32,
    wanted: impl Into<Option<&'a Waypoints>>,
    duration_s: f64,
    approve: impl Fn(&mut Bench),
) -> Vec<Taken> {
    let wanted = wanted.into();
    let mut bench = Bench::with(GatewayConfig {
        representation,
        ..GatewayConfig::default()
    });
    bench.fly(duration_s, |bench, t| {
        bench.telemetry(t, custom_mode, HERE, Vector3::zeros());
        if ((t * 100.0).round() as u32).is_multiple_of(20)
            && let Some(wanted) = wanted
        {
            bench.receive(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(wanted.clone()));
        }
        approve(bench);
    });
    let all = taken(&bench, representation);
    let (first, last) = (all.first().unwrap(), all.last().unwrap());
    assert!(first.time.seconds_since(at(0.0)) < 0.5, "too late for mode entry");
    assert!(bench.now.seconds_since(last.time) <= GAP_S);
    all
}

fn approve_mirror(bench: &mut Bench) {
    bench.approve(Verdict::Passed, mirror());
}

/// Point 0, and for points 1 and 2 another place, so that they can be distinguished.
fn wanted(target: Vector3<f64>, command: u16) -> Waypoints {
    waypoints([(target, command), (FAR, COMMAND_NONE), (FAR * 2.0, COMMAND_NONE)])
}

/// The same place in all points: take-off and landing.
fn vertical(target: Vector3<f64>, command: u16) -> Waypoints {
    waypoints([(target, command); 3])
}

fn descent() -> Waypoints {
    let mut landing = vertical(HERE, COMMAND_LAND);
    landing.pos_z[0] = f32::NAN;
    landing.vel_z[0] = 0.7;
    landing
}

#[test]
fn what_is_not_planned_goes_back_as_it_came() {
    let above = HERE + Vector3::new(0.1, -0.2, -2.5);
    for (mode, asked) in [
        (MODE_TAKEOFF, vertical(above, COMMAND_TAKEOFF)),
        (MODE_LAND, descent()),
        (MODE_MISSION, vertical(above, COMMAND_TAKEOFF)),
        (MODE_MISSION, descent()),
        (MODE_RETURN, descent()),
    ] {
        for representation in REPRESENTATIONS {
            let last = answered(representation, mode, &asked, 1.0, approve_mirror)
                .pop()
                .unwrap();
            let what = format!("{representation:?}, mode {mode:#x}, command {}", asked.command[0]);
            if let Some(reply) = last.waypoints {
                let bits = |w: &Waypoints| {
                    [
                        w.pos_x, w.pos_y, w.pos_z, w.vel_x, w.vel_y, w.vel_z, w.pos_yaw, w.vel_yaw,
                    ]
                    .map(|field| field[0].to_bits())
                };
                assert_eq!(bits(&reply), bits(&asked), "{what}");
                continue;
            }
            for axis in 0..3 {
                let place = [asked.pos_x, asked.pos_y, asked.pos_z][axis][0];
                if place.is_finite() {
                    assert!(
                        (last.position[axis] - f64::from(place)).abs() < 1e-4,
                        "{what}: {last:?}"
                    );
                    assert!(last.velocity[axis].abs() < 1e-2, "{what}: {last:?}");
                } else {
                    assert!(
                        (last.position[axis] - HERE[axis]).abs() < 0.05,
                        "{what}: {last:?}"
                    );
                    assert!((last.velocity[axis] - 0.7).abs() < 1e-2, "{what}: {last:?}");
                }
            }
        }
    }
}

#[test]
fn every_target_to_the_side_is_planned_and_its_goal_is_held() {
    let (way, duration_s) = (Vector3::new(5.0, 0.0, 0.0), 2.0);
    for (mode, command) in TARGETS {
        for representation in REPRESENTATIONS {
            let plan = flight(7, at(1.0), HERE, way, duration_s);
            let all = answered(
                representation,
                mode,
                &vertical(HERE + way, command),
                6.0,
                |bench| {
                    if bench.now < at(1.0) {
                        bench.approve(Verdict::Hold, Trajectory::default());
                    } else {
                        bench.approve(Verdict::Passed, plan);
                    }
                },
            );
            for one in &all {
                let there = plan.at(one.time).filter(|_| one.time > at(1.05));
                let place = there.map_or(HERE, |state| state.position.vector());
                assert!(
                    (one.position - place).norm() < 0.03,
                    "{representation:?}, {mode:#x}: {one:?}"
                );
            }
            let last = all.last().unwrap();
            assert!(
                (last.position - HERE - way).norm() < 1e-3 && last.velocity.norm() < 1e-3,
                "{last:?}"
            );
        }
    }
}

#[test]
fn without_a_path_the_place_is_held_and_never_the_raw_waypoint_flown() {
    let guards: [(&str, Guard); 3] = [
        ("nothing approved", |bench| {
            bench.approve(Verdict::Hold, Trajectory::default());
        }),
        ("to be mirrored, which a leg is not", approve_mirror),
        ("no guard", |_| {}),
    ];
    for (what, guard) in guards {
        for (mode, command) in TARGETS {
            for representation in REPRESENTATIONS {
                let all = answered(representation, mode, &vertical(FAR, command), 10.0, guard);
                assert!(all.len() > 190);
                for one in &all {
                    assert!((one.position - HERE).norm() < 0.01, "{what}: {one:?}");
                    assert!(one.velocity.norm() < 0.01, "{what}: {one:?}");
                }
            }
        }
    }
}

#[test]
fn where_nobody_listens_the_stream_stays_at_the_vehicle() {
    for mode in [MODE_OFFBOARD, MODE_POSITION, MODE_MANUAL] {
        for representation in REPRESENTATIONS {
            let plan = flight(7, at(0.0), HERE, Vector3::new(20.0, 0.0, 0.0), 8.0);
            let all = answered(representation, mode, None, 2.0, |bench| {
                bench.approve(Verdict::Passed, plan);
            });
            // Until the first heartbeat is received the mode is not known; it comes with the first position.
            assert!(
                all.iter().all(|one| (one.position - HERE).norm() <= 0.5),
                "{mode:#x}"
            );
        }
    }
}

#[test]
fn the_stream_is_there_before_a_mode_is_entered_and_goes_on_through_every_change() {
    let modes = [
        (MODE_POSITION, None),
        (MODE_TAKEOFF, Some(wanted(HERE, COMMAND_TAKEOFF))),
        (MODE_HOLD, Some(wanted(HERE, COMMAND_LOITER))),
        (MODE_MISSION, Some(wanted(FAR, COMMAND_NONE))),
        (MODE_OFFBOARD, None),
        (MODE_RETURN, Some(wanted(FAR, COMMAND_NONE))),
        (MODE_LAND, Some(descent())),
        (MODE_MANUAL, None),
    ];
    for representation in REPRESENTATIONS {
        let mut bench = Bench::with(GatewayConfig {
            representation,
            ..GatewayConfig::default()
        });
        // From each mode into each.
        for (from, before) in &modes {
            for (to, after) in &modes {
                for (mode, asked) in [(from, before), (to, after)] {
                    bench.receive_heartbeat(*mode, true);
                    if let Some(asked) = asked {
                        bench.receive(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(asked.clone()));
                    }
                    bench.fly(0.3, |bench, _| {
                        bench.receive_position(HERE, Vector3::zeros());
                        bench.receive_attitude(0.3);
                    });
                }
            }
        }
        // No gap in it, and every setpoint is where the vehicle is: nothing was approved. A landing whose vehicle stands still
        // is on the ground, and is pressed into it.
        let all = taken(&bench, representation);
        assert!(all.len() > 700, "{}", all.len());
        for one in &all {
            let given = one.position.map(|c| if c.is_nan() { HERE.z } else { c });
            let beside = given - HERE;
            let lands = one.velocity.z > 0.0;
            assert!(
                beside.xy().norm() < 0.5 && (lands || beside.z.abs() < 0.5),
                "{representation:?}: {one:?}"
            );
        }
    }
}

#[test]
fn a_curve_starts_in_the_clock_that_timesync_is_answered_in_converged_or_not() {
    let mut bench = Bench::new();
    let (mut answers, mut converged) = (0, Vec::new());
    // An autopilot that answers every request of ours after 2 ms, and asks at the same rate.
    bench.fly(80.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, HERE, Vector3::zeros());
        let asked: Vec<_> = bench
            .sent
            .iter()
            .filter_map(|sent| match &sent.message {
                MavMessage::TIMESYNC(sync) if sync.tc1 == 0 => Some(sync.ts1),
                _ => None,
            })
            .collect();
        for ts1 in asked {
            let boot_ns = i64::from(bench.boot_ms(bench.now)) * 1_000_000;
            bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: boot_ns - 1_000_000,
                ts1,
                ..TIMESYNC_DATA::default()
            }));
        }
        for sent in &bench.sent {
            if let MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(curve) = &sent.message {
                let age_us = sent.time.ns / 1000 - curve.time_usec;
                assert!((9_400..=11_000).contains(&age_us), "started {age_us} us ago");
                converged.push(
                    bench
                        .status
                        .is_some_and(|status| status.timesync_converged.is_set()),
                );
            }
        }
        bench.sent.clear();
        let boot_ns = i64::from(bench.boot_ms(bench.now)) * 1_000_000;
        bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
            ts1: boot_ns,
            ..TIMESYNC_DATA::default()
        }));
        bench.step();
        for sent in &bench.sent {
            if let MavMessage::TIMESYNC(answer) = &sent.message
                && answer.ts1 == boot_ns
            {
                assert_eq!(answer.tc1, boot_ns, "another clock than the curves'");
                answers += 1;
            }
        }
    });
    assert!(answers > 7000, "{answers}");
    let before = converged.iter().filter(|converged| !**converged).count();
    assert!(
        before > 20 && converged.len() - before > 20,
        "{before} of {}",
        converged.len()
    );
}
