//! Nothing is flown into what is in sight: the guard brakes at once, within limits, to rest, and lets go again.

use crate::common;
use crate::common::{
    Lidar, VehiclePose, World, end, fly, guard, hovering_guard, look, looking, on, random, step, straight,
    time, trajectory,
};
use jink_collision_guard::StepEvents;
use jink_collision_guard::guard::{Guard, GuardConfig};
use jink_collision_guard::ring::Ring;
use jink_shared_types::bezier::{derivative, quintic_between};
use jink_shared_types::events;
use jink_shared_types::frames::Acceleration;
use jink_shared_types::motion::{
    ApprovedTrajectory, BezierPiece, GuardReason, MotionLimits, Trajectory, TrajectoryMode, Verdict,
    stopping_distance_m,
};
use jink_shared_types::params::ParamSet;
use jink_shared_types::tracking::Tracking;
use jink_shared_types::{Coded, Point, Velocity};
use nalgebra::Vector3;
use proptest::prelude::*;

const NOW_S: f64 = 10.0;
/// Vehicle radius and margin of the default parameters.
const CLEARANCE_M: f64 = 0.4;

fn started(first: &Trajectory) -> (Guard, Ring) {
    let (mut guard, ring) = hovering_guard(NOW_S);
    let (out, _) = step(&mut guard, NOW_S, Some(first), &ring, VehiclePose::at(0.0, 0.0));
    assert_eq!(out.verdict, Verdict::Passed, "{:?}", out.reason);
    (guard, ring)
}

/// Steps along `first` at 30 Hz with a sweep of `world` every 0.1 s, until `until_s`; calls `each` after every step.
fn follow(
    guard: &mut Guard,
    ring: &mut Ring,
    world: &dyn Fn(f64) -> World,
    until_s: f64,
    mut each: impl FnMut(f64, &ApprovedTrajectory, &StepEvents),
) {
    let mut flown = step(guard, NOW_S, None, ring, VehiclePose::at(0.0, 0.0))
        .0
        .trajectory;
    let mut t = NOW_S;
    let mut sweep = 0;
    while t < until_s {
        t += 1.0 / 30.0;
        let path = flown;
        let place = move |t: f64| on(&path, t);
        fly(ring, &place, t - 0.04, t);
        if t >= NOW_S + 0.1 * f64::from(sweep + 1) {
            sweep += 1;
            let lidar = Lidar {
                sigma_m: 0.02,
                ..Lidar::default()
            };
            let at = NOW_S + 0.1 * f64::from(sweep);
            let (cloud, header) = lidar.sweep(&world(at), &place, at, &mut random(sweep as u64));
            ring.cloud(0, &cloud, &header).unwrap();
        }
        let (out, step_events) = step(guard, t, None, ring, place(t));
        flown = out.trajectory;
        each(t, &out, &step_events);
    }
}

#[test]
fn the_guard_brakes_as_hard_as_the_autopilot_is_known_to_follow_and_later() {
    // The distance to the post when the brake begins, and the way that it takes (m).
    let brake = |tracking: Tracking| {
        let first = straight(7, NOW_S, 3.8, 2.0, 40.0);
        let (mut guard, mut ring) = started(&first);
        let known = VehiclePose {
            tracking,
            ..VehiclePose::at(0.0, 0.0)
        };
        step(&mut guard, NOW_S, None, &ring, known);
        let mut braked = None;
        follow(
            &mut guard,
            &mut ring,
            &|_| World(vec![[18.0, 0.0, 0.2]]),
            NOW_S + 6.0,
            |t, out, _| {
                if out.verdict == Verdict::Braked && braked.is_none() {
                    assert_is_a_good_brake(&out.trajectory, &first, t);
                    let from_m = out.trajectory.at(time(t)).unwrap().position.x_m;
                    let end_m = out.trajectory.at(out.trajectory.end()).unwrap().position.x_m;
                    braked = Some([18.0 - from_m, end_m - from_m]);
                }
            },
        );
        braked.unwrap()
    };
    let [soon_m, long_m] = brake(Tracking::default());
    let [late_m, short_m] = brake(Tracking::PX4_OFFBOARD);
    assert!(
        late_m < soon_m - 0.5 && short_m < 0.7 * long_m,
        "{late_m} {short_m}, {soon_m} {long_m}"
    );
    // It ends with the clearance before the post, and what the vehicle runs past its end.
    let harder_mps2 = Tracking::PX4_OFFBOARD.shortest_stop(3.8, (2.0, 12.0)).0 - 2.0;
    let room_m = 0.2 + CLEARANCE_M + Tracking::PX4_OFFBOARD.overshoot_m(harder_mps2) - 0.1;
    assert!(late_m - short_m > room_m, "{late_m} {short_m}");
}

