//! Cholesky factor of a symmetric positive definite matrix whose blocks couple neighbours only.
//!
//! `A = U' U` with upper triangular blocks `U_k` and blocks `Y_k` to the right of them: with diagonal blocks `D_k` and
//! blocks `C_k` between neighbours `k` and `k + 1`, `U_k' U_k = D_k - Y_(k-1)' Y_(k-1)` and `U_k' Y_k = C_k` (G. Golub and
//! C. Van Loan, "Matrix Computations", 4th edition, section 4.5). The work grows with the number of blocks, not with its
//! cube.

/// Numbers of a block: position, velocity and acceleration of one joint.
pub const SIZE: usize = 9;
/// The unknowns of one joint.
pub type Block = [f64; SIZE];
/// A square of one joint's unknowns against another's.
pub type Square = [Block; SIZE];
/// A pivot below this share of what stood on the diagonal is rounding.
const PIVOT_MIN: f64 = 1e-14;

/// The matrix, and after [`Tridiagonal::factorise`] its factor in the same place.
#[derive(Debug, Default)]
pub struct Tridiagonal {
    /// The diagonal blocks; only the upper triangles are read.
    pub diagonal: Vec<Square>,
    /// Between each block (rows) and the next (columns); the last is not used.
    pub right: Vec<Square>,
    /// One over the factor's diagonal.
    inverse: Vec<Block>,
}

impl Tridiagonal {
    /// Room for so many blocks.
    pub fn with_capacity(blocks: usize) -> Self {
        Self {
            diagonal: Vec::with_capacity(blocks),
            right: Vec::with_capacity(blocks),
            inverse: Vec::with_capacity(blocks),
        }
    }

    /// A zero matrix of so many blocks.
    pub fn clear(&mut self, blocks: usize) {
        self.diagonal.clear();
        self.diagonal.resize(blocks, [[0.0; SIZE]; SIZE]);
        self.right.clear();
        self.right.resize(blocks, [[0.0; SIZE]; SIZE]);
        self.inverse.clear();
        self.inverse.resize(blocks, [0.0; SIZE]);
    }

    /// Replaces the matrix by its factor. A direction in which the matrix is zero but for rounding is made so stiff that
    /// a solution does not move along it.
    pub fn factorise(&mut self) {
        let blocks = self.diagonal.len();
        for k in 0..blocks {
            if k > 0 {
                let (before, here) = self.diagonal.split_at_mut(k);
                let above = &mut self.right[k - 1];
                divide(&before[k - 1], &self.inverse[k - 1], above);
                subtract_square(above, &mut here[0]);
            }
            factorise_block(&mut self.diagonal[k], &mut self.inverse[k]);
        }
    }

    /// Replaces the right side by the solution; only after [`Tridiagonal::factorise`].
    pub fn solve(&self, x: &mut [Block]) {
        let blocks = self.diagonal.len();
        for k in 0..blocks {
            if k > 0 {
                let before = x[k - 1];
                subtract_transposed(&self.right[k - 1], &before, &mut x[k]);
            }
            forward(&self.diagonal[k], &self.inverse[k], &mut x[k]);
        }
        for k in (0..blocks).rev() {
            if k + 1 < blocks {
                let after = x[k + 1];
                subtract(&self.right[k], &after, &mut x[k]);
            }
            backward(&self.diagonal[k], &self.inverse[k], &mut x[k]);
        }
    }
}

/// `row -= factor * other`.
fn subtract_multiple(row: &mut Block, factor: f64, other: &Block) {
    for (x, y) in row.iter_mut().zip(other) {
        *x -= factor * y;
    }
}

/// `U' U = d`: row by row, what is below the diagonal is left undefined.
fn factorise_block(d: &mut Square, inverse: &mut Block) {
    let stood: Block = std::array::from_fn(|i| d[i][i]);
    for i in 0..SIZE {
        let pivot = d[i][i];
        inverse[i] = if pivot > PIVOT_MIN * stood[i] {
            1.0 / pivot.sqrt()
        } else {
            0.0
        };
        for x in &mut d[i] {
            *x *= inverse[i];
        }
        let row = d[i];
        for j in i + 1..SIZE {
            subtract_multiple(&mut d[j], row[j], &row);
        }
    }
}

