//! How far the estimated position has slipped: it moves otherwise than the estimated velocity says, as when an estimator follows a
//! GPS that is off. Everything at rest seems to move so, too. A vehicle cannot be steered by an estimate that slips fast for long: after a reset
//! its position may be right, and all that is seen agree with it, while its velocity is metres per second off.

use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::Estimate;
use nalgebra::{Vector2, Vector3};

/// Estimates further apart (s) say nothing.
const GAP_S: f64 = 0.2;

/// Speeds are a mean over about this long (s): jitter of times and positions cancels out.
const MEAN_S: f64 = 0.3;
/// The estimate is wrong when it has slipped faster than this (m/s) ...
const WRONG_MPS: f64 = 1.0;
/// ... for so long (s), and right again when it has slipped slower for as long: an estimator that follows a GPS that has jumped by 2 m
/// is never so fast for so long, whatever its pace.
const LASTS_S: f64 = 1.0;

/// The slip of the estimated position.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slip {
    last: Option<(Timestamp, Estimate)>,
    slipped_m: Vector3<f64>,
    mean_mps: Vector2<f64>,
    is_wrong: bool,
    /// When its speed last was as `is_wrong` says.
    confirmed: Timestamp,
}

impl Slip {
    /// Takes the estimate of `at`.
    pub fn update(&mut self, at: Timestamp, estimate: &Estimate) {
        let Some((last_at, last)) = self.last.replace((at, *estimate)) else {
            return;
        };
        let passed_s = at.seconds_since(last_at);
        if passed_s <= 0.0 || passed_s > GAP_S {
            self.confirmed = at;
            return;
        }
        let expected_m = (last.velocity_mps + estimate.velocity_mps) * (0.5 * passed_s);
        let step_m = estimate.position_m - last.position_m - expected_m;
        self.slipped_m += step_m;
        self.mean_mps += (step_m.xy() / passed_s - self.mean_mps) * (passed_s / MEAN_S).min(1.0);
        if (self.mean_mps.norm() > WRONG_MPS) == self.is_wrong {
            self.confirmed = at;
        } else if at.seconds_since(self.confirmed) >= LASTS_S {
            (self.is_wrong, self.confirmed) = (!self.is_wrong, at);
        }
    }

    /// The position was reset: the step to it is no slip.
    pub fn on_reset(&mut self) {
        self.last = None;
    }

    /// Whether the estimated position moves otherwise than the estimated velocity says.
    pub fn is_wrong(&self) -> bool {
        self.is_wrong
    }

    /// How far it has slipped so far (m, local).
    pub fn slipped_m(&self) -> Vector3<f64> {
        self.slipped_m
    }
}

#[cfg(test)]
mod tests {
    use super::Slip;
    use jink_shared_types::Timestamp;
    use jink_shared_types::pose_history::Estimate;
    use nalgebra::{UnitQuaternion, Vector3};

    /// When the estimate becomes wrong and right again (s) in 10 s at 50 Hz in which it is off by `off_m` of its time, and its velocity
    /// is that of the vehicle.
    fn changes(off_m: impl Fn(f64) -> f64) -> Vec<f64> {
        let (mut slip, mut changes) = (Slip::default(), Vec::new());
        for step in 0..500 {
            let t_s = 0.02 * f64::from(step);
            // Gusts, and the time is off by some milliseconds.
            let north_m = |t_s: f64| 3.0 * t_s + (2.0 * t_s).sin();
            let late_s = 0.004 * f64::from(step * 7 % 5);
            let was_wrong = slip.is_wrong();
            let estimate = Estimate {
                position_m: Vector3::new(north_m(t_s - late_s) + off_m(t_s), 0.0, -2.0),
                local_q_body: UnitQuaternion::identity(),
                velocity_mps: Vector3::new(3.0 + 2.0 * (2.0 * t_s).cos(), 0.0, 0.0),
                rates_radps: Vector3::zeros(),
            };
            slip.update(Timestamp::from_seconds(100.0 + t_s), &estimate);
            if slip.is_wrong() != was_wrong {
                changes.push(t_s);
            }
        }
        changes
    }

    #[test]
    fn an_estimate_is_wrong_while_it_slips_fast_and_a_second_longer() {
        assert!(changes(|_| 0.0).is_empty());
        assert!(changes(|t_s| 0.8 * t_s).is_empty(), "slow");
        let changed = changes(|t_s| -3.0 * t_s.clamp(2.0, 6.0));
        let [wrong_s, right_s] = changed[..] else {
            panic!("{changed:?}");
        };
        assert!(
            (3.0..3.5).contains(&wrong_s) && (7.0..8.0).contains(&right_s),
            "{changed:?}"
        );
    }

    #[test]
    fn an_estimator_that_follows_a_gps_jump_of_2_m_is_right_whatever_its_pace() {
        for pace_s in [0.1, 0.3, 0.5, 0.7, 1.0, 1.5] {
            let follows = |t_s: f64| 2.0 * (1.0 - (-(t_s - 2.0).max(0.0) / pace_s).exp());
            assert!(changes(follows).is_empty(), "{pace_s} s");
        }
    }
}