fn assert_is_a_good_brake(brake: &Trajectory, base: &Trajectory, now_s: f64) {
    assert_eq!(brake.mode, TrajectoryMode::Brake);
    assert_eq!(brake.base_id, base.id);
    let lead = brake.splice.seconds_since(time(now_s));
    assert!((0.0..=0.0501).contains(&lead), "{lead}");
    // The same up to the splice.
    for i in 0..=10 {
        let t = time(now_s).plus_seconds(lead * f64::from(i) / 10.0);
        let (new, old) = (brake.at(t).unwrap(), base.at(t).unwrap());
        assert!((new.position.vector() - old.position.vector()).norm() < 1e-3);
        assert!((new.velocity.vector() - old.velocity.vector()).norm() < 1e-2);
        assert!((new.acceleration.vector() - old.acceleration.vector()).norm() < 2e-2);
    }
    // Continuous, within its limits, at rest at the end.
    let mut last = brake.pieces()[0].at(0.0);
    for piece in brake.pieces() {
        let first = piece.at(0.0);
        assert!((first.position.vector() - last.position.vector()).norm() < 1e-6);
        assert!((first.velocity.vector() - last.velocity.vector()).norm() < 1e-3);
        assert!((first.acceleration.vector() - last.acceleration.vector()).norm() < 2e-2);
        assert!((first.yaw_rad - last.yaw_rad).abs() < 1e-6);
        last = piece.at(piece.duration_s);
        let velocity: [_; 5] = derivative(&piece.points(), piece.duration_s);
        let acceleration: [_; 4] = derivative(&velocity, piece.duration_s);
        let jerk: [_; 3] = derivative(&acceleration, piece.duration_s);
        for a in acceleration {
            assert!(
                a.norm() <= MotionLimits::allowed(brake.limits.acceleration_mps2),
                "{} m/s2",
                a.norm()
            );
        }
        for j in jerk {
            assert!(
                j.norm() <= MotionLimits::allowed(brake.limits.jerk_mps3),
                "{} m/s3",
                j.norm()
            );
        }
    }
    assert!(last.velocity.vector().norm() < 1e-6 && last.acceleration.vector().norm() < 1e-6);
    assert!(last.yaw_rate_radps.abs() < 1e-6);
}

#[test]
fn an_obstacle_that_appears_within_the_stopping_distance_is_braked_for_in_one_step() {
    let first = straight(7, NOW_S, 3.0, 2.0, 40.0);
    let (mut guard, mut ring) = started(&first);
    let t = NOW_S + 4.0;
    let place = on(&first, t);
    look(&mut ring, &World::default(), place, t);
    let (out, _) = step(&mut guard, t, None, &ring, place);
    assert_eq!(out.verdict, Verdict::Passed);

    let world = World(vec![[place.position.x + 3.5, 0.0, 0.2]]);
    let t = t + 0.1;
    let place = on(&first, t);
    look(&mut ring, &world, place, t);
    let (out, step_events) = step(&mut guard, t, None, &ring, place);
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Braked, GuardReason::Obstacle)
    );
    assert!(out.free_way_m < out.stopping_m);
    assert_is_a_good_brake(&out.trajectory, &first, t);
    assert_eq!(out.trajectory.id >> 63, 1);
    assert_eq!(
        (out.trajectory.id >> 32) & 0x7fff_ffff,
        3,
        "the guard's generation"
    );
    let event = step_events.events()[0];
    assert_eq!(
        (event.id, event.name.as_str()),
        (events::GUARD_BRAKED.id, "obstacle")
    );
    assert!((event.numbers[0] - out.free_way_m).abs() < 1e-9);

    // Reported once, and not braked again.
    let (again, step_events) = step(&mut guard, t + 0.03, None, &ring, place);
    assert_eq!(again.trajectory, out.trajectory);
    assert!(step_events.events().is_empty());
}

#[test]
fn a_guard_brake_ends_before_the_obstacle_it_is_made_for() {
    let first = straight(7, NOW_S, 3.0, 2.0, 20.0);
    // Seen when 12 m away, flown at by a planner that does not care.
    let world = World(vec![[16.0, 0.1, 0.3]]);
    let (mut guard, mut ring) = started(&first);
    let mut braked = None;
    follow(
        &mut guard,
        &mut ring,
        &|_| world.clone(),
        NOW_S + 12.0,
        |t, out, _| {
            if out.verdict == Verdict::Braked && braked.is_none() {
                braked = Some((t, out.trajectory));
            }
        },
    );
    let (t, brake) = braked.unwrap();
    assert_is_a_good_brake(&brake, &first, t);
    let rest = brake.at(brake.end()).unwrap().position;
    let clearance = world.clearance_m(rest.x_m, rest.y_m);
    assert!(clearance > CLEARANCE_M, "{clearance}");
    assert!(clearance < 2.5, "{clearance}: not much earlier than needed");
}

