//! From jink's frames (MAVLink's: north, east, down and forward, right, down) to those of ROS and Foxglove (REP-103: east, north, up and
//! forward, left, up; REP-105: `map` and `base_link`). The origins stay.

use foxglove::messages::{Point3, Pose, Quaternion, Vector3 as Triple};
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};

/// The frame of everything that stands: east, north, up from the autopilot's local origin.
pub const MAP: &str = "map";
/// The frame of the vehicle: forward, left, up from its centre of gravity.
pub const BASE_LINK: &str = "base_link";

/// `map_q_local`: half a turn about the axis between north and east.
const MAP_Q_LOCAL: nalgebra::Quaternion<f64> =
    nalgebra::Quaternion::new(0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0);
/// `body_q_base`: half a turn about forward.
const BODY_Q_BASE: nalgebra::Quaternion<f64> = nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0);

/// A vector or a place along north, east, down (any unit), along east, north, up.
pub fn map_of(local: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(local.y, local.x, -local.z)
}

/// `map_q_base_link` of `local_q_body`.
pub fn attitude_of(local_q_body: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let [map_q_local, body_q_base] = [MAP_Q_LOCAL, BODY_Q_BASE].map(UnitQuaternion::new_unchecked);
    map_q_local * local_q_body * body_q_base
}

/// The attitude of something level with a heading (rad, clockwise from north): counted from east, counterclockwise.
pub fn level_of(heading_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2 - heading_rad)
}

/// As Foxglove writes a place.
pub fn point(at: Vector3<f64>) -> Point3 {
    let [x, y, z] = at.into();
    Point3 { x, y, z }
}

/// As Foxglove writes a vector.
pub fn vector(at: Vector3<f64>) -> Triple {
    let [x, y, z] = at.into();
    Triple { x, y, z }
}

/// As Foxglove writes a rotation.
pub fn quaternion(turn: UnitQuaternion<f64>) -> Quaternion {
    let [x, y, z, w] = turn.coords.into();
    Quaternion { x, y, z, w }
}

/// As Foxglove writes a pose.
pub fn pose(at: Vector3<f64>, turn: UnitQuaternion<f64>) -> Pose {
    Pose {
        position: Some(vector(at)),
        orientation: Some(quaternion(turn)),
    }
}

#[cfg(test)]
mod tests {
    use super::{attitude_of, level_of, map_of};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    /// A vector of the body along forward, left, up.
    fn base_of(body: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(body.x, -body.y, -body.z)
    }

    proptest! {
        #[test]
        fn a_point_of_the_body_is_at_the_same_place_in_both_conventions(
            roll in -3.1..3.1f64, pitch in -1.5..1.5f64, yaw in -3.1..3.1f64,
            body in prop::array::uniform3(-10.0..10.0f64),
        ) {
            let local_q_body = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let body = Vector3::from(body);
            let one_way = map_of(local_q_body * body);
            let other_way = attitude_of(local_q_body) * base_of(body);
            prop_assert!((one_way - other_way).norm() < 1e-12);
        }

        #[test]
        fn angles_and_lengths_are_kept_and_no_side_is_exchanged(
            one in prop::array::uniform3(-10.0..10.0f64), other in prop::array::uniform3(-10.0..10.0f64),
        ) {
            let (one, other) = (Vector3::from(one), Vector3::from(other));
            prop_assert!((map_of(one).dot(&map_of(other)) - one.dot(&other)).abs() < 1e-9);
            prop_assert!((map_of(one).cross(&map_of(other)) - map_of(one.cross(&other))).norm() < 1e-9);
        }

        #[test]
        fn a_heading_is_the_same_for_what_is_level(heading in -3.1..3.1f64) {
            let level = UnitQuaternion::from_euler_angles(0.0, 0.0, heading);
            prop_assert!(attitude_of(level).angle_to(&level_of(heading)) < 1e-7);
        }
    }

    #[test]
    fn north_is_y_east_is_x_and_up_is_z() {
        assert_eq!(map_of(Vector3::x()), Vector3::y());
        assert_eq!(map_of(Vector3::y()), Vector3::x());
        assert_eq!(map_of(-Vector3::z()), Vector3::z());
    }

    #[test]
    fn the_nose_points_where_the_compass_says() {
        for (heading_deg, nose) in [
            (0.0_f64, Vector3::y()),
            (90.0, Vector3::x()),
            (180.0, -Vector3::y()),
            (-90.0, -Vector3::x()),
        ] {
            let local_q_body = UnitQuaternion::from_euler_angles(0.0, 0.0, heading_deg.to_radians());
            let attitude = attitude_of(local_q_body);
            assert!((attitude * Vector3::x() - nose).norm() < 1e-12, "{heading_deg}");
            assert!(
                (attitude * Vector3::z() - Vector3::z()).norm() < 1e-12,
                "{heading_deg}"
            );
        }
        // Nose up is nose up, right wing down is right wing down.
        let climbs = attitude_of(UnitQuaternion::from_euler_angles(0.0, 0.3, 1.0)) * Vector3::x();
        assert!(climbs.z > 0.0);
        let left = attitude_of(UnitQuaternion::from_euler_angles(0.3, 0.0, 1.0)) * Vector3::y();
        assert!(left.z > 0.0);
    }
}
