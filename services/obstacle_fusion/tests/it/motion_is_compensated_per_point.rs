//! A sweep takes a tenth of a second: every point is placed where the vehicle was when that point was measured.

use crate::world::{Lidar, VehicleMotion, WorldShape, at, distance_m, header, known};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::map::{CELL_M, Cell, LocalMap, center_of};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::PointCloud;
use nalgebra::{UnitQuaternion, Vector3};

const SWEEP_S: f64 = 0.1;

fn scene() -> Vec<WorldShape> {
    vec![
        WorldShape::Sphere {
            center_m: Vector3::new(5.0, 1.0, -2.0),
            radius_m: 1.0,
        },
        WorldShape::Sphere {
            center_m: Vector3::new(-3.0, 4.0, -3.0),
            radius_m: 1.5,
        },
        WorldShape::Post {
            north_m: 1.0,
            east_m: -4.0,
            radius_m: 0.4,
        },
        WorldShape::Block {
            center_m: Vector3::new(-6.0, -2.0, -2.0),
            half_m: Vector3::new(0.5, 3.0, 3.0),
        },
        WorldShape::Ground { down_m: 0.5 },
    ]
}

/// A banked turn at 6 m/s and 2 rad/s, at the origin's height half-way through the sweep.
fn turning(t_s: f64) -> VehicleMotion {
    let angle_rad = 2.0 * (t_s - 0.5 * SWEEP_S);
    let (sin, cos) = angle_rad.sin_cos();
    let attitude = UnitQuaternion::from_euler_angles(0.0, 0.0, angle_rad)
        * UnitQuaternion::from_euler_angles(0.5, -0.2, 0.0);
    VehicleMotion {
        position_m: Vector3::new(3.0 * sin, 3.0 * (1.0 - cos), -2.0),
        velocity_mps: Vector3::new(6.0 * cos, 6.0 * sin, 0.0),
        attitude,
        rates_radps: attitude.inverse() * Vector3::new(0.0, 0.0, 2.0),
    }
}

fn still(_: f64) -> VehicleMotion {
    VehicleMotion::still(Vector3::new(0.0, 0.0, -2.0))
}

/// The map of one sweep that ends at `SWEEP_S`; states at 50 Hz, the last one `blind_s` before the end of the sweep.
fn map_of(
    motion: impl Fn(f64) -> VehicleMotion,
    blind_s: f64,
    corrupt: impl Fn(&mut PointCloud),
) -> Box<LocalMap> {
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    for i in -5..=5 {
        let t_s = f64::from(i) * 0.02;
        if t_s <= SWEEP_S - blind_s + 1e-9 {
            fusion.vehicle(&motion(t_s).state(), &header(t_s));
        }
    }
    // Dense enough that neighbouring points are in neighbouring cells everywhere.
    let lidar = Lidar {
        rays: 60_000,
        sweep_s: SWEEP_S,
        range_max_m: 9.0,
        elevation_rad: (-1.5, 1.5),
        ..Lidar::default()
    };
    let mut cloud = PointCloud::boxed();
    lidar.sweep(&scene(), &motion, SWEEP_S, 0, &mut cloud);
    corrupt(&mut cloud);
    fusion.cloud(0, &cloud, &header(SWEEP_S));
    let mut map = LocalMap::boxed();
    fusion.write(at(SWEEP_S), &mut map);
    assert_eq!(fusion.counters().rays_without_pose, 0);
    map
}

fn occupied(map: &LocalMap) -> Vec<Cell> {
    known(map).filter(|cell| map.is_occupied(*cell)).collect()
}

/// Largest distance of an occupied cell's centre from a surface (m).
fn worst_m(map: &LocalMap) -> f64 {
    occupied(map)
        .iter()
        .map(|cell| distance_m(&scene(), &center_of(*cell).vector()).abs())
        .fold(0.0, f64::max)
}

/// Share of the cells of `of` that have a neighbour (26 and itself) in `map`.
fn found_share(of: &LocalMap, map: &LocalMap) -> f64 {
    let cells = occupied(of);
    let near = |cell: &&Cell| {
        (0..27).any(|i| map.is_occupied([cell[0] + i % 3 - 1, cell[1] + i / 3 % 3 - 1, cell[2] + i / 9 - 1]))
    };
    cells.iter().filter(near).count() as f64 / cells.len() as f64
}

const HALF_DIAGONAL_M: f64 = 0.5 * CELL_M * 1.732_050_9;

#[test]
fn a_moving_vehicle_sees_what_a_still_one_sees() {
    let (moving, resting) = (map_of(turning, 0.0, |_| {}), map_of(still, 0.0, |_| {}));
    assert!(occupied(&resting).len() > 3_000);
    // 2 mm for interpolation between states 20 ms apart.
    assert!(worst_m(&moving) <= HALF_DIAGONAL_M + 2e-3, "{}", worst_m(&moving));
    let share = found_share(&resting, &moving);
    assert!(share > 0.97, "{share} of what the still vehicle sees");
}

#[test]
fn without_the_times_of_the_points_the_same_sweep_would_be_smeared() {
    let smeared = map_of(turning, 0.0, |cloud| {
        let len = cloud.len as usize;
        cloud.points[..len]
            .iter_mut()
            .for_each(|point| point.offset_10us = 10_000);
    });
    assert!(worst_m(&smeared) > 2.0 * CELL_M, "{}", worst_m(&smeared));
}

#[test]
fn a_sweep_may_run_ahead_of_the_states_for_a_moment() {
    // 60 ms ahead at 12 m/s2 towards the centre of the turn: 22 mm, and the rates are carried on.
    let ahead = map_of(turning, 0.06, |_| {});
    assert!(worst_m(&ahead) <= HALF_DIAGONAL_M + 0.03, "{}", worst_m(&ahead));
}

#[test]
fn points_without_a_pose_are_counted_and_change_nothing() {
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    let lidar = Lidar {
        rays: 1_000,
        sweep_s: SWEEP_S,
        ..Lidar::default()
    };
    let mut cloud = PointCloud::boxed();
    lidar.sweep(&scene(), still, SWEEP_S, 0, &mut cloud);
    fusion.cloud(0, &cloud, &header(SWEEP_S));
    assert_eq!(fusion.counters().rays_without_pose, 1_000, "no state at all");

    // One state 130 ms before the end of the next sweep: its last 30 ms are too far ahead.
    fusion.vehicle(&still(0.0).state(), &header(0.2));
    lidar.sweep(&scene(), still, 0.33, 1, &mut cloud);
    fusion.cloud(0, &cloud, &header(0.33));
    let refused = fusion.counters().rays_without_pose - 1_000;
    assert!((300..=320).contains(&refused), "{refused}");

    // A sweep from before the first state.
    let mut map = LocalMap::boxed();
    fusion.write(at(0.33), &mut map);
    let known_before = map.known_cells;
    lidar.sweep(&scene(), still, 0.19, 2, &mut cloud);
    let mut second = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    second.vehicle(&still(0.0).state(), &header(0.2));
    second.cloud(0, &cloud, &header(0.19));
    second.write(at(0.2), &mut map);
    assert_eq!(second.counters().rays_without_pose, 1_000);
    assert_eq!(
        (map.known_cells, map.live_sensors),
        (0, 0),
        "{known_before} cells were known with poses"
    );
}
