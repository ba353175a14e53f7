//! The small complex matrices of the reference.

use num_complex::Complex64;

/// A symmetric 2×2 or general 2×2 matrix, by rows.
pub(super) type Matrix2 = [[Complex64; 2]; 2];

pub(super) fn product(a: &Matrix2, b: &Matrix2) -> Matrix2 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}

pub(super) fn sum(a: &Matrix2, b: &Matrix2) -> Matrix2 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j]))
}

pub(super) fn difference(a: &Matrix2, b: &Matrix2) -> Matrix2 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] - b[i][j]))
}

pub(super) fn transpose(a: &Matrix2) -> Matrix2 {
    [[a[0][0], a[1][0]], [a[0][1], a[1][1]]]
}

pub(super) fn inverse(a: &Matrix2) -> Matrix2 {
    let scale = (a[0][0] * a[1][1] - a[0][1] * a[1][0]).inv();
    [[a[1][1] * scale, -a[0][1] * scale], [-a[1][0] * scale, a[0][0] * scale]]
}

/// A matrix over the tip's motions (w, φ, v, ψ, θ).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Matrix5([[Complex64; 5]; 5]);

impl Matrix5 {
    pub(super) const ZERO: Self = Self([[Complex64::ZERO; 5]; 5]);

    pub(super) fn add(&mut self, row: usize, column: usize, value: Complex64) {
        self.0[row][column] += value;
    }

    /// Adds a 2×2 block whose first row and column is `first`.
    pub(super) fn add_block(&mut self, first: usize, block: Matrix2) {
        for (i, row) in block.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                self.0[first + i][first + j] += value;
            }
        }
    }

    /// Adds `factor` times the outer product of `along` with itself.
    pub(super) fn add_square(&mut self, factor: Complex64, along: [f64; 5]) {
        for (row, a) in self.0.iter_mut().zip(along) {
            for (value, b) in row.iter_mut().zip(along) {
                *value += factor * a * b;
            }
        }
    }
}

/// The result of eliminating a matrix over the tip's motions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eliminated {
    /// The slope φ that a unit moment on φ causes.
    pub(super) slope: Complex64,
    pub(super) determinant: Complex64,
}

/// Eliminates all motions but the slope.
///
/// The stiff motions go first: their pivots are far from zero below the first lateral resonance,
/// so that no search for a pivot is needed.
pub(super) fn eliminate(matrix: &Matrix5) -> Eliminated {
    const ORDER: [usize; 4] = [3, 2, 4, 0];
    const SLOPE: usize = 1;
    let mut m = matrix.0;
    for (step, &pivot) in ORDER.iter().enumerate() {
        let scale = m[pivot][pivot].inv();
        let rest = ORDER[step + 1..].iter().copied().chain([SLOPE]);
        for row in rest.clone() {
            let factor = m[row][pivot] * scale;
            for column in rest.clone() {
                let taken = factor * m[pivot][column];
                m[row][column] -= taken;
            }
        }
    }
    let pivots = ORDER.iter().map(|&pivot| m[pivot][pivot]);
    Eliminated {
        slope: m[SLOPE][SLOPE].inv(),
        determinant: pivots.product::<Complex64>() * m[SLOPE][SLOPE],
    }
}
