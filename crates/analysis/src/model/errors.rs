//! The errors of the main touches, which the results of a run have in common.
//!
//! The mean of a sample, the factor of the calibration and the learnt terms are made of the same touches. To first
//! order each result is a sum of the errors of these touches, so that their covariance gives the variance of the
//! result, with all that its ingredients share.

use super::linear::{self, Matrix};

/// The errors of the main touches, and behind them those of the differences of touches measured at two depths.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct TouchErrors {
    /// Number of main touches, in the list of the caller.
    touches: usize,
    /// Covariance of the relative errors of measurement.
    measured: Matrix,
    /// Variance of the relative stiffness from one point of a sample to the next, of each touch.
    of_point: f64,
    /// The part of it that different touches share by their references.
    references: Matrix,
    /// The change of each learnt term with each error.
    gains: Matrix,
}

/// By how much each error enters a result.
pub(crate) type Entering = Vec<f64>;

impl TouchErrors {
    /// Errors of which nothing is learnt, and whose covariance is not known yet.
    pub(super) fn of_touches(touches: usize, of_point: f64) -> Self {
        let none = vec![vec![0.0; touches]; touches];
        Self { touches, measured: none, of_point, references: Vec::new(), gains: Vec::new() }
    }

    /// The errors of a fit. Its rows are the touches with these indices and then the differences; its covariance
    /// has the variance from point to point in the rows of touches.
    pub(super) fn of_fit(mut self, indices: &[usize], covariance: &Matrix, gains: &Matrix) -> Self {
        let differences = covariance.len() - indices.len();
        let place = |row: usize| {
            indices.get(row).copied().unwrap_or_else(|| self.touches + row - indices.len())
        };
        let all = self.touches + differences;
        self.measured = vec![vec![0.0; all]; all];
        for (row, values) in covariance.iter().enumerate() {
            for (column, value) in values.iter().enumerate() {
                self.measured[place(row)][place(column)] = *value;
            }
            if row < indices.len() {
                self.measured[place(row)][place(row)] -= self.of_point;
            }
        }
        let placed = |gains: &Vec<f64>| {
            let mut placed = vec![0.0; all];
            gains.iter().enumerate().for_each(|(row, gain)| placed[place(row)] = *gain);
            placed
        };
        self.gains = gains.iter().map(placed).collect();
        self
    }

    /// These errors with the variances of touches that the fit did not use; `None` for a touch without a stiffness.
    /// `references` is what different touches share by them, also of those that the fit used.
    pub(crate) fn with_others(mut self, variances: &[Option<f64>], references: Matrix) -> Self {
        if self.measured.len() < variances.len() {
            self = Self::of_touches(variances.len(), self.of_point);
        }
        let is_fitted = |index: usize| self.measured[index][index] > 0.0;
        let is_fitted: Vec<bool> = (0..variances.len()).map(is_fitted).collect();
        for (index, variance) in variances.iter().enumerate() {
            if !is_fitted[index] {
                self.measured[index][index] = variance.unwrap_or(0.0);
            }
        }
        for (i, row) in references.iter().enumerate() {
            for (j, shared) in row.iter().enumerate().filter(|(j, _)| *j != i) {
                if !(is_fitted[i] && is_fitted[j]) {
                    self.measured[i][j] = *shared;
                }
            }
        }
        self.references = references;
        self
    }

    /// The covariance of these touches by what they share, with zeros on the diagonal.
    pub(crate) fn shared_by(&self, indices: &[usize]) -> Matrix {
        let entry = |i: usize, j: usize| if i == j { 0.0 } else { self.measured[i][j] };
        indices.iter().map(|&i| indices.iter().map(|&j| entry(i, j)).collect()).collect()
    }

    /// What different touches share by their references, in the covariance of two results.
    pub(crate) fn of_references(&self, a: &Entering, b: &Entering) -> f64 {
        linear::form(a, &self.references, b)
    }