#[test]
fn with_collision_prevention_a_guard_brake_ends_before_the_distance_to_keep() {
    const KEPT_M: f64 = 2.5;
    let mut params = ParamSet::default();
    params.set("CP_DIST", KEPT_M).unwrap();
    let first = straight(7, NOW_S, 3.0, 2.0, 20.0);
    // Not in the path of the vehicle's radius, but nearer to it than the standoff.
    let world = World(vec![[16.0, 1.5, 0.3]]);
    let (mut guard, mut ring) = started(&first);
    follow(
        &mut guard,
        &mut ring,
        &|_| world.clone(),
        NOW_S + 12.0,
        |_, out, _| {
            assert_eq!(out.verdict, Verdict::Passed, "without it: {:?}", out.reason);
        },
    );
    let (mut guard, mut ring) = started(&first);
    guard.configure(GuardConfig::from_params(&params));
    let mut braked = None;
    follow(
        &mut guard,
        &mut ring,
        &|_| world.clone(),
        NOW_S + 12.0,
        |_, out, _| {
            if out.verdict == Verdict::Braked {
                braked.get_or_insert(out.trajectory);
            }
        },
    );
    let brake = braked.unwrap();
    let rest = brake.at(brake.end()).unwrap().position;
    let clearance_m = world.clearance_m(rest.x_m, rest.y_m);
    // Noise of the lidar: 2 cm, the nearest of many rays.
    assert!(clearance_m > KEPT_M - 0.05, "{clearance_m}");
    assert!(
        clearance_m < KEPT_M + 2.5,
        "{clearance_m}: not much earlier than needed"
    );
}

#[test]
fn a_planned_stop_before_a_wall_is_not_braked() {
    // Rests 0.45 m before the surface: 5 cm more than the guard demands, with 2 cm of noise on every ray.
    let world = World(vec![[15.0, 0.0, 1.0], [15.0, 2.0, 1.0], [15.0, -2.0, 1.0]]);
    let first = straight(7, NOW_S, 3.0, 2.0, 13.45);
    let (mut guard, mut ring) = started(&first);
    follow(
        &mut guard,
        &mut ring,
        &|_| world.clone(),
        NOW_S + 9.0,
        |t, out, step_events| {
            assert_eq!(
                out.verdict,
                Verdict::Passed,
                "{:?} at {t}, {} m free",
                out.reason,
                out.free_way_m
            );
            assert!(step_events.events().is_empty());
        },
    );
}

#[test]
fn a_start_toward_a_near_obstacle_is_refused_not_approved_and_braked() {
    let ring = looking(&World(vec![[1.5, 0.0, 0.5]]), VehiclePose::at(0.0, 0.0), NOW_S);
    let start = straight(7, NOW_S, 2.0, 1.5, 6.0);
    let (out, _) = step(
        &mut guard(),
        NOW_S,
        Some(&start),
        &ring,
        VehiclePose::at(0.0, 0.0),
    );
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Hold, GuardReason::Obstacle)
    );
}

#[test]
fn who_is_too_near_may_leave_but_not_come_nearer() {
    // 0.35 m from the surface: less than the 0.4 m demanded.
    let ring = looking(&World(vec![[1.35, 0.0, 1.0]]), VehiclePose::at(0.0, 0.0), NOW_S);
    let rest = end([0.0, 0.0], [0.0, 0.0]);
    for (to, verdict) in [
        ([-3.0, 0.0], Verdict::Passed),
        ([0.0, 3.0], Verdict::Passed),
        ([1.0, 0.0], Verdict::Hold),
        ([1.0, 3.0], Verdict::Hold),
    ] {
        let start = trajectory(7, NOW_S, rest, &[(end(to, [0.0, 0.0]), 3.0)]);
        let (out, _) = step(
            &mut guard(),
            NOW_S,
            Some(&start),
            &ring,
            VehiclePose::at(0.0, 0.0),
        );
        assert_eq!(out.verdict, verdict, "to {to:?}: {:?}", out.reason);
    }
}

