//! A primal-dual interior-point method for curves: minimise a convex quadratic cost of the joints of a chain of pieces,
//! with linear forms of each piece inside half-spaces and balls.
//!
//! | in | out |
//! |---|---|
//! | a [`Chain`] | the joints' values, or why there are none |
//!
//! With `x` the joints' position, velocity and acceleration, the problem is `min x' P x / 2 + q' x` with `G x + s = h`,
//! `s` in a product of half-lines (half-spaces) and second-order cones of dimension four (balls). The method is
//! Mehrotra's predictor and corrector with the scaling of Nesterov and Todd, as in L. Vandenberghe, "The CVXOPT linear
//! and quadratic cone program solvers", 2010 (its path-following method for quadratic cone programs). Slack and dual are eliminated from each Newton system:
//!
//! ```text
//! (P + G' W^-2 G) dx = -(P x + q + G' z) + G' W^-2 t
//! dz = W^-2 (G dx - t)           ds = -(G x + s - h) - G dx
//! t  = h - G x                                                  predictor
//! t  = h - G x + W (l \ (W^-1 ds o W dz - sigma mu e))          corrector,  l = W z = W^-1 s
//! ```
//!
//! A piece touches its two joints only, so the matrix is block tridiagonal ([`tridiagonal`]). A form treats the three
//! axes alike: it is `c . (p0, v0, a0, p1, v1, a1)` with six factors `c`, and adds `c c'` times one symmetric matrix
//! of three rows to the matrix of its piece.
//!
//! Infeasibility is proven by the duals: for `x` that keeps all constraints and `z` in the cone `z' (h - G x) >= 0`.
//! Where `h' z` is more negative than `|G' z|` times how far a joint may be from zero ([`chain::Joint::reach`]), there is no
//! such `x`. That happens long before the duals converge to a ray.
//!
//! Rounding: the equations' condition grows as slacks vanish, so that in a corridor of a few centimetres the residual of
//! the gradient falls to some `1e-6` and grows again. What is reached then is taken if it is nearly as good.
//!
//! All memory is reserved by [`InteriorPoint::with_capacity`].

pub mod chain;
pub mod cone;
pub mod tridiagonal;

use chain::{Chain, PAIRS, PAIRS_WITHIN};
use cone::{ConeVector, Scaling};
use tridiagonal::{Block, SIZE, Tridiagonal};

/// Iterations after which a problem counts as infeasible: feasible ones need 6 to 20.
const ITERATIONS_MAX: u32 = 40;
/// A step goes this share of the way to the cone's surface.
const STEP_SHARE: f64 = 0.99;
/// Steps below this are no progress.
const STEP_MIN: f64 = 1e-7;
/// Costs below this are as good as this.
const COST_MIN: f64 = 0.1;

/// How close is close enough.
#[derive(Clone, Copy, Debug)]
struct Accuracy {
    /// By how much a bound may be missed, in the bound's own unit.
    primal: f64,
    /// The same for the gradient of the Lagrange function, as a share of the cost's gradient at zero (or of one).
    dual: f64,
    /// Distance from the least cost, as a share of the cost (or of [`COST_MIN`]).
    gap: f64,
}

/// What a solution has. The cost is within 0.01 %; a bound is missed by a thousandth of the margin that is kept from it.
const WANTED: Accuracy = Accuracy {
    primal: 1e-6,
    dual: 1e-6,
    gap: 1e-4,
};
/// What is still taken where rounding ends the progress.
const ACCEPTED: Accuracy = Accuracy {
    primal: 1e-5,
    dual: 1e-4,
    gap: 5e-4,
};

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoSolution {
    /// The duals prove that the constraints exclude each other.
    Infeasible,
    /// No step leads on.
    Stalled,
    /// Not done after so many iterations.
    IterationLimit,
}

/// How far an iterate is.
#[derive(Clone, Copy, Debug)]
struct Progress {
    primal: f64,
    dual: f64,
    gap: f64,
    is_proven_infeasible: bool,
}

impl Progress {
    fn reaches(&self, wanted: &Accuracy) -> bool {
        self.primal <= wanted.primal && self.dual <= wanted.dual && self.gap <= wanted.gap
    }
}

/// The method's memory. One block per joint, names as in the module's comment.
#[derive(Debug, Default)]
pub struct InteriorPoint {
    x: Vec<Block>,
    dx: Vec<Block>,
    /// `P x + q`.
    cost_gradient: Vec<Block>,
    /// `G' z`.
    dual_force: Vec<Block>,
    s: ConeVector,
    z: ConeVector,
    ds: ConeVector,
    dz: ConeVector,
    /// `G x + s - h`.
    excess: ConeVector,
    t: ConeVector,
    /// `W^-2` of the half-lines.
    weights: Vec<f64>,
    /// `W` of the cones.
    scalings: Vec<Scaling>,
    matrix: Tridiagonal,
    iterations: u32,
}

