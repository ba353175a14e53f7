//! Solves small symmetric systems.

#![expect(clippy::needless_range_loop, reason = "rows and columns are named by their index")]

/// The factors L D Lᵀ of a positive definite matrix.
///
/// Only the leading `n` rows and columns are used: a model with fewer parameters is the leading block
/// of one with more.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cholesky<const N: usize> {
    /// L, with ones on its diagonal.
    lower: [[f64; N]; N],
    /// 1/D.
    inverse_pivots: [f64; N],
    /// D divided by the diagonal of the matrix.
    distinct: [f64; N],
    n: usize,
}

/// A pivot below this fraction of its diagonal element is rounding.
const SINGULAR: f64 = 1e-15;

impl<const N: usize> Cholesky<N> {
    /// The factors of the leading block, with every diagonal element raised by the factor 1 +
    /// `damping`. `None` if the block is not positive definite.
    #[inline]
    pub(crate) fn new(matrix: &[[f64; N]; N], n: usize, damping: f64) -> Option<Self> {
        let mut lower = [[0.0; N]; N];
        let mut inverse_pivots = [0.0; N];
        let mut distinct = [0.0; N];
        for i in 0..n {
            // L D, row by row.
            let mut scaled = [0.0; N];
            for j in 0..i {
                let mut sum = matrix[i][j];
                for k in 0..j {
                    sum -= scaled[k] * lower[j][k];
                }
                scaled[j] = sum;
                lower[i][j] = sum * inverse_pivots[j];
            }
            let diagonal = matrix[i][i] * (1.0 + damping);
            let mut pivot = diagonal;
            for k in 0..i {
                pivot -= scaled[k] * lower[i][k];
            }
            // NaN must not pass.
            let is_positive = pivot > SINGULAR * diagonal && pivot.is_finite();
            if !is_positive {
                return None;
            }
            inverse_pivots[i] = 1.0 / pivot;
            distinct[i] = pivot / diagonal;
        }
        Some(Self { lower, inverse_pivots, distinct, n })
    }

    /// The solution for this right-hand side; zero beyond the leading block.
    #[inline]
    pub(crate) fn solve(&self, right: &[f64; N]) -> [f64; N] {
        self.solve_leading(right, self.n)
    }

    /// The right-hand side in coordinates in which the matrix is the unit matrix.
    #[inline]
    pub(crate) fn whitened(&self, right: &[f64; N]) -> [f64; N] {
        let mut x = [0.0; N];
        for i in 0..self.n {
            let mut sum = right[i];
            for k in 0..i {
                sum -= self.lower[i][k] * x[k];
            }
            x[i] = sum;
        }
        for i in 0..self.n {
            x[i] *= self.inverse_pivots[i].sqrt();
        }
        x
    }

    /// The solution with only the leading `n` rows and columns.
    #[inline]
    pub(crate) fn solve_leading(&self, right: &[f64; N], n: usize) -> [f64; N] {
        let mut x = [0.0; N];
        for i in 0..n {
            let mut sum = right[i];
            for k in 0..i {
                sum -= self.lower[i][k] * x[k];
            }
            x[i] = sum;
        }
        for i in 0..n {
            x[i] *= self.inverse_pivots[i];
        }
        for i in (0..n).rev() {
            let mut sum = x[i];
            for k in i + 1..n {
                sum -= self.lower[k][i] * x[k];
            }
            x[i] = sum;
        }
        x
    }

    /// Fraction of a column that remains after the columns before it are fitted to it.
    pub(crate) fn distinct(&self, column: usize) -> f64 {
        self.distinct[column]
    }

    /// The inverse of the leading `n` rows and columns; zero beyond them.
    #[inline]
    pub(crate) fn inverse_leading(&self, n: usize) -> [[f64; N]; N] {
        let mut inverse = [[0.0; N]; N];
        for (i, row) in inverse.iter_mut().enumerate().take(n) {
            let mut unit = [0.0; N];
            unit[i] = 1.0;
            *row = self.solve_leading(&unit, n);
        }
        inverse
    }

    /// The inverse of the block; zero beyond it.
    pub(crate) fn inverse(&self) -> [[f64; N]; N] {
        self.inverse_leading(self.n)
    }
}

/// The condition number, in the maximum norm, of a matrix that is scaled to ones on its diagonal.
pub(crate) fn condition<const N: usize>(
    matrix: &[[f64; N]; N],
    inverse: &[[f64; N]; N],
    n: usize,
) -> f64 {
    let mut scale = [0.0; N];
    for i in 0..n {
        scale[i] = matrix[i][i].sqrt();
    }
    let (mut direct, mut inverted) = (0.0_f64, 0.0_f64);
    for i in 0..n {
        let (mut a, mut b) = (0.0, 0.0);
        for j in 0..n {
            a += matrix[i][j].abs() / (scale[i] * scale[j]);
            b += inverse[i][j].abs() * (scale[i] * scale[j]);
        }
        (direct, inverted) = (direct.max(a), inverted.max(b));
    }
    direct * inverted
}

/// The product S M Sᵀ.
pub(crate) fn sandwich(s: &[[f64; 5]; 5], m: &[[f64; 5]; 5]) -> [[f64; 5]; 5] {
    let mut left = [[0.0; 5]; 5];
    let mut all = [[0.0; 5]; 5];
    for i in 0..5 {
        for j in 0..5 {
            left[i][j] = (0..5).map(|k| s[i][k] * m[k][j]).sum();
        }
    }
    for i in 0..5 {
        for j in 0..5 {
            all[i][j] = (0..5).map(|k| left[i][k] * s[j][k]).sum();
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solution_and_inverse_undo_the_matrix_also_when_rows_differ_by_many_orders() {
        let a = [[4e12, 1e6, 3.0], [1e6, 2.0, 1e-7], [3.0, 1e-7, 5e-9]];
        let factor = Cholesky::new(&a, 3, 0.0).unwrap();
        let wanted = [1e-6, -3.0, 2e4];
        let right = std::array::from_fn(|i| (0..3).map(|j| a[i][j] * wanted[j]).sum());
        let found = factor.solve(&right);
        let inverse = factor.inverse();
        for i in 0..3 {
            assert!((found[i] / wanted[i] - 1.0).abs() < 1e-10, "{found:?}");
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| a[i][k] * inverse[k][j]).sum();
                let unit = f64::from(u8::from(i == j));
                let size = (a[i][i] / a[j][j]).sqrt();
                assert!((product - unit).abs() < 1e-10 * size.max(1.0), "{i} {j} {product}");
            }
        }
    }

    #[test]
    fn only_the_leading_block_takes_part() {
        let a = [[2.0, 1.0, f64::NAN], [1.0, 3.0, f64::NAN], [f64::NAN; 3]];
        let found = Cholesky::new(&a, 2, 0.0).unwrap().solve(&[3.0, 4.0, f64::NAN]);
        assert!(
            (found[0] - 1.0).abs() < 1e-15 && (found[1] - 1.0).abs() < 1e-15 && found[2] == 0.0
        );
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let singular = [
            [[1.0, 1.0], [1.0, 1.0]],
            [[1.0, 2.0], [2.0, 1.0]],
            [[0.0, 0.0], [0.0, 1.0]],
            [[f64::NAN, 0.0], [0.0, 1.0]],
        ];
        for a in singular {
            assert!(Cholesky::new(&a, 2, 0.0).is_none(), "{a:?}");
        }
    }
}