#[test]
fn the_brake_is_flown_until_something_that_departs_from_it_passes() {
    let first = straight(7, NOW_S, 3.0, 2.0, 40.0);
    let (mut guard, mut ring) = started(&first);
    let t = NOW_S + 4.0;
    let place = on(&first, t);
    look(
        &mut ring,
        &World(vec![[place.position.x + 3.5, 0.0, 0.2]]),
        place,
        t,
    );
    let (out, _) = step(&mut guard, t, None, &ring, place);
    assert_eq!(out.verdict, Verdict::Braked);
    let brake = out.trajectory;

    // What still departs from the replaced one does not pass.
    let mut stale = first;
    (stale.id, stale.base_id, stale.splice) = (8, 7, time(t + 0.2));
    let (out, _) = step(&mut guard, t + 0.03, Some(&stale), &ring, place);
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Kept, GuardReason::WrongBase)
    );
    assert_eq!(out.trajectory.id, brake.id);

    // A trajectory that departs from the brake passes when its path is free again.
    let t = t + 0.1;
    let place = on(&brake, t);
    look(&mut ring, &World::default(), place, t);
    let splice = time(t + 0.15);
    let mut next = Trajectory {
        id: 9,
        base_id: brake.id,
        splice,
        limits: first.limits,
        mode: Coded::new(TrajectoryMode::Plan),
        ..Trajectory::default()
    };
    assert!(next.take_prefix(&brake, time(t), splice));
    let from = brake.at(splice).unwrap().end();
    let to = end([from.position.x + 8.0, 0.0], [0.0, 0.0]);
    assert!(next.push(BezierPiece::new(&quintic_between(&from, &to, 6.0), [0.0; 6], 6.0)));
    let (out, step_events) = step(&mut guard, t, Some(&next), &ring, place);
    assert_eq!(
        (out.verdict.get(), out.trajectory.id),
        (Verdict::Passed, 9),
        "{:?}",
        out.reason
    );
    assert_eq!(step_events.events()[0].id, events::GUARD_RELEASED.id);
}

#[test]
fn a_stop_that_is_shorter_than_the_guard_s_brake_is_left_alone() {
    // 4 m/s2 instead of the guard's 2.
    let from = end([0.0, 0.0], [3.0, 0.0]);
    let mut stop = trajectory(7, NOW_S, from, &[(end([1.75, 0.0], [0.0, 0.0]), 1.2)]);
    stop.mode = Coded::new(TrajectoryMode::Stop);
    stop.limits.jerk_mps3 = 20.0;
    let ring = looking(&World::default(), VehiclePose::at(0.0, 0.0), NOW_S);
    let mut guard = guard();
    let (out, _) = step(&mut guard, NOW_S, Some(&stop), &ring, on(&stop, NOW_S));
    assert_eq!(out.verdict, Verdict::Passed, "{:?}", out.reason);
    let ring = looking(&World(vec![[2.2, 0.0, 0.2]]), on(&stop, NOW_S + 0.1), NOW_S + 0.1);
    let (out, _) = step(&mut guard, NOW_S + 0.1, None, &ring, on(&stop, NOW_S + 0.1));
    assert_eq!(out.trajectory.id, 7);
    assert!(
        out.free_way_m < out.stopping_m,
        "it is blocked, but nothing better is at hand"
    );
}

#[test]
fn a_changed_parameter_counts_from_the_next_step() {
    // 0.6 m from the surface of a tree beside the path: enough for the default margin of 0.1, not for 0.5.
    let first = straight(7, NOW_S, 3.0, 2.0, 40.0);
    let (mut guard, mut ring) = started(&first);
    let t = NOW_S + 4.0;
    let place = on(&first, t);
    look(
        &mut ring,
        &World(vec![[place.position.x + 3.0, 0.9, 0.3]]),
        place,
        t,
    );
    let (out, _) = step(&mut guard, t, None, &ring, place);
    assert_eq!(out.verdict, Verdict::Passed);
    let mut params = jink_shared_types::params::ParamSet::default();
    params.set("GD_MARGIN", 0.5).unwrap();
    guard.configure(GuardConfig::from_params(&params));
    let (out, _) = step(&mut guard, t, None, &ring, place);
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Braked, GuardReason::Obstacle)
    );
}

