//! Angles: clockwise from north (world) or from the nose (body), bins of five degrees.

use super::map::{BIN_DEG, BINS};
use nalgebra::Vector2;
use std::f32::consts::{FRAC_PI_2, PI};

/// This near to straight up or down the heading is that of the body's z axis (rad).
const GIMBAL_LOCK_RAD: f32 = 1e-3;

/// In degrees. Both conversions divide in single precision, as PX4 does: the factor differs in its last bit, and edges
/// of fields of view notice.
pub(super) fn degrees(angle_rad: f32) -> f32 {
    angle_rad * (180.0 / PI)
}

/// In radians.
pub(super) fn radians(angle_deg: f32) -> f32 {
    angle_deg * (PI / 180.0)
}

/// `angle_deg` in 0 to 360. 360 itself comes out for tiny negative angles.
pub(super) fn wrap_deg(angle_deg: f32) -> f32 {
    if (0.0..360.0).contains(&angle_deg) {
        return angle_deg;
    }
    angle_deg - 360.0 * (angle_deg / 360.0).floor()
}

/// The heading of an attitude (rad); the quaternion is taken as it is, of unit length or not.
pub(super) fn heading_rad([w, x, y, z]: [f32; 4]) -> f32 {
    let pitch_rad = (2.0 * (w * y - x * z)).asin();
    let (ahead, aside) = (2.0 * (w * y + x * z), 2.0 * (y * z - w * x));
    if (pitch_rad - FRAC_PI_2).abs() < GIMBAL_LOCK_RAD {
        aside.atan2(ahead)
    } else if (pitch_rad + FRAC_PI_2).abs() < GIMBAL_LOCK_RAD {
        (-aside).atan2(-ahead)
    } else {
        (2.0 * (x * y + w * z)).atan2(1.0 - 2.0 * (y * y + z * z))
    }
}

/// The unit vector towards `angle_rad`.
pub(super) fn direction(angle_rad: f32) -> Vector2<f32> {
    Vector2::new(angle_rad.cos(), angle_rad.sin())
}

/// The world direction of the centre of a bin.
pub(super) fn bin_direction(yaw_rad: f32, bin: i32) -> Vector2<f32> {
    direction(yaw_rad + radians(bin as f32 * BIN_DEG))
}

/// The body angle of a world vector in 0 to 360 (deg).
pub(super) fn body_angle_deg(vector: Vector2<f32>, yaw_rad: f32) -> f32 {
    wrap_deg(degrees(vector.y.atan2(vector.x) - yaw_rad))
}

/// The bin whose number is `bin` but for whole turns.
pub(super) fn wrap_bin(bin: i32) -> usize {
    bin.rem_euclid(BINS as i32) as usize
}
