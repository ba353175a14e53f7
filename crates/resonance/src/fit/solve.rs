//! The maximum-likelihood circuit: a rational fit for the start value, then damped Gauss–Newton.
//!
//! # Source
//! Sanathanan and Koerner, IEEE Trans. Automatic Control 8 (1963) 56 (the rational fit).

use crate::{
    circuit::kernel::{self, PARAMETERS, Theta},
    circuit::points::Points,
    numeric::dense::Cholesky,
    numeric::descent::{Descent, End, Normal, Step},
};

/// Passes of the rational fit. The first is practically unweighted.
const RATIONAL_PASSES: usize = 2;

/// The most likely circuit near `start`, with `free` parameters (4, or 5 with dielectric loss).
pub(crate) fn solve(points: &Points, start: Theta, free: usize) -> Solution {
    let descent = Descent { count: points.count, weight: points.total_weight, free };
    let (theta, normal, end) = descent.run(start, |theta| kernel::normal(&points.blocks, theta));
    Solution { theta, normal, end }
}

/// The most likely circuit of a steady fit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Solution {
    pub(crate) theta: Theta,
    /// The normal equations at `theta`.
    pub(crate) normal: Normal<PARAMETERS>,
    pub(crate) end: End,
}

/// A start value from the data alone; `None` if the result is not a resonant circuit.
pub(crate) fn rational_start(points: &Points) -> Option<Theta> {
    let mut earlier = None;
    let mut theta = None;
    for _ in 0..RATIONAL_PASSES {
        let sums = kernel::rational(&points.blocks, earlier);
        let x = Cholesky::new(&sums.matrix, PARAMETERS, 0.0)?.solve(&sums.right);
        let [c, second, _, nu, alpha] = x;
        if !(nu > -1.0 && nu.is_finite() && alpha.is_finite()) {
            return None;
        }
        // Noise can reverse the sign of a small damping; its magnitude is still the best start value.
        let alpha = alpha.abs().max(ALPHA_MIN);
        earlier = Some((nu, alpha));
        theta = Some(Theta { nu, alpha, c, kappa: second - c * nu, g: 0.0 });
    }
    theta.filter(|theta| theta.kappa > 0.0 && theta.c > 0.0)
}

/// Smallest damping 1/Q: a ceramic on tissue has no quality factor above a million.
const ALPHA_MIN: f64 = 1e-6;

impl Step<PARAMETERS> for Theta {
    /// Limits the step so that the damping stays positive; a full step could pass an infinite quality
    /// factor and converge to a mirrored circuit.
    fn minus(&self, step: &[f64; PARAMETERS]) -> Self {
        let relative = (-step[1] / self.alpha).clamp(-0.75, 3.0);
        Self {
            nu: self.nu - step[0],
            alpha: self.alpha * (1.0 + relative),
            c: self.c - step[2],
            kappa: self.kappa - step[3],
            g: self.g - step[4],
        }
    }
}