/// `c = U'^-1 c`.
fn divide(u: &Square, inverse: &Block, c: &mut Square) {
    for i in 0..SIZE {
        let (done, rest) = c.split_at_mut(i);
        let row = &mut rest[0];
        for (k, above) in done.iter().enumerate() {
            subtract_multiple(row, u[k][i], above);
        }
        for x in row {
            *x *= inverse[i];
        }
    }
}

/// `d -= y' y`.
fn subtract_square(y: &Square, d: &mut Square) {
    for (i, row) in d.iter_mut().enumerate() {
        for other in y {
            subtract_multiple(row, other[i], other);
        }
    }
}

/// `x -= y' before`.
fn subtract_transposed(y: &Square, before: &Block, x: &mut Block) {
    for (row, factor) in y.iter().zip(before) {
        subtract_multiple(x, *factor, row);
    }
}

/// `x -= y after`.
fn subtract(y: &Square, after: &Block, x: &mut Block) {
    for (value, row) in x.iter_mut().zip(y) {
        *value -= row.iter().zip(after).map(|(a, b)| a * b).sum::<f64>();
    }
}

/// `x = U'^-1 x`.
fn forward(u: &Square, inverse: &Block, x: &mut Block) {
    for i in 0..SIZE {
        x[i] *= inverse[i];
        let value = x[i];
        for j in i + 1..SIZE {
            x[j] -= value * u[i][j];
        }
    }
}

/// `x = U^-1 x`.
fn backward(u: &Square, inverse: &Block, x: &mut Block) {
    for i in (0..SIZE).rev() {
        let mut value = x[i];
        for j in i + 1..SIZE {
            value -= u[i][j] * x[j];
        }
        x[i] = value * inverse[i];
    }
}

#[cfg(test)]
mod tests {
    use super::{Block, SIZE, Tridiagonal};
    use proptest::prelude::*;

    const BLOCKS: usize = 3;
    const ROWS: usize = BLOCKS * SIZE;

    proptest! {
        #[test]
        fn the_solution_fits_the_matrix(
            factors in proptest::collection::vec(-1.0..1.0f64, 2 * BLOCKS * SIZE * SIZE),
            wanted in proptest::array::uniform3(proptest::array::uniform9(-1.0..1.0f64)),
        ) {
            // A = R' R + I, with R of two block diagonals.
            let mut r = [[0.0; ROWS]; ROWS];
            for (n, factor) in factors.iter().enumerate() {
                let (block, row, column) = (n / (2 * SIZE * SIZE), n / (2 * SIZE) % SIZE, n % (2 * SIZE));
                if block * SIZE + column < ROWS {
                    r[block * SIZE + row][block * SIZE + column] = *factor;
                }
            }
            let entry = |i: usize, j: usize| {
                f64::from(u8::from(i == j)) + r.iter().map(|row| row[i] * row[j]).sum::<f64>()
            };
            let mut matrix = Tridiagonal::with_capacity(BLOCKS);
            matrix.clear(BLOCKS);
            for n in 0..ROWS * SIZE {
                let (i, j) = (n / SIZE, n % SIZE);
                let k = i / SIZE;
                matrix.diagonal[k][i % SIZE][j] = entry(i, k * SIZE + j);
                if k + 1 < BLOCKS {
                    matrix.right[k][i % SIZE][j] = entry(i, (k + 1) * SIZE + j);
                }
            }
            let value = |n: usize| wanted[n / SIZE][n % SIZE];
            let right_side = |i: usize| (0..ROWS).map(|n| entry(i, n) * value(n)).sum();
            let mut x: [Block; BLOCKS] =
                std::array::from_fn(|k| std::array::from_fn(|i| right_side(k * SIZE + i)));
            matrix.factorise();
            matrix.solve(&mut x);
            let far = |a: &Block, b: &Block| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-9);
            prop_assert!(!x.iter().zip(&wanted).any(|(a, b)| far(a, b)), "{x:?} {wanted:?}");
        }
    }
}
