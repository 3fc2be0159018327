//! The second-order cone `u0 >= |(u1, u2, u3)|` of dimension four: its product and its Nesterov-Todd scaling; and products
//! of half-lines and such cones.
//!
//! All formulas: L. Vandenberghe, "The CVXOPT linear and quadratic cone program solvers", 2010, here for dimension four.
//! `J` is the diagonal matrix `(1, -1, -1, -1)`.

/// A member of the cone's space: the bound first, then the vector.
pub type Lorentz = [f64; 4];

/// `u . w`.
pub fn dot(u: &Lorentz, w: &Lorentz) -> f64 {
    u[0] * w[0] + u[1] * w[1] + u[2] * w[2] + u[3] * w[3]
}

/// The smaller eigenvalue `u0 - |(u1, u2, u3)|`: positive inside the cone.
pub fn depth(u: &Lorentz) -> f64 {
    u[0] - (u[1] * u[1] + u[2] * u[2] + u[3] * u[3]).sqrt()
}

/// `u' J u`, by both eigenvalues, which loses less near the cone's surface than the difference of squares.
fn determinant(u: &Lorentz) -> f64 {
    let norm = (u[1] * u[1] + u[2] * u[2] + u[3] * u[3]).sqrt();
    (u[0] - norm) * (u[0] + norm)
}

/// The product of the cone's algebra, `(u . w, u0 w1 + w0 u1)`.
pub fn product(u: &Lorentz, w: &Lorentz) -> Lorentz {
    let vector = |i: usize| u[0] * w[i] + w[0] * u[i];
    [dot(u, w), vector(1), vector(2), vector(3)]
}

/// The `x` with `product(u, x) = w`, for `u` inside the cone.
pub fn quotient(w: &Lorentz, u: &Lorentz) -> Lorentz {
    let first = (u[0] * w[0] - u[1] * w[1] - u[2] * w[2] - u[3] * w[3]) / determinant(u);
    let per_bound = 1.0 / u[0];
    let vector = |i: usize| (w[i] - first * u[i]) * per_bound;
    [first, vector(1), vector(2), vector(3)]
}

/// The largest `t` for which `u + t d` stays in the cone, for `u` inside; infinite if it never leaves.
///
/// The first positive root of `(u + t d)' J (u + t d)`, in the form that has no difference of nearly equal numbers.
pub fn step_to_surface(u: &Lorentz, d: &Lorentz) -> f64 {
    let a = d[0] * d[0] - d[1] * d[1] - d[2] * d[2] - d[3] * d[3];
    let b = u[0] * d[0] - u[1] * d[1] - u[2] * d[2] - u[3] * d[3];
    let c = determinant(u);
    let root = b * b - a * c;
    if root < 0.0 {
        return f64::INFINITY;
    }
    let denominator = root.sqrt() - b;
    if denominator > 0.0 {
        c / denominator
    } else {
        f64::INFINITY
    }
}

/// The Nesterov-Todd scaling `W = scale (2 v v' - J)` of a pair inside the cone: `W z = W^-1 s`, and
/// `W^2 = scale^2 (2 w w' - J)`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scaling {
    scale: f64,
    v: Lorentz,
    w: Lorentz,
}

impl Scaling {
    /// The one for slack `s` and dual `z`, both inside the cone.
    pub fn new(s: &Lorentz, z: &Lorentz) -> Self {
        let (s_size, z_size) = (determinant(s).sqrt(), determinant(z).sqrt());
        let (per_s, per_z) = (1.0 / s_size, 1.0 / z_size);
        let gamma = (0.5 + 0.5 * dot(s, z) * per_s * per_z).sqrt();
        let half = 0.5 / gamma;
        let vector = |i: usize| half * (s[i] * per_s - z[i] * per_z);
        let w = [
            half * (s[0] * per_s + z[0] * per_z),
            vector(1),
            vector(2),
            vector(3),
        ];
        let per_root = 1.0 / (2.0 * (w[0] + 1.0)).sqrt();
        Self {
            scale: (s_size * per_z).sqrt(),
            v: [
                (w[0] + 1.0) * per_root,
                w[1] * per_root,
                w[2] * per_root,
                w[3] * per_root,
            ],
            w,
        }
    }

