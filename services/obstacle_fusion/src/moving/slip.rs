//! How far the estimated position has slipped: it moves otherwise than the estimated velocity says, as when an estimator follows a
//! GPS that is off. Everything at rest seems to move so, too.

use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::Estimate;
use nalgebra::Vector3;

/// Estimates further apart (s) say nothing.
const GAP_S: f64 = 0.2;

/// The slip of the estimated position.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slip {
    last: Option<(Timestamp, Estimate)>,
    slipped_m: Vector3<f64>,
}

impl Slip {
    /// Takes the estimate of `at`.
    pub fn update(&mut self, at: Timestamp, estimate: &Estimate) {
        let Some((last_at, last)) = self.last.replace((at, *estimate)) else {
            return;
        };
        let passed_s = at.seconds_since(last_at);
        if (0.0..=GAP_S).contains(&passed_s) {
            let expected_m = (last.velocity_mps + estimate.velocity_mps) * (0.5 * passed_s);
            self.slipped_m += estimate.position_m - last.position_m - expected_m;
        }
    }

    /// How far it has slipped so far (m, local).
    pub fn slipped_m(&self) -> Vector3<f64> {
        self.slipped_m
    }
}
