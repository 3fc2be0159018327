//! Laws of the projection: a plane comes back as that plane for any mounting, lens and block size; what is unknown
//! stays unknown.

use crate::images::{cloud_of, small, with_bins};
use jink_depth_driver::projection::{Distortion, Intrinsics, Projection};
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;

fn end_m(point: &CloudPoint) -> Vector3<f64> {
    Vector3::new(point.forward_m, point.right_m, point.down_m).cast()
}

fn of_kind(cloud: &PointCloud, kind: RayKind) -> usize {
    let points = cloud.points().iter();
    points.filter(|point| point.kind.get() == kind).count()
}

/// Depths (mm) of the plane at `distance_m` along `normal` in the sensor's axes, seen with the intrinsics given; 0
/// where it is not met or farther than Z16 goes.
fn plane(
    size_px: [u16; 2],
    seen: impl Fn([f64; 2]) -> [f64; 2],
    normal: Vector3<f64>,
    distance_m: f64,
) -> Vec<u16> {
    let mut depths = Vec::new();
    for row in 0..size_px[1] {
        for column in 0..size_px[0] {
            let [right, down] = seen([f64::from(column), f64::from(row)]);
            let along = normal.dot(&Vector3::new(1.0, right, down));
            let mm = 1e3 * distance_m / along;
            depths.push(if along > 0.05 && mm < 65_000.0 {
                mm.round() as u16
            } else {
                0
            });
        }
    }
    depths
}

proptest! {
    #[test]
    fn a_plane_comes_back_as_that_plane_for_any_mounting(
        turn in prop::array::uniform4(-1.0..1.0f64),
        at_m in prop::array::uniform3(-2.0..2.0f64),
        tilt in prop::array::uniform2(-0.6..0.6f64),
        distance_m in 0.5..4.0f64,
        bin_px in 1u16..6,
    ) {
        let turn = Quaternion::new(turn[0], turn[1], turn[2], turn[3]);
        prop_assume!(turn.norm() > 0.1);
        let body_q_sensor = UnitQuaternion::from_quaternion(turn);
        let q = body_q_sensor.quaternion();
        let spec = with_bins(bin_px, &format!(
            "range_max_m = 20\nforward_m = {}\nright_m = {}\ndown_m = {}\nquaternion = [{}, {}, {}, {}]\n",
            at_m[0], at_m[1], at_m[2], q.w, q.i, q.j, q.k
        ));
        let normal = Vector3::new(1.0, tilt[0], tilt[1]).normalize();
        let pinhole = |[u, v]: [f64; 2]| [(u - 19.5) / 40.0, (v - 14.5) / 40.0];
        let depths = plane([40, 30], pinhole, normal, distance_m);
        let cloud = cloud_of(&spec, &depths);
        prop_assert_eq!(cloud.points().len(), spec.points());
        let in_body = body_q_sensor * normal;
        let origin_m = Vector3::from(at_m);
        let mut hits = 0;
        for point in cloud.points().iter().filter(|point| point.kind.get() == RayKind::Hit) {
            hits += 1;
            let off_m = in_body.dot(&(end_m(point) - origin_m)) - distance_m;
            // Rounding to millimetres along the optical axis, and to f32.
            prop_assert!(off_m.abs() < 0.0006, "{off_m}");
        }
        prop_assert!(hits * 10 > cloud.points().len() * 7, "{hits} of {}", cloud.points().len());
    }

    #[test]
    fn a_lens_bends_no_plane(k1 in -0.15..0.15f64, k2 in -0.03..0.03f64, p in prop::array::uniform2(-0.01..0.01f64)) {
        let lens = Distortion { k1, k2, p1: p[0], p2: p[1], k3: 0.0 };
        let intrinsics = Intrinsics { fx_px: 40.0, fy_px: 40.0, cx_px: 19.5, cy_px: 14.5 };
        let projection = Projection::new([40, 30], 0, &intrinsics, &lens).unwrap();
        for (pixel, [u, v]) in (0..30).flat_map(|v| (0..40).map(move |u| [f64::from(u), f64::from(v)])).enumerate() {
            let [right, down] = projection.slopes(pixel).map(f64::from);
            let [x, y] = lens.distort([right, down]);
            let seen = [40.0 * x + 19.5, 40.0 * y + 14.5];
            prop_assert!((seen[0] - u).abs() < 0.03 && (seen[1] - v).abs() < 0.03, "{u} {v}: {seen:?}");
        }
    }

    #[test]
    fn what_is_unknown_is_never_clear_and_what_is_beyond_the_range_is_never_a_hit(
        depths in prop::collection::vec(prop_oneof![3 => Just(0u16), 2 => Just(9_000u16), 1 => 200u16..4_000, 1 => any::<u16>()], 1_200),
        bin_px in 1u16..5,
        filter in prop_oneof![Just(0.0), Just(0.02)],
    ) {
        let spec = with_bins(bin_px, &format!("range_max_m = 5\nflying_pixel_per_m = {filter:?}\n"));
        let cloud = cloud_of(&spec, &depths);
        let [columns, rows] = spec.bins();
        prop_assert_eq!(cloud.points().len(), columns * rows);
        let bin = usize::from(bin_px);
        let begin = [(40 - columns * bin) / 2, (30 - rows * bin) / 2];
        for (index, point) in cloud.points().iter().enumerate() {
            let [column, row] = [begin[0] + index % columns * bin, begin[1] + index / columns * bin];
            let block: Vec<u16> = (row..row + bin)
                .flat_map(|row| (column..column + bin).map(move |column| row * 40 + column))
                .map(|pixel| depths[pixel])
                .collect();
            let measured = block.iter().filter(|depth| **depth > 0).count();
            let range_m = end_m(point).norm();
            match point.kind.get() {
                RayKind::Unknown => {}
                RayKind::Hit => {
                    // One of its depths, at least as far as the nearest along the axis.
                    let forward_mm = (f64::from(point.forward_m) * 1e3).round() as u16;
                    prop_assert!(block.contains(&forward_mm), "{forward_mm} of {block:?}");
                    prop_assert!(range_m <= 5.0001);
                }
                RayKind::Clear => {
                    prop_assert!(2 * measured >= block.len(), "{measured} of {}", block.len());
                    prop_assert!((range_m - 5.0).abs() < 1e-4, "{range_m}");
                    if filter == 0.0 {
                        let nearest = block.iter().filter(|depth| **depth > 0).min().unwrap();
                        prop_assert!(f64::from(*nearest) * 1e-3 > 5.0 / 1.2, "{nearest}");
                    }
                }
            }
            if measured == 0 {
                prop_assert_eq!(point.kind.get(), RayKind::Unknown);
            }
        }
    }
}

