//! Bezier curves: evaluation, derivatives, subdivision, and the closed form between two states.
//!
//! A curve of degree `n` over duration `T` has control points `P[0..=n]`; with `u = t / T`
//!
//! * position `B(u) = sum_i C(n,i) (1-u)^(n-i) u^i P[i]` (de Casteljau's algorithm),
//! * velocity: degree `n-1` with control points `n (P[i+1] - P[i]) / T`,
//! * hull property: the curve lies in the convex hull of its control points, so a half-space that holds all control
//!   points holds the whole curve, and a bound on a derivative's control points bounds the derivative.
//!
//! Source: G. Farin, "Curves and Surfaces for CAGD", chapters 4 and 5.

use nalgebra::Vector3;

/// Number of control points of jink's own curves: quintic, so that position, velocity and acceleration can be given at both ends.
pub const QUINTIC: usize = 6;

/// Evaluates the curve with control points `points` at `u` in [0, 1].
pub fn evaluate<const N: usize>(points: &[Vector3<f64>; N], u: f64) -> Vector3<f64> {
    let mut work = *points;
    for level in (1..N).rev() {
        for i in 0..level {
            work[i] = work[i] * (1.0 - u) + work[i + 1] * u;
        }
    }
    work[0]
}

/// Evaluates a one-dimensional curve at `u` in [0, 1].
pub fn evaluate_scalar<const N: usize>(points: &[f64; N], u: f64) -> f64 {
    let mut work = *points;
    for level in (1..N).rev() {
        for i in 0..level {
            work[i] = work[i] * (1.0 - u) + work[i + 1] * u;
        }
    }
    work[0]
}

/// Control points of the derivative with respect to time of a curve of duration `duration_s`. `M` must be `N - 1`.
pub fn derivative<const N: usize, const M: usize>(
    points: &[Vector3<f64>; N],
    duration_s: f64,
) -> [Vector3<f64>; M] {
    const { assert!(M + 1 == N, "a derivative has one control point less") };
    let factor = (N - 1) as f64 / duration_s;
    std::array::from_fn(|i| (points[i + 1] - points[i]) * factor)
}

/// Control points of the derivative of a one-dimensional curve. `M` must be `N - 1`.
pub fn derivative_scalar<const N: usize, const M: usize>(points: &[f64; N], duration_s: f64) -> [f64; M] {
    const { assert!(M + 1 == N, "a derivative has one control point less") };
    let factor = (N - 1) as f64 / duration_s;
    std::array::from_fn(|i| (points[i + 1] - points[i]) * factor)
}

/// Cuts a curve at `u`: the control points of the part before and of the part after (de Casteljau).
pub fn split<const N: usize>(points: &[Vector3<f64>; N], u: f64) -> ([Vector3<f64>; N], [Vector3<f64>; N]) {
    let mut work = *points;
    let mut left = *points;
    let mut right = *points;
    left[0] = work[0];
    right[N - 1] = work[N - 1];
    for level in (1..N).rev() {
        for i in 0..level {
            work[i] = work[i] * (1.0 - u) + work[i + 1] * u;
        }
        left[N - level] = work[0];
        right[level - 1] = work[level - 1];
    }
    (left, right)
}

/// Cuts a one-dimensional curve at `u`.
pub fn split_scalar<const N: usize>(points: &[f64; N], u: f64) -> ([f64; N], [f64; N]) {
    let lifted: [Vector3<f64>; N] = std::array::from_fn(|i| Vector3::new(points[i], 0.0, 0.0));
    let (left, right) = split(&lifted, u);
    (
        std::array::from_fn(|i| left[i].x),
        std::array::from_fn(|i| right[i].x),
    )
}

/// Whether the whole curve keeps the convex condition `keeps`, as far as its hull shows. The hull is larger than the
/// curve: where it sticks out the curve is cut in halves, at most `halvings` times, each of which takes away three
/// quarters of the excess. Never true for a curve that breaks the condition somewhere.
pub fn hull_keeps<const N: usize>(
    points: &[Vector3<f64>; N],
    halvings: u32,
    keeps: &impl Fn(&Vector3<f64>) -> bool,
) -> bool {
    if points.iter().all(keeps) {
        return true;
    }
    if halvings == 0 {
        return false;
    }
    let (before, after) = split(points, 0.5);
    hull_keeps(&before, halvings - 1, keeps) && hull_keeps(&after, halvings - 1, keeps)
}

/// Position, velocity and acceleration at one end of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct End {
    /// Position (m).
    pub position: Vector3<f64>,
    /// Velocity (m/s).
    pub velocity: Vector3<f64>,
    /// Acceleration (m/s^2).
    pub acceleration: Vector3<f64>,
}

