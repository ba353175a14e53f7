//! The stiffness at one angle and azimuth, by least squares.

use super::{LogVariances, Problem, SiteTouch, TouchModel};
use crate::{Contact, Depth};

/// The best stiffness at one angle and azimuth, and how well it explains the touches.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// ln E of the best stiffness.
    pub(super) log_young: f64,
    /// Variance of ln E.
    pub(super) variance: f64,
    /// The variance by cause, without one from the tilt: it is known here.
    pub(super) variances: LogVariances,
    /// Sum of squared deviations over their variances, including the shared depth.
    pub(super) chi_squared: f64,
    /// The logarithm of the likelihood of the touches at this angle and azimuth.
    pub(super) log_evidence: f64,
}

/// A touch's shift as a linear function of ln E and of the depth.
struct Linear {
    residual: f64,
    per_log: f64,
    per_mm: f64,
    /// The inverse of the variance of the shift, in which is the touch's own depth error.
    weight: f64,
}

/// Gauss–Newton steps. The shift is nearly a power of the stiffness, so that two steps usually
/// suffice.
const STEPS_MAX: u32 = 12;
/// Largest last step of ln E. The linear model gives the rest: the curvature of the shift, a tenth
/// of the squared step, is then below a millionth.
const TOLERANCE: f64 = 3e-3;
/// Largest step of ln E, so that a poor start stays in the model's range.
const STEP_LONGEST: f64 = 1.0;
/// Steps of the numerical slopes.
const LOG_STEP: f64 = 1e-5;
const DEPTH_STEP_MM: f64 = 1e-6;

impl Node {
    /// The node, from a start near ln E; `None` when the model refuses.
    pub(super) fn at(
        problem: &Problem<'_>,
        angle_rad: f64,
        azimuth_rad: f64,
        start_log: f64,
    ) -> Option<Self> {
        let (mut log, mut depth_mm) = (start_log, 0.0);
        for _ in 0..STEPS_MAX {
            let normal = Normal::of(problem, angle_rad, azimuth_rad, log, depth_mm)?;
            let (step, depth_step) = normal.step();
            if step.abs() <= TOLERANCE {
                return Some(normal.settled(log + step, step, depth_step, problem, angle_rad));
            }
            log += step.clamp(-STEP_LONGEST, STEP_LONGEST);
            depth_mm += depth_step;
        }
        None
    }
}

/// The normal equations over (ln E, shared depth).
struct Normal {
    log_log: f64,
    log_depth: f64,
    depth_depth: f64,
    log_right: f64,
    depth_right: f64,
    chi_squared: f64,
    /// Sum of the logarithms of the variances of the touches, which depend on angle and azimuth.
    log_variances: f64,
    /// The touches, in their order.
    linears: Vec<Linear>,
}

impl Normal {
    fn of(
        problem: &Problem<'_>,
        angle_rad: f64,
        azimuth_rad: f64,
        log_young: f64,
        depth_mm: f64,
    ) -> Option<Self> {
        let shared = problem.touch_model.shared_depth_sigma_mm;
        let has_depth = shared > 0.0;
        let mut normal = Self {
            log_log: 0.0,
            log_depth: 0.0,
            // Without a shared error the depth stays at zero.
            depth_depth: if has_depth { shared.powi(-2) } else { 1.0 },
            log_right: 0.0,
            depth_right: if has_depth { -depth_mm * shared.powi(-2) } else { 0.0 },
            chi_squared: if has_depth { (depth_mm / shared).powi(2) } else { 0.0 },
            log_variances: 0.0,
            linears: Vec::with_capacity(problem.touches.len()),
        };
        for touch in problem.touches {
            let linear = linear(problem, touch, angle_rad, azimuth_rad, log_young, depth_mm)?;
            let Linear { residual, per_log, per_mm, weight } = linear;
            normal.log_log += weight * per_log * per_log;
            normal.log_right += weight * per_log * residual;
            normal.chi_squared += weight * residual * residual;
            normal.log_variances -= weight.ln();
            if has_depth {
                normal.log_depth += weight * per_log * per_mm;
                normal.depth_depth += weight * per_mm * per_mm;
                normal.depth_right += weight * per_mm * residual;
            }
            normal.linears.push(linear);
        }
        Some(normal)
    }

