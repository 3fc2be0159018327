//! By how much velocity and acceleration are sent ahead of the position, learned from the tracking error in flight.
//!
//! A vehicle that answers a velocity with the delay `d` and corrects its position with the gain `K` is off by `e = d a / K` while
//! the reference accelerates by `a`: on the outside of a turn, past the end of a stop. Sending velocity and acceleration (not the
//! position) `d` early makes up for it. So the lead grows while the error, seen along the acceleration, is positive, and shrinks while
//! it is negative. Which lead is best belongs to the vehicle.

use jink_shared_types::Timestamp;
use nalgebra::Vector3;

/// Lead before anything has been learned (s): with it errors along the acceleration were zero in the mean on PX4; with half of it they
/// were 5 to 18 cm.
const FIRST_S: f64 = 0.15;
/// The longest lead (s): beyond it the error of another cause would be learned as a delay.
const LONGEST_S: f64 = 0.3;
/// The reference must turn or brake at least this hard for the error to say anything about the delay (m/s^2).
const TELLING_MPS2: f64 = 0.5;
/// An error beyond this is no delay but a disturbance (m).
const LARGEST_ERROR_M: f64 = 1.0;
/// Share of the missing lead taken up per second of turning (1/s): it settles over some ten seconds of turns, slower than
/// gusts come and go.
const LEARNING_PER_S: f64 = 0.3;
/// Longest time between two setpoints that is learned from (s).
const LONGEST_STEP_S: f64 = 0.1;

/// The lead.
#[derive(Clone, Copy, Debug)]
pub struct Lead {
    seconds: f64,
    last: Timestamp,
}

impl Default for Lead {
    fn default() -> Self {
        Self {
            seconds: FIRST_S,
            last: Timestamp::NEVER,
        }
    }
}

impl Lead {
    /// The lead now (s).
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Learns from the `error` (reference minus vehicle, m, local NED) while the reference accelerates by `acceleration` (m/s^2),
    /// of a vehicle that corrects its position with `gain_per_s` (1/s).
    pub fn learn(
        &mut self,
        now: Timestamp,
        error: Vector3<f64>,
        acceleration: Vector3<f64>,
        gain_per_s: f64,
    ) {
        let step_s = now.seconds_since(std::mem::replace(&mut self.last, now));
        let hard_mps2 = acceleration.xy().norm();
        let reports = hard_mps2 >= TELLING_MPS2 && error.norm() <= LARGEST_ERROR_M;
        if !reports || !(0.0..=LONGEST_STEP_S).contains(&step_s) {
            return;
        }
        let along_m = error.xy().dot(&acceleration.xy()) / hard_mps2;
        let missing_s = gain_per_s * along_m / hard_mps2;
        self.seconds = (self.seconds + missing_s * LEARNING_PER_S * step_s).clamp(0.0, LONGEST_S);
    }
}

#[cfg(test)]
mod tests {
    use super::{FIRST_S, LONGEST_S, Lead};
    use jink_shared_types::Timestamp;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    /// Weaves with `peak_mps2` in front of a vehicle that answers velocities `delay_s` late and corrects its position with
    /// `gain_per_s`.
    fn settled(delay_s: f64, gain_per_s: f64, peak_mps2: f64, seconds: f64) -> f64 {
        const STEP_S: f64 = 0.02;
        const TURN_RADPS: f64 = 1.1;
        let reference = |t: f64| {
            let amplitude = peak_mps2 / (TURN_RADPS * TURN_RADPS);
            let (sine, cosine) = (TURN_RADPS * t).sin_cos();
            (
                amplitude * sine,
                amplitude * TURN_RADPS * cosine,
                -peak_mps2 * sine,
            )
        };
        let mut lead = Lead::default();
        let mut vehicle = 0.0;
        let delayed = (delay_s / STEP_S).round() as usize;
        let mut commands = vec![reference(0.0).1; delayed + 1];
        for i in 0..(seconds / STEP_S) as usize {
            let t = i as f64 * STEP_S;
            let (position, _, acceleration) = reference(t);
            let error = position - vehicle;
            lead.learn(
                Timestamp::from_seconds(100.0 + t),
                Vector3::y() * error,
                Vector3::y() * acceleration,
                gain_per_s,
            );
            commands.push(reference(t + lead.seconds()).1 + gain_per_s * error);
            vehicle += STEP_S * commands[i];
        }
        lead.seconds()
    }

    #[test]
    fn the_lead_becomes_the_vehicles_delay() {
        for gain_per_s in [0.6, 0.95, 1.5] {
            for delay_s in [0.06, 0.1, 0.16, 0.22] {
                let lead_s = settled(delay_s, gain_per_s, 2.5, 120.0);
                assert!(
                    (lead_s - delay_s).abs() < 0.05,
                    "learned {lead_s:.3} s for a delay of {delay_s} s, gain {gain_per_s}/s"
                );
            }
        }
    }

    #[test]
    fn straight_flight_and_disturbances_teach_nothing() {
        let mut lead = Lead::default();
        for i in 0..1000 {
            let now = Timestamp::from_seconds(100.0 + f64::from(i) * 0.02);
            lead.learn(now, Vector3::x() * 0.4, Vector3::x() * 0.3, 0.95);
            lead.learn(now, Vector3::x() * 1.5, Vector3::x() * 3.0, 0.95);
        }
        assert_eq!(lead.seconds(), FIRST_S);
    }

    proptest! {
        #[test]
        fn whatever_comes_the_lead_stays_within_its_bounds(
            steps in prop::collection::vec((0u64..400, prop::array::uniform6(any::<f64>())), 1..100),
            gain_per_s in 0.0..2.0f64,
        ) {
            let mut lead = Lead::default();
            let mut now = Timestamp::from_seconds(1.0);
            for (ms, [a, b, c, d, e, f]) in steps {
                now = Timestamp::from_ns(now.ns + ms * 1_000_000);
                lead.learn(now, Vector3::new(a, b, c), Vector3::new(d, e, f), gain_per_s);
                prop_assert!((0.0..=LONGEST_S).contains(&lead.seconds()));
            }
        }
    }
}