impl InteriorPoint {
    /// Room for chains of so many pieces with so many forms each and half-spaces each.
    pub fn with_capacity(pieces: usize, forms: usize, rows: usize) -> Self {
        let blocks = || Vec::with_capacity(pieces + 1);
        let cones = || ConeVector::with_capacity(pieces * rows, pieces * forms);
        Self {
            x: blocks(),
            dx: blocks(),
            cost_gradient: blocks(),
            dual_force: blocks(),
            s: cones(),
            z: cones(),
            ds: cones(),
            dz: cones(),
            excess: cones(),
            t: cones(),
            weights: Vec::with_capacity(pieces * rows),
            scalings: Vec::with_capacity(pieces * forms),
            matrix: Tridiagonal::with_capacity(pieces + 1),
            iterations: 0,
        }
    }

    /// Iterations of the last solution.
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// Solves the problem and returns the joints' values.
    ///
    /// # Errors
    /// [`NoSolution`].
    pub fn solve(&mut self, chain: &Chain) -> Result<&[Block], NoSolution> {
        self.clear(chain);
        self.begin(chain);
        let mut step = 1.0;
        let mut dual_before = f64::INFINITY;
        loop {
            let progress = self.progress(chain);
            if progress.reaches(&WANTED) {
                return Ok(&self.x);
            }
            if progress.is_proven_infeasible {
                return Err(NoSolution::Infeasible);
            }
            // But for rounding this residual never grows.
            let is_rounding = progress.dual > dual_before.max(WANTED.dual);
            let is_stuck = step < STEP_MIN || !progress.gap.is_finite();
            let is_last = is_stuck || self.iterations == ITERATIONS_MAX;
            if (is_rounding || is_last) && progress.reaches(&ACCEPTED) {
                return Ok(&self.x);
            }
            if is_last {
                return Err(if is_stuck {
                    NoSolution::Stalled
                } else {
                    NoSolution::IterationLimit
                });
            }
            dual_before = progress.dual;
            step = self.iterate(chain);
            self.iterations += 1;
        }
    }

    fn clear(&mut self, chain: &Chain) {
        self.iterations = 0;
        self.x.clear();
        self.x.extend(chain.joints.iter().map(|joint| joint.value));
        for blocks in [&mut self.dx, &mut self.cost_gradient, &mut self.dual_force] {
            blocks.clear();
            blocks.resize(chain.joints.len(), [0.0; SIZE]);
        }
        for vector in [
            &mut self.s,
            &mut self.z,
            &mut self.ds,
            &mut self.dz,
            &mut self.excess,
            &mut self.t,
        ] {
            vector.clear(chain.rows.len(), chain.balls.len());
        }
        self.weights.clear();
        self.weights.resize(chain.rows.len(), 1.0);
        self.scalings.clear();
        let unit = [1.0, 0.0, 0.0, 0.0];
        self.scalings
            .resize(chain.balls.len(), Scaling::new(&unit, &unit));
    }

    /// The start: the solution of the Newton system without scaling, slack and dual moved into the cone, as in the
    /// source.
    fn begin(&mut self, chain: &Chain) {
        self.set_slack_to_room(chain);
        std::mem::swap(&mut self.t, &mut self.s);
        chain.cost(&self.x, &mut self.cost_gradient);
        self.factorise(chain);
        self.direction(chain);
        advance(&mut self.x, 1.0, &self.dx);
        self.set_slack_to_room(chain);
        for (z, s) in self.z.numbers.iter_mut().zip(&self.s.numbers) {
            *z = -s;
        }
        for vector in [&mut self.s, &mut self.z] {
            let depth = vector.depth();
            if depth <= 1e-8 {
                vector.deepen(1.0 - depth);
            }
        }
    }

    /// `s = h - G x`.
    fn set_slack_to_room(&mut self, chain: &Chain) {
        chain.apply(&self.x, &mut self.s);
        let (rows, balls) = self.s.parts_mut();
        for (s, row) in rows.iter_mut().zip(&chain.rows) {
            *s = row[3] - *s;
        }
        for (s, bound) in balls.iter_mut().zip(&chain.balls) {
            *s = [*bound, -s[1], -s[2], -s[3]];
        }
    }

