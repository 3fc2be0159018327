//! How the autopilot's time passes beside everybody else's.
//!
//! A simulation that waits for its autopilot, or the autopilot for it, is slower than the clock on the wall: the time of a
//! PX4 of 2026 on its built-in simulator ran at 0.987 to 0.990 of real time, and one of 2021 stood still for 0.10 to 0.16 s
//! at every arming, while its log file was opened. Time, vehicle and answers stand still together.

use jink_simulated_world::vehicle::STEP_S;

/// How the time of an autopilot passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Autopilot's seconds per second; at most 1.
    pub rate: f64,
    /// For how long it stands still when it is armed (s).
    pub arming_stall_s: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            rate: 1.0,
            arming_stall_s: 0.0,
        }
    }
}

/// Which steps the autopilot makes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StepGate {
    credit: f64,
    stalled_steps: u32,
}

impl StepGate {
    /// Whether time passes in this step.
    pub fn passes(&mut self, pace: &Pace) -> bool {
        if self.stalled_steps > 0 {
            self.stalled_steps -= 1;
            return false;
        }
        self.credit += pace.rate.min(1.0);
        let passes = self.credit >= 1.0;
        if passes {
            self.credit -= 1.0;
        }
        passes
    }

    /// It was armed.
    pub fn stall(&mut self, pace: &Pace) {
        self.stalled_steps = (pace.arming_stall_s / STEP_S).round() as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::{Pace, StepGate};

    #[test]
    fn time_passes_at_its_rate_and_stands_still_at_arming() {
        let count = |pace: Pace, stalls: bool| {
            let mut step_gate = StepGate::default();
            if stalls {
                step_gate.stall(&pace);
            }
            (0..25_000).filter(|_| step_gate.passes(&pace)).count()
        };
        assert_eq!(count(Pace::default(), true), 25_000);
        let slow = Pace {
            rate: 0.988,
            arming_stall_s: 0.12,
        };
        assert!(count(slow, false).abs_diff(24_700) <= 1);
        assert!(count(slow, true).abs_diff(24_670) <= 1);
    }
}
