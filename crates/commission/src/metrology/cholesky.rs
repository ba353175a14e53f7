//! The Cholesky factor of a symmetric positive matrix, as large as the number of touches.

/// The lower factor L of a matrix L Lᵀ.
#[derive(Debug, Clone)]
pub(crate) struct Cholesky {
    rows: Vec<Vec<f64>>,
}

impl Cholesky {
    /// `None` for a matrix that is not positive definite, or has an entry that is not finite.
    pub(crate) fn new(size: usize, entry: impl Fn(usize, usize) -> f64) -> Option<Self> {
        let mut rows: Vec<Vec<f64>> = Vec::with_capacity(size);
        for i in 0..size {
            let mut row = Vec::with_capacity(i + 1);
            for (j, other) in rows.iter().enumerate() {
                let sum: f64 = row.iter().zip(other).map(|(a, b): (&f64, &f64)| a * b).sum();
                row.push((entry(i, j) - sum) / other[j]);
            }
            let pivot = entry(i, i) - row.iter().map(|a| a * a).sum::<f64>();
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            row.push(pivot.sqrt());
            rows.push(row);
        }
        Some(Self { rows })
    }

    /// L⁻¹ b.
    pub(crate) fn whiten(&self, b: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = Vec::with_capacity(b.len());
        for (row, b) in self.rows.iter().zip(b) {
            let i = x.len();
            let sum: f64 = row[..i].iter().zip(&x).map(|(a, x)| a * x).sum();
            x.push((b - sum) / row[i]);
        }
        x
    }

    /// L⁻ᵀ y.
    pub(crate) fn back(&self, y: &[f64]) -> Vec<f64> {
        let mut x = y.to_vec();
        for i in (0..x.len()).rev() {
            x[i] /= self.rows[i][i];
            let known = x[i];
            for (x, a) in x[..i].iter_mut().zip(&self.rows[i]) {
                *x -= a * known;
            }
        }
        x
    }

    /// The logarithm of the determinant of the matrix.
    pub(crate) fn log_determinant(&self) -> f64 {
        2.0 * self.rows.iter().enumerate().map(|(i, row)| row[i].ln()).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_times_its_solution_is_the_right_side() {
        let matrix = [[4.0, 2.0, -1.0], [2.0, 5.0, 0.5], [-1.0, 0.5, 3.0]];
        let factor = Cholesky::new(3, |i, j| matrix[i][j]).unwrap();
        let b = [1.0, -2.0, 0.25];
        let x = factor.back(&factor.whiten(&b));
        for (row, b) in matrix.iter().zip(b) {
            let product: f64 = row.iter().zip(&x).map(|(a, x)| a * x).sum();
            assert!((product - b).abs() < 1e-12);
        }
        // 4 (15 − 0.25) − 2 (6 + 0.5) − (1 + 5)
        assert!((factor.log_determinant() - 40.0_f64.ln()).abs() < 1e-12);
        assert!(Cholesky::new(2, |i, j| if i == j { 1.0 } else { 2.0 }).is_none());
        assert!(Cholesky::new(1, |_, _| f64::NAN).is_none());
    }
}
