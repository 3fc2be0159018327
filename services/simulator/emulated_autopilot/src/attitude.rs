//! The attitude in which a multicopter gives a thrust.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The attitude (local from body) whose body z opposes `thrust` (local NED, any length) and whose heading is `yaw_rad`.
pub fn attitude_for(thrust: &Vector3<f64>, yaw_rad: f64) -> UnitQuaternion<f64> {
    let body_z = (-thrust).try_normalize(f64::EPSILON).unwrap_or(Vector3::z());
    let (sine, cosine) = yaw_rad.sin_cos();
    let right = Vector3::new(-sine, cosine, 0.0);
    let body_x = right
        .cross(&body_z)
        .try_normalize(1e-6)
        .unwrap_or(Vector3::new(cosine, sine, 0.0));
    let body_y = body_z.cross(&body_x);
    let matrix = Matrix3::from_columns(&[body_x, body_y, body_z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn attitude_points_the_thrust_and_keeps_the_heading(x in -0.4..0.4f64, y in -0.4..0.4f64, yaw in -3.1..3.1f64) {
            let thrust = Vector3::new(x, y, -0.5);
            let attitude = attitude_for(&thrust, yaw);
            prop_assert!((attitude * -Vector3::z()).angle(&thrust) < 1e-6);
            prop_assert!((jink_shared_types::frames::Attitude::from_rotation(attitude).yaw_rad() - yaw).abs() < 1e-6);
        }
    }
}
