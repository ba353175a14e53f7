//! From nothing to the most likely circuit: a rational fit for the start, Gauss–Newton with damping
//! for the rest.
//!
//! # Source
//! Sanathanan and Koerner, IEEE Trans. Automatic Control 8 (1963) 56 (the rational fit);
//! Marquardt, J. SIAM 11 (1963) 431 (the damping).

use crate::{
    dense::Cholesky,
    kernel::{self, Normal, PARAMETERS, Theta, on_this_machine},
    points::Points,
};

/// Where an iteration ended, and why.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Solution {
    pub(crate) theta: Theta,
    /// The normal equations at `theta`.
    pub(crate) normal: Normal,
    pub(crate) end: End,
}

/// Why an iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// The next step would be far below the uncertainty.
    Converged,
    /// No step made the cost smaller.
    Stalled,
    /// The allowed number of steps was taken.
    OutOfSteps,
}

/// A step is not worth taking when the cost it saves is below this part of the cost per degree of
/// freedom: it moves every parameter by less than a hundredth of its standard deviation.
const DECREMENT: f64 = 1e-4;
/// Relative errors below this are rounding, not noise.
pub(crate) const ROUNDING: f64 = 1e-11;
/// A start within reach needs three steps; a bad one is better left to another start.
const STEPS_MAX: usize = 40;
/// Passes of the rational fit. The first has no weights to speak of.
const RATIONAL_PASSES: usize = 3;

/// The most likely circuit near `start`, with `free` parameters (4, or 5 with dielectric loss).
pub(crate) fn solve(points: &Points, start: Theta, free: usize) -> Solution {
    let degrees = (2 * points.count).saturating_sub(free).max(1) as f64;
    let floor = ROUNDING * ROUNDING * points.total_weight;
    let mut theta = start;
    let mut normal = normal_at(points, &theta);
    let mut damping = 0.0;
    for _ in 0..STEPS_MAX {
        let Some(factor) = Cholesky::new(&normal.matrix, free, damping) else {
            if damping > DAMPING_MAX {
                return Solution { theta, normal, end: End::Stalled };
            }
            damping = more(damping);
            continue;
        };
        let step = factor.solve(&normal.gradient);
        let decrement = dot(&step, &normal.gradient);
        let next = theta.minus(&step);
        if decrement < DECREMENT * normal.cost / degrees + floor {
            // The quadratic model is exact here, so the cost at `next` needs no further pass.
            normal.cost -= decrement;
            return Solution { theta: next, normal, end: End::Converged };
        }
        let there = normal_at(points, &next);
        if there.cost < normal.cost {
            (theta, normal) = (next, there);
            damping = if damping > DAMPING_MIN { 0.1 * damping } else { 0.0 };
        } else if damping > DAMPING_MAX {
            return Solution { theta, normal, end: End::Stalled };
        } else {
            damping = more(damping);
        }
    }
    Solution { theta, normal, end: End::OutOfSteps }
}

const DAMPING_MIN: f64 = 1e-4;
const DAMPING_MAX: f64 = 1e8;

fn more(damping: f64) -> f64 {
    (10.0 * damping).max(1e-3)
}

/// A start from the data alone, or `None` where no ringing circuit comes out.
pub(crate) fn rational_start(points: &Points) -> Option<Theta> {
    let mut earlier = None;
    let mut theta = None;
    for _ in 0..RATIONAL_PASSES {
        let sums = on_this_machine(|| kernel::rational(&points.blocks, earlier));
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

fn normal_at(points: &Points, theta: &Theta) -> Normal {
    on_this_machine(|| kernel::normal(&points.blocks, theta))
}

fn dot(a: &[f64; PARAMETERS], b: &[f64; PARAMETERS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Theta {
    /// The parameters after a step, which never takes the damping through zero: a raw step would
    /// walk through an infinite quality to a negative one and find a mirrored circuit there.
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
