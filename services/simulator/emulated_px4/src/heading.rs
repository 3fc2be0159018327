//! The heading of automatic modes: towards the waypoint or along the trajectory, at a limited rate.

use super::parameters::{Parameter as P, Parameters};
use jink_shared_types::frames::wrap_pi;
use nalgebra::Vector2;

/// Shorter vectors have no direction.
const DIRECTION_MIN: f64 = 1e-3;
/// Time constant of the rate that is fed forward (s).
const RATE_FILTER_S: f64 = 0.2;
/// Below this speed the trajectory gives no heading (m/s).
const TRAJECTORY_SPEED_MIN_MPS: f64 = 0.1;
/// Nearer to the target than this the trajectory gives no heading (m).
const TRAJECTORY_DISTANCE_MIN_M: f64 = 2.0;

/// The heading setpoint's memory.
#[derive(Clone, Debug, Default)]
pub struct Heading {
    previous_rad: f64,
    rate_radps: f64,
    locked: bool,
}

impl Heading {
    /// Starts from the heading the vehicle has.
    pub fn reset(&mut self, yaw_rad: f64) {
        *self = Self {
            previous_rad: yaw_rad,
            ..Self::default()
        };
    }

    /// A new leg: the heading may be chosen again.
    pub fn unlock(&mut self) {
        self.locked = false;
    }

    /// Towards a waypoint that lies `to_target` away, and once within the acceptance radius the heading it had.
    pub fn towards(
        &mut self,
        to_target: Vector2<f64>,
        acceptance_m: f64,
        setpoint_rad: f64,
        yaw_rad: f64,
    ) -> f64 {
        if self.locked {
            return setpoint_rad;
        }
        if to_target.norm() < acceptance_m {
            self.locked = true;
            return yaw_rad;
        }
        direction_rad(to_target).unwrap_or(setpoint_rad)
    }

    /// Along the trajectory, or as it was where that has no direction.
    pub fn along(&self, velocity: Vector2<f64>, to_target: Vector2<f64>) -> f64 {
        let under_way =
            velocity.norm() > TRAJECTORY_SPEED_MIN_MPS && to_target.norm() > TRAJECTORY_DISTANCE_MIN_M;
        match direction_rad(velocity) {
            Some(heading_rad) if under_way => heading_rad,
            _ => self.previous_rad,
        }
    }

    /// Limits the rate of heading and heading rate setpoints; a heading alone gets its filtered rate fed forward.
    pub fn limit(
        &mut self,
        yaw_rad: f64,
        yaw_rate_radps: f64,
        parameters: &Parameters,
        dt_s: f64,
    ) -> (f64, f64) {
        let rate_max = parameters.radians(P::MPC_YAWRAUTO_MAX);
        let mut limited = (yaw_rad, yaw_rate_radps);
        if yaw_rad.is_finite() {
            let step = wrap_pi(yaw_rad - self.previous_rad).clamp(-rate_max * dt_s, rate_max * dt_s);
            self.previous_rad = wrap_pi(self.previous_rad + step);
            limited.0 = self.previous_rad;
            if !yaw_rate_radps.is_finite() {
                let share = dt_s / (RATE_FILTER_S + dt_s);
                self.rate_radps += (step / dt_s - self.rate_radps) * share;
                limited.1 = self.rate_radps;
            }
        }
        if limited.1.is_finite() {
            limited.1 = limited.1.clamp(-rate_max, rate_max);
        }
        limited
    }
}

fn direction_rad(v: Vector2<f64>) -> Option<f64> {
    (v.norm() > DIRECTION_MIN).then(|| v.y.atan2(v.x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn the_heading_turns_no_faster_than_allowed_and_arrives() {
        let parameters = Parameters::default();
        let mut heading = Heading::default();
        heading.reset(3.0);
        let mut last = 3.0;
        for _ in 0..1_000 {
            let (yaw, rate) = heading.limit(-2.0, f64::NAN, &parameters, 0.008);
            assert!(wrap_pi(yaw - last).abs() <= 45f64.to_radians() * 0.008 + 1e-12);
            assert!(rate.abs() <= 45f64.to_radians() + 1e-9);
            last = yaw;
        }
        assert!((last + 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_rate_without_a_heading_passes_within_the_limit() {
        let parameters = Parameters::default();
        let mut heading = Heading::default();
        let (yaw, rate) = heading.limit(f64::NAN, 0.5, &parameters, 0.008);
        assert!(yaw.is_nan());
        assert_eq!(rate, 0.5);
        assert_eq!(
            heading.limit(f64::NAN, 3.0, &parameters, 0.008).1,
            45f64.to_radians()
        );
    }

    #[test]
    fn near_the_target_the_heading_is_kept() {
        let mut heading = Heading::default();
        heading.reset(0.3);
        assert_eq!(heading.along(Vector2::new(0.0, 1.0), Vector2::new(1.0, 0.0)), 0.3);
        assert!((heading.along(Vector2::new(0.0, 1.0), Vector2::new(9.0, 0.0)) - FRAC_PI_2).abs() < 1e-9);
        let far = heading.towards(Vector2::new(0.0, 9.0), 2.0, 0.3, 0.4);
        assert!((far - FRAC_PI_2).abs() < 1e-9);
        assert_eq!(heading.towards(Vector2::new(0.0, 1.0), 2.0, far, 0.4), 0.4);
        assert_eq!(heading.towards(Vector2::new(9.0, 0.0), 2.0, 0.4, 0.1), 0.4);
    }
}
