//! The same inputs give the same map, to the bit, whatever ran before in the process.

use crate::world::{Lidar, VehicleMotion, at, forest, header};
use jink_obstacle_fusion::{Fusion, FusionConfig, RejectedCounts};
use jink_shared_types::map::LocalMap;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::PointCloud;
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

fn flight(seed: u64) -> (Box<LocalMap>, RejectedCounts) {
    let world = forest(40.0, seed);
    let mut random = SplitMix64::seed_from_u64(seed);
    let motion = |t_s: f64| VehicleMotion {
        position_m: Vector3::new(-5.0 + 6.0 * t_s, 0.4 * t_s.sin(), -2.0),
        velocity_mps: Vector3::new(6.0, 0.4 * t_s.cos(), 0.0),
        attitude: UnitQuaternion::from_euler_angles(0.1 * t_s, -0.2, t_s),
        rates_radps: Vector3::new(0.1, 0.0, 1.0),
    };
    let lidar = Lidar {
        rays: 8_000,
        sweep_s: 0.1,
        ..Lidar::default()
    };
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    let mut cloud = PointCloud::boxed();
    let mut map = LocalMap::boxed();
    for sweep in 0..15 {
        let start_s = sweep as f64 * 0.1;
        for i in 0..5 {
            let t_s = start_s + f64::from(i) * 0.02 + random.random_range(0.0..0.01);
            fusion.vehicle(&motion(t_s).state(), &header(t_s));
        }
        lidar.sweep(&world, motion, start_s + 0.1, sweep, &mut cloud);
        for point in &mut cloud.points[..8_000] {
            point.forward_m += random.random_range(-0.03..0.03) as f32;
        }
        fusion.cloud(0, &cloud, &header(start_s + 0.1));
        fusion.write(at(start_s + 0.1), &mut map);
    }
    (map, fusion.counters())
}

#[test]
fn a_flight_repeats_to_the_bit() {
    let (first, first_counters) = flight(11);
    let (other, _) = flight(12);
    let (second, second_counters) = flight(11);
    assert!(first.occupied == second.occupied && first.known == second.known);
    assert_eq!(first.min_cell, second.min_cell);
    assert_eq!(
        (first.occupied_cells, first.known_cells),
        (second.occupied_cells, second.known_cells)
    );
    assert_eq!(first_counters, second_counters);
    assert!(
        first.known_cells > 50_000 && first.known != other.known,
        "the flights are not trivial"
    );
}
