//! What touches have in common by their references, and χ² about means of touches that share an error.

use super::{judge::shared_probability, linear::Matrix};

/// The covariance of relative errors of different rows by their references, with zeros on the diagonal. `per_hz` is the
/// relative change of each row for 1 Hz of its reference, and `hz2` the covariance of the references of two rows, Hz².
pub(crate) fn sharing(per_hz: &[f64], hz2: impl Fn(usize, usize) -> f64) -> Matrix {
    let entry = |i: usize, j: usize| {
        let covariance_hz2 = if i == j { 0.0 } else { hz2(i, j) };
        // A row without a reference has no slope over it.
        if covariance_hz2 == 0.0 { 0.0 } else { per_hz[i] * per_hz[j] * covariance_hz2 }
    };
    (0..per_hz.len()).map(|i| (0..per_hz.len()).map(|j| entry(i, j)).collect()).collect()
}

/// Mean and half of the variance of χ² of rows about the weighted mean of their group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Chi2Expected {
    pub(crate) mean: f64,
    half_variance: f64,
}

impl Chi2Expected {
    /// Of rows that share nothing in their groups, with so many degrees of freedom. `overlap` is the factor by which the
    /// variance is larger than that of independent rows.
    pub(crate) fn of_freedom(freedom: f64, overlap: f64) -> Self {
        Self { mean: freedom, half_variance: freedom * overlap }
    }

    /// The same for rows that share errors beyond that, such as a reference. `shared` is their covariance, with zeros on the
    /// diagonal. What the rows of a group share goes into their mean, so that χ² is smaller.
    pub(crate) fn sharing(self, groups: &[usize], weights: &[f64], shared: &[Vec<f64>]) -> Self {
        let n = weights.len();
        if shared.iter().take(n).flatten().all(|entry| *entry == 0.0) {
            return self;
        }
        let mut all = vec![0.0; groups.iter().max().map_or(0, |last| last + 1)];
        groups.iter().zip(weights).for_each(|(group, weight)| all[*group] += weight);
        let unit: Vec<f64> = groups
            .iter()
            .zip(weights)
            .map(|(group, weight)| (weight / all[*group]).sqrt())
            .collect();
        let entry = |i: usize, j: usize| (weights[i] * weights[j]).sqrt() * shared[i][j];
        let mut left: Matrix = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
        // The matrix is symmetric: taking the means out of its rows, twice with a transposition, takes them out on both sides.
        for _ in 0..2 {
            left = transposed(&left);
            for row in &mut left {
                let mut along = vec![0.0; all.len()];
                for ((value, unit), group) in row.iter().zip(&unit).zip(groups) {
                    along[*group] += unit * value;
                }
                for ((value, unit), group) in row.iter_mut().zip(&unit).zip(groups) {
                    *value -= unit * along[*group];
                }
            }
        }
        let trace: f64 = (0..n).map(|i| left[i][i]).sum();
        let squares: f64 = left.iter().flatten().map(|value| value * value).sum();
        Self { mean: self.mean + trace, half_variance: self.half_variance + 2.0 * trace + squares }
    }

    /// Probability of a χ² at least as large.
    pub(crate) fn probability(&self, chi2: f64) -> f64 {
        if self.mean <= 0.0 || self.half_variance <= 0.0 {
            return 1.0;
        }
        shared_probability(chi2, self.mean, self.half_variance / self.mean)
    }
}

fn transposed(matrix: &Matrix) -> Matrix {
    (0..matrix.len()).map(|i| matrix.iter().map(|row| row[i]).collect()).collect()
}
