//! Noiseless sweeps of analytic worlds: occupied cells are at surfaces, free cells are outside of obstacles and in
//! sight, and the space behind an obstacle stays unknown.

use crate::world;
use crate::world::{Lidar, VehicleMotion, WorldShape, at, cells, distance_m, header, known};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::map::{CELL_M, Cell, LocalMap, center_of};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use nalgebra::Vector3;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

/// A cell with a point on a surface has its centre within half a diagonal of it; f32 coordinates add micrometres.
const HALF_DIAGONAL_M: f64 = 0.5 * CELL_M * 1.732_050_9 + 1e-5;

/// Some obstacles, none within 1.5 m of the north axis, where the vehicle is.
fn random_world(seed: u64) -> Vec<WorldShape> {
    let mut random = SplitMix64::seed_from_u64(seed);
    let mut world = Vec::new();
    while world.len() < 7 {
        let center_m = Vector3::new(
            random.random_range(-9.0..9.0),
            random.random_range(-9.0..9.0),
            random.random_range(-6.0..2.0),
        );
        let size_m = random.random_range(0.05..1.5);
        let shape = match random.random_range(0..3) {
            0 => WorldShape::Post {
                north_m: center_m.x,
                east_m: center_m.y,
                radius_m: 0.3 * size_m,
            },
            1 => WorldShape::Sphere {
                center_m,
                radius_m: size_m,
            },
            _ => WorldShape::Block {
                center_m,
                half_m: Vector3::new(size_m, random.random_range(0.05..1.5), size_m),
            },
        };
        let clear_m = (-15..=15).map(|i| shape.distance_m(&Vector3::new(f64::from(i) * 0.3, 0.0, -2.0)));
        if clear_m.fold(f64::INFINITY, f64::min) > 1.5 {
            world.push(shape);
        }
    }
    world.push(WorldShape::Ground {
        down_m: random.random_range(0.0..3.0),
    });
    world
}

/// The map after sweeps from each of `stands` in turn.
fn map_from(world: &[WorldShape], stands: &[Vector3<f64>], rays: usize) -> Box<LocalMap> {
    let lidar = Lidar {
        rays,
        range_max_m: 15.0,
        elevation_rad: (-1.4, 1.4),
        ..Lidar::default()
    };
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    let mut cloud = PointCloud::boxed();
    let mut map = LocalMap::boxed();
    for (sweep, stand) in stands.iter().enumerate() {
        let t_s = sweep as f64 * 0.1;
        let motion = VehicleMotion::still(*stand);
        fusion.vehicle(&motion.state(), &header(t_s));
        lidar.sweep(world, |_| motion, t_s, sweep, &mut cloud);
        fusion.cloud(0, &cloud, &header(t_s));
        fusion.write(at(t_s), &mut map);
    }
    map
}