#[test]
fn an_image_without_any_depth_is_a_cloud_that_knows_nothing() {
    let spec = small("");
    let cloud = cloud_of(&spec, &[0; 1_200]);
    assert_eq!((cloud.len, of_kind(&cloud, RayKind::Unknown)), (1_200, 1_200));
    assert!(cloud.is_consistent());
}

#[test]
fn depths_beyond_the_range_are_clear_up_to_it_and_depths_below_are_obstacles() {
    let spec = small("range_min_m = 0.5\nrange_max_m = 3\n");
    let far = cloud_of(&spec, &[20_000; 1_200]);
    assert_eq!(of_kind(&far, RayKind::Clear), 1_200);
    assert!(
        far.points()
            .iter()
            .all(|point| (end_m(point).norm() - 3.0).abs() < 1e-5)
    );
    let near = cloud_of(&spec, &[200; 1_200]);
    assert_eq!(of_kind(&near, RayKind::Hit), 1_200);
    assert_eq!((near.range_min_m, near.range_max_m), (0.5, 3.0));
}

#[test]
fn the_border_is_left_out() {
    let spec = small("border_px = 5\n");
    assert_eq!(spec.bins(), [30, 20]);
    let mut depths = vec![1_000; 1_200];
    for (pixel, depth) in depths.iter_mut().enumerate() {
        let (column, row) = (pixel % 40, pixel / 40);
        if !(5..35).contains(&column) || !(5..25).contains(&row) {
            *depth = 2_000;
        }
    }
    let cloud = cloud_of(&spec, &depths);
    assert_eq!(of_kind(&cloud, RayKind::Hit), 600);
    assert!(cloud.points().iter().all(|point| point.forward_m == 1.0));
}

#[test]
fn a_camera_that_looks_to_the_right_sees_its_upper_left_pixel_in_front_and_above() {
    let spec = small("orientation = \"right\"\nright_m = 0.1\n");
    let cloud = cloud_of(&spec, &[2_000; 1_200]);
    let first = cloud.points()[0];
    // 2 m to the right of the camera; half the image to its left (forward) and up.
    assert!((first.right_m - 2.1).abs() < 1e-6);
    assert!((first.forward_m - 2.0 * 19.5 / 40.0).abs() < 1e-6, "{first:?}");
    assert!((first.down_m + 2.0 * 14.5 / 40.0).abs() < 1e-6, "{first:?}");
}
