//! The same problem, posed and solved independently with Clarabel: what our own method is compared with.
//!
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
//! lie in balls of the limits' size (second-order cones): by the hull property the whole curve then does. The end is at
//! rest, its position is free and drawn to the target; so a target that is too far for the time given costs but does
//! not make the problem infeasible.
//!
//! Objective: integral of the squared jerk, `T g' G g` with the control points `g` of the jerk and the Gram matrix of
//! the quadratic Bernstein polynomials, plus the squared distance of the end from the target and a light pull of the
//! joints towards the guide.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus,
    SupportedConeT,
};
use jink_bezier_generator::problem::{Infeasible, PieceSpec};
use jink_shared_types::bezier::{QUINTIC, derivative};
use jink_shared_types::motion::{MotionLimits, MotionState, Polytope};
use nalgebra::Vector3;

/// Weight of the squared distance between end and target.
const TARGET_WEIGHT: f64 = 10.0;
/// Weight of the squared jerk.
const JERK_WEIGHT: f64 = 0.01;
/// Weight of the squared distance of a joint from its guide vertex.
const GUIDE_WEIGHT: f64 = 0.05;
/// What the generator keeps from every bound (metres, and share of a limit).
pub const MARGIN: f64 = 1e-3;
/// The start may lie on a plane of its polytope, up to rounding (m).
const ON_THE_PLANE_M: f64 = 1e-5;
/// Iterations after which a problem counts as infeasible: feasible ones need 8 to 20.
const ITERATIONS_MAX: u32 = 40;

/// Gram matrix of the quadratic Bernstein polynomials on [0, 1].
const GRAM: [[f64; 3]; 3] = [
    [1.0 / 5.0, 1.0 / 10.0, 1.0 / 30.0],
    [1.0 / 10.0, 2.0 / 15.0, 1.0 / 10.0],
    [1.0 / 30.0, 1.0 / 10.0, 1.0 / 5.0],
];

/// An affine function of the variables, the same for all three axes: variable `index + axis` with its factor, and a
/// constant vector.
#[derive(Clone, Copy, Debug, Default)]
struct Affine {
    terms: [(usize, f64); 6],
    used: usize,
    constant: Vector3<f64>,
}

impl Affine {
    fn add(&mut self, other: &Self, factor: f64) {
        for (index, coefficient) in &other.terms[..other.used] {
            match self.terms[..self.used].iter_mut().find(|(have, _)| have == index) {
                Some((_, sum)) => *sum += coefficient * factor,
                None => {
                    self.terms[self.used] = (*index, coefficient * factor);
                    self.used += 1;
                }
            }
        }
        self.constant += other.constant * factor;
    }

    fn combine(parts: &[(&Self, f64)]) -> Self {
        let mut sum = Self::default();
        for (part, factor) in parts {
            sum.add(part, *factor);
        }
        sum
    }

    fn is_constant(&self) -> bool {
        self.terms[..self.used].iter().all(|(_, factor)| *factor == 0.0)
    }

    fn value(&self, x: &[f64]) -> Vector3<f64> {
        let mut value = self.constant;
        for (index, factor) in &self.terms[..self.used] {
            for axis in 0..3 {
                value[axis] += factor * x[index + axis];
            }
        }
        value
    }
}

/// Position, velocity and acceleration at a joint.
#[derive(Clone, Copy, Debug)]
struct Joint {
    position: Affine,
    velocity: Affine,
    acceleration: Affine,
}

fn constant(value: Vector3<f64>) -> Affine {
    Affine {
        constant: value,
        ..Affine::default()
    }
}

fn variable(index: usize) -> Affine {
    let mut affine = Affine {
        used: 1,
        ..Affine::default()
    };
    affine.terms[0] = (index, 1.0);
    affine
}

/// The constraint rows under construction: inequalities first, cones behind them.
#[derive(Debug, Default)]
struct ConstraintRows {
    triplets: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
}

impl ConstraintRows {
    fn clear(&mut self) {
        self.triplets.clear();
        self.right.clear();
    }