    /// The variance of the relative stiffness from point to point.
    pub(crate) const fn of_point(&self) -> f64 {
        self.of_point
    }

    /// No error enters.
    pub(crate) fn none(&self) -> Entering {
        vec![0.0; self.measured.len()]
    }

    /// The errors that enter through the learnt terms, by this change of a result for a unit of each.
    pub(crate) fn through_learnt(&self, gradient: &[f64]) -> Entering {
        let mut all = self.none();
        for (by, gains) in gradient.iter().zip(&self.gains) {
            all.iter_mut().zip(gains).for_each(|(all, gain)| *all += by * gain);
        }
        all
    }

    /// The variance of a result for a sample: each touch errs by its measurement and by its point.
    pub(crate) fn variance(&self, entering: &Entering) -> f64 {
        self.variance_at_points(entering, entering)
    }

    /// The variance of a result into which measurements and points do not enter alike. The stiffness at the point of
    /// a touch has no error from this point.
    pub(crate) fn variance_at_points(&self, measured: &Entering, points: &Entering) -> f64 {
        let of_points: f64 = points[..self.touches].iter().map(|by| by * by).sum();
        linear::form(measured, &self.measured, measured) + self.of_point * of_points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two touches that share an error, a refused one between them, and a difference of two depths, with one learnt term.
    fn errors() -> TouchErrors {
        let covariance = vec![vec![5.0, 2.0, 0.0], vec![2.0, 7.0, 0.0], vec![0.0, 0.0, 3.0]];
        let gains = vec![vec![0.5, -0.25, 1.0]];
        TouchErrors::of_touches(3, 1.0).of_fit(&[0, 2], &covariance, &gains)
    }

    #[test]
    fn the_variance_of_a_sum_has_what_its_errors_share() {
        let errors = errors().with_others(&[Some(9.0), Some(0.5), Some(9.0)], Vec::new());
        assert_eq!(errors.variance(&vec![1.0, 0.0, 0.0, 0.0]), 5.0);
        assert_eq!(errors.variance(&vec![1.0, 0.0, 1.0, 0.0]), 5.0 + 7.0 + 2.0 * 2.0);
        assert_eq!(errors.variance(&vec![1.0, 0.0, -1.0, 0.0]), 5.0 + 7.0 - 2.0 * 2.0);
        assert_eq!(errors.variance(&vec![0.0, 1.0, 0.0, 0.0]), 0.5 + 1.0, "it was not fitted");
        assert_eq!(errors.variance_at_points(&vec![1.0, 0.0, 0.0, 0.0], &errors.none()), 4.0);
    }

    #[test]
    fn touches_share_their_reference_also_if_the_fit_did_not_use_them() {
        let references = vec![vec![0.0, 0.25, 1.5], vec![0.25, 0.0, 0.25], vec![1.5, 0.25, 0.0]];
        let errors = errors().with_others(&[None, Some(0.5), None], references);
        let two = vec![1.0, 1.0, 0.0, 0.0];
        assert_eq!(errors.variance(&two), 5.0 + 0.5 + 1.0 + 2.0 * 0.25);
        // The covariance of the fit has what it knows of the references.
        assert_eq!(errors.variance(&vec![1.0, 0.0, 1.0, 0.0]), 5.0 + 7.0 + 2.0 * 2.0);
        assert_eq!(errors.of_references(&two, &two), 0.5);
    }

    #[test]
    fn a_learnt_term_moves_with_the_errors_that_it_was_fitted_to() {
        let errors = errors();
        assert_eq!(errors.through_learnt(&[2.0, 7.0]), [1.0, 0.0, -0.5, 2.0], "one is learnt");
        assert_eq!(errors.through_learnt(&[]), errors.none());
        // What a touch errs by and what the term makes of it go partly out.
        let mut all = errors.through_learnt(&[-2.0]);
        all[0] += 1.0;
        assert_eq!(errors.variance(&all), 0.25 * 7.0 + 4.0 * 3.0);
    }
}
