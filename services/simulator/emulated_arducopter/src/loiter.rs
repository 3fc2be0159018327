//! LOITER: sticks lean the vehicle in thought; what speed that would give is flown, and braked when sticks are centred.
//!
//! The scheme is that of ArduPilot's `AC_Loiter`: the velocity gains the acceleration of the lean that the sticks ask for,
//! loses a drag that makes LOIT_SPEED the end of it, and, LOIT_BRK_DELAY after the sticks were centred, a braking that builds up
//! with LOIT_BRK_JERK to LOIT_BRK_ACCEL.

use super::avoid::Avoid;
use super::parameters::{Parameter as P, Parameters};
use super::position_control::PositionControl;
use super::proximity::Proximity;
use super::shaping::sqrt_controller;
use jink_simulated_world::vehicle::estimator::Estimate;
use jink_simulated_world::vehicle::{GRAVITY_MPS2, STEP_S};
use nalgebra::{Rotation2, Vector2};

/// Lag of the lean behind the sticks (s): ATC_INPUT_TC.
const LEAN_LAG_S: f64 = 0.15;

/// The mode's memory.
#[derive(Clone, Debug, Default)]
pub struct Loiter {
    predicted: Vector2<f64>,
    centred_s: f64,
    braking_mps2: f64,
}

impl Loiter {
    /// One step. `lean`: the sticks' wish forward and to the right, -1 to 1.
    pub fn step(
        &mut self,
        lean: Vector2<f64>,
        estimate: &Estimate,
        parameters: &Parameters,
        proximity: &Proximity,
        avoid: &mut Avoid,
        control: &mut PositionControl,
    ) {
        let most_mps2 = GRAVITY_MPS2 * lean_max_rad(parameters).tan();
        let wanted = Rotation2::new(estimate.attitude.yaw_rad()) * lean * most_mps2;
        self.predicted += (wanted - self.predicted) * (STEP_S / (LEAN_LAG_S + STEP_S));
        let desired = control.desired();
        let position = desired.position.xy();
        let mut velocity = desired.velocity.xy() + self.predicted * STEP_S;
        let braking_mps2 = self.brake(velocity.norm(), wanted == Vector2::zeros(), parameters);
        let mut acceleration = wanted;
        if let Some(direction) = velocity.try_normalize(1e-9) {
            let speed_mps = velocity.norm();
            let drag_mps2 = most_mps2 * speed_mps / parameters.hundredth(P::LOIT_SPEED);
            let slower_mps = speed_mps - (drag_mps2 + braking_mps2) * STEP_S;
            velocity = direction * slower_mps.max(0.0);
            acceleration -= direction * braking_mps2;
        }
        let braking_mps2 = parameters.hundredth(P::LOIT_ACC_MAX);
        let allowed = avoid.limit_velocity(velocity, braking_mps2, estimate, proximity, parameters);
        if let Some(against) = (velocity - allowed).try_normalize(1e-9) {
            // Without this the sticks would push on against the limit, and the vehicle would come nearer than was observed.
            acceleration -= against * acceleration.dot(&against).max(0.0);
        }
        let velocity = allowed;
        control.set_horizontal(position + velocity * STEP_S, velocity, acceleration);
    }

    fn brake(&mut self, speed_mps: f64, centred: bool, parameters: &Parameters) -> f64 {
        self.centred_s = if centred { self.centred_s + STEP_S } else { 0.0 };
        let jerk_mps3 = parameters.hundredth(P::LOIT_BRK_JERK);
        let mut wanted = 0.0;
        if centred && self.centred_s > parameters.get(P::LOIT_BRK_DELAY) {
            let gain = 0.5 * parameters.get(P::PSC_VELXY_P);
            wanted = sqrt_controller(speed_mps, gain, jerk_mps3, STEP_S)
                .min(parameters.hundredth(P::LOIT_BRK_ACCEL));
        }
        let step = jerk_mps3 * STEP_S;
        self.braking_mps2 += (wanted - self.braking_mps2).clamp(-step, step);
        self.braking_mps2
    }
}

/// Lean at full stick (rad).
pub fn lean_max_rad(parameters: &Parameters) -> f64 {
    let own_deg = parameters.get(P::LOIT_ANG_MAX);
    if own_deg > 0.0 {
        own_deg.to_radians()
    } else {
        parameters.hundredth(P::ANGLE_MAX).to_radians() * (2.0 / 3.0)
    }
}