/// The quintic of duration `duration_s` from state `start` to state `end`: the minimum-jerk motion between them.
///
/// Each end fixes three control points: `P0 = p`, `P1 = p + v T/5`, `P2 = a T^2/20 + 2 P1 - P0`, mirrored at the end.
pub fn quintic_between(start: &End, end: &End, duration_s: f64) -> [Vector3<f64>; QUINTIC] {
    let h = duration_s / 5.0;
    let k = duration_s * duration_s / 20.0;
    let p0 = start.position;
    let p1 = p0 + start.velocity * h;
    let p2 = start.acceleration * k + p1 * 2.0 - p0;
    let p5 = end.position;
    let p4 = p5 - end.velocity * h;
    let p3 = end.acceleration * k + p4 * 2.0 - p5;
    [p0, p1, p2, p3, p4, p5]
}

/// The quartic of duration `duration_s` that starts in state `start` and ends at `end_position` with `end_velocity`:
/// five control points, as many as MAVLink's TRAJECTORY_REPRESENTATION_BEZIER carries.
pub fn quartic_between(
    start: &End,
    end_position: Vector3<f64>,
    end_velocity: Vector3<f64>,
    duration_s: f64,
) -> [Vector3<f64>; 5] {
    let p0 = start.position;
    let p1 = p0 + start.velocity * (duration_s / 4.0);
    let p2 = start.acceleration * (duration_s * duration_s / 12.0) + p1 * 2.0 - p0;
    let p3 = end_position - end_velocity * (duration_s / 4.0);
    [p0, p1, p2, p3, end_position]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        (-50.0..50.0f64, -50.0..50.0f64, -50.0..50.0f64).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    fn quintic() -> impl Strategy<Value = [Vector3<f64>; 6]> {
        proptest::array::uniform6(vector())
    }

    fn end() -> impl Strategy<Value = End> {
        (vector(), vector(), vector()).prop_map(|(position, velocity, acceleration)| End {
            position,
            velocity,
            acceleration,
        })
    }

    proptest! {
        #[test]
        fn what_the_hull_keeps_the_curve_keeps_and_what_all_points_keep_needs_no_halving(
            points in quintic(), bound in 1.0..100.0f64, halvings in 0u32..4, u in 0.0..=1.0f64,
        ) {
            let keeps = |point: &Vector3<f64>| point.norm() <= bound;
            let kept = hull_keeps(&points, halvings, &keeps);
            prop_assert!(!kept || evaluate(&points, u).norm() <= bound + 1e-9);
            prop_assert!(kept || !points.iter().all(keeps));
        }

        #[test]
        fn a_half_space_that_holds_the_control_points_holds_the_curve(
            points in quintic(), normal in vector(), u in 0.0..=1.0f64,
        ) {
            let bound = points.iter().map(|p| normal.dot(p)).fold(f64::MIN, f64::max);
            prop_assert!(normal.dot(&evaluate(&points, u)) <= bound + 1e-6);
        }

        #[test]
        fn both_parts_of_a_cut_trace_the_same_curve(points in quintic(), cut in 0.01..0.99f64, u in 0.0..=1.0f64) {
            let (left, right) = split(&points, cut);
            prop_assert!((evaluate(&left, u) - evaluate(&points, u * cut)).norm() < 1e-9);
            prop_assert!((evaluate(&right, u) - evaluate(&points, cut + u * (1.0 - cut))).norm() < 1e-9);
        }

        #[test]
        fn the_quintic_meets_both_ends(start in end(), finish in end(), duration in 0.1..10.0f64) {
            let points = quintic_between(&start, &finish, duration);
            let velocity: [_; 5] = derivative(&points, duration);
            let acceleration: [_; 4] = derivative(&velocity, duration);
            for (u, state) in [(0.0, start), (1.0, finish)] {
                prop_assert!((evaluate(&points, u) - state.position).norm() < 1e-6);
                prop_assert!((evaluate(&velocity, u) - state.velocity).norm() < 1e-6);
                prop_assert!((evaluate(&acceleration, u) - state.acceleration).norm() < 1e-4);
            }
        }

        #[test]
        fn the_quartic_meets_its_five_conditions(start in end(), finish in end(), duration in 0.1..10.0f64) {
            let points = quartic_between(&start, finish.position, finish.velocity, duration);
            let velocity: [_; 4] = derivative(&points, duration);
            let acceleration: [_; 3] = derivative(&velocity, duration);
            prop_assert!((evaluate(&points, 0.0) - start.position).norm() < 1e-6);
            prop_assert!((evaluate(&velocity, 0.0) - start.velocity).norm() < 1e-6);
            prop_assert!((evaluate(&acceleration, 0.0) - start.acceleration).norm() < 1e-4);
            prop_assert!((evaluate(&points, 1.0) - finish.position).norm() < 1e-6);
            prop_assert!((evaluate(&velocity, 1.0) - finish.velocity).norm() < 1e-6);
        }
    }
}
