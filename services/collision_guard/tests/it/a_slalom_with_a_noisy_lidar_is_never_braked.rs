//! A path planned with 0.4 m more clearance than the guard requires is flown at 3 m/s without a brake, though parts of
//! it are hidden behind the cylinders it winds around.

use crate::common::{DOWN_M, Lidar, World, fly, guard, limits, on, random, ring, step, time};
use jink_shared_types::Coded;
use jink_shared_types::bezier::{End, quintic_between};
use jink_shared_types::motion::{BezierPiece, Trajectory, TrajectoryMode, Verdict};
use nalgebra::Vector3;

const START_S: f64 = 10.0;
const SPEED_MPS: f64 = 3.0;
const CYLINDER_M: f64 = 0.3;
/// Radius 0.3, margin 0.1, and the 0.4 more.
const ASIDE_M: f64 = CYLINDER_M + 0.4 + 0.4;

/// Cylinders every `spacing` metres along a line, and the path that passes them left and right in turns.
fn slalom(spacing_m: f64, gates: usize) -> (World, Trajectory) {
    let world = World(
        (0..gates)
            .map(|i| [spacing_m * (i + 1) as f64, 0.0, CYLINDER_M])
            .collect(),
    );
    // Fastest where it crosses the line: there its speed is the one asked for.
    let slope = std::f64::consts::PI * ASIDE_M / spacing_m;
    let along_mps = SPEED_MPS / slope.hypot(1.0);
    let leg_s = spacing_m / along_mps;
    let bend_mps2 = ASIDE_M * (std::f64::consts::PI / leg_s).powi(2);
    let apex = |i: usize| {
        let side = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        End {
            position: Vector3::new(spacing_m * (i + 1) as f64, side * ASIDE_M, DOWN_M),
            velocity: Vector3::new(along_mps, 0.0, 0.0),
            acceleration: Vector3::new(0.0, -side * bend_mps2, 0.0),
        }
    };
    let mut way = Trajectory {
        id: 7,
        start: time(START_S),
        splice: time(START_S),
        limits: limits(),
        mode: Coded::new(TrajectoryMode::Plan),
        ..Trajectory::default()
    };
    way.limits.acceleration_mps2 = 6.0;
    way.limits.jerk_mps3 = 15.0;
    let rest = |x: f64, y: f64| End {
        position: Vector3::new(x, y, DOWN_M),
        velocity: Vector3::zeros(),
        acceleration: Vector3::zeros(),
    };
    let mut last = rest(0.0, ASIDE_M);
    for i in 0..gates {
        let duration_s = if i == 0 { 2.0 * leg_s } else { leg_s };
        let points = quintic_between(&last, &apex(i), duration_s);
        assert!(way.push(BezierPiece::new(&points, [0.0; 6], duration_s)));
        last = apex(i);
    }
    let stop = rest(last.position.x + 1.5 * along_mps, last.position.y);
    assert!(way.push(BezierPiece::new(
        &quintic_between(&last, &stop, 3.0),
        [0.0; 6],
        3.0
    )));
    (world, way)
}

/// Flies the slalom; a new trajectory along the same path every `replan_s`, if given. Returns the steps taken.
fn fly_through(spacing_m: f64, lidar: &Lidar, seed: u64, replan_s: Option<f64>) -> u32 {
    let (world, mut way) = slalom(spacing_m, 14);
    let mut random = random(seed);
    let mut guard = guard();
    let mut ring = ring();
    let mut steps = 0;
    let mut next_plan_s = START_S;
    let end_s = way.end().seconds();
    let mut sweeps = 0_u32;
    while START_S + 0.05 * f64::from(steps) < end_s {
        let t = START_S + 0.05 * f64::from(steps);
        let place = |t: f64| on(&way, t);
        fly(&mut ring, &place, t - 0.2, t);
        if t + 1e-9 >= START_S + 0.1 * f64::from(sweeps) {
            let (cloud, header) = lidar.sweep(&world, &place, t, &mut random);
            ring.cloud(0, &cloud, &header).unwrap();
            sweeps += 1;
        }
        let candidate = if steps == 0 {
            Some(way)
        } else if replan_s.is_some() && t >= next_plan_s {
            let mut next = way;
            next.id += 1;
            next.base_id = way.id;
            next.splice = time(t + 0.1);
            Some(next)
        } else {
            None
        };
        if candidate.is_some() {
            next_plan_s = t + replan_s.unwrap_or(0.0);
        }
        let here = place(t);
        let (out, step_events) = step(&mut guard, t, candidate.as_ref(), &ring, here);
        assert_eq!(
            out.verdict.get(),
            Verdict::Passed,
            "{:?} at {:.2} s, x = {:.2} m, {:.2} m free, {:.2} m to stop, spacing {spacing_m}",
            out.reason,
            t - START_S,
            here.position.x,
            out.free_way_m,
            out.stopping_m
        );
        assert!(step_events.events().is_empty());
        way = out.trajectory;
        steps += 1;
    }
    steps
}

#[test]
fn at_three_metres_per_second_between_cylinders() {
    let lidar = Lidar {
        sigma_m: 0.03,
        ..Lidar::default()
    };
    for (seed, spacing_m) in [(1, 6.0), (2, 5.0), (3, 7.5), (4, 4.5)] {
        assert!(fly_through(spacing_m, &lidar, seed, None) > 300);
    }
}

#[test]
fn with_a_new_trajectory_every_tenth_of_a_second() {
    let lidar = Lidar {
        sigma_m: 0.03,
        ..Lidar::default()
    };
    for (seed, spacing_m) in [(5, 6.0), (6, 5.0)] {
        assert!(fly_through(spacing_m, &lidar, seed, Some(0.1)) > 300);
    }
}

#[test]
fn with_a_short_sighted_lidar_of_few_rows() {
    let lidar = Lidar {
        rows: 16,
        half_height_rad: 0.6,
        range_max_m: 8.0,
        sigma_m: 0.03,
        ..Lidar::default()
    };
    for (seed, spacing_m) in [(7, 6.0), (8, 5.0)] {
        assert!(fly_through(spacing_m, &lidar, seed, Some(0.1)) > 300);
    }
}
