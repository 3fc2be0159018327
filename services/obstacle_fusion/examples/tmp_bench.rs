//! Time of one map update in a synthetic forest: a lidar vehicle flies along a lane at 3 m/s while turning slowly.
//!
//! `cargo run --release -p jink-obstacle-fusion --example map_update`
//!
//! An update is what the service does for one cloud: enter it and write the map. Vehicle states are not timed (they
//! cost microseconds). Percentiles are over wall time; run it on an idle machine.
#[path = "../tests/world/mod.rs"]
mod world;

use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::map::LocalMap;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::PointCloud;
use nalgebra::{UnitQuaternion, Vector3};
use std::time::Instant;
use world::{Lidar, Motion, Shape, at, forest, header};

const SWEEP_S: f64 = 0.1;
const SWEEPS: usize = 200;

fn motion(t_s: f64) -> Motion {
    Motion {
        position_m: Vector3::new(-30.0 + 3.0 * t_s, 0.0, -2.0),
        velocity_mps: Vector3::new(3.0, 0.0, 0.0),
        attitude: UnitQuaternion::from_euler_angles(0.0, -0.1, 0.3 * t_s),
        rates_radps: UnitQuaternion::from_euler_angles(0.0, -0.1, 0.0).inverse()
            * Vector3::new(0.0, 0.0, 0.3),
    }
}

fn main() {
    for rays in [20_000, 100_000] {
        let world = forest(120.0, 7);
        let lidar = Lidar {
            rays,
            sweep_s: SWEEP_S,
            ..Lidar::default()
        };
        let n = 12;
        let clouds: Vec<_> = (0..n)
            .map(|sweep| {
                let mut c = PointCloud::boxed();
                let end_s = (sweep + 1) as f64 * SWEEP_S + 5.0;
                let near: Vec<Shape> = world
                    .iter()
                    .filter(|shape| shape.distance_m(&motion(end_s).position_m) < 41.0)
                    .copied()
                    .collect();
                lidar.sweep(&near, motion, end_s, sweep, &mut c);
                c
            })
            .collect();
        let mut best = vec![f64::INFINITY; n];
        let mut map = LocalMap::boxed();
        for _ in 0..40 {
            let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
            for k in 0..20 {
                let t_s = 4.6 + k as f64 * 0.02;
                fusion.vehicle(&motion(t_s).state(), &header(t_s));
            }
            for (sweep, c) in clouds.iter().enumerate() {
                let end_s = (sweep + 1) as f64 * SWEEP_S + 5.0;
                for k in 1..=5 {
                    let t_s = end_s - 0.1 + k as f64 * 0.02;
                    fusion.vehicle(&motion(t_s).state(), &header(t_s));
                }
                let begin = Instant::now();
                fusion.cloud(0, c, &header(end_s));
                fusion.write(at(end_s), &mut map);
                best[sweep] = best[sweep].min(begin.elapsed().as_secs_f64() * 1e3);
            }
        }
        best.sort_by(f64::total_cmp);
        println!(
            "{rays} min-of-40: median over sweeps {:.2} max {:.2}  known {} occ {}",
            best[n / 2],
            best[n - 1],
            map.known_cells,
            map.occupied_cells
        );
    }
}
