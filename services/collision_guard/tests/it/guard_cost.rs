//! What the guard costs: point clouds of a lidar in a forest into a layer of the ring, layers into the sector ring, and a step
//! of the guard on a flight at 3 m/s along a line of cylinders, with a new trajectory in every step and without.
//!
//! `cargo bench -p jink-collision-guard --bench guard_cost`
//!
//! Clouds come in the two orders that sensors have, azimuth by azimuth and row by row, and, as the worst case for
//! caches and branch prediction, shuffled.

mod common;

use common::{DOWN_M, Lidar, VehiclePose, World, fly, guard, on, random, ring, step, straight, time};
use jink_collision_guard::ring::Ring;
use jink_shared_types::SampleHeader;
use jink_shared_types::motion::Verdict;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::ring::SectorRing;
use nalgebra::Vector3;
use rand::RngExt;
use rand::seq::SliceRandom;
use std::hint::black_box;
use std::time::Instant;

const RUNS: usize = 1_000;
const RANGE_MAX_M: f64 = 30.0;
/// When the sweep ends that the ring is measured with (s), and how long it takes (s).
const END_S: f64 = 100.0;
const SWEEP_S: f64 = 0.1;

fn main() {
    println!(
        "{:<44} {:>9} {:>9} {:>9} {:>9}",
        "what", "min us", "p50 us", "p99 us", "max us"
    );
    ring_costs();
    let world = World(
        (0..40)
            .map(|i| [1.0 + f64::from(i), if i % 2 == 0 { 2.0 } else { -2.0 }, 0.3])
            .collect(),
    );
    for sensors in [1, 4] {
        for (replan, name) in [(false, "watching"), (true, "judging a new trajectory")] {
            report(
                &format!("{name}, {sensors} sensors"),
                &step_costs(&world, sensors, replan),
            );
        }
    }
}

fn report(what: &str, us: &[f64]) {
    let [min, p50, p99, max] = quantiles(us, [0.0, 0.5, 0.99, 1.0]).unwrap_or_default();
    println!("{what:<44} {min:>9.1} {p50:>9.1} {p99:>9.1} {max:>9.1}");
}