    /// `normal . expression <= bound`.
    fn below(&mut self, expression: &Affine, normal: &Vector3<f64>, bound: f64) {
        let row = self.right.len();
        for (index, factor) in &expression.terms[..expression.used] {
            for axis in 0..3 {
                let entry = factor * normal[axis];
                if entry != 0.0 {
                    self.triplets.push((row, index + axis, entry));
                }
            }
        }
        self.right.push(bound - normal.dot(&expression.constant));
    }

    /// `|expression| <= bound`, as four rows of a second-order cone.
    fn within(&mut self, expression: &Affine, bound: f64) {
        self.right.push(bound);
        for axis in 0..3 {
            let row = self.right.len();
            for (index, factor) in &expression.terms[..expression.used] {
                self.triplets.push((row, index + axis, -factor));
            }
            self.right.push(expression.constant[axis]);
        }
    }

    fn matrix(&self, columns: usize) -> CscMatrix<f64> {
        let (mut i, mut j, mut v) = (Vec::new(), Vec::new(), Vec::new());
        for (row, column, value) in &self.triplets {
            i.push(*row);
            j.push(*column);
            v.push(*value);
        }
        CscMatrix::new_from_triplets(self.right.len(), columns, i, j, v)
    }
}

/// What Clarabel says of a problem.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The control points of the pieces.
    pub curves: Result<Vec<[Vector3<f64>; QUINTIC]>, Infeasible>,
    /// Iterations.
    pub iterations: u32,
}

/// How exactly Clarabel solves: the gap, relative and absolute.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance(pub f64);