    /// Computes the residuals of the iterate and what they mean.
    fn progress(&mut self, chain: &Chain) -> Progress {
        chain.apply(&self.x, &mut self.excess);
        self.excess.add(1.0, &self.s);
        let (rows, balls) = self.excess.parts_mut();
        for (excess, row) in rows.iter_mut().zip(&chain.rows) {
            *excess -= row[3];
        }
        for (excess, bound) in balls.iter_mut().zip(&chain.balls) {
            excess[0] -= bound;
        }
        let primal = self
            .excess
            .numbers
            .iter()
            .fold(0.0, |most: f64, x| most.max(x.abs()));
        let cost = chain.cost(&self.x, &mut self.cost_gradient);
        self.dual_force.fill([0.0; SIZE]);
        let bound = chain.apply_transposed(&self.z, &mut self.dual_force);
        let gap = self.s.dot(&self.z);
        Progress {
            primal,
            dual: self.dual_residual(chain),
            gap: gap / cost.max(COST_MIN),
            is_proven_infeasible: self.is_proven_infeasible(chain, bound),
        }
    }

    /// Largest entry of `P x + q + G' z`, as a share of the largest of `q`.
    fn dual_residual(&self, chain: &Chain) -> f64 {
        let (mut residual, mut size): (f64, f64) = (0.0, 1.0);
        for ((joint, gradient), force) in chain.joints.iter().zip(&self.cost_gradient).zip(&self.dual_force) {
            for (a, b) in gradient.iter().zip(force).take(joint.free) {
                residual = residual.max((a + b).abs());
            }
            for place in joint.place {
                size = size.max(2.0 * joint.pull * place.abs());
            }
        }
        residual / size
    }

    /// Whether `h' z`, given as `bound`, is too small for any point within reach (see the module's comment).
    fn is_proven_infeasible(&self, chain: &Chain, bound: f64) -> bool {
        let mut most = bound;
        for (joint, force) in chain.joints.iter().zip(&self.dual_force) {
            for part in 0..3 {
                let range = 3 * part..3 * part + 3;
                let (force, value) = (&force[range.clone()], &joint.value[range]);
                most += if joint.free > 3 * part {
                    joint.reach[part] * force.iter().map(|x| x * x).sum::<f64>().sqrt()
                } else {
                    -force.iter().zip(value).map(|(a, b)| a * b).sum::<f64>()
                };
            }
        }
        most < -1e-9 * (1.0 + bound.abs())
    }

    /// One predictor and corrector; returns the length of the step.
    fn iterate(&mut self, chain: &Chain) -> f64 {
        self.scale();
        self.factorise(chain);
        self.t.numbers.copy_from_slice(&self.s.numbers);
        self.t.add(-1.0, &self.excess);
        self.direction(chain);
        let step = self.step_to_surface().min(1.0);
        let gap = self.s.dot(&self.z);
        // As in the source: the share of the gap that the predictor would leave, cubed.
        let left = 1.0 - step + step * step * self.ds.dot(&self.dz) / gap;
        let target = left.clamp(0.0, 1.0).powi(3) * gap / chain.degree();
        self.correct(target);
        self.direction(chain);
        let step = (STEP_SHARE * self.step_to_surface()).min(1.0);
        advance(&mut self.x, step, &self.dx);
        self.s.add(step, &self.ds);
        self.z.add(step, &self.dz);
        step
    }

    fn scale(&mut self) {
        let ((s_rows, s_balls), (z_rows, z_balls)) = (self.s.parts(), self.z.parts());
        for ((weight, s), z) in self.weights.iter_mut().zip(s_rows).zip(z_rows) {
            *weight = z / s;
        }
        for ((scaling, s), z) in self.scalings.iter_mut().zip(s_balls).zip(z_balls) {
            *scaling = Scaling::new(s, z);
        }
    }

    /// `P + G' W^-2 G`, factorised.
    fn factorise(&mut self, chain: &Chain) {
        self.matrix.clear(chain.joints.len());
        for (index, piece) in chain.pieces.iter().enumerate() {
            let mut sums = PAIRS.map(|(a, b)| {
                let cost = piece.cost[a][b];
                [cost, 0.0, 0.0, cost, 0.0, cost]
            });
            for form in &chain.forms[piece.forms.clone()] {
                let mut curvature = form.ball.map_or([0.0; 6], |ball| self.scalings[ball].curvature());
                let rows = &chain.rows[form.rows.clone()];
                for (weight, [a, b, c, _]) in self.weights[form.rows.clone()].iter().zip(rows) {
                    let (wa, wb) = (weight * a, weight * b);
                    let products = [wa * a, wa * b, wa * c, wb * b, wb * c, weight * c * c];
                    for (sum, product) in curvature.iter_mut().zip(products) {
                        *sum += product;
                    }
                }
                let (products, pairs) = form.products();
                for (sum, product) in sums[pairs].iter_mut().zip(products) {
                    for (sum, x) in sum.iter_mut().zip(curvature) {
                        *sum += product * x;
                    }
                }
            }
            self.place(index, &sums);
        }
        for (joint, diagonal) in chain.joints.iter().zip(&mut self.matrix.diagonal) {
            for (axis, row) in diagonal.iter_mut().enumerate().take(3) {
                row[axis] += 2.0 * joint.pull;
            }
        }
        self.fix(chain);
        self.matrix.factorise();
    }

