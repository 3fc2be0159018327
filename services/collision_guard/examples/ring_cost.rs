//! What the ring costs: point clouds of a lidar in a forest into a layer, and the layer into the sector ring.
//!
//! `cargo run --release -p jink-collision-guard --example ring_cost`
//!
//! Clouds come in the two orders that sensors have, azimuth by azimuth and row by row, and, as the worst case for
//! caches and branch prediction, shuffled.

use jink_collision_guard::ring::Ring;
use jink_shared_types::frames::{AngularRate, Attitude};
use jink_shared_types::params::ParamSet;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RangeScan, RayKind};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Coded, Flag, Point, Reserved, SampleHeader, Timestamp, Velocity};
use nalgebra::UnitQuaternion;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;
use std::hint::black_box;
use std::time::Instant;

const RUNS: usize = 1_000;
const RANGE_MAX_M: f64 = 30.0;
const HEIGHT_M: f64 = 2.0;
const SWEEP_S: f64 = 0.1;

fn main() {
    println!(
        "{:<44} {:>9} {:>9} {:>9} {:>9}",
        "what", "min us", "p50 us", "p99 us", "max us"
    );
    for points in [20_000, 100_000] {
        for (order, name) in [
            (Order::Columns, "columns"),
            (Order::Rows, "rows"),
            (Order::Shuffled, "shuffled"),
        ] {
            let cloud = forest(points, order);
            let mut ring = flying();
            report(&format!("cloud, {} points, {name}", cloud.len), || {
                ring.cloud(0, black_box(&cloud), &SampleHeader::at(last()))
                    .is_ok()
            });
        }
    }
    // A 2-D lidar with gaps between its beams, and one whose beams touch each other.
    for (beams, width_rad) in [(1_024, 0.006), (1_000, std::f64::consts::TAU / 1e3)] {
        let mut ring = flying();
        let scan = turn(beams, width_rad);
        report(
            &format!("scan, {beams} beams of {:.2} deg", width_rad.to_degrees()),
            || ring.scan(1, black_box(&scan), &SampleHeader::at(last())).is_ok(),
        );
    }
    let mut ring = flying();
    let cloud = forest(20_000, Order::Columns);
    for sensor in 0..4 {
        let taken = ring.cloud(sensor, &cloud, &SampleHeader::at(last()));
        assert!(taken.is_ok(), "{taken:?}");
    }
    let mut out = SectorRing::default();
    report("sector ring of 4 layers, 30 ms later", || {
        ring.ring(last().plus_seconds(0.03), black_box(&mut out));
        out.distance_m.iter().any(|distance| distance.is_finite())
    });
}

/// A scan of a 2-D lidar whose turn takes the whole sweep.
fn turn(beams: u32, width_rad: f64) -> RangeScan {
    let count = f64::from(beams);
    RangeScan {
        first_beam: first(),
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

fn report(what: &str, mut run: impl FnMut() -> bool) {
    let us: Vec<f64> = (0..RUNS)
        .map(|_| {
            let begin = Instant::now();
            assert!(black_box(run()), "{what} did nothing");
            begin.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    let [min, p50, p99, max] = quantiles(&us, [0.0, 0.5, 0.99, 1.0]).unwrap_or_default();
    println!("{what:<44} {min:>9.1} {p50:>9.1} {p99:>9.1} {max:>9.1}");
}

fn first() -> Timestamp {
    Timestamp::from_seconds(100.0)
}

fn last() -> Timestamp {
    first().plus_seconds(SWEEP_S)
}

/// A ring that knows the poses of a vehicle that flies at 5 m/s, nose down, turning.
fn flying() -> Ring {
    let mut ring = Ring::from_params(&ParamSet::default());
    for i in 0..8 {
        let t_s = 0.02 * f64::from(i);
        let state = VehicleState {
            position: Point::new(5.0 * t_s, 0.0, -HEIGHT_M),
            velocity: Velocity::new(5.0, 0.0, 0.0),
            attitude: Attitude::from_rotation(UnitQuaternion::from_euler_angles(0.05, -0.15, 0.5 * t_s)),
            rates: AngularRate::new(0.0, 0.0, 0.5),
            position_valid: Flag::YES,
            ..VehicleState::default()
        };
        let taken = ring.vehicle(&state, &SampleHeader::at(first().plus_seconds(t_s)));
        assert!(taken.is_ok(), "{taken:?}");
    }
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
    let columns = points / ROWS;
    let mut random = SplitMix64::seed_from_u64(7);
    let trees: Vec<(f64, f64)> = (0..200)
        .map(|_| {
            (
                random.random_range(-30.0..30.0_f64),
                random.random_range(-30.0..30.0_f64),
            )
        })
        .filter(|(x, y)| x.hypot(*y) > 1.5)
        .collect();
    let mut rays: Vec<(usize, usize)> = (0..columns)
        .flat_map(|column| (0..ROWS).map(move |row| (column, row)))
        .collect();
    match order {
        Order::Columns => {}
        Order::Rows => rays.sort_by_key(|(column, row)| (*row, *column)),
        Order::Shuffled => {
            for i in (1..rays.len()).rev() {
                rays.swap(i, random.random_range(0..=i));
            }
        }
    }
    let mut cloud = PointCloud::boxed();
    cloud.first_point = first();
    cloud.range_min_m = 0.3;
    cloud.range_max_m = RANGE_MAX_M as f32;
    for (column, row) in rays {
        let azimuth = std::f64::consts::TAU * column as f64 / columns as f64;
        let elevation = (row as f64 / (ROWS - 1) as f64 - 0.5) * 60.0_f64.to_radians();
        let (range, kind) = cast(&trees, azimuth, elevation);
        let range = range + random.random_range(-0.01..0.01);
        assert!(cloud.push(CloudPoint {
            forward_m: (range * elevation.cos() * azimuth.cos()) as f32,
            right_m: (range * elevation.cos() * azimuth.sin()) as f32,
            down_m: (-range * elevation.sin()) as f32,
            offset_10us: (SWEEP_S * 1e5 * column as f64 / columns as f64) as u16,
            kind: Coded::new(kind),
            reserved: Reserved::ZERO,
        }));
    }
    cloud
}

fn cast(trees: &[(f64, f64)], azimuth: f64, elevation: f64) -> (f64, RayKind) {
    const TREE_RADIUS_M: f64 = 0.2;
    let mut level = RANGE_MAX_M * elevation.cos();
    if elevation < 0.0 {
        level = level.min(HEIGHT_M / (-elevation).tan());
    }
    let (sin, cos) = azimuth.sin_cos();
    for (x, y) in trees {
        let along = x * cos + y * sin;
        let aside = y * cos - x * sin;
        if along > 0.0 && aside.abs() < TREE_RADIUS_M {
            level = level.min(along - (TREE_RADIUS_M * TREE_RADIUS_M - aside * aside).sqrt());
        }
    }
    let range = level / elevation.cos();
    let kind = if range < RANGE_MAX_M - 1e-6 {
        RayKind::Hit
    } else {
        RayKind::Clear
    };
    (range, kind)
}
