//! From nothing to the most likely circuit: a rational fit for the start, Gauss–Newton with damping
//! for the rest.
//!
//! # Source
//! Sanathanan and Koerner, IEEE Trans. Automatic Control 8 (1963) 56 (the rational fit).

use crate::{
    circuit::kernel::{self, PARAMETERS, Theta},
    circuit::points::Points,
    numeric::dense::Cholesky,
    numeric::descent::{Descent, End, Normal, Step},
};

/// Passes of the rational fit. The first has no weights to speak of.
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

/// A start from the data alone, or `None` where no ringing circuit comes out.
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
        // Noise can turn the sign of a small damping; its size is still the best guess there is.
        let alpha = alpha.abs().max(ALPHA_MIN);
        earlier = Some((nu, alpha));
        theta = Some(Theta { nu, alpha, c, kappa: second - c * nu, g: 0.0 });
    }
    theta.filter(|theta| theta.kappa > 0.0 && theta.c > 0.0)
}

/// Quality factors above a million do not occur in a lump of ceramic on tissue.
const ALPHA_MIN: f64 = 1e-6;

impl Step<PARAMETERS> for Theta {
    /// Never takes the damping through zero: a raw step would walk through an infinite quality to a
    /// negative one and find a mirrored circuit there.
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
