//! The optimisation: quintic pieces through a corridor, least jerk, within speed, acceleration and jerk.
//!
//! Neighbouring pieces share position, velocity and acceleration at their joint, so these nine numbers per joint are
//! the variables and continuity needs no constraint. With `p, v, a` at both ends of a piece of duration `T` its control
//! points are
//!
//! ```text
//! c0 = p0                c1 = p0 + v0 T/5       c2 = p0 + 2 v0 T/5 + a0 T^2/20
//! c5 = p1                c4 = p1 - v1 T/5       c3 = p1 - 2 v1 T/5 + a1 T^2/20
//! ```
//!
//! all linear in the variables. Every control point lies in the piece's polytope, the control points of the derivatives
//! lie in balls of the limits' size (second-order cones): by the hull property the whole curve then does. A piece that
//! brakes has larger balls, and half-spaces that bound its acceleration across the way. The end is at
//! rest, its position is free and drawn to the target; so a target that is too far for the time given costs but does
//! not make the problem infeasible.
//!
//! Objective: integral of the squared jerk, `T g' G g` with the control points `g` of the jerk and the Gram matrix of
//! the quadratic Bernstein polynomials, plus the squared distance of the end from the target and a light pull of the
//! joints towards the guide.

use crate::interior_point::InteriorPoint;
use crate::interior_point::chain::{Chain, Factors, HalfSpaceRow, Joint};
use jink_shared_types::bezier::QUINTIC;
use jink_shared_types::motion::{MotionLimits, MotionState, POLYTOPE_PLANES, Polytope};
use nalgebra::Vector3;

/// Weight of the squared distance between end and target.
const TARGET_WEIGHT: f64 = 10.0;
/// Weight of the squared jerk.
const JERK_WEIGHT: f64 = 0.01;
/// Weight of the squared distance of a joint from its guide vertex.
const GUIDE_WEIGHT: f64 = 0.05;
/// Kept from every bound, so that the solver's tolerance never breaks it (metres, and share of a limit).
const MARGIN: f64 = 1e-3;
/// The same across the way of a piece that brakes: its own way differs from its guide's.
const ACROSS_MARGIN: f64 = 0.1;
/// The start may lie on a plane of its polytope, up to rounding (m).
const ON_THE_PLANE_M: f64 = 1e-5;
/// Bounds are posed as shares of their limits, so that all have the size of one; of smaller limits than this as shares
/// of it.
const UNIT_MIN: f64 = 1e-3;
/// Forms of a piece that are kept somewhere: control points of position, velocity, acceleration and jerk.
const FORMS: usize = 6 + 5 + 4 + 3;
/// Most half-spaces of a piece: of its polytope for the control points, of climb and descent for those of the velocity, across the way
/// for those of the acceleration.
const ROWS: usize = 6 * POLYTOPE_PLANES + 2 * 5 + 4 * 4;

/// Gram matrix of the quadratic Bernstein polynomials on [0, 1].
const GRAM: [[f64; 3]; 3] = [
    [1.0 / 5.0, 1.0 / 10.0, 1.0 / 30.0],
    [1.0 / 10.0, 2.0 / 15.0, 1.0 / 10.0],
    [1.0 / 30.0, 1.0 / 10.0, 1.0 / 5.0],
];

/// One piece to be found.
#[derive(Clone, Copy, Debug)]
pub struct PieceSpec<'a> {
    /// Its duration (s).
    pub duration_s: f64,
    /// Where all of it must lie.
    pub polytope: &'a Polytope,
    /// Where its end should be, with a small weight.
    pub guide: Vector3<f64>,
    /// It may brake as hard as a stop.
    pub brakes: bool,
    /// The unit vectors across its way along which its acceleration is bounded then.
    pub across: Option<[Vector3<f64>; 2]>,
}

/// Why there is no curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Infeasible {
    /// The start's own control points leave the corridor or the limits, whatever comes after.
    Start,
    /// The solver found no curve.
    Solver,
}

/// Finds curves; owns the memory for it.
#[derive(Debug)]
pub struct CurveSolver {
    chain: Chain,
    solver: InteriorPoint,
}

impl CurveSolver {
    /// A solver with memory for so many pieces.
    pub fn with_capacity(pieces: usize) -> Self {
        Self {
            chain: Chain::with_capacity(pieces, FORMS, ROWS),
            solver: InteriorPoint::with_capacity(pieces, FORMS, ROWS),
        }
    }