fn measure(what: &str, mut run: impl FnMut() -> bool) {
    let us: Vec<f64> = (0..RUNS)
        .map(|_| {
            let begin = Instant::now();
            assert!(black_box(run()), "{what} did nothing");
            begin.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    report(what, &us);
}

fn ring_costs() {
    let header = SampleHeader::at(time(END_S));
    for points in [20_000, 100_000] {
        for (order, name) in [
            (Order::Columns, "columns"),
            (Order::Rows, "rows"),
            (Order::Shuffled, "shuffled"),
        ] {
            let cloud = forest(points, order);
            let mut ring = flying();
            measure(&format!("cloud, {} points, {name}", cloud.len), || {
                ring.cloud(0, black_box(&cloud), &header).is_ok()
            });
        }
    }
    // A 2-D lidar with gaps between its beams, and one whose beams touch each other.
    for (beams, width_rad) in [(1_024, 0.006), (1_000, std::f64::consts::TAU / 1e3)] {
        let mut ring = flying();
        let scan = turn(beams, width_rad);
        measure(
            &format!("scan, {beams} beams of {:.2} deg", width_rad.to_degrees()),
            || ring.scan(1, black_box(&scan), &header).is_ok(),
        );
    }
    let mut ring = flying();
    let cloud = forest(20_000, Order::Columns);
    for sensor in 0..4 {
        let taken = ring.cloud(sensor, &cloud, &header);
        assert!(taken.is_ok(), "{taken:?}");
    }
    let mut out = SectorRing::default();
    measure("sector ring of 4 layers, 30 ms later", || {
        ring.ring(time(END_S + 0.03), black_box(&mut out));
        out.distance_m.iter().any(|distance| distance.is_finite())
    });
    // As many views as are remembered, of a flight that has seen no level obstacle.
    let ring = ring_in_flight();
    measure("sector ring of 1 layer and what it remembers", || {
        ring.ring(time(END_S), black_box(&mut out));
        out.range_max_m.iter().any(|reach_m| *reach_m > 0.0)
    });
}

/// A ring after ten seconds at 5 m/s.
fn ring_in_flight() -> Ring {
    let along = |t: f64| VehiclePose {
        velocity: Vector3::new(5.0, 0.0, 0.0),
        ..VehiclePose::at(5.0 * (t - END_S), 0.0)
    };
    let mut ring = ring();
    let lidar = Lidar {
        range_max_m: RANGE_MAX_M,
        ..Lidar::default()
    };
    for i in (0..100).rev() {
        let end_s = END_S - 0.1 * f64::from(i);
        fly(&mut ring, &along, end_s - SWEEP_S, end_s);
        let (cloud, header) = lidar.sweep(&World(Vec::new()), &along, end_s, &mut random(1));
        let taken = ring.cloud(0, &cloud, &header);
        assert!(taken.is_ok(), "{taken:?}");
    }
    ring
}

/// A scan of a 2-D lidar whose turn takes the whole sweep.
fn turn(beams: u32, width_rad: f64) -> RangeScan {
    let count = f64::from(beams);
    RangeScan {
        first_beam: time(END_S - SWEEP_S),
        beam_interval_s: (SWEEP_S / count) as f32,
        angle_step_rad: (std::f64::consts::TAU / count) as f32,
        beam_width_rad: width_rad as f32,
        range_min_m: 0.1,
        range_max_m: RANGE_MAX_M as f32,
        beams,
        range_m: std::array::from_fn(|i| 3.0 + (i % 37) as f32),
        ..RangeScan::default()
    }
}

/// A vehicle that flies at 5 m/s, nose down, turning.
fn place(t: f64) -> VehiclePose {
    let since_s = t - (END_S - SWEEP_S);
    VehiclePose {
        position: Vector3::new(5.0 * since_s, 0.0, DOWN_M),
        velocity: Vector3::new(5.0, 0.0, 0.0),
        rates: Vector3::new(0.0, 0.0, 0.5),
        ..VehiclePose::at(0.0, 0.0)
    }
    .turned(0.05, -0.15, 0.5 * since_s)
}

/// A ring that knows its poses.
fn flying() -> Ring {
    let mut ring = ring();
    fly(&mut ring, &place, END_S - SWEEP_S, END_S + 0.04);
    ring
}

#[derive(Clone, Copy, PartialEq)]
enum Order {
    Columns,
    Rows,
    Shuffled,
}

/// What a lidar of 64 rows, 30 degrees up and down, sees 2 m above the ground among 200 trees of 0.4 m.
fn forest(points: usize, order: Order) -> Box<PointCloud> {
    const ROWS: usize = 64;
    let mut random = random(7);
    let world = World(
        (0..200)
            .map(|_| {
                [
                    random.random_range(-30.0..30.0),
                    random.random_range(-30.0..30.0),
                    0.2,
                ]
            })
            .filter(|[x, y, _]: &[f64; 3]| x.hypot(*y) > 1.5)
            .collect(),
    );
    let lidar = Lidar {
        rows: ROWS,
        columns: points / ROWS,
        half_height_rad: 30.0_f64.to_radians(),
        range_max_m: RANGE_MAX_M,
        sigma_m: 0.01,
        sweep_s: SWEEP_S,
        ..Lidar::default()
    };
    let (mut cloud, _) = lidar.sweep(&world, &place, END_S, &mut random);
    let count = cloud.len as usize;
    let columns = cloud.points[..count].to_vec();
    match order {
        Order::Columns => {}
        Order::Rows => {
            let by_row = (0..ROWS).flat_map(|row| columns[row..].iter().step_by(ROWS));
            cloud
                .points
                .iter_mut()
                .zip(by_row)
                .for_each(|(to, from)| *to = *from);
        }
        Order::Shuffled => cloud.points[..count].shuffle(&mut random),
    }
    cloud
}

fn step_costs(world: &World, sensors: usize, replan: bool) -> Vec<f64> {
    let lidar = Lidar {
        sigma_m: 0.03,
        ..Lidar::default()
    };
    let mut way = straight(7, 10.0, 3.0, 2.0, 40.0);
    let (mut guard, mut ring) = (guard(), ring());
    let mut us = Vec::new();
    for i in 0..300_u32 {
        let t = 10.0 + 0.05 * f64::from(i);
        let place = |t: f64| on(&way, t);
        fly(&mut ring, &place, t - 0.2, t);
        for sensor in 0..sensors {
            let seed = u64::from(i) * 8 + sensor as u64;
            let (cloud, header) = lidar.sweep(world, &place, t, &mut random(seed));
            let taken = ring.cloud(sensor, &cloud, &header);
            assert!(taken.is_ok(), "{taken:?}");
        }
        let mut next = way;
        if i > 0 {
            (next.id, next.base_id, next.splice) = (way.id + 1, way.id, time(t + 0.1));
        }
        let candidate = (i == 0 || replan).then_some(&next);
        let here = place(t);
        let begin = Instant::now();
        let (out, _) = step(&mut guard, t, candidate, &ring, here);
        us.push(begin.elapsed().as_secs_f64() * 1e6);
        assert_eq!(out.verdict.get(), Verdict::Passed, "{:?} at {t}", out.reason);
        way = out.trajectory;
    }
    us
}
