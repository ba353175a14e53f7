//! Damped Gauss–Newton iteration for any model.
//!
//! # Source
//! Marquardt, J. SIAM 11 (1963) 431 (the damping).

use num_complex::Complex64;

use super::dense::Cholesky;

/// The normal equations of a least-squares problem with complex residuals.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normal<const N: usize> {
    /// `JᵀWJ`.
    pub(crate) matrix: [[f64; N]; N],
    /// `JᵀWr`.
    pub(crate) gradient: [f64; N],
    /// `rᵀWr`.
    pub(crate) cost: f64,
}

impl<const N: usize> Default for Normal<N> {
    fn default() -> Self {
        Self { matrix: [[0.0; N]; N], gradient: [0.0; N], cost: 0.0 }
    }
}

impl<const N: usize> Normal<N> {
    /// Adds the sums of other readings.
    pub(crate) fn sum(&mut self, other: &Self) {
        for i in 0..N {
            self.gradient[i] += other.gradient[i];
            for j in 0..N {
                self.matrix[i][j] += other.matrix[i][j];
            }
        }
        self.cost += other.cost;
    }

    /// Adds one residual with its derivatives.
    pub(crate) fn add(&mut self, residual: Complex64, row: &[Complex64; N], weight: f64) {
        self.add_leading::<N>(residual, row, weight);
    }

    /// Adds one residual of which only the first `LEADING` derivatives are nonzero.
    pub(crate) fn add_leading<const LEADING: usize>(
        &mut self,
        residual: Complex64,
        row: &[Complex64; N],
        weight: f64,
    ) {
        for (i, slope) in row.iter().take(LEADING).enumerate() {
            let left = weight * slope.conj();
            self.gradient[i] += (left * residual).re;
            for (j, other) in row.iter().take(i).enumerate() {
                let product = left.re * other.re - left.im * other.im;
                self.matrix[i][j] += product;
                self.matrix[j][i] += product;
            }
            self.matrix[i][i] += left.re * slope.re - left.im * slope.im;
        }
        self.cost += weight * residual.norm_sqr();
    }
}

/// The unknowns of an iteration.
pub(crate) trait Step<const N: usize>: Copy {
    /// The unknowns minus this step, limited to a reasonable length.
    fn minus(&self, step: &[f64; N]) -> Self;
}

/// The reason why an iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// The next step would be far below the uncertainty.
    Converged,
    /// No step lowered the cost.
    Stalled,
    /// The allowed number of steps was taken.
    OutOfSteps,
    /// The caller abandoned the iteration.
    Abandoned,
}

/// Smallest relevant decrease of the cost, relative to the cost per degree of freedom. A smaller step
/// moves every parameter by less than a hundredth of its standard deviation.
const DECREMENT: f64 = 1e-4;
/// Relative errors below this are rounding, not noise.
pub(crate) const ROUNDING: f64 = 1e-11;
/// Largest number of steps. A good start value needs three; a bad one is better replaced.
pub(crate) const STEPS_MAX: usize = 40;

/// Gauss–Newton iteration, damped if a step does not lower the cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Descent {
    /// Number of complex residuals.
    pub(crate) count: usize,
    /// The sum of their weights.
    pub(crate) weight: f64,
    /// Number of free parameters, which are the leading ones.
    pub(crate) free: usize,
}

impl Descent {
    /// The unknowns at the minimum of the cost near `start`, the normal equations there, and why the
    /// iteration ended.
    #[inline]
    pub(crate) fn run<T: Step<N>, const N: usize>(
        &self,
        start: T,
        normal_at: impl FnMut(&T) -> Normal<N>,
    ) -> (T, Normal<N>, End) {
        self.run_while(start, normal_at, |_, _, _| true)
    }

    /// Finds the minimum, and gives it up after a step if `is_wanted` rejects the unknowns, the cost there
    /// and the cost saved by the step.
    #[inline]
    pub(crate) fn run_while<T: Step<N>, const N: usize>(
        &self,
        start: T,
        mut normal_at: impl FnMut(&T) -> Normal<N>,
        is_wanted: impl Fn(&T, f64, f64) -> bool,
    ) -> (T, Normal<N>, End) {
        let degrees = (2 * self.count).saturating_sub(self.free).max(1) as f64;
        let floor = ROUNDING * ROUNDING * self.weight;
        let mut place = start;
        let mut normal = normal_at(&place);
        let mut damping = 0.0;
        for _ in 0..STEPS_MAX {
            let Some(factor) = Cholesky::new(&normal.matrix, self.free, damping) else {
                if damping > DAMPING_MAX {
                    return (place, normal, End::Stalled);
                }
                damping = more(damping);
                continue;
            };
            let step = factor.solve(&normal.gradient);
            let decrement = dot(&step, &normal.gradient);
            let next = place.minus(&step);
            if decrement < DECREMENT * normal.cost / degrees + floor {
                // The quadratic model is exact here, so the cost at `next` needs no further pass.
                normal.cost -= decrement;
                return (next, normal, End::Converged);
            }
            let there = normal_at(&next);
            if there.cost < normal.cost {
                let saved = normal.cost - there.cost;
                (place, normal) = (next, there);
                if !is_wanted(&place, normal.cost, saved) {
                    return (place, normal, End::Abandoned);
                }
                damping = if damping > DAMPING_MIN { 0.1 * damping } else { 0.0 };
            } else if damping > DAMPING_MAX {
                return (place, normal, End::Stalled);
            } else {
                damping = more(damping);
            }
        }
        (place, normal, End::OutOfSteps)
    }
}

const DAMPING_MIN: f64 = 1e-4;
const DAMPING_MAX: f64 = 1e8;

fn more(damping: f64) -> f64 {
    (10.0 * damping).max(1e-3)
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
