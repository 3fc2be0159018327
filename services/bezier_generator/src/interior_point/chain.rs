//! The problem of the interior-point method: joints, pieces between them, forms of the pieces that are kept somewhere.

use super::cone::ConeVector;
use super::tridiagonal::{Block, SIZE};
use std::ops::Range;

/// Pairs of the six joint vectors of a piece: within its start, within its end, between both.
pub const PAIRS: [(usize, usize); 21] = [
    (0, 0),
    (0, 1),
    (0, 2),
    (1, 1),
    (1, 2),
    (2, 2),
    (3, 3),
    (3, 4),
    (3, 5),
    (4, 4),
    (4, 5),
    (5, 5),
    (0, 3),
    (0, 4),
    (0, 5),
    (1, 3),
    (1, 4),
    (1, 5),
    (2, 3),
    (2, 4),
    (2, 5),
];
/// How many of them are within one joint.
pub const PAIRS_WITHIN: usize = 6;

/// A joint: position, velocity and acceleration, three axes each.
#[derive(Clone, Copy, Debug)]
pub struct Joint {
    /// The first so many numbers are free.
    pub free: usize,
    /// The values of those that are not, and where the others start.
    pub value: Block,
    /// No solution has position, velocity or acceleration farther from zero than this.
    pub reach: [f64; 3],
    /// Weight of the squared distance of the position from `place`.
    pub pull: f64,
    /// See `pull`.
    pub place: [f64; 3],
}

/// The six factors of a linear form of a piece: of position, velocity and acceleration at its start and its end.
pub type Factors = [f64; 6];

/// A half-space `normal . form <= bound`, as one row: normal, bound.
pub type HalfSpaceRow = [f64; 4];

/// A piece of the curve.
#[derive(Clone, Debug)]
pub struct Piece {
    /// `x' P x / 2` of the six joint vectors, the same for each axis.
    pub cost: [Factors; 6],
    /// Its forms.
    pub forms: Range<usize>,
}

/// A form that is kept inside half-spaces and, maybe, within a radius.
#[derive(Clone, Debug)]
pub struct Form {
    factors: Factors,
    /// Which of the piece's two ends have factors that are not zero.
    ends: Range<usize>,
    /// Products of the factors by [`PAIRS`].
    products: [f64; 21],
    /// Its half-spaces.
    pub rows: Range<usize>,
    /// Its ball.
    pub ball: Option<usize>,
}

impl Form {
    /// The products of the factors, by [`PAIRS`], that may be other than zero, and which these are.
    pub fn products(&self) -> (&[f64], Range<usize>) {
        let pairs = match (self.ends.start, self.ends.end) {
            (0, 1) => 0..PAIRS_WITHIN,
            (1, 2) => PAIRS_WITHIN..2 * PAIRS_WITHIN,
            _ => 0..PAIRS.len(),
        };
        (&self.products[pairs.clone()], pairs)
    }
}

/// The problem: joints, pieces between them, forms of the pieces.
#[derive(Debug, Default)]
pub struct Chain {
    /// Where the pieces meet, start and end included.
    pub joints: Vec<Joint>,
    /// The pieces.
    pub pieces: Vec<Piece>,
    /// The forms of all pieces.
    pub forms: Vec<Form>,
    /// The half-spaces of all forms.
    pub rows: Vec<HalfSpaceRow>,
    /// The radii of all forms.
    pub balls: Vec<f64>,
}

impl Chain {
    /// Room for so many pieces with so many forms each and half-spaces each.
    pub fn with_capacity(pieces: usize, forms: usize, rows: usize) -> Self {
        Self {
            joints: Vec::with_capacity(pieces + 1),
            pieces: Vec::with_capacity(pieces),
            forms: Vec::with_capacity(pieces * forms),
            rows: Vec::with_capacity(pieces * rows),
            balls: Vec::with_capacity(pieces * forms),
        }
    }

    /// Starts a new problem at its first joint.
    pub fn restart(&mut self, joint: Joint) {
        self.joints.clear();
        self.pieces.clear();
        self.forms.clear();
        self.rows.clear();
        self.balls.clear();
        self.joints.push(joint);
    }

    /// Appends a piece with the quadratic `cost`, symmetric, of its six joint vectors, and the joint at its end.
    pub fn append(&mut self, cost: &[Factors; 6], end: Joint) {
        self.joints.push(end);
        self.pieces.push(Piece {
            cost: *cost,
            forms: self.forms.len()..self.forms.len(),
        });
    }

