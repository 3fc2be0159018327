//! The vector nearest to a desired one within every limit `x . u <= b`, in the plane.
//!
//! Limits are taken one after the other. A vector that breaks a new limit is replaced by the nearest one on that
//! limit's line within all limits before; since the feasible set is convex, the best one lies there (Seidel's
//! incremental linear programming; used for velocities by van den Berg, Guy, Lin, Manocha: Reciprocal n-body collision
//! avoidance, 2011, section 5). If no vector is within all limits, the one with the smallest greatest violation is
//! taken.
//!
//! The result moves by no more than the desired vector does, as long as the limits are compatible: it is a projection
//! onto a convex set.

use nalgebra::Vector2;

/// Most limits: one per sector, and some more.
pub const HALF_PLANES: usize = 80;
/// A violation smaller than this is rounding.
const BOUND_SLACK: f64 = 1e-9;
/// Directions nearer to parallel than this (sine of the angle) have no crossing.
const PARALLEL: f64 = 1e-9;

/// `x . toward <= bound`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfPlane {
    /// Unit vector.
    pub toward: Vector2<f64>,
    /// Greatest component of the answer along it.
    pub bound: f64,
}

impl HalfPlane {
    fn excess(&self, x: &Vector2<f64>) -> f64 {
        x.dot(&self.toward) - self.bound
    }
}

/// A list of limits that allocates nothing.
#[derive(Clone, Debug)]
pub struct HalfPlanes {
    len: usize,
    limits: [HalfPlane; HALF_PLANES],
}

impl Default for HalfPlanes {
    fn default() -> Self {
        Self {
            len: 0,
            limits: [HalfPlane {
                toward: Vector2::new(1.0, 0.0),
                bound: 0.0,
            }; HALF_PLANES],
        }
    }
}

impl HalfPlanes {
    /// Adds a limit; ignored when the list is full.
    pub fn push(&mut self, toward: Vector2<f64>, bound: f64) {
        if let Some(slot) = self.limits.get_mut(self.len) {
            *slot = HalfPlane { toward, bound };
            self.len += 1;
        }
    }

    fn all(&self) -> &[HalfPlane] {
        &self.limits[..self.len]
    }

    /// The vector nearest to `desired` within all limits.
    pub fn nearest(&self, desired: Vector2<f64>) -> Vector2<f64> {
        let mut x = desired;
        for (count, limit) in self.all().iter().enumerate() {
            if limit.excess(&x) <= BOUND_SLACK {
                continue;
            }
            match nearest_on(limit, &self.limits[..count], 0.0, &desired) {
                Some(better) => x = better,
                None => return self.least_broken(desired),
            }
        }
        x
    }

    /// The vector with every limit relaxed by the smallest slack that makes them compatible.
    fn least_broken(&self, desired: Vector2<f64>) -> Vector2<f64> {
        let (mut low, mut high) = (0.0, self.slack_of(&Vector2::zeros()).max(BOUND_SLACK));
        let mut best = Vector2::zeros();
        // Forty halvings: to a millionth of a millionth of the violation at rest.
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            match self.loosened(middle, desired) {
                Some(x) => {
                    best = x;
                    high = middle;
                }
                None => low = middle,
            }
        }
        best
    }

    fn slack_of(&self, x: &Vector2<f64>) -> f64 {
        self.all().iter().map(|limit| limit.excess(x)).fold(0.0, f64::max)
    }

    fn loosened(&self, slack: f64, desired: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut x = desired;
        for (count, limit) in self.all().iter().enumerate() {
            if limit.excess(&x) > slack + BOUND_SLACK {
                x = nearest_on(limit, &self.limits[..count], slack, &desired)?;
            }
        }
        Some(x)
    }
}

/// The place on the line of `limit` nearest to `desired` within all of `others`, everything relaxed by `slack`.
fn nearest_on(
    limit: &HalfPlane,
    others: &[HalfPlane],
    slack: f64,
    desired: &Vector2<f64>,
) -> Option<Vector2<f64>> {
    let along = Vector2::new(-limit.toward.y, limit.toward.x);
    let foot = limit.toward * (limit.bound + slack);
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for other in others {
        let slope = along.dot(&other.toward);
        let room = other.bound + slack - foot.dot(&other.toward);
        if slope.abs() < PARALLEL {
            if room < -BOUND_SLACK {
                return None;
            }
        } else if slope > 0.0 {
            to = to.min(room / slope);
        } else {
            from = from.max(room / slope);
        }
    }
    if from > to + BOUND_SLACK {
        return None;
    }
    let desired_along = desired.dot(&along);
    // Not `clamp`: rounding may have put the ends into the wrong order.
    Some(foot + along * desired_along.max(from).min(to))
}

#[cfg(test)]
mod tests {
    use super::{HalfPlane, HalfPlanes};
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn limits() -> impl Strategy<Value = Vec<HalfPlane>> {
        proptest::collection::vec((0.0..std::f64::consts::TAU, -1.0..4.0f64), 0..72).prop_map(|raw| {
            raw.into_iter()
                .map(|(angle, bound)| HalfPlane {
                    toward: Vector2::new(angle.cos(), angle.sin()),
                    bound,
                })
                .collect()
        })
    }

    fn list(limits: &[HalfPlane]) -> HalfPlanes {
        let mut list = HalfPlanes::default();
        for limit in limits {
            list.push(limit.toward, limit.bound);
        }
        list
    }

    fn excess(limits: &[HalfPlane], x: &Vector2<f64>) -> f64 {
        limits.iter().map(|limit| limit.excess(x)).fold(0.0, f64::max)
    }

    fn vector() -> impl Strategy<Value = Vector2<f64>> {
        (-6.0..6.0f64, -6.0..6.0f64).prop_map(|(x, y)| Vector2::new(x, y))
    }

    proptest! {
        #[test]
        fn nothing_allowed_is_nearer_to_the_desired_vector(limits in limits(), desired in vector(), other in vector()) {
            let answer = list(&limits).nearest(desired);
            let allowed = excess(&limits, &answer) < 1e-6;
            if excess(&limits, &other) <= 0.0 {
                prop_assert!(allowed, "there is an answer");
                prop_assert!((answer - desired).norm() <= (other - desired).norm() + 1e-6);
            }
        }

        #[test]
        fn what_is_allowed_stays(limits in limits(), desired in vector()) {
            if excess(&limits, &desired) <= 0.0 {
                prop_assert_eq!(list(&limits).nearest(desired), desired);
            }
        }

        #[test]
        fn where_not_all_can_be_kept_none_is_broken_more_than_needed(limits in limits(), desired in vector(), other in vector()) {
            let answer = list(&limits).nearest(desired);
            prop_assert!(answer.iter().all(|x| x.is_finite()));
            prop_assert!(excess(&limits, &answer) <= excess(&limits, &other) + 1e-6);
        }

        #[test]
        fn the_answer_moves_no_more_than_the_desired_vector(limits in limits(), desired in vector(), step in vector()) {
            let list = list(&limits);
            let (here, there) = (list.nearest(desired), list.nearest(desired + step));
            if excess(&limits, &here) < 1e-7 && excess(&limits, &there) < 1e-7 {
                prop_assert!((here - there).norm() <= step.norm() + 1e-6);
            }
        }
    }
}
