//! Planar scans and single beams: a wide beam is interpreted in the way that leaves the least free space.

use crate::world::{VehicleMotion, at, header, known};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::frames::{Mounting, Point};
use jink_shared_types::map::{CELL_M, Cell, LocalMap, center_of};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::RangeScan;
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

/// Sensor position in the body: 0.2 m ahead. The vehicle rests 2.1 m above the origin, in the middle of a cell.
const EYE: Vector3<f64> = Vector3::new(0.3, 0.1, -2.1);

fn beam(range_m: f32, width_rad: f32, mounting: UnitQuaternion<f64>) -> RangeScan {
    let mut scan = RangeScan {
        origin: Point::new(0.2, 0.0, 0.0),
        mounting: Mounting::from_rotation(mounting),
        first_beam: at(0.0),
        beam_width_rad: width_rad,
        range_min_m: 0.3,
        range_max_m: 10.0,
        beams: 1,
        ..RangeScan::default()
    };
    scan.range_m[0] = range_m;
    scan
}

fn map_of(scan: &RangeScan) -> (Box<LocalMap>, Fusion) {
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    fusion.vehicle(
        &VehicleMotion::still(Vector3::new(0.1, 0.1, -2.1)).state(),
        &header(0.0),
    );
    fusion.scan(0, scan, &header(0.0));
    let mut map = LocalMap::boxed();
    fusion.write(at(0.0), &mut map);
    (map, fusion)
}

/// Smallest and largest distance of `cell` from the sensor (m).
fn distances_m(cell: Cell) -> (f64, f64) {
    let offset = (center_of(cell).vector() - EYE).abs();
    (
        offset.add_scalar(-0.5 * CELL_M).map(|c| c.max(0.0)).norm(),
        offset.add_scalar(0.5 * CELL_M).norm(),
    )
}

/// Free cells that the body, which is free by itself, does not account for.
fn seen_free(map: &LocalMap) -> Vec<Cell> {
    let body_m = Vector3::new(0.1, 0.1, -2.1);
    known(map)
        .filter(|cell| map.is_free(*cell) && (center_of(*cell).vector() - body_m).norm() > 0.31)
        .collect()
}

fn any_rotation() -> impl Strategy<Value = UnitQuaternion<f64>> {
    (-3.1..3.1f64, -1.5..1.5f64, -3.1..3.1f64)
        .prop_map(|(r, p, y)| UnitQuaternion::from_euler_angles(r, p, y))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_hit_is_the_whole_cap_and_clears_only_the_centre_ray(
        range_m in 1.0..6.0f32,
        width_rad in 0.2..1.2f32,
        mounting in any_rotation(),
    ) {
        let (map, _) = map_of(&beam(range_m, width_rad, mounting));
        let (range_m, half_rad) = (f64::from(range_m), 0.5 * f64::from(width_rad));
        let along = mounting * Vector3::x();
        for cell in known(&map).filter(|cell| map.is_occupied(*cell)) {
            let (near_m, far_m) = distances_m(cell);
            prop_assert!(near_m <= range_m && range_m <= far_m + 1e-6, "{cell:?} is not at that range");
            let angle_rad = (center_of(cell).vector() - EYE).angle(&along);
            prop_assert!(angle_rad <= half_rad + CELL_M / range_m, "{cell:?} is not in the cone");
        }
        // The other way round: a fan of directions over the cap, all found occupied, or outside the window.
        for (tilt, turn) in (0..=10).flat_map(|tilt| (0..12).map(move |turn| (tilt, turn))) {
            let tilt_rad = half_rad * f64::from(tilt) / 10.0;
            let (sin, cos) = (f64::from(turn) * std::f64::consts::FRAC_PI_6).sin_cos();
            let direction = Vector3::new(tilt_rad.cos(), tilt_rad.sin() * cos, tilt_rad.sin() * sin);
            let point_m = EYE + mounting * direction * range_m;
            let cell = point_m.map(|c| (c / CELL_M).floor() as i32);
            let near = (0..27).any(|i| {
                map.is_occupied([cell.x + i % 3 - 1, cell.y + i / 3 % 3 - 1, cell.z + i / 9 - 1])
            });
            prop_assert!(near || !map.contains(cell.into()), "{point_m:?} on the cap is not marked");
        }
        let rim_m = range_m * half_rad.cos();
        for cell in seen_free(&map) {
            let offset = center_of(cell).vector() - EYE;
            let beside_m = (offset - along * offset.dot(&along)).norm();
            prop_assert!(beside_m <= 0.5 * CELL_M * 1.733, "{cell:?} is not on the centre ray");
            prop_assert!(distances_m(cell).0 <= rim_m, "{cell:?} is behind the rim");
        }
    }

    #[test]
    fn only_the_known_meanings_of_a_range_open_space(mounting in any_rotation(), width_rad in 0.0..1.0f32) {
        for (range_m, opens) in [
            (f32::NAN, false),
            (f32::INFINITY, true),
            (f32::NEG_INFINITY, false),
            (-1.0, false),
            (0.0, false),
            (0.25, false),
            (0.35, true),
            (50.0, false),
            (1e30, false),
        ] {
            let (map, fusion) = map_of(&beam(range_m, width_rad, mounting));
            let opened = seen_free(&map).len();
            prop_assert!(opens || opened == 0, "{range_m} opened {opened} cells");
            let informed = opens || range_m == 0.25 && fusion.counters().self_hits == 0;
            let self_hit = fusion.counters().self_hits == 1;
            prop_assert_eq!(map.live_sensors == 1, informed && !self_hit, "{}", range_m);
        }
    }
}

