//! Coming down, and the return that ends in it.
//!
//! A return climbs to RTL_ALT (less within a cone about home), flies home, waits RTL_LOIT_TIME there, and lands.

use super::leg::Leg;
use super::parameters::{Parameter as P, Parameters};
use super::position_control::PositionControl;
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::{Vector2, Vector3};

/// The cone never asks for a lower height than this (m).
const CLIMB_MIN_M: f64 = 2.5;

/// Moves the reference down by a step, over the place where the vehicle stops.
pub fn descend(
    estimate: &Estimate,
    home_down_m: f64,
    parameters: &Parameters,
    control: &mut PositionControl,
) {
    let height_m = home_down_m - estimate.position.z_m;
    let low = height_m < parameters.hundredth(P::LAND_ALT_LOW);
    let speed = if low { P::LAND_SPEED } else { P::WPNAV_SPEED_DN };
    control.follow_velocity(Vector2::zeros(), Vector2::zeros());
    control.follow_sink(parameters.hundredth(speed), 0.0);
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    #[default]
    Climb,
    Home,
    Wait {
        since_us: u64,
    },
    Descend,
}

/// A return.
#[derive(Clone, Copy, Debug, Default)]
pub struct Return {
    phase: Phase,
    leg: Leg,
}

impl Return {
    /// Begins at the reference.
    pub fn begin(
        &mut self,
        home: Vector3<f64>,
        estimate: &Estimate,
        parameters: &Parameters,
        control: &PositionControl,
    ) {
        let at = estimate.position.vector();
        let slope = parameters.get(P::RTL_CONE_SLOPE);
        let mut height_m = parameters.hundredth(P::RTL_ALT);
        if slope > 0.0 {
            let away_m = (at - home).xy().norm();
            height_m = height_m.min((away_m * slope).max(CLIMB_MIN_M));
        }
        let down_m = (home.z - height_m).min(at.z);
        *self = Self {
            phase: Phase::Climb,
            leg: Leg::new(control.desired(), Vector3::new(at.x, at.y, down_m)),
        };
    }

    /// Moves the reference on by a step.
    pub fn step(
        &mut self,
        now_us: u64,
        home: Vector3<f64>,
        estimate: &Estimate,
        parameters: &Parameters,
        control: &mut PositionControl,
    ) {
        if self.phase == Phase::Descend {
            return descend(estimate, home.z, parameters, control);
        }
        let limits = control.limits;
        self.leg.step(&limits, control);
        match self.phase {
            Phase::Climb if self.leg.has_arrived() => {
                let above_home = Vector3::new(home.x, home.y, self.leg.destination().z);
                self.leg = Leg::new(control.desired(), above_home);
                self.phase = Phase::Home;
            }
            Phase::Home if self.leg.has_arrived() => self.phase = Phase::Wait { since_us: now_us },
            Phase::Wait { since_us }
                if (now_us - since_us) as f64 >= parameters.get(P::RTL_LOIT_TIME) * 1e3 =>
            {
                self.phase = Phase::Descend;
            }
            _ => {}
        }
    }

    /// Coming down over home.
    pub fn is_landing(&self) -> bool {
        self.phase == Phase::Descend
    }
}
