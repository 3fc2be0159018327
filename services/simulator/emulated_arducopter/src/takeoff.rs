//! The climb after NAV_TAKEOFF: motors spool up, then straight up to the height.

use super::parameters::Parameters;
use super::position_control::{Limits, Motion, PositionControl};
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::Vector2;

/// From the command to the lift (us). Fitted: with it 4.96 m are reached 9.4 s after NAV_TAKEOFF to 5 m, as observed.
const SPOOL_UP_US: u64 = 2_000_000;
/// Share of the climb at which it is over.
const DONE_SHARE: f64 = 0.99;
/// And the climb speed of the reference below this (m/s): a tenth of WPNAV_SPEED_UP.
const DONE_CLIMB_MPS: f64 = 0.25;

/// What a step of it leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TakeoffStep {
    /// Motors spool up.
    Wait,
    /// Under way.
    Climb,
    /// The height is reached.
    Done,
}

/// A take-off.
#[derive(Clone, Debug, Default)]
pub struct Takeoff {
    begun_us: u64,
    target_down_m: f64,
    from_down_m: Option<f64>,
}

impl Takeoff {
    /// Begins a climb to the down coordinate `target_down_m`.
    pub fn begin(&mut self, now_us: u64, target_down_m: f64) {
        *self = Self {
            begun_us: now_us,
            target_down_m,
            from_down_m: None,
        };
    }

    /// Moves the reference on by a step.
    pub fn step(
        &mut self,
        now_us: u64,
        estimate: &Estimate,
        parameters: &Parameters,
        control: &mut PositionControl,
    ) -> TakeoffStep {
        if now_us < self.begun_us + SPOOL_UP_US {
            return TakeoffStep::Wait;
        }
        let from_down_m = *self.from_down_m.get_or_insert_with(|| {
            control.start(estimate, Limits::automatic(parameters));
            estimate.position.z_m
        });
        let mut target = *control.desired();
        target = Motion {
            position: target.position,
            ..Motion::default()
        };
        target.position.z = self.target_down_m;
        control.follow_velocity(Vector2::zeros(), Vector2::zeros());
        control.follow_height(&target);
        let desired = control.desired();
        let climbed = from_down_m - desired.position.z;
        let whole = from_down_m - self.target_down_m;
        let done = climbed >= DONE_SHARE * whole && -desired.velocity.z < DONE_CLIMB_MPS;
        if done {
            TakeoffStep::Done
        } else {
            TakeoffStep::Climb
        }
    }
}