/// A straight flight that is somewhere in its middle, and an obstacle somewhere around.
fn scene() -> impl Strategy<Value = (f64, f64, [f64; 3])> {
    (
        0.5..4.0f64,
        0.2..7.0f64,
        (1.0..11.0f64, -2.5..2.5f64, 0.1..0.6f64),
    )
        .prop_map(|(speed, since, (ahead, aside, radius))| (speed, since, [ahead, aside, radius]))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn what_is_approved_never_leads_through_an_obstacle_inside_the_stopping_distance(
        (speed, since, obstacle) in scene(),
    ) {
        let first = straight(7, NOW_S, speed, 2.5, 40.0);
        let (mut guard, mut ring) = started(&first);
        let t = NOW_S + since;
        let place = on(&first, t);
        let world = World(vec![[place.position.x + obstacle[0], obstacle[1], obstacle[2]]]);
        prop_assume!(world.clearance_m(place.position.x, place.position.y) > 0.5);
        look(&mut ring, &world, place, t);
        let (out, _) = step(&mut guard, t, None, &ring, place);
        let now = first.at(time(t)).unwrap().velocity.vector().norm();
        let stopping = stopping_distance_m(now, 0.35, 2.0, 12.0);
        // Where the straight path first comes within the clearance, or never.
        let reach = obstacle[2] + CLEARANCE_M;
        let conflict = obstacle[0] - (reach * reach - obstacle[1] * obstacle[1]).max(0.0).sqrt();
        let crosses = obstacle[1].abs() < reach;
        // What counts is the nearest hit of each slot: it may lie a slot's width, a 45th of the distance, inside the
        // edge.
        let seen_reach = reach - 0.02 - conflict.max(0.0) / 45.0;
        if crosses && obstacle[1].abs() < seen_reach && conflict < stopping - 0.3 {
            prop_assert_eq!(out.verdict.get(), Verdict::Braked);
            prop_assert_eq!(out.reason.get(), GuardReason::Obstacle);
        }
        if obstacle[1].abs() > reach + 0.05 {
            prop_assert_eq!(out.verdict.get(), Verdict::Passed, "{:?}, {} m free", out.reason, out.free_way_m);
        }
    }

    #[test]
    fn every_brake_is_continuous_within_its_limits_and_ends_at_rest(
        v in proptest::array::uniform3(-4.0..4.0f64), a in proptest::array::uniform3(-2.0..2.0f64),
        yaw_rate in -1.5..1.5f64, jerk in 3.0..30.0f64, since in 0.1..0.9f64,
    ) {
        // One second of flight around the state (v, a), and a long stop behind it.
        let (v, a) = (Vector3::from(v), Vector3::from(a));
        let from = jink_shared_types::bezier::End {
            position: Vector3::new(0.0, 0.0, common::DOWN_M),
            velocity: v,
            acceleration: a,
        };
        let there = jink_shared_types::motion::MotionState {
            position: Point::from_vector(from.position + v + a * 0.5),
            velocity: Velocity::from_vector(v + a),
            acceleration: Acceleration::from_vector(a),
            ..Default::default()
        };
        let mut first = trajectory(7, NOW_S, from, &[(there.end(), 1.0)]);
        first.pieces[0].yaw_rad = std::array::from_fn(|i| yaw_rate * i as f64 / 5.0);
        let rest = jink_shared_types::bezier::End {
            position: there.position.vector() + (v + a) * 6.0,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        let points = quintic_between(&there.end(), &rest, 12.0);
        let turned: [f64; 6] = std::array::from_fn(|i| if i < 2 { yaw_rate * (1.0 + 12.0 * i as f64 / 5.0) } else { yaw_rate * 3.4 });
        prop_assert!(first.push(BezierPiece::new(&points, turned, 12.0)));
        first.mode = Coded::new(TrajectoryMode::Plan);
        first.limits.speed_mps = 20.0;
        first.limits.climb_mps = 20.0;
        first.limits.descent_mps = 20.0;
        first.limits.acceleration_mps2 = 8.0;
        first.limits.jerk_mps3 = jerk;
        let moving = VehiclePose { velocity: v, ..VehiclePose::at(0.0, 0.0) };
        let ring = looking(&World::default(), moving, NOW_S);
        let mut guard = guard();
        let (out, _) = step(&mut guard, NOW_S, Some(&first), &ring, moving);
        prop_assume!(out.verdict == Verdict::Passed);
        // An obstacle where it will be in 0.8 s: nearer than any stopping distance.
        let t = NOW_S + since;
        let place = on(&first, t);
        let ahead = first.at(time(t + 0.8)).unwrap().position;
        let world = World(vec![[ahead.x_m, ahead.y_m, 0.3]]);
        prop_assume!(world.clearance_m(place.position.x, place.position.y) > CLEARANCE_M + 0.05);
        let mut blocked = common::ring();
        look(&mut blocked, &world, place, t);
        let (out, _) = step(&mut guard, t, None, &blocked, place);
        prop_assert_eq!(out.verdict.get(), Verdict::Braked);
        assert_is_a_good_brake(&out.trajectory, &first, t);
    }
}
