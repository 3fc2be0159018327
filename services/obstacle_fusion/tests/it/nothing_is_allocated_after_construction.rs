//! The hot path allocates nothing: a counting allocator sees every call between construction and the last map.

use crate::world::{Lidar, VehicleMotion, at, forest, header};
use allocation_counter::measure;
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::map::LocalMap;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::vehicle::VehicleState;
use nalgebra::Vector3;

#[test]
fn states_clouds_scans_and_maps_allocate_nothing() {
    let world = forest(40.0, 3);
    let lidar = Lidar {
        rays: 5_000,
        sweep_s: 0.1,
        ..Lidar::default()
    };
    let motion = |t_s: f64| VehicleMotion {
        velocity_mps: Vector3::new(8.0, 0.0, 0.0),
        ..VehicleMotion::still(Vector3::new(8.0 * t_s, 0.0, -2.0))
    };
    let clouds: Vec<_> = (1..=10)
        .map(|sweep| {
            let mut cloud = PointCloud::boxed();
            lidar.sweep(&world, motion, f64::from(sweep) * 0.1, sweep as usize, &mut cloud);
            cloud
        })
        .collect();
    let mut scan = RangeScan {
        range_max_m: 20.0,
        beam_width_rad: 0.3,
        beams: 8,
        angle_step_rad: 0.7,
        ..RangeScan::default()
    };
    scan.range_m[..8].copy_from_slice(&[5.0, 0.0, f32::NAN, f32::INFINITY, 9.0, 1e30, -1.0, 3.0]);
    let mut map = LocalMap::boxed();

    let mut fusion = None;
    let in_new = measure(|| fusion = Some(Fusion::new(FusionConfig::from_params(&ParamSet::default(), 2))));
    assert!(in_new.count_total > 0, "the counter counts");
    let mut fusion = fusion.unwrap();
    let in_flight = measure(|| {
        for (sweep, cloud) in clouds.iter().enumerate() {
            for i in 1..=5 {
                let t_s = sweep as f64 * 0.1 + f64::from(i) * 0.02;
                fusion.vehicle(&motion(t_s).state(), &header(t_s));
            }
            let end_s = (sweep + 1) as f64 * 0.1;
            fusion.cloud(0, cloud, &header(end_s));
            scan.first_beam = at(end_s);
            fusion.scan(1, &scan, &header(end_s));
            fusion.write(at(end_s), &mut map);
        }
        let reset = VehicleState {
            estimator_resets: 1,
            ..motion(1.02).state()
        };
        fusion.vehicle(&reset, &header(1.02));
        fusion.cloud(5, &clouds[0], &header(1.02));
        fusion.write(at(1.02), &mut map);
    });
    assert_eq!(in_flight.count_total, 0);
    assert_eq!(map.epoch, 1, "all of it has really run");
    assert!(fusion.counters().rays_malformed > 0 && fusion.counters().frames_refused == 1);
}