/// Whether the convex `shape` hides all of `cell` from `eye_m`: the shadow of a convex body is convex, so that a cell
/// with all its corners in it is in it.
fn hides(shape: &WorldShape, eye_m: &Vector3<f64>, cell: Cell) -> bool {
    let low_m = center_of(cell).vector().add_scalar(-0.5 * CELL_M);
    (0..8).all(|corner| {
        let offset_m = Vector3::new(corner & 1, corner >> 1 & 1, corner >> 2 & 1).cast::<f64>() * CELL_M;
        let sight = low_m + offset_m - eye_m;
        let distance_m = sight.norm();
        world::cast_m(std::slice::from_ref(shape), eye_m, &(sight / distance_m)) < distance_m - 1e-6
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn occupied_is_at_a_surface_and_free_is_outside(seed in any::<u64>()) {
        let world = random_world(seed);
        let mut random = SplitMix64::seed_from_u64(!seed);
        let stands: Vec<_> = (0..4)
            .map(|_| Vector3::new(random.random_range(-4.0..4.0), random.random_range(-0.3..0.3), random.random_range(-2.2..-1.8)))
            .collect();
        let map = map_from(&world, &stands, 8_000);
        prop_assert!(map.occupied_cells > 200 && map.known_cells > 20_000);
        for cell in known(&map) {
            let clear_m = distance_m(&world, &center_of(cell).vector());
            if map.is_occupied(cell) {
                prop_assert!(clear_m.abs() <= HALF_DIAGONAL_M, "{cell:?} is occupied, {clear_m} m from any surface");
            }
            if map.is_free(cell) {
                prop_assert!(clear_m >= -HALF_DIAGONAL_M, "{cell:?} is free, {clear_m} m inside");
            }
        }
    }

    #[test]
    fn what_nobody_can_see_stays_unknown(seed in any::<u64>()) {
        let world = random_world(seed);
        let stand = Vector3::new(0.37, 0.11, -2.05);
        let map = map_from(&world, &[stand; 3], 20_000);
        let eye_m = stand + Lidar::default().origin_body_m;
        for cell in known(&map).filter(|cell| map.is_free(*cell)) {
            for shape in &world {
                prop_assert!(!hides(shape, &eye_m, cell), "{cell:?} is free behind {shape:?}");
            }
        }
    }
}

#[test]
fn a_wall_is_seen_and_the_room_behind_it_is_not() {
    let wall = WorldShape::Block {
        center_m: Vector3::new(5.6, 0.0, -2.0),
        half_m: Vector3::new(0.5, 4.0, 4.0),
    };
    let map = map_from(&[wall], &[Vector3::new(0.0, 0.0, -2.0); 8], 60_000);
    let mut seen = 0;
    for cell in cells(&map) {
        let center = center_of(cell);
        let in_front = center.x_m > 1.0 && center.x_m < 4.7 && center.y_m.abs() < 0.5 * center.x_m;
        let level = (center.z_m + 2.0).abs() < 1.0;
        if in_front && level {
            assert!(map.is_free(cell), "{cell:?} in front of the wall");
        }
        if (5.0..5.2).contains(&center.x_m) && center.y_m.abs() < 3.0 && level {
            assert!(map.is_occupied(cell), "{cell:?} in the wall's face");
            seen += 1;
        }
        if center.x_m > 5.3 && center.y_m.abs() < 3.5 && level {
            assert!(
                !map.is_free(cell) && !map.is_occupied(cell),
                "{cell:?} behind the wall's face"
            );
        }
    }
    assert_eq!(seen, 30 * 10);
}

#[test]
fn below_the_shortest_range_a_point_is_an_obstacle_and_clears_nothing() {
    for (kind, occupied, malformed) in [
        (RayKind::Hit, 1, 0),
        (RayKind::Clear, 0, 1),
        (RayKind::Unknown, 0, 0),
    ] {
        let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
        let motion = VehicleMotion::still(Vector3::new(0.0, 0.0, -2.0));
        fusion.vehicle(&motion.state(), &header(0.0));
        let mut map = LocalMap::boxed();
        let mut cloud = PointCloud::boxed();
        cloud.first_point = at(0.0);
        (cloud.range_min_m, cloud.range_max_m) = (2.0, 20.0);
        assert!(cloud.push(CloudPoint {
            forward_m: 1.9,
            kind: kind.into(),
            ..CloudPoint::default()
        }));
        fusion.cloud(0, &cloud, &header(0.1));
        fusion.write(at(0.1), &mut map);
        let body_cells = known(&map).filter(|cell| center_of(*cell).x_m < 0.4).count();
        assert_eq!(map.known_cells as usize, body_cells + occupied, "{kind}");
        assert_eq!(map.occupied_cells as usize, occupied, "{kind}");
        assert_eq!(fusion.counters().rays_malformed, malformed, "{kind}");
    }
}

#[test]
fn beyond_the_carve_range_a_hit_is_a_hit_and_its_ray_clears_up_to_the_carve_range() {
    let far = WorldShape::Block {
        center_m: Vector3::new(10.6, 0.0, -2.0),
        half_m: Vector3::new(0.5, 9.0, 9.0),
    };
    let mut params = ParamSet::default();
    assert!(params.set("OA_CARVE_RNG", 6.0).is_ok());
    let mut fusion = Fusion::new(FusionConfig::from_params(&params, 1));
    let motion = VehicleMotion::still(Vector3::new(0.0, 0.0, -2.0));
    let mut cloud = PointCloud::boxed();
    let lidar = Lidar {
        rays: 60_000,
        range_max_m: 14.0,
        ..Lidar::default()
    };
    let mut map = LocalMap::boxed();
    for sweep in 0..8 {
        let t_s = sweep as f64 * 0.1;
        fusion.vehicle(&motion.state(), &header(t_s));
        lidar.sweep(&[far], |_| motion, t_s, sweep, &mut cloud);
        fusion.cloud(0, &cloud, &header(t_s));
        fusion.write(at(t_s), &mut map);
    }
    let along = |north: i32| [north, 2, -11];
    assert!((2..29).all(|north| map.is_free(along(north))), "cleared to 6 m");
    assert!(
        (32..50).all(|north| !map.is_free(along(north))),
        "nothing is known of 6.4 to 10 m"
    );
    assert!(map.is_occupied(along(50)), "the wall's face is known");
}

#[test]
fn a_vehicle_in_motion_sees_as_far_ahead_as_rays_clear_and_keeps_six_metres_behind() {
    let walls = [40.0, -30.0].map(|north_m| WorldShape::Block {
        center_m: Vector3::new(north_m, 0.0, -2.0),
        half_m: Vector3::new(0.5, 30.0, 30.0),
    });
    let lidar = Lidar {
        rays: 60_000,
        range_max_m: 60.0,
        ..Lidar::default()
    };
    let mut cloud = PointCloud::boxed();
    let mut map = LocalMap::boxed();
    // How far ahead and behind the map is free after a second at this speed (m).
    let mut free_m = |speed_mps: f64| {
        let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
        let motion = |t_s: f64| VehicleMotion {
            velocity_mps: Vector3::new(speed_mps, 0.0, 0.0),
            ..VehicleMotion::still(Vector3::new(speed_mps * t_s, 0.0, -2.0))
        };
        for sweep in 0..11 {
            let t_s = sweep as f64 * 0.1;
            for part in 0..3 {
                let t_s = t_s + 0.03 * f64::from(part);
                fusion.vehicle(&motion(t_s).state(), &header(t_s));
            }
            lidar.sweep(&walls, motion, t_s, sweep, &mut cloud);
            fusion.cloud(0, &cloud, &header(t_s));
            fusion.write(at(t_s), &mut map);
        }
        let here = (speed_mps / CELL_M) as i32;
        let free = |way: i32| {
            let cells = (0..100).take_while(|cell| map.is_free([here + way * cell, 2, -11]));
            CELL_M * cells.count() as f64
        };
        [free(1), free(-1)]
    };
    let [ahead_m, behind_m] = free_m(0.0);
    assert!(
        (ahead_m - 12.8).abs() < 0.5 && (behind_m - 12.8).abs() < 0.5,
        "{ahead_m} {behind_m}"
    );
    let [ahead_m, behind_m] = free_m(9.0);
    assert!(ahead_m > 17.0 && behind_m > 5.8, "{ahead_m} {behind_m}");
}

#[test]
fn a_lidar_that_repeats_itself_on_a_hovering_vehicle_leaves_nothing_out_for_long() {
    let lidar = Lidar {
        rays: 20_000,
        ..Lidar::default()
    };
    let motion = VehicleMotion::still(Vector3::new(0.0, 0.0, -2.0));
    let mut cloud = PointCloud::boxed();
    lidar.sweep(&random_world(5), |_| motion, 0.0, 0, &mut cloud);
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    let mut map = LocalMap::boxed();
    let known: Vec<f64> = (0..60)
        .map(|frame| {
            let t_s = f64::from(frame) * 0.1;
            cloud.first_point = at(t_s);
            fusion.vehicle(&motion.state(), &header(t_s));
            fusion.cloud(0, &cloud, &header(t_s));
            fusion.write(at(t_s), &mut map);
            f64::from(map.known_cells)
        })
        .collect();
    assert!(known[0] < 0.95 * known[59], "a single frame leaves cells out");
    assert!(known[9] > 0.99 * known[59], "ten frames leave out next to none");
}