/// Poses and solves the problem; `margin` is what is kept from every bound (metres, and share of a limit).
pub fn solve(
    start: &MotionState,
    pieces: &[PieceSpec<'_>],
    target: &Vector3<f64>,
    limits: &MotionLimits,
    margin: f64,
    tolerance: Tolerance,
) -> Answer {
    let mut iterations = 0;
    let curves = curves(start, pieces, target, limits, margin, tolerance, &mut iterations);
    Answer { curves, iterations }
}

/// What the curves cost: their weighted squared jerk, and the pulls of the guide and the target.
pub fn objective(curves: &[[Vector3<f64>; QUINTIC]], pieces: &[PieceSpec<'_>], target: &Vector3<f64>) -> f64 {
    let mut sum = 0.0;
    for (index, (points, piece)) in curves.iter().zip(pieces).enumerate() {
        let t = piece.duration_s;
        let velocity: [_; 5] = derivative(points, t);
        let acceleration: [_; 4] = derivative(&velocity, t);
        let jerk: [_; 3] = derivative(&acceleration, t);
        for (a, weights) in jerk.iter().zip(GRAM) {
            for (b, weight) in jerk.iter().zip(weights) {
                sum += JERK_WEIGHT * t * weight * a.dot(b);
            }
        }
        let (place, weight) = if index + 1 == pieces.len() {
            (target, TARGET_WEIGHT)
        } else {
            (&piece.guide, GUIDE_WEIGHT)
        };
        sum += weight * (points[5] - place).norm_squared();
    }
    sum
}

fn curves(
    start: &MotionState,
    pieces: &[PieceSpec<'_>],
    target: &Vector3<f64>,
    limits: &MotionLimits,
    margin: f64,
    tolerance: Tolerance,
    iterations: &mut u32,
) -> Result<Vec<[Vector3<f64>; QUINTIC]>, Infeasible> {
    let origin = start.position.vector();
    let joints = joints(start, pieces.len());
    let count = 9 * (pieces.len() - 1) + 3;
    let mut cost = QuadraticCost::new(count);
    let mut inequalities = ConstraintRows::default();
    let mut cones = ConstraintRows::default();
    let mut points = Vec::with_capacity(pieces.len());
    for (index, piece) in pieces.iter().enumerate() {
        let controls = control_points(&joints[index], &joints[index + 1], piece.duration_s);
        let t = piece.duration_s;
        let velocity: [Affine; 5] = differences(&controls, 5.0 / t);
        let acceleration: [Affine; 4] = differences(&velocity, 4.0 / t);
        let jerk: [Affine; 3] = differences(&acceleration, 3.0 / t);
        for control in &controls {
            keep_inside(control, piece.polytope, &origin, margin, &mut inequalities)?;
        }
        for v in &velocity {
            keep_within(v, limits.speed_mps, margin, &mut cones)?;
            keep_below(v, -Vector3::z(), limits.climb_mps, margin, &mut inequalities)?;
            keep_below(v, Vector3::z(), limits.descent_mps, margin, &mut inequalities)?;
        }
        for a in &acceleration {
            keep_within(a, limits.acceleration_mps2, margin, &mut cones)?;
        }
        for j in &jerk {
            keep_within(j, limits.jerk_mps3, margin, &mut cones)?;
        }
        for (k, row) in GRAM.iter().enumerate() {
            for (l, weight) in row.iter().enumerate() {
                cost.add(&jerk[k], &jerk[l], JERK_WEIGHT * t * weight);
            }
        }
        if index + 1 < pieces.len() {
            cost.pull(&joints[index + 1].position, &(piece.guide - origin), GUIDE_WEIGHT);
        }
        points.push(controls);
    }
    cost.pull(&joints[pieces.len()].position, &(target - origin), TARGET_WEIGHT);
    let x = run(&cost, &inequalities, &cones, tolerance, iterations)?;
    let curve = |controls: &[Affine; QUINTIC]| controls.map(|control| control.value(&x) + origin);
    Ok(points.iter().map(curve).collect())
}

/// The joints: the start is given, the end rests, everything between is variable.
fn joints(start: &MotionState, pieces: usize) -> Vec<Joint> {
    let mut joints = vec![Joint {
        position: constant(Vector3::zeros()),
        velocity: constant(start.velocity.vector()),
        acceleration: constant(start.acceleration.vector()),
    }];
    for k in 0..pieces - 1 {
        joints.push(Joint {
            position: variable(9 * k),
            velocity: variable(9 * k + 3),
            acceleration: variable(9 * k + 6),
        });
    }
    joints.push(Joint {
        position: variable(9 * (pieces - 1)),
        velocity: constant(Vector3::zeros()),
        acceleration: constant(Vector3::zeros()),
    });
    joints
}

fn control_points(from: &Joint, to: &Joint, t: f64) -> [Affine; QUINTIC] {
    let (h, k) = (t / 5.0, t * t / 20.0);
    [
        from.position,
        Affine::combine(&[(&from.position, 1.0), (&from.velocity, h)]),
        Affine::combine(&[
            (&from.position, 1.0),
            (&from.velocity, 2.0 * h),
            (&from.acceleration, k),
        ]),
        Affine::combine(&[
            (&to.position, 1.0),
            (&to.velocity, -2.0 * h),
            (&to.acceleration, k),
        ]),
        Affine::combine(&[(&to.position, 1.0), (&to.velocity, -h)]),
        to.position,
    ]
}

fn differences<const N: usize, const M: usize>(points: &[Affine; N], factor: f64) -> [Affine; M] {
    const { assert!(M + 1 == N, "a derivative has one control point less") };
    std::array::from_fn(|i| Affine::combine(&[(&points[i + 1], factor), (&points[i], -factor)]))
}

/// Inside all planes; a control point that the start fixes must already be.
fn keep_inside(
    control: &Affine,
    polytope: &Polytope,
    origin: &Vector3<f64>,
    margin: f64,
    rows: &mut ConstraintRows,
) -> Result<(), Infeasible> {
    for plane in polytope.planes() {
        let normal = Vector3::from(plane.normal);
        let bound = plane.offset_m - normal.dot(origin);
        if control.is_constant() {
            if normal.dot(&control.constant) > bound + ON_THE_PLANE_M {
                return Err(Infeasible::Start);
            }
        } else {
            rows.below(control, &normal, bound - margin);
        }
    }
    Ok(())
}

/// Within a norm ball; what the start fixes may exceed the limit by its tolerance.
fn keep_within(
    expression: &Affine,
    limit: f64,
    margin: f64,
    rows: &mut ConstraintRows,
) -> Result<(), Infeasible> {
    if expression.is_constant() {
        if expression.constant.norm() > MotionLimits::allowed(limit) {
            return Err(Infeasible::Start);
        }
    } else {
        rows.within(expression, limit * (1.0 - margin));
    }
    Ok(())
}

/// The same for one direction.
fn keep_below(
    expression: &Affine,
    normal: Vector3<f64>,
    limit: f64,
    margin: f64,
    rows: &mut ConstraintRows,
) -> Result<(), Infeasible> {
    if expression.is_constant() {
        if normal.dot(&expression.constant) > MotionLimits::allowed(limit) {
            return Err(Infeasible::Start);
        }
    } else {
        rows.below(expression, &normal, limit * (1.0 - margin));
    }
    Ok(())
}

/// The quadratic objective `x' P x / 2 + q' x`, `P` dense.
#[derive(Debug)]
struct QuadraticCost {
    size: usize,
    p: Vec<f64>,
    q: Vec<f64>,
}

impl QuadraticCost {
    fn new(size: usize) -> Self {
        Self {
            size,
            p: vec![0.0; size * size],
            q: vec![0.0; size],
        }
    }

    /// Adds `weight * a . b`; over all ordered pairs of a form this gives the symmetric matrix.
    fn add(&mut self, a: &Affine, b: &Affine, weight: f64) {
        for axis in 0..3 {
            for (i, fi) in &a.terms[..a.used] {
                for (j, fj) in &b.terms[..b.used] {
                    // Half goes to each triangle; the objective has a factor of one half in front of P.
                    self.p[(i + axis) * self.size + j + axis] += weight * fi * fj;
                    self.p[(j + axis) * self.size + i + axis] += weight * fi * fj;
                }
                self.q[i + axis] += weight * fi * b.constant[axis];
            }
            for (j, fj) in &b.terms[..b.used] {
                self.q[j + axis] += weight * fj * a.constant[axis];
            }
        }
    }

    /// Adds `weight * |expression - place|^2`.
    fn pull(&mut self, expression: &Affine, place: &Vector3<f64>, weight: f64) {
        let mut difference = *expression;
        difference.constant -= place;
        self.add(&difference, &difference, weight);
    }

    fn matrix(&self) -> CscMatrix<f64> {
        let (mut i, mut j, mut v) = (Vec::new(), Vec::new(), Vec::new());
        for column in 0..self.size {
            for row in 0..=column {
                let value = self.p[row * self.size + column];
                if value != 0.0 {
                    i.push(row);
                    j.push(column);
                    v.push(value);
                }
            }
        }
        CscMatrix::new_from_triplets(self.size, self.size, i, j, v)
    }
}

fn run(
    cost: &QuadraticCost,
    inequalities: &ConstraintRows,
    cones: &ConstraintRows,
    tolerance: Tolerance,
    iterations: &mut u32,
) -> Result<Vec<f64>, Infeasible> {
    let mut rows = ConstraintRows::default();
    rows.clear();
    rows.triplets.extend_from_slice(&inequalities.triplets);
    rows.right.extend_from_slice(&inequalities.right);
    let below = inequalities.right.len();
    rows.triplets.extend(
        cones
            .triplets
            .iter()
            .map(|(row, column, value)| (row + below, *column, *value)),
    );
    rows.right.extend_from_slice(&cones.right);
    let mut kinds: Vec<SupportedConeT<f64>> = vec![NonnegativeConeT(below)];
    kinds.extend((0..cones.right.len() / 4).map(|_| SecondOrderConeT(4)));
    let settings = DefaultSettings {
        verbose: false,
        max_iter: ITERATIONS_MAX,
        tol_gap_abs: tolerance.0,
        tol_gap_rel: tolerance.0,
        tol_feas: 1e-6,
        presolve_enable: false,
        ..DefaultSettings::default()
    };
    let mut solver = DefaultSolver::new(
        &cost.matrix(),
        &cost.q,
        &rows.matrix(cost.size),
        &rows.right,
        &kinds,
        settings,
    )
    .map_err(|_| Infeasible::Solver)?;
    solver.solve();
    *iterations = solver.solution.iterations;
    match solver.solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => Ok(solver.solution.x.clone()),
        _ => Err(Infeasible::Solver),
    }
}