    /// A form of the last piece that stays inside half-spaces and, where given, within a radius.
    pub fn keep(
        &mut self,
        factors: &Factors,
        half_spaces: impl Iterator<Item = HalfSpaceRow>,
        ball: Option<f64>,
    ) {
        let first = self.rows.len();
        self.rows.extend(half_spaces);
        if self.rows.len() == first && ball.is_none() {
            return;
        }
        let is_zero = |half: &[f64]| half.iter().all(|factor| *factor == 0.0);
        let (from, to) = factors.split_at(3);
        self.forms.push(Form {
            factors: *factors,
            ends: usize::from(is_zero(from))..2 - usize::from(is_zero(to)),
            products: PAIRS.map(|(a, b)| factors[a] * factors[b]),
            rows: first..self.rows.len(),
            ball: ball.map(|_| self.balls.len()),
        });
        self.balls.extend(ball);
        if let Some(piece) = self.pieces.last_mut() {
            piece.forms.end = self.forms.len();
        }
    }

    /// The value of a form of the last piece as far as it is fixed, and whether that is all of it.
    pub fn fixed_part(&self, factors: &Factors) -> ([f64; 3], bool) {
        let (mut value, mut is_all) = ([0.0; 3], true);
        let from = self.joints.len().saturating_sub(2);
        for (k, factor) in factors.iter().enumerate() {
            let Some(joint) = self.joints.get(from + k / 3) else {
                continue;
            };
            let first = 3 * (k % 3);
            if *factor != 0.0 && joint.free > first {
                is_all = false;
            } else {
                for (sum, x) in value.iter_mut().zip(&joint.value[first..]) {
                    *sum += factor * x;
                }
            }
        }
        (value, is_all)
    }

    /// How many half-lines and cones there are.
    pub fn degree(&self) -> f64 {
        (self.rows.len() + self.balls.len()) as f64
    }

    /// Calls `visit` for every form with its place in the chain.
    fn each_form(&self, mut visit: impl FnMut(usize, &Form)) {
        for (index, piece) in self.pieces.iter().enumerate() {
            for form in &self.forms[piece.forms.clone()] {
                visit(index, form);
            }
        }
    }

    /// `P x + q` into `gradient`; returns the cost, with the pulls' constants.
    pub fn cost(&self, x: &[Block], gradient: &mut [Block]) -> f64 {
        let mut twice = 0.0;
        for ((joint, x), gradient) in self.joints.iter().zip(x).zip(gradient.iter_mut()) {
            *gradient = [0.0; SIZE];
            for axis in 0..3 {
                let off = x[axis] - joint.place[axis];
                gradient[axis] = 2.0 * joint.pull * off;
                twice += gradient[axis] * off;
            }
        }
        for (index, piece) in self.pieces.iter().enumerate() {
            for (a, row) in piece.cost.iter().enumerate() {
                let (joint, first) = (index + a / 3, 3 * (a % 3));
                for axis in 0..3 {
                    let other = |b: usize| x[index + b / 3][3 * (b % 3) + axis];
                    let sum: f64 = row.iter().enumerate().map(|(b, factor)| factor * other(b)).sum();
                    gradient[joint][first + axis] += sum;
                    twice += sum * x[joint][first + axis];
                }
            }
        }
        0.5 * twice
    }

    /// `G x`.
    pub fn apply(&self, x: &[Block], out: &mut ConeVector) {
        let (out_rows, out_balls) = out.parts_mut();
        self.each_form(|index, form| {
            let mut value = [0.0; 3];
            for end in form.ends.clone() {
                let [p, v, a, ..] = form.factors[3 * end..] else {
                    continue;
                };
                let x = &x[index + end];
                for (axis, value) in value.iter_mut().enumerate() {
                    *value += p * x[axis] + v * x[3 + axis] + a * x[6 + axis];
                }
            }
            let [a, b, c] = value;
            let rows = &self.rows[form.rows.clone()];
            for (out, row) in out_rows[form.rows.clone()].iter_mut().zip(rows) {
                *out = row[0] * a + row[1] * b + row[2] * c;
            }
            if let Some(ball) = form.ball {
                out_balls[ball] = [0.0, a, b, c];
            }
        });
    }

    /// `out += G' u`; returns `h' u`.
    pub fn apply_transposed(&self, u: &ConeVector, out: &mut [Block]) -> f64 {
        let (u_rows, u_balls) = u.parts();
        let mut bound = 0.0;
        self.each_form(|index, form| {
            let mut sum = [0.0; 4];
            let rows = &self.rows[form.rows.clone()];
            for (u, row) in u_rows[form.rows.clone()].iter().zip(rows) {
                for (sum, x) in sum.iter_mut().zip(row) {
                    *sum += u * x;
                }
            }
            if let Some(ball) = form.ball {
                let [first, a, b, c] = u_balls[ball];
                sum = [
                    sum[0] + a,
                    sum[1] + b,
                    sum[2] + c,
                    sum[3] + first * self.balls[ball],
                ];
            }
            bound += sum[3];
            for end in form.ends.clone() {
                let [p, v, a, ..] = form.factors[3 * end..] else {
                    continue;
                };
                let out = &mut out[index + end];
                for (axis, sum) in sum.iter().take(3).enumerate() {
                    out[axis] += p * sum;
                    out[3 + axis] += v * sum;
                    out[6 + axis] += a * sum;
                }
            }
        });
        bound
    }
}
