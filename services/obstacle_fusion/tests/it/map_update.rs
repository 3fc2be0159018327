//! Time of one map update in a synthetic forest: a vehicle with a lidar flies along a lane at 3 m/s while it turns.
//!
//! `cargo bench -p jink-obstacle-fusion --bench map_update`
//!
//! An update is what the service does for one cloud: enter it and write the map. Vehicle states are not timed (they
//! cost microseconds). Every cloud is entered into several maps that have seen the same flight: percentiles over all of
//! them are wall times as they come; percentiles over the fastest of each cloud show the work itself where other
//! programs take the processor away.
mod world;

use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::map::LocalMap;
use jink_shared_types::params::ParamSet;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::ranges::PointCloud;
use nalgebra::{UnitQuaternion, Vector3};
use std::time::Instant;
use world::{Lidar, VehicleMotion, WorldShape, at, forest, header};

const SWEEP_S: f64 = 0.1;
const SWEEPS: usize = 200;
const MAPS: usize = 5;

fn motion(t_s: f64) -> VehicleMotion {
    VehicleMotion {
        position_m: Vector3::new(-30.0 + 3.0 * t_s, 0.0, -2.0),
        velocity_mps: Vector3::new(3.0, 0.0, 0.0),
        attitude: UnitQuaternion::from_euler_angles(0.0, -0.1, 0.3 * t_s),
        rates_radps: UnitQuaternion::from_euler_angles(0.0, -0.1, 0.0).inverse()
            * Vector3::new(0.0, 0.0, 0.3),
    }
}

fn main() {
    println!("forest, one post per 25 m2, {SWEEPS} sweeps of 100 ms, 3 m/s; milliseconds per update");
    println!("  points   all: p50    p99    max   fastest of {MAPS}: p50    p99    max      known  occupied");
    for rays in [20_000, 100_000] {
        run(rays);
    }
}

fn run(rays: usize) {
    let world = forest(120.0, 7);
    let lidar = Lidar {
        rays,
        sweep_s: SWEEP_S,
        ..Lidar::default()
    };
    let config = FusionConfig::from_params(&ParamSet::default(), 1);
    let mut maps: Vec<Fusion> = (0..MAPS).map(|_| Fusion::new(config)).collect();
    let mut cloud = PointCloud::boxed();
    let mut map = LocalMap::boxed();
    let (mut all_ms, mut fastest_ms) = (Vec::new(), Vec::new());
    let mut states = 0;
    for sweep in 0..SWEEPS {
        let end_s = (sweep + 1) as f64 * SWEEP_S;
        while f64::from(states) * 0.02 <= end_s {
            let t_s = f64::from(states) * 0.02;
            for fusion in &mut maps {
                fusion.vehicle(&motion(t_s).state(), &header(t_s));
            }
            states += 1;
        }
        let here = motion(end_s).position_m;
        let near: Vec<WorldShape> = world
            .iter()
            .filter(|shape| shape.distance_m(&here) < lidar.range_max_m + 1.0)
            .copied()
            .collect();
        lidar.sweep(&near, motion, end_s, sweep, &mut cloud);
        let times_ms = maps.iter_mut().map(|fusion| {
            let begin = Instant::now();
            fusion.cloud(0, &cloud, &header(end_s));
            fusion.write(at(end_s), &mut map);
            begin.elapsed().as_secs_f64() * 1e3
        });
        let times_ms: Vec<f64> = times_ms.collect();
        fastest_ms.push(times_ms.iter().copied().fold(f64::INFINITY, f64::min));
        all_ms.extend(times_ms);
    }
    let [p50, p99, max] = percentiles(&all_ms);
    let [fast_p50, fast_p99, fast_max] = percentiles(&fastest_ms);
    println!(
        "{rays:>8}   {p50:>8.2} {p99:>6.2} {max:>6.2}   {fast_p50:>17.2} {fast_p99:>6.2} {fast_max:>6.2} {:>10} {:>9}",
        map.known_cells, map.occupied_cells
    );
}

/// Median, 99th percentile and maximum.
fn percentiles(times_ms: &[f64]) -> [f64; 3] {
    quantiles(times_ms, [0.5, 0.99, 1.0]).unwrap_or_default()
}
