//! Space that no sensor sees, or saw a moment ago, is not flown into; but a sensor that falls silent stops nothing that
//! was approved while it was well.

use crate::common::{
    Lidar, VehiclePose, World, end, fly, guard, hovering_guard, on, points, random, ring, step, straight,
    time, trajectory,
};
use jink_collision_guard::guard::{Guard, GuardConfig};
use jink_shared_types::map::declared_as;
use jink_shared_types::motion::{GuardReason, Verdict, stopping_distance_m};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::RayKind;

const NOW_S: f64 = 10.0;

#[test]
fn a_path_beyond_what_the_sensor_sees_is_braked_as_unseen() {
    let lidar = Lidar {
        range_max_m: 3.5,
        ..Lidar::default()
    };
    let first = straight(7, NOW_S, 3.0, 2.0, 20.0);
    let mut ring = ring();
    fly(&mut ring, &|_| VehiclePose::at(0.0, 0.0), NOW_S - 0.2, NOW_S);
    let (cloud, header) = lidar.sweep(
        &World::default(),
        &|_| VehiclePose::at(0.0, 0.0),
        NOW_S,
        &mut random(1),
    );
    ring.cloud(0, &cloud, &header).unwrap();
    let mut guard = guard();
    let (out, _) = step(&mut guard, NOW_S, Some(&first), &ring, VehiclePose::at(0.0, 0.0));
    assert_eq!(out.verdict, Verdict::Passed);
    assert!((out.free_way_m - 3.5).abs() < 0.1, "{}", out.free_way_m);
    let mut reason = GuardReason::None;
    for i in 1..60 {
        let t = NOW_S + 0.05 * f64::from(i);
        let place = |t: f64| on(&first, t);
        fly(&mut ring, &place, t - 0.04, t);
        let (cloud, header) = lidar.sweep(&World::default(), &place, t, &mut random(1));
        ring.cloud(0, &cloud, &header).unwrap();
        let (out, step_events) = step(&mut guard, t, None, &ring, place(t));
        if out.verdict == Verdict::Braked {
            assert_eq!(step_events.events()[0].name.as_str(), "unseen");
            reason = out.reason.get();
            break;
        }
        let speed = first.at(time(t)).unwrap().velocity.vector().norm();
        assert!(
            stopping_distance_m(speed, 0.35, 2.0, 12.0) < 3.6,
            "too fast for what is seen: {speed}"
        );
    }
    assert_eq!(reason, GuardReason::Unseen);
}

#[test]
fn above_what_is_seen_to_be_free_is_free_only_where_the_user_declares_it_and_the_trajectory_depends_on_it() {
    // A lidar sees the ground 9 m ahead: its rays leave the height band after 2.3 m.
    let place = VehiclePose::at(0.0, 0.0);
    let mut ring = ring();
    fly(&mut ring, &|_| place, NOW_S - 0.2, NOW_S);
    let ends: Vec<_> = (-40..=40)
        .map(|i| ([9.0, 0.1 * f64::from(i), 2.0], RayKind::Hit))
        .collect();
    let (cloud, header) = points(&ends, 40.0, NOW_S);
    ring.cloud(0, &cloud, &header).unwrap();
    let declare = |is_declared: bool| {
        let mut params = ParamSet::default();
        if is_declared {
            params.set("OA_DCL_HANG_HI", 10.0).unwrap();
        }
        GuardConfig::from_params(&params)
    };
    let rest = end([0.0, 0.0], [0.0, 0.0]);
    for (is_declared, declarations, verdict) in [
        (false, 0, Verdict::Hold),
        (false, declared_as::NO_OVERHANG, Verdict::Hold),
        (true, 0, Verdict::Hold),
        (true, declared_as::NO_OVERHANG, Verdict::Passed),
    ] {
        let mut start = trajectory(7, NOW_S, rest, &[(end([8.0, 0.0], [0.0, 0.0]), 4.0)]);
        start.declarations = declarations;
        let mut guard = Guard::new(declare(is_declared), 3);
        let (out, _) = step(&mut guard, NOW_S, Some(&start), &ring, place);
        assert_eq!(
            out.verdict.get(),
            verdict,
            "{is_declared} {declarations} {:?}",
            out.reason
        );
    }
}