    /// `W u`.
    pub fn apply(&self, u: &Lorentz) -> Lorentz {
        let twice = 2.0 * dot(&self.v, u);
        let vector = |i: usize| self.scale * (twice * self.v[i] + u[i]);
        [
            self.scale * (twice * self.v[0] - u[0]),
            vector(1),
            vector(2),
            vector(3),
        ]
    }

    /// `W^-1 u`.
    pub fn apply_inverse(&self, u: &Lorentz) -> Lorentz {
        reflected(&self.v, u, 1.0 / self.scale)
    }

    /// `W^-2 u`.
    pub fn apply_inverse_square(&self, u: &Lorentz) -> Lorentz {
        reflected(&self.w, u, 1.0 / (self.scale * self.scale))
    }

    /// The rows and columns of `W^-2` that belong to the vector: xx, xy, xz, yy, yz, zz.
    pub fn curvature(&self) -> [f64; 6] {
        let factor = 1.0 / (self.scale * self.scale);
        let [_, x, y, z] = self.w;
        [
            factor * (1.0 + 2.0 * x * x),
            factor * 2.0 * x * y,
            factor * 2.0 * x * z,
            factor * (1.0 + 2.0 * y * y),
            factor * 2.0 * y * z,
            factor * (1.0 + 2.0 * z * z),
        ]
    }
}

/// `factor (2 J v v' J - J) u`.
fn reflected(v: &Lorentz, u: &Lorentz, factor: f64) -> Lorentz {
    let twice = 2.0 * (v[0] * u[0] - v[1] * u[1] - v[2] * u[2] - v[3] * u[3]);
    let vector = |i: usize| factor * (u[i] - twice * v[i]);
    [factor * (twice * v[0] - u[0]), vector(1), vector(2), vector(3)]
}

/// A member of the product of half-lines and cones: a slack, a dual, or a step of them.
#[derive(Debug, Default)]
pub struct ConeVector {
    /// All numbers, those of the half-lines first.
    pub numbers: Vec<f64>,
    half_lines: usize,
}

impl ConeVector {
    /// Room for so many half-lines and cones.
    pub fn with_capacity(half_lines: usize, cones: usize) -> Self {
        Self {
            numbers: Vec::with_capacity(half_lines + 4 * cones),
            half_lines,
        }
    }

    /// Zero, of so many half-lines and cones.
    pub fn clear(&mut self, half_lines: usize, cones: usize) {
        self.numbers.clear();
        self.numbers.resize(half_lines + 4 * cones, 0.0);
        self.half_lines = half_lines;
    }

    /// Half-lines and cones.
    pub fn parts(&self) -> (&[f64], &[Lorentz]) {
        let (rows, cones) = self.numbers.split_at(self.half_lines);
        (rows, cones.as_chunks().0)
    }

    /// The same, to be written.
    pub fn parts_mut(&mut self) -> (&mut [f64], &mut [Lorentz]) {
        let (rows, cones) = self.numbers.split_at_mut(self.half_lines);
        (rows, cones.as_chunks_mut().0)
    }