    fn determinant(&self) -> f64 {
        self.log_log * self.depth_depth - self.log_depth * self.log_depth
    }

    fn step(&self) -> (f64, f64) {
        let determinant = self.determinant();
        (
            (self.log_right * self.depth_depth - self.depth_right * self.log_depth) / determinant,
            (self.depth_right * self.log_log - self.log_right * self.log_depth) / determinant,
        )
    }

    /// The node at the bottom of the parabola, one small step away.
    fn settled(
        &self,
        log_young: f64,
        step: f64,
        depth_step: f64,
        problem: &Problem<'_>,
        angle_rad: f64,
    ) -> Node {
        let chi_squared = self.chi_squared - self.log_right * step - self.depth_right * depth_step;
        let determinant = self.determinant();
        let log_evidence = -0.5 * (determinant.ln() + chi_squared + self.log_variances)
            + problem.log_prior(angle_rad);
        let variance = self.depth_depth / determinant;
        Node { log_young, variance, variances: self.variances(problem), chi_squared, log_evidence }
    }

    /// The variance of ln E by cause, by its gain over each shift and over the shared depth.
    fn variances(&self, problem: &Problem<'_>) -> LogVariances {
        let TouchModel { shared_depth_sigma_mm, depth_sigma_mm, .. } = *problem.touch_model;
        let determinant = self.determinant();
        // The prior of the shared depth is one more observation, of a depth of zero.
        let of_shared = if shared_depth_sigma_mm > 0.0 {
            self.log_depth / (determinant * shared_depth_sigma_mm)
        } else {
            0.0
        };
        let mut variances = LogVariances {
            resonance: 0.0,
            reference: 0.0,
            sample: 0.0,
            own_depth: 0.0,
            shared_depth: of_shared * of_shared,
            tilt: 0.0,
        };
        for (touch, linear) in problem.touches.iter().zip(&self.linears) {
            let Linear { per_log, per_mm, weight, .. } = *linear;
            let right = per_log * self.depth_depth - per_mm * self.log_depth;
            let gain = weight * right / determinant;
            variances.resonance += (gain * touch.sigmas.resonance_hz).powi(2);
            variances.reference += (gain * touch.sigmas.reference_hz).powi(2);
            variances.sample += (gain * touch.sigmas.sample_hz).powi(2);
            variances.own_depth += (gain * per_mm * depth_sigma_mm).powi(2);
        }
        variances
    }
}

fn linear(
    problem: &Problem<'_>,
    touch: &SiteTouch,
    angle_rad: f64,
    azimuth_rad: f64,
    log_young: f64,
    depth_mm: f64,
) -> Option<Linear> {
    let TouchModel { tier, kind, shared_depth_sigma_mm, depth_sigma_mm, .. } = *problem.touch_model;
    let touch = SiteTouch { depth: deeper(touch.depth, depth_mm), ..*touch };
    let contact = problem.contact(&touch, angle_rad, azimuth_rad)?;
    let shift = |young_mpa: f64, contact: &Contact| {
        let tissue = kind.with(young_mpa).ok()?;
        Some(problem.models.predict(tier, &tissue, contact).ok()?.shift_hz)
    };
    let young_mpa = log_young.exp();
    let here = shift(young_mpa, &contact)?;
    let per_mm = if shared_depth_sigma_mm > 0.0 || depth_sigma_mm > 0.0 {
        // One-sided: the touch may lie at the largest depth of its law.
        let higher = Contact { depth: deeper(contact.depth, -DEPTH_STEP_MM), ..contact };
        (here - shift(young_mpa, &higher)?) / DEPTH_STEP_MM
    } else {
        0.0
    };
    Some(Linear {
        residual: touch.shift_hz - here,
        per_log: (shift(young_mpa * (1.0 + LOG_STEP), &contact)? - here) / LOG_STEP,
        per_mm,
        weight: (touch.sigmas.whole_hz().powi(2) + (per_mm * depth_sigma_mm).powi(2)).recip(),
    })
}

fn deeper(depth: Depth, by_mm: f64) -> Depth {
    match depth {
        Depth::Indentation { along_probe_mm } => {
            Depth::Indentation { along_probe_mm: along_probe_mm + by_mm }
        }
        Depth::Stage { along_probe_mm } => Depth::Stage { along_probe_mm: along_probe_mm + by_mm },
    }
}