    /// Finds the pieces, relative to the start's position, and writes their control points into `curves` (absolute).
    ///
    /// # Errors
    /// [`Infeasible`].
    pub fn solve(
        &mut self,
        start: &MotionState,
        pieces: &[PieceSpec<'_>],
        target: &Vector3<f64>,
        limits: &MotionLimits,
        curves: &mut Vec<[Vector3<f64>; QUINTIC]>,
    ) -> Result<(), Infeasible> {
        let origin = start.position.vector();
        self.pose(start, pieces, target, limits)?;
        let joints = self.solver.solve(&self.chain).map_err(|_| Infeasible::Solver)?;
        curves.clear();
        for (piece, ends) in pieces.iter().zip(joints.windows(2)) {
            let vector = |k: usize| Vector3::from_column_slice(&ends[k / 3][3 * (k % 3)..][..3]);
            let point = |factors: Factors| {
                let parts = factors.iter().enumerate().map(|(k, factor)| vector(k) * *factor);
                parts.sum::<Vector3<f64>>() + origin
            };
            curves.push(control_points(piece.duration_s).map(point));
        }
        Ok(())
    }

    /// Poses the problem.
    fn pose(
        &mut self,
        start: &MotionState,
        pieces: &[PieceSpec<'_>],
        target: &Vector3<f64>,
        limits: &MotionLimits,
    ) -> Result<(), Infeasible> {
        let origin = start.position.vector();
        let speed_mps = MotionLimits::allowed(limits.speed_mps);
        let hardest_mps2 = MotionLimits::allowed(limits.acceleration_mps2.max(limits.braking_mps2));
        self.chain.restart(first_joint(start));
        let (mut before_s, mut before, mut braked) = (0.0, None, false);
        for (index, piece) in pieces.iter().enumerate() {
            let is_last = index + 1 == pieces.len();
            let t = piece.duration_s;
            let controls = control_points(t);
            let velocity: [Factors; 5] = differences(&controls, 5.0 / t);
            let acceleration: [Factors; 4] = differences(&velocity, 4.0 / t);
            let jerk: [Factors; 3] = differences(&acceleration, 3.0 / t);
            let place = if is_last { *target } else { piece.guide } - origin;
            let end = Joint {
                free: if is_last { 3 } else { 9 },
                value: [0.0; 9],
                reach: [speed_mps * (before_s + t), speed_mps, hardest_mps2],
                pull: if is_last { TARGET_WEIGHT } else { GUIDE_WEIGHT },
                place: place.into(),
            };
            self.chain.append(&jerk_cost(&jerk, t), end);
            // What the piece before has kept at their joint is not repeated, nor what is equal because the end rests.
            let is_first = index == 0;
            let first = usize::from(before == Some(piece.polytope));
            for (n, control) in controls.iter().enumerate().skip(first) {
                if !is_last || n != 3 && n != 4 {
                    let reach_m = speed_mps * (before_s + t * n as f64 / 5.0);
                    self.keep_inside(control, piece.polytope, &origin, reach_m)?;
                }
            }
            let skipped = usize::from(!is_first);
            for v in velocity.iter().skip(skipped) {
                self.keep_slow(v, limits)?;
            }
            let (most_mps2, most_mps3) = match piece.brakes {
                true => (limits.braking_mps2, limits.braking_jerk_mps3),
                false => (limits.acceleration_mps2, limits.jerk_mps3),
            };
            let skipped = usize::from(!is_first && piece.brakes == braked);
            for a in acceleration.iter().skip(skipped) {
                self.keep_within(a, most_mps2)?;
            }
            if let Some(across) = &piece.across {
                for a in &acceleration {
                    self.keep_straight(a, across, limits.across_mps2());
                }
            }
            for j in &jerk {
                self.keep_within(j, most_mps3)?;
            }
            (before_s, before, braked) = (before_s + t, Some(piece.polytope), piece.brakes);
        }
        Ok(())
    }

    /// Inside all planes that it may reach; a control point that the start fixes must already be.
    fn keep_inside(
        &mut self,
        control: &Factors,
        polytope: &Polytope,
        origin: &Vector3<f64>,
        reach_m: f64,
    ) -> Result<(), Infeasible> {
        let (value, is_fixed) = self.chain.fixed_part(control);
        let rows = polytope.planes().iter().map(|plane| {
            let [x, y, z] = plane.normal;
            [x, y, z, plane.offset_m - Vector3::from(plane.normal).dot(origin)]
        });
        if is_fixed {
            let mut rows = rows;
            let is_inside = |[x, y, z, bound]: HalfSpaceRow| {
                x * value[0] + y * value[1] + z * value[2] <= bound + ON_THE_PLANE_M
            };
            return if rows.all(is_inside) {
                Ok(())
            } else {
                Err(Infeasible::Start)
            };
        }
        let rows = rows.map(|[x, y, z, bound]| [x, y, z, bound - MARGIN]);
        // What is not a number is kept, and then nothing is found.
        let is_reached = |[x, y, z, bound]: &HalfSpaceRow| {
            bound.is_nan() || (x * x + y * y + z * z).sqrt() * reach_m > *bound
        };
        self.chain.keep(control, rows.filter(is_reached), None);
        Ok(())
    }

    /// Within the limits of speed, climb and descent.
    fn keep_slow(&mut self, velocity: &Factors, limits: &MotionLimits) -> Result<(), Infeasible> {
        let vertical = [(-1.0, limits.climb_mps), (1.0, limits.descent_mps)];
        let (value, is_fixed) = self.chain.fixed_part(velocity);
        if is_fixed {
            let is_kept = |(sign, limit): (f64, f64)| sign * value[2] <= MotionLimits::allowed(limit);
            if !vertical.into_iter().all(is_kept) {
                return Err(Infeasible::Start);
            }
            return keeps(&value, limits.speed_mps);
        }
        let unit = limits.speed_mps.max(UNIT_MIN);
        let rows = vertical
            .into_iter()
            .filter(|(_, limit)| *limit < limits.speed_mps)
            .map(|(sign, limit)| [0.0, 0.0, sign, limit * (1.0 - MARGIN) / unit]);
        let bound = limits.speed_mps * (1.0 - MARGIN) / unit;
        self.chain
            .keep(&velocity.map(|factor| factor / unit), rows, Some(bound));
        Ok(())
    }

    /// Within a norm ball; what the start fixes may exceed the limit by its tolerance.
    fn keep_within(&mut self, form: &Factors, limit: f64) -> Result<(), Infeasible> {
        let (value, is_fixed) = self.chain.fixed_part(form);
        if is_fixed {
            return keeps(&value, limit);
        }
        let unit = limit.max(UNIT_MIN);
        let bound = limit * (1.0 - MARGIN) / unit;
        self.chain
            .keep(&form.map(|factor| factor / unit), std::iter::empty(), Some(bound));
        Ok(())
    }

    /// Within `limit` along both vectors. What the start fixes is as it is.
    fn keep_straight(&mut self, form: &Factors, across: &[Vector3<f64>; 2], limit: f64) {
        let (_, is_fixed) = self.chain.fixed_part(form);
        if is_fixed {
            return;
        }
        let unit = limit.max(UNIT_MIN);
        let bound = limit * (1.0 - ACROSS_MARGIN) / unit;
        let rows = across.iter().flat_map(|normal| {
            [1.0, -1.0].map(|sign| [sign * normal.x, sign * normal.y, sign * normal.z, bound])
        });
        self.chain.keep(&form.map(|factor| factor / unit), rows, None);
    }

    /// Iterations that the last problem took whose start was feasible.
    pub fn iterations(&self) -> u32 {
        self.solver.iterations()
    }
}

/// The start is given.
fn first_joint(start: &MotionState) -> Joint {
    let (v, a) = (start.velocity.vector(), start.acceleration.vector());
    Joint {
        free: 0,
        value: [0.0, 0.0, 0.0, v.x, v.y, v.z, a.x, a.y, a.z],
        reach: [0.0; 3],
        pull: 0.0,
        place: [0.0; 3],
    }
}

fn keeps(value: &[f64; 3], limit: f64) -> Result<(), Infeasible> {
    if Vector3::from(*value).norm() <= MotionLimits::allowed(limit) {
        Ok(())
    } else {
        Err(Infeasible::Start)
    }
}

/// The control points of a piece of duration `t` (s) in terms of its joints (see the module's comment).
fn control_points(t: f64) -> [Factors; QUINTIC] {
    let (h, k) = (t / 5.0, t * t / 20.0);
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1.0, h, 0.0, 0.0, 0.0, 0.0],
        [1.0, 2.0 * h, k, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, -2.0 * h, k],
        [0.0, 0.0, 0.0, 1.0, -h, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    ]
}

fn differences<const N: usize, const M: usize>(points: &[Factors; N], factor: f64) -> [Factors; M] {
    const { assert!(M + 1 == N, "a derivative has one control point less") };
    std::array::from_fn(|i| std::array::from_fn(|k| (points[i + 1][k] - points[i][k]) * factor))
}

/// The matrix of the weighted integral of the squared jerk over a piece of duration `t` (s), for `x' P x / 2`.
fn jerk_cost(jerk: &[Factors; 3], t: f64) -> [Factors; 6] {
    let mut cost = [[0.0; 6]; 6];
    for (first, weights) in jerk.iter().zip(GRAM) {
        for (second, weight) in jerk.iter().zip(weights) {
            for (row, a) in cost.iter_mut().zip(first) {
                for (entry, b) in row.iter_mut().zip(second) {
                    *entry += 2.0 * JERK_WEIGHT * t * weight * a * b;
                }
            }
        }
    }
    cost
}