    /// The scalar product, in four sums that do not wait for each other.
    pub fn dot(&self, other: &Self) -> f64 {
        let (fours, rest) = self.numbers.as_chunks::<4>();
        let (other_fours, other_rest) = other.numbers.as_chunks::<4>();
        let mut sums = [0.0; 4];
        for (a, b) in fours.iter().zip(other_fours) {
            for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
                *sum += a * b;
            }
        }
        let rest: f64 = rest.iter().zip(other_rest).map(|(a, b)| a * b).sum();
        sums.iter().sum::<f64>() + rest
    }

    /// The least eigenvalue: positive inside.
    pub fn depth(&self) -> f64 {
        let (rows, cones) = self.parts();
        let cones = cones.iter().map(depth);
        rows.iter().copied().chain(cones).fold(f64::INFINITY, f64::min)
    }

    /// Adds `amount` times the unit, which raises all eigenvalues by `amount`.
    pub fn deepen(&mut self, amount: f64) {
        let (rows, cones) = self.parts_mut();
        for row in rows {
            *row += amount;
        }
        for cone in cones {
            cone[0] += amount;
        }
    }

    /// `self += factor * other`.
    pub fn add(&mut self, factor: f64, other: &Self) {
        for (a, b) in self.numbers.iter_mut().zip(&other.numbers) {
            *a += factor * b;
        }
    }

    /// The largest `t` for which `self + t step` stays inside, for `self` inside.
    pub fn step_to_surface(&self, step: &Self) -> f64 {
        let ((rows, cones), (row_steps, cone_steps)) = (self.parts(), step.parts());
        let mut fastest = 0.0;
        for (u, d) in rows.iter().zip(row_steps) {
            if -d > fastest * u {
                fastest = -d / u;
            }
        }
        let steps = cones.iter().zip(cone_steps).map(|(u, d)| step_to_surface(u, d));
        steps.fold(1.0 / fastest, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::{Lorentz, Scaling, depth, product, quotient, step_to_surface};
    use proptest::prelude::*;

    fn inside() -> impl Strategy<Value = Lorentz> {
        (-2.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64, 1e-3..3.0f64)
            .prop_map(|(x, y, z, depth)| [(x * x + y * y + z * z).sqrt() + depth, x, y, z])
    }

    fn anywhere() -> impl Strategy<Value = Lorentz> {
        proptest::array::uniform4(-2.0..2.0f64)
    }

    fn are_equal(u: &Lorentz, w: &Lorentz) -> bool {
        let size = u.iter().chain(w).fold(1.0, |most: f64, x| most.max(x.abs()));
        u.iter().zip(w).all(|(a, b)| (a - b).abs() < 1e-8 * size)
    }

    proptest! {
        #[test]
        fn the_scaling_takes_slack_and_dual_to_the_same_point(s in inside(), z in inside(), u in anywhere()) {
            let scaling = Scaling::new(&s, &z);
            prop_assert!(are_equal(&scaling.apply(&z), &scaling.apply_inverse(&s)));
            prop_assert!(are_equal(&scaling.apply_inverse(&scaling.apply(&u)), &u));
            let twice = scaling.apply_inverse(&scaling.apply_inverse(&u));
            prop_assert!(are_equal(&scaling.apply_inverse_square(&u), &twice));
        }

        #[test]
        fn the_curvature_is_a_part_of_the_inverse_square(s in inside(), z in inside(), u in anywhere()) {
            let scaling = Scaling::new(&s, &z);
            let [xx, xy, xz, yy, yz, zz] = scaling.curvature();
            let whole = scaling.apply_inverse_square(&[0.0, u[1], u[2], u[3]]);
            let part = [
                whole[0],
                xx * u[1] + xy * u[2] + xz * u[3],
                xy * u[1] + yy * u[2] + yz * u[3],
                xz * u[1] + yz * u[2] + zz * u[3],
            ];
            prop_assert!(are_equal(&whole, &part));
        }

        #[test]
        fn a_quotient_times_its_divisor_is_the_dividend(u in inside(), w in anywhere()) {
            prop_assert!(are_equal(&product(&u, &quotient(&w, &u)), &w));
        }

        #[test]
        fn the_step_ends_on_the_surface(u in inside(), d in anywhere()) {
            let t = step_to_surface(&u, &d);
            let at = |t: f64| -> Lorentz { std::array::from_fn(|i| u[i] + t * d[i]) };
            if t.is_finite() {
                prop_assert!(depth(&at(t)).abs() < 1e-6 * (1.0 + t), "{t}: {}", depth(&at(t)));
                prop_assert!(depth(&at(0.99 * t)) > 0.0);
            } else {
                prop_assert!(depth(&at(1e6)) >= -1e-6);
            }
        }
    }
}