#[test]
fn a_start_into_a_sector_without_data_is_refused() {
    // A camera that looks north.
    let lidar = Lidar {
        half_width_rad: 0.75,
        ..Lidar::default()
    };
    let place = VehiclePose::at(0.0, 0.0);
    let mut ring = ring();
    fly(&mut ring, &|_| place, NOW_S - 0.2, NOW_S);
    let (cloud, header) = lidar.sweep(&World::default(), &|_| place, NOW_S, &mut random(1));
    ring.cloud(0, &cloud, &header).unwrap();
    let rest = end([0.0, 0.0], [0.0, 0.0]);
    for (to, verdict, reason) in [
        ([5.0, 0.0], Verdict::Passed, GuardReason::None),
        ([0.0, 5.0], Verdict::Hold, GuardReason::Unseen),
        ([-5.0, 0.0], Verdict::Hold, GuardReason::Unseen),
    ] {
        let start = trajectory(7, NOW_S, rest, &[(end(to, [0.0, 0.0]), 5.0)]);
        let (out, _) = step(&mut guard(), NOW_S, Some(&start), &ring, place);
        assert_eq!(
            (out.verdict.get(), out.reason.get()),
            (verdict, reason),
            "to {to:?}"
        );
    }
}

#[test]
fn what_a_camera_has_seen_counts_for_a_while_after_it_has_turned_away() {
    let lidar = Lidar {
        half_width_rad: 0.75,
        ..Lidar::default()
    };
    let north = VehiclePose::at(0.0, 0.0);
    let east = north.turned(0.0, 0.0, 1.6);
    let beside = World(vec![[0.8, 0.6, 0.3]]);
    let rest = end([0.0, 0.0], [0.0, 0.0]);
    let start = |t: f64| trajectory(7, t, rest, &[(end([6.0, 0.0], [0.0, 0.0]), 5.0)]);
    for (world, waited_s, verdict) in [
        (World::default(), 9.0, Verdict::Passed),
        (World::default(), 11.0, Verdict::Hold),
        // Free where it leads, but not with the clearance around it.
        (beside, 1.0, Verdict::Hold),
    ] {
        let mut ring = ring();
        let mut show = |place: VehiclePose, t: f64| {
            fly(&mut ring, &|_| place, t - 0.2, t);
            let (cloud, header) = lidar.sweep(&world, &|_| place, t, &mut random(1));
            ring.cloud(0, &cloud, &header).unwrap();
        };
        show(north, NOW_S);
        show(east, NOW_S + 0.5);
        let t = NOW_S + waited_s;
        show(east, t);
        let (out, _) = step(&mut guard(), t, Some(&start(t)), &ring, east);
        assert_eq!(
            out.verdict, verdict,
            "{:?} after {waited_s} s, {:?}",
            out.reason, world.0
        );
    }
}

#[test]
fn a_dead_sensor_does_not_brake_what_was_approved_but_blocks_what_is_new() {
    // One sensor covers ahead, the other back; the one ahead no longer answers.
    let half = Lidar {
        half_width_rad: 1.5,
        ..Lidar::default()
    };
    let first = straight(7, NOW_S, 3.0, 2.0, 30.0);
    let mut ring = ring();
    let mut guard = guard();
    for i in 0..40 {
        let t = NOW_S + 0.1 * f64::from(i);
        let place = |t: f64| on(&first, t);
        let backward = |t: f64| place(t).turned(0.0, 0.0, std::f64::consts::PI);
        fly(&mut ring, &place, t - 0.2, t);
        if i < 20 {
            let (cloud, header) = half.sweep(&World::default(), &place, t, &mut random(1));
            ring.cloud(0, &cloud, &header).unwrap();
        }
        let (mut cloud, header) = half.sweep(&World::default(), &backward, t, &mut random(1));
        for point in &mut cloud.points {
            (point.forward_m, point.right_m) = (-point.forward_m, -point.right_m);
        }
        ring.cloud(1, &cloud, &header).unwrap();
        let candidate = (i == 0).then_some(&first);
        let (out, step_events) = step(&mut guard, t, candidate, &ring, place(t));
        assert_eq!(out.verdict, Verdict::Passed, "{:?} at {t}", out.reason);
        assert!(step_events.events().is_empty());
    }
    let t = NOW_S + 3.95;
    let mut next = first;
    (next.id, next.base_id, next.splice) = (8, 7, time(t + 0.1));
    let (out, _) = step(&mut guard, t, Some(&next), &ring, on(&first, t));
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Kept, GuardReason::Unseen)
    );
}

#[test]
fn ranges_that_stop_altogether_brake_nothing() {
    let first = straight(7, NOW_S, 3.0, 2.0, 30.0);
    let (mut guard, ring) = hovering_guard(NOW_S);
    step(&mut guard, NOW_S, Some(&first), &ring, VehiclePose::at(0.0, 0.0));
    for i in 1..200 {
        let t = NOW_S + 0.1 * f64::from(i);
        let (out, _) = step(&mut guard, t, None, &ring, on(&first, t));
        assert_eq!(out.trajectory.id, 7);
    }
}