    /// Adds the matrix of piece `index`, by [`PAIRS`], to the whole.
    fn place(&mut self, index: usize, sums: &[[f64; 6]; 21]) {
        for (n, ((a, b), sum)) in PAIRS.iter().zip(sums).enumerate() {
            let block = if n < PAIRS_WITHIN {
                &mut self.matrix.diagonal[index]
            } else if n < 2 * PAIRS_WITHIN {
                &mut self.matrix.diagonal[index + 1]
            } else {
                &mut self.matrix.right[index]
            };
            let (row, column) = (3 * (a % 3), 3 * (b % 3));
            let [xx, xy, xz, yy, yz, zz] = *sum;
            for (i, values) in [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]].iter().enumerate() {
                for (j, value) in values.iter().enumerate() {
                    block[row + i][column + j] += value;
                }
            }
        }
    }

    /// Takes the numbers that are fixed out of the matrix: their steps are zero.
    fn fix(&mut self, chain: &Chain) {
        for (index, joint) in chain.joints.iter().enumerate() {
            for i in joint.free..SIZE {
                let diagonal = &mut self.matrix.diagonal[index];
                diagonal[i] = [0.0; SIZE];
                for row in diagonal.iter_mut() {
                    row[i] = 0.0;
                }
                diagonal[i][i] = 1.0;
                self.matrix.right[index][i] = [0.0; SIZE];
                if index > 0 {
                    for row in &mut self.matrix.right[index - 1] {
                        row[i] = 0.0;
                    }
                }
            }
        }
    }

    /// The step `dx, dz, ds` for `t` (see the module's comment). Leaves `t` as it is.
    fn direction(&mut self, chain: &Chain) {
        self.dz.numbers.copy_from_slice(&self.t.numbers);
        self.unscale_twice();
        for ((dx, gradient), force) in self.dx.iter_mut().zip(&self.cost_gradient).zip(&self.dual_force) {
            for ((dx, a), b) in dx.iter_mut().zip(gradient).zip(force) {
                *dx = -(a + b);
            }
        }
        chain.apply_transposed(&self.dz, &mut self.dx);
        for (joint, dx) in chain.joints.iter().zip(&mut self.dx) {
            dx[joint.free..].fill(0.0);
        }
        self.matrix.solve(&mut self.dx);
        chain.apply(&self.dx, &mut self.ds);
        self.dz.numbers.copy_from_slice(&self.ds.numbers);
        self.dz.add(-1.0, &self.t);
        self.unscale_twice();
        for (ds, excess) in self.ds.numbers.iter_mut().zip(&self.excess.numbers) {
            *ds = -(excess + *ds);
        }
    }

    /// `dz = W^-2 dz`.
    fn unscale_twice(&mut self) {
        let (rows, balls) = self.dz.parts_mut();
        for (dz, weight) in rows.iter_mut().zip(&self.weights) {
            *dz *= weight;
        }
        for (dz, scaling) in balls.iter_mut().zip(&self.scalings) {
            *dz = scaling.apply_inverse_square(dz);
        }
    }

    /// Adds what the predictor's step says of curvature and centre to `t`: `target` is what each product of slack and
    /// dual shall be.
    fn correct(&mut self, target: f64) {
        let (t_rows, t_balls) = self.t.parts_mut();
        let (z_rows, z_balls) = self.z.parts();
        let ((ds_rows, ds_balls), (dz_rows, dz_balls)) = (self.ds.parts(), self.dz.parts());
        for (((t, z), ds), dz) in t_rows.iter_mut().zip(z_rows).zip(ds_rows).zip(dz_rows) {
            *t += (ds * dz - target) / z;
        }
        let balls = t_balls
            .iter_mut()
            .zip(&self.scalings)
            .zip(z_balls)
            .zip(ds_balls)
            .zip(dz_balls);
        for ((((t, scaling), z), ds), dz) in balls {
            let mut wanted = cone::product(&scaling.apply_inverse(ds), &scaling.apply(dz));
            wanted[0] -= target;
            let change = scaling.apply(&cone::quotient(&wanted, &scaling.apply(z)));
            for (t, change) in t.iter_mut().zip(change) {
                *t += change;
            }
        }
    }

    fn step_to_surface(&self) -> f64 {
        let primal = self.s.step_to_surface(&self.ds);
        primal.min(self.z.step_to_surface(&self.dz))
    }
}

fn advance(x: &mut [Block], step: f64, dx: &[Block]) {
    for (x, d) in x.as_flattened_mut().iter_mut().zip(dx.as_flattened()) {
        *x += step * d;
    }
}
