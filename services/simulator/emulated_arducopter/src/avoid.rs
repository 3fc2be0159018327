//! Stopping before obstacles, in LOITER and for velocities in GUIDED. Nothing else looks at obstacles.
//!
//! The speed towards each sector's nearest obstacle is held to what AVOID_ACCEL_MAX can stop before AVOID_MARGIN; within the
//! margin the vehicle backs off, at AVOID_BACKUP_SPD at most. The real one takes the polygon through the sectors' points for
//! its boundary; for one wall straight ahead both are the same.

use super::parameters::{Parameter as P, Parameters};
use super::proximity::Proximity;
use super::shaping::{limit_length, sqrt_controller};
use jink_simulated_world::vehicle::STEP_S;
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::Vector2;

/// The bit of AVOID_ENABLE that says: use the proximity sensor.
const PROXIMITY_BIT: u8 = 2;
/// How fast the speed of the retreat may change (m/s^2).
const RETREAT_ACCELERATION_MPS2: f64 = 2.0;

/// The limiter's memory.
#[derive(Clone, Debug, Default)]
pub struct Avoid {
    retreat: Vector2<f64>,
    now_us: u64,
}

impl Avoid {
    /// A new step begins.
    pub fn begin(&mut self, now_us: u64) {
        self.now_us = now_us;
    }

    /// `velocity` (m/s, north and east), reduced towards obstacles by a vehicle that can brake with `braking_mps2`.
    pub fn limit_velocity(
        &mut self,
        velocity: Vector2<f64>,
        braking_mps2: f64,
        estimate: &Estimate,
        proximity: &Proximity,
        parameters: &Parameters,
    ) -> Vector2<f64> {
        let enabled = parameters.get(P::AVOID_ENABLE) as u8 & PROXIMITY_BIT != 0;
        if !enabled || !proximity.is_enabled() {
            return velocity;
        }
        let margin_m = parameters.get(P::AVOID_MARGIN);
        let deceleration = parameters.get(P::AVOID_ACCEL_MAX).min(braking_mps2);
        let gain = parameters.get(P::PSC_POSXY_P);
        let mut limited = velocity;
        let mut retreat = Vector2::zeros();
        for obstacle in proximity.obstacles(self.now_us, estimate.attitude.yaw_rad()) {
            let distance_m = obstacle.norm();
            let Some(towards) = obstacle.try_normalize(1e-6) else {
                continue;
            };
            let most_mps = sqrt_controller((distance_m - margin_m).max(0.0), gain, deceleration, STEP_S);
            let closing_mps = limited.dot(&towards);
            if closing_mps > most_mps {
                limited -= towards * (closing_mps - most_mps);
            }
            let breach_m = margin_m - parameters.get(P::AVOID_BACKUP_DZ) - distance_m;
            if breach_m > 0.0 {
                retreat -= towards * sqrt_controller(breach_m, gain, deceleration, STEP_S);
            }
        }
        let retreat = limit_length(retreat, parameters.get(P::AVOID_BACKUP_SPD));
        self.retreat += limit_length(retreat - self.retreat, RETREAT_ACCELERATION_MPS2 * STEP_S);
        self.at_least_retreating(limited)
    }

    /// `velocity`, made at least as fast in the direction of the retreat as that is.
    fn at_least_retreating(&self, velocity: Vector2<f64>) -> Vector2<f64> {
        let Some(away) = self.retreat.try_normalize(1e-6) else {
            return velocity;
        };
        let missing_mps = self.retreat.norm() - velocity.dot(&away);
        velocity + away * missing_mps.max(0.0)
    }
}