#[test]
fn below_the_shortest_range_there_is_an_obstacle_and_nothing_is_cleared() {
    let (map, _) = map_of(&beam(0.28, 0.0, UnitQuaternion::identity()));
    assert!(map.is_occupied([2, 0, -11]), "0.2 + 0.28 + 0.1 m ahead");
    assert_eq!((map.occupied_cells, seen_free(&map).len()), (1, 0));
}

#[test]
fn a_cap_that_reaches_into_the_vehicle_is_no_obstacle_there() {
    let mut params = ParamSet::default();
    assert!(params.set("OA_VEH_RADIUS", 1.0).is_ok());
    let mut fusion = Fusion::new(FusionConfig::from_params(&params, 1));
    let body_m = Vector3::new(0.1, 0.1, -2.1);
    fusion.vehicle(&VehicleMotion::still(body_m).state(), &header(0.0));
    let mut scan = beam(1.0, 1.5, UnitQuaternion::identity());
    scan.origin = Point::new(-0.3, -1.0, 0.0);
    fusion.scan(0, &scan, &header(0.0));
    let mut map = LocalMap::boxed();
    fusion.write(at(0.0), &mut map);
    assert!(map.occupied_cells > 20);
    for cell in known(&map).filter(|cell| map.is_occupied(*cell)) {
        let offset = (center_of(cell).vector() - body_m).abs();
        assert!(
            offset.add_scalar(0.5 * CELL_M).norm() > 1.0,
            "{cell:?} is inside the vehicle"
        );
    }
}

#[test]
fn infinity_clears_to_the_sensors_range_and_no_further_than_the_window() {
    for (range_max_m, last) in [(4.0, 20), (40.0, 63)] {
        let mut scan = beam(f32::INFINITY, 0.4, UnitQuaternion::identity());
        scan.range_max_m = range_max_m;
        let (map, _) = map_of(&scan);
        let freed = seen_free(&map);
        assert!(
            freed.iter().all(|cell| cell[1] == 0 && cell[2] == -11),
            "a single row of cells"
        );
        assert_eq!(freed.iter().map(|cell| cell[0]).max(), Some(last));
        assert_eq!(map.occupied_cells, 0);
    }
}

#[test]
fn a_scan_turns_clockwise_and_its_beams_have_their_own_times() {
    // A quarter turn in 100 beams of 1 ms, on a vehicle that moves north at 5 m/s; a wall 5 m east of its whole path.
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    for i in 0..=5 {
        let t_s = f64::from(i) * 0.02;
        let motion = VehicleMotion {
            velocity_mps: Vector3::new(5.0, 0.0, 0.0),
            ..VehicleMotion::still(Vector3::new(0.05 + 5.0 * t_s, 0.1, -2.1))
        };
        fusion.vehicle(&motion.state(), &header(t_s));
    }
    let mut scan = RangeScan {
        first_beam: at(0.0),
        beam_interval_s: 1e-3,
        angle_first_rad: std::f32::consts::FRAC_PI_4,
        angle_step_rad: std::f32::consts::FRAC_PI_2 / 100.0,
        beam_width_rad: 0.01,
        range_min_m: 0.1,
        range_max_m: 20.0,
        beams: 100,
        ..RangeScan::default()
    };
    for beam in 0..100 {
        let angle_rad = scan.angle_first_rad + beam as f32 * scan.angle_step_rad;
        scan.range_m[beam] = 5.0 / angle_rad.sin();
    }
    fusion.scan(0, &scan, &header(0.1));
    let mut map = LocalMap::boxed();
    fusion.write(at(0.1), &mut map);
    let occupied: Vec<Cell> = known(&map).filter(|cell| map.is_occupied(*cell)).collect();
    assert!(
        occupied.iter().all(|cell| cell[1] == 25 && cell[2] == -11),
        "the wall at 5.1 m east: {occupied:?}"
    );
    let (first, last) = (
        occupied.iter().map(|c| c[0]).min(),
        occupied.iter().map(|c| c[0]).max(),
    );
    // The first beam leaves at 0.05 m north and hits 5 m ahead, the last one leaves at 0.545 m and hits 4.85 m behind.
    assert_eq!((first, last), (Some(-22), Some(25)));
}
