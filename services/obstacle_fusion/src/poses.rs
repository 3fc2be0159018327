//! Poses for rays: a hundred thousand of them in a sweep.
//!
//! | in | out |
//! |---|---|
//! | the history of poses, the offset of a ray | the pose as a matrix, or nothing |

use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::{self, PoseHistory, Reach};
use nalgebra::{Matrix3, Vector3};

/// Furthest moment from a measured state for which a pose is given (s): the deadline of the vehicle state. At 3 m/s2
/// of unknown acceleration 100 ms cost 15 mm, 200 ms would cost 60 mm, over half of what `OA_MAP_ERR` allows.
pub(crate) const MAX_GAP_S: f64 = 0.1;

/// No gap is too long near its ends.
pub(crate) const REACH: Reach = Reach {
    state_s: MAX_GAP_S,
    gap_s: f64::INFINITY,
};

/// `local_T_body`: takes body coordinates to local ones.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose {
    /// `local_R_body`.
    pub rotation: Matrix3<f64>,
    /// Position of the body's origin in the local frame (m).
    pub position_m: Vector3<f64>,
}

impl Pose {
    /// The angle between this attitude and that of `other` (rad).
    pub fn turned_rad(&self, other: &Pose) -> f64 {
        let cosine = 0.5 * (self.rotation.component_mul(&other.rotation).sum() - 1.0);
        cosine.clamp(-1.0, 1.0).acos()
    }

    /// The pose at `fraction` (0..1) of the way to `to`, component by component. Only for neighbours: between poses
    /// `a` radians apart the matrix is short of a rotation by `a^2 / 8`.
    fn blend(&self, to: &Pose, fraction: f64) -> Pose {
        Pose {
            rotation: self.rotation + (to.rotation - self.rotation) * fraction,
            position_m: self.position_m + (to.position_m - self.position_m) * fraction,
        }
    }
}

impl From<pose_history::Pose> for Pose {
    fn from(pose: pose_history::Pose) -> Self {
        Self {
            rotation: pose.local_q_body.to_rotation_matrix().into_inner(),
            position_m: pose.position_m,
        }
    }
}

/// log2 of the units of 10 us between two knots: a knot every 1.28 ms. In that time 10 rad/s turn by 13 mrad, which
/// puts a blended point at 60 m off by 1.2 mm, and 20 m/s2 bend a path by 4 um.
const KNOT_SHIFT: u32 = 7;
const UNITS_PER_KNOT: u16 = 1 << KNOT_SHIFT;
const NS_PER_UNIT: u64 = 10_000;
/// Every offset a point can have lies before the last knot.
const KNOTS: usize = (1 << (16 - KNOT_SHIFT)) + 1;

#[derive(Clone, Copy)]
enum Knot {
    NotAsked,
    Refused,
    Known(Pose),
}

/// The poses during one sweep, by offset from its first point: full interpolation at knots, made when first asked
/// for, and a blend between neighbours, so that a hundred thousand points cost a hundred interpolations.
pub(crate) struct SweepPoses {
    first: Timestamp,
    knots: Box<[Knot; KNOTS]>,
}

impl SweepPoses {
    pub fn new() -> Self {
        Self {
            first: Timestamp::NEVER,
            knots: Box::new([Knot::NotAsked; KNOTS]),
        }
    }

    /// Starts a sweep whose first point was measured at `first`.
    pub fn begin(&mut self, first: Timestamp) {
        self.first = first;
        self.knots.fill(Knot::NotAsked);
    }

    /// The pose `offset_10us` after the first point, if `history` knows it.
    pub fn at(&mut self, offset_10us: u16, history: &PoseHistory) -> Option<Pose> {
        let index = usize::from(offset_10us >> KNOT_SHIFT);
        let rest = offset_10us & (UNITS_PER_KNOT - 1);
        let from = self.knot(index, history)?;
        if rest == 0 {
            return Some(from);
        }
        let to = self.knot(index + 1, history)?;
        Some(from.blend(&to, f64::from(rest) / f64::from(UNITS_PER_KNOT)))
    }

    fn knot(&mut self, index: usize, history: &PoseHistory) -> Option<Pose> {
        if let Knot::NotAsked = self.knots[index] {
            let after_ns = index as u64 * u64::from(UNITS_PER_KNOT) * NS_PER_UNIT;
            let at = Timestamp::from_ns(self.first.ns.saturating_add(after_ns));
            self.knots[index] = history
                .at(at)
                .map_or(Knot::Refused, |pose| Knot::Known(pose.into()));
        }
        match self.knots[index] {
            Knot::Known(pose) => Some(pose),
            Knot::Refused | Knot::NotAsked => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Pose, REACH, SweepPoses};
    use jink_shared_types::Timestamp;
    use jink_shared_types::pose_history::{Estimate, PoseHistory};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    const START_S: f64 = 100.0;

    fn local(pose: &Pose, body_m: &Vector3<f64>) -> Vector3<f64> {
        pose.rotation * body_m + pose.position_m
    }

    /// A circle of 3 m radius at 1.5 rad/s while turning about two axes.
    fn estimate(t_s: f64) -> Estimate {
        let (sin, cos) = (1.5 * t_s).sin_cos();
        let rates_radps = Vector3::new(0.5, -0.2, 2.0);
        Estimate {
            position_m: Vector3::new(3.0 * cos, 3.0 * sin, -2.0 + 0.5 * t_s),
            velocity_mps: Vector3::new(-4.5 * sin, 4.5 * cos, 0.5),
            local_q_body: UnitQuaternion::from_euler_angles(0.3, 0.2, 0.0)
                * UnitQuaternion::from_scaled_axis(rates_radps * t_s),
            rates_radps,
        }
    }

    fn at(t_s: f64) -> Timestamp {
        Timestamp::from_seconds(START_S + t_s)
    }

    fn history(states: usize) -> PoseHistory {
        let mut history = PoseHistory::new(REACH);
        for i in 0..states {
            let t_s = i as f64 * 0.02;
            assert!(history.push(estimate(t_s), at(t_s)));
        }
        history
    }

    proptest! {
        #[test]
        fn a_sweep_agrees_with_the_history(offset in 0u16..60_000) {
            let history = history(100);
            let mut sweep = SweepPoses::new();
            sweep.begin(at(0.5));
            let body = Vector3::new(8.0, -3.0, 1.0);
            let exact = Pose::from(history.at(at(0.5 + f64::from(offset) * 1e-5)).unwrap());
            let swept = sweep.at(offset, &history).unwrap();
            prop_assert!((local(&exact, &body) - local(&swept, &body)).norm() < 2e-4);
        }
    }

    #[test]
    fn a_sweep_that_leaves_the_history_refuses_only_what_lies_outside() {
        let history = history(10);
        let mut sweep = SweepPoses::new();
        sweep.begin(at(0.1));
        assert!(sweep.at(10_000, &history).is_some());
        assert!(sweep.at(25_000, &history).is_none());
        assert!(sweep.at(10_000, &history).is_some());
    }
}
