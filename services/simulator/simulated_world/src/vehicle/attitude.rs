//! The attitude loop: attitude setpoint to body rates to attitude.
//!
//! A proportional law on the attitude error gives rate setpoints, limited as PX4 limits them; rates follow their
//! setpoints with one lag and a bounded angular acceleration. Tilt goes before heading: the error is split into the
//! shortest rotation of the body's z axis and a twist about it, and the twist is weighted down (D. Brescianini, M. Hehn,
//! R. D'Andrea, "Nonlinear Quadrocopter Attitude Control", ETH 2013; gains are the defaults of PX4 1.12).

use super::airframe::{ActuatorCommand, Response, STEP_S};
use nalgebra::{UnitQuaternion, Vector3};

/// MC_YAW_P (1/s).
const YAW_GAIN: f64 = 2.8;
/// MC_ROLLRATE_MAX, MC_PITCHRATE_MAX (rad/s).
const TILT_RATE_MAX_RADPS: f64 = 220.0 * std::f64::consts::PI / 180.0;
/// MC_YAWRATE_MAX (rad/s).
const YAW_RATE_MAX_RADPS: f64 = 200.0 * std::f64::consts::PI / 180.0;
/// What the motors can give about roll and pitch (rad/s^2).
const ANGULAR_ACCELERATION_MAX_RADPS2: f64 = 60.0;

/// Attitude and body rates under control.
#[derive(Clone, Debug)]
pub struct AttitudeLoop {
    rotation: UnitQuaternion<f64>,
    rates: Vector3<f64>,
    tilt_gain: f64,
    rate_lag_s: f64,
}

impl AttitudeLoop {
    /// Level at the given heading, not turning.
    pub fn new(heading_rad: f64, response: &Response) -> Self {
        Self {
            tilt_gain: 1.0 / response.tilt_s,
            rate_lag_s: response.rates_s,
            rotation: UnitQuaternion::from_euler_angles(0.0, 0.0, heading_rad),
            rates: Vector3::zeros(),
        }
    }

    /// `local_q_body`.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        self.rotation
    }

    /// Body rates, forward right down (rad/s).
    pub fn rates(&self) -> Vector3<f64> {
        self.rates
    }

    /// Puts the vehicle level at its heading, not turning: what the ground does.
    pub fn level(&mut self) {
        let (_, _, yaw_rad) = self.rotation.euler_angles();
        self.rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
        self.rates = Vector3::zeros();
    }

    /// Follows the setpoint for one step.
    pub fn step(&mut self, command: &ActuatorCommand) {
        let wanted = self.rate_setpoint(command);
        let mut change = (wanted - self.rates) * (1.0 - (-STEP_S / self.rate_lag_s).exp());
        let limit = ANGULAR_ACCELERATION_MAX_RADPS2 * STEP_S;
        change.apply(|c| *c = c.clamp(-limit, limit));
        self.rates += change;
        self.rotation *= UnitQuaternion::from_scaled_axis(self.rates * STEP_S);
        self.rotation.renormalize_fast();
    }

    fn rate_setpoint(&self, command: &ActuatorCommand) -> Vector3<f64> {
        let down = Vector3::z();
        // Everything in the body frame: where the body's z axis should point, and what turn about it is left then.
        let body_q_wanted = self.rotation.inverse() * command.attitude;
        let wanted_down = body_q_wanted * down;
        let tilt = UnitQuaternion::rotation_between(&down, &wanted_down)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        let twist = tilt.inverse() * body_q_wanted;
        let twist_rad = 2.0 * twist.k.atan2(twist.w);
        let twist_rad = jink_shared_types::frames::wrap_pi(twist_rad);
        let tilt_error = tilt.scaled_axis();
        let local_down_in_body = self.rotation.inverse() * down;
        let mut rates = tilt_error * self.tilt_gain
            + down * (twist_rad * YAW_GAIN)
            + local_down_in_body * command.yaw_rate_radps;
        rates.x = rates.x.clamp(-TILT_RATE_MAX_RADPS, TILT_RATE_MAX_RADPS);
        rates.y = rates.y.clamp(-TILT_RATE_MAX_RADPS, TILT_RATE_MAX_RADPS);
        rates.z = rates.z.clamp(-YAW_RATE_MAX_RADPS, YAW_RATE_MAX_RADPS);
        rates
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn settle(wanted: UnitQuaternion<f64>, start_heading_rad: f64, steps: usize) -> AttitudeLoop {
        let mut attitude = AttitudeLoop::new(start_heading_rad, &Response::default());
        let command = ActuatorCommand {
            attitude: wanted,
            yaw_rate_radps: 0.0,
            thrust: 0.5,
        };
        for _ in 0..steps {
            attitude.step(&command);
        }
        attitude
    }

    proptest! {
        #[test]
        fn every_attitude_is_reached(roll in -0.7..0.7f64, pitch in -0.7..0.7f64, yaw in -3.1..3.1f64, start in -3.1..3.1f64) {
            let wanted = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let attitude = settle(wanted, start, 2_000);
            prop_assert!(attitude.rotation().angle_to(&wanted) < 1e-3);
        }
    }

    #[test]
    fn tilt_settles_well_before_heading() {
        let wanted = UnitQuaternion::from_euler_angles(0.3, 0.0, 1.0);
        let attitude = settle(wanted, 0.0, 75);
        let down = attitude.rotation() * Vector3::z();
        assert!(down.angle(&(wanted * Vector3::z())) < 0.06);
        let (_, _, yaw_rad) = attitude.rotation().euler_angles();
        assert!(yaw_rad < 0.7);
    }

    #[test]
    fn rates_stay_within_the_limits() {
        let mut attitude = AttitudeLoop::new(0.0, &Response::default());
        let command = ActuatorCommand {
            attitude: UnitQuaternion::from_euler_angles(3.0, 0.0, 0.0),
            yaw_rate_radps: 9.0,
            thrust: 0.5,
        };
        for _ in 0..200 {
            attitude.step(&command);
            assert!(attitude.rates().x.abs() <= TILT_RATE_MAX_RADPS + 1e-9);
            assert!(attitude.rates().z.abs() <= YAW_RATE_MAX_RADPS + 1e-9);
        }
    }
}
