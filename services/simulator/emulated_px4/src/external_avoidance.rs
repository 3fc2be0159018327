//! Velocities and accelerations of a companion, taken into what Position and Mission fly: as proposed for PX4 in August 2026
//! (pull request 28187, not part of any release), and off unless EAV_EN is set.
//!
//! | given on an axis | the setpoint of the mode |
//! |---|---|
//! | velocity | replaced, and no position is held on this axis |
//! | acceleration | replaced, and no position is held on this axis |
//! | nothing | as it was |
//!
//! Headings and positions are not taken. When nothing has come for EAV_TIMEOUT, the mode's own setpoint is flown again.

use super::setpoint::MotionSetpoint;
use jink_shared_types::vehicle::NavMode;

/// Whether a companion may deviate a vehicle in this mode.
pub fn is_taken_in(mode: NavMode) -> bool {
    matches!(mode, NavMode::Position | NavMode::Mission)
}

/// What is flown when a companion gives `external` while the mode itself wants `setpoint`.
pub fn fuse(setpoint: &MotionSetpoint, external: &MotionSetpoint) -> MotionSetpoint {
    let mut fused = *setpoint;
    for axis in 0..3 {
        let (velocity, acceleration) = (external.velocity[axis], external.acceleration[axis]);
        if velocity.is_finite() {
            fused.velocity[axis] = velocity;
        }
        if acceleration.is_finite() {
            fused.acceleration[axis] = acceleration;
        }
        if velocity.is_finite() || acceleration.is_finite() {
            fused.position[axis] = f64::NAN;
        }
    }
    fused
}

#[cfg(test)]
mod tests {
    use super::{MotionSetpoint, fuse};
    use nalgebra::Vector3;

    #[test]
    fn an_axis_that_is_given_is_not_held_in_place_and_the_others_stay() {
        let own = MotionSetpoint {
            position: Vector3::new(1.0, 2.0, -3.0),
            velocity: Vector3::new(0.5, 0.5, 0.5),
            yaw_rad: 1.0,
            ..MotionSetpoint::unset()
        };
        let external = MotionSetpoint {
            position: Vector3::new(9.0, 9.0, 9.0),
            velocity: Vector3::new(2.0, f64::NAN, f64::NAN),
            acceleration: Vector3::new(f64::NAN, 1.0, f64::NAN),
            yaw_rad: 3.0,
            ..MotionSetpoint::unset()
        };
        let fused = fuse(&own, &external);
        assert!(fused.position.x.is_nan() && fused.position.y.is_nan());
        assert_eq!(fused.position.z, -3.0);
        assert_eq!(fused.velocity, Vector3::new(2.0, 0.5, 0.5));
        assert_eq!(fused.acceleration.y, 1.0);
        assert_eq!(fused.yaw_rad, 1.0);
    }
}
