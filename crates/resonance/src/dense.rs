//! Solving small symmetric systems.

#![expect(clippy::needless_range_loop, reason = "rows and columns are named by their index")]

/// The Cholesky factor of a positive definite matrix that was first scaled to ones on its diagonal.
///
/// Only the leading `n` rows and columns take part: a model with fewer parameters is the leading
/// block of one with more.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cholesky<const N: usize> {
    lower: [[f64; N]; N],
    /// 1/√ of the diagonal of the matrix.
    scale: [f64; N],
    n: usize,
}

impl<const N: usize> Cholesky<N> {
    /// The factor of the leading block, with every diagonal element raised by the factor
    /// 1 + `damping`. `None` where the block is not positive definite.
    #[inline]
    pub(crate) fn new(matrix: &[[f64; N]; N], n: usize, damping: f64) -> Option<Self> {
        let mut scale = [0.0; N];
        for i in 0..n {
            let diagonal = matrix[i][i];
            if !(diagonal > 0.0 && diagonal.is_finite()) {
                return None;
            }
            scale[i] = 1.0 / diagonal.sqrt();
        }
        let mut lower = [[0.0; N]; N];
        for i in 0..n {
            for j in 0..=i {
                let mut sum = matrix[i][j] * scale[i] * scale[j];
                if i == j {
                    sum += damping;
                }
                for k in 0..j {
                    sum -= lower[i][k] * lower[j][k];
                }
                if i == j {
                    if sum.is_nan() || sum <= SINGULAR {
                        return None;
                    }
                    lower[i][i] = sum.sqrt();
                } else {
                    lower[i][j] = sum / lower[j][j];
                }
            }
        }
        Some(Self { lower, scale, n })
    }

    /// The solution for this right-hand side; zero beyond the leading block.
    #[inline]
    pub(crate) fn solve(&self, right: &[f64; N]) -> [f64; N] {
        let n = self.n;
        let mut x = [0.0; N];
        for i in 0..n {
            let mut sum = right[i] * self.scale[i];
            for k in 0..i {
                sum -= self.lower[i][k] * x[k];
            }
            x[i] = sum / self.lower[i][i];
        }
        for i in (0..n).rev() {
            let mut sum = x[i];
            for k in i + 1..n {
                sum -= self.lower[k][i] * x[k];
            }
            x[i] = sum / self.lower[i][i];
        }
        for i in 0..n {
            x[i] *= self.scale[i];
        }
        x
    }

    /// The inverse of the leading block; zero beyond it.
    pub(crate) fn inverse(&self) -> [[f64; N]; N] {
        let mut inverse = [[0.0; N]; N];
        for (i, row) in inverse.iter_mut().enumerate().take(self.n) {
            let mut unit = [0.0; N];
            unit[i] = 1.0;
            *row = self.solve(&unit);
        }
        inverse
    }
}

/// A scaled pivot below this leaves no digit of the solution: the square root of the relative
/// precision of `f64`, squared by forming normal equations.
const SINGULAR: f64 = 1e-15;

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
        for a in [[[1.0, 1.0], [1.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]]] {
            assert!(Cholesky::new(&a, 2, 0.0).is_none(), "{a:?}");
        }
    }
}
