//! From arming to flight: motors spool up, then the climb speed limit ramps from "no thrust" to take-off speed.
//!
//! The ramp starts at the downward speed at which the velocity controller demands no thrust at all, `g / P_z`, so that
//! thrust rises smoothly from zero: this is the three seconds PX4 stands on the ground with its motors running.

use super::parameters::{Parameter as P, Parameters};
use jink_simulated_world::vehicle::GRAVITY_MPS2;

/// How far the take-off has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum TakeoffState {
    /// Motors off.
    #[default]
    Disarmed,
    /// Motors spooling up.
    SpoolUp,
    /// Waiting for somebody to want to fly.
    Ready,
    /// Thrust ramps up.
    RampUp,
    /// In the air.
    Flight,
}

/// The take-off sequence.
#[derive(Clone, Debug, Default)]
pub struct Takeoff {
    state: TakeoffState,
    armed_s: f64,
    ramp: f64,
}

impl Takeoff {
    /// How far it has come.
    pub fn state(&self) -> TakeoffState {
        self.state
    }

    /// Moves on by one cycle.
    pub fn step(
        &mut self,
        armed: bool,
        landed: bool,
        want_takeoff: bool,
        parameters: &Parameters,
        dt_s: f64,
    ) {
        if !armed {
            *self = Self::default();
            return;
        }
        self.armed_s += dt_s;
        self.state = match self.state {
            TakeoffState::Disarmed => TakeoffState::SpoolUp,
            TakeoffState::SpoolUp if self.armed_s >= parameters.get(P::COM_SPOOLUP_TIME) => {
                TakeoffState::Ready
            }
            TakeoffState::Ready if want_takeoff => {
                self.ramp = 0.0;
                TakeoffState::RampUp
            }
            TakeoffState::RampUp if self.ramp >= 1.0 => TakeoffState::Flight,
            TakeoffState::Flight if landed => TakeoffState::Ready,
            same => same,
        };
        if self.state == TakeoffState::RampUp {
            self.ramp = (self.ramp + dt_s / parameters.get(P::MPC_TKO_RAMP_T).max(dt_s)).min(1.0);
        }
    }

    /// The upward speed limit on the way to `wanted_mps`; negative = it may not even hold its height.
    pub fn climb_limit_mps(&self, wanted_mps: f64, parameters: &Parameters) -> f64 {
        let no_thrust_mps = -GRAVITY_MPS2 / parameters.get(P::MPC_Z_VEL_P_ACC).max(0.01);
        match self.state {
            TakeoffState::Flight => wanted_mps,
            TakeoffState::RampUp => no_thrust_mps + self.ramp * (wanted_mps - no_thrust_mps),
            _ => no_thrust_mps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn take_off_takes_a_spool_up_and_a_ramp() {
        let parameters = Parameters::default();
        let mut takeoff = Takeoff::default();
        let mut reached = [0.0; 5];
        for step in 0..1_000 {
            takeoff.step(true, false, true, &parameters, 0.008);
            let slot = &mut reached[takeoff.state() as usize];
            if *slot == 0.0 {
                *slot = f64::from(step) * 0.008;
            }
        }
        assert!((reached[TakeoffState::RampUp as usize] - 1.0).abs() < 0.03);
        assert!((reached[TakeoffState::Flight as usize] - 4.0).abs() < 0.05);
        takeoff.step(true, true, false, &parameters, 0.008);
        assert_eq!(takeoff.state(), TakeoffState::Ready);
        takeoff.step(false, true, false, &parameters, 0.008);
        assert_eq!(takeoff.state(), TakeoffState::Disarmed);
    }

    #[test]
    fn the_limit_ramps_from_no_thrust_to_the_wanted_speed() {
        let parameters = Parameters::default();
        let mut takeoff = Takeoff::default();
        let mut last = -10.0;
        for _ in 0..600 {
            takeoff.step(true, false, true, &parameters, 0.008);
            let limit = takeoff.climb_limit_mps(1.5, &parameters);
            assert!(limit >= last);
            last = limit;
        }
        assert_eq!(last, 1.5);
    }
}
