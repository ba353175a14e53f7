//! The stiffness at one angle and azimuth, by least squares.

use super::{Problem, SiteTouch, TouchModel};
use crate::{Contact, Depth};

/// The best stiffness at one angle and azimuth, and how well it explains the touches.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// ln E of the best stiffness.
    pub(super) log_young: f64,
    /// Variance of ln E.
    pub(super) variance: f64,
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
    has_depth: bool,
}

impl Normal {
    fn of(
        problem: &Problem<'_>,
        angle_rad: f64,
        azimuth_rad: f64,
        log_young: f64,
        depth_mm: f64,
    ) -> Option<Self> {
        let touch_model = problem.touch_model;
        let shared = touch_model.shared_depth_sigma_mm;
        let has_depth = shared > 0.0;
        let mut normal = Self {
            log_log: 0.0,
            log_depth: 0.0,
            depth_depth: 0.0,
            log_right: 0.0,
            depth_right: 0.0,
            chi_squared: 0.0,
            log_variances: 0.0,
            has_depth,
        };
        if has_depth {
            normal.depth_depth = shared.powi(-2);
            normal.depth_right = -depth_mm * shared.powi(-2);
            normal.chi_squared = (depth_mm / shared).powi(2);
        }
        for touch in problem.touches {
            let linear = linear(problem, touch, angle_rad, azimuth_rad, log_young, depth_mm)?;
            let Linear { residual, per_log, per_mm } = linear;
            let own = per_mm * touch_model.depth_sigma_mm;
            let variance = touch.sigma_hz * touch.sigma_hz + own * own;
            let weight = variance.recip();
            normal.log_log += weight * per_log * per_log;
            normal.log_right += weight * per_log * residual;
            normal.chi_squared += weight * residual * residual;
            normal.log_variances += variance.ln();
            if has_depth {
                normal.log_depth += weight * per_log * per_mm;
                normal.depth_depth += weight * per_mm * per_mm;
                normal.depth_right += weight * per_mm * residual;
            }
        }
        Some(normal)
    }

    fn step(&self) -> (f64, f64) {
        if !self.has_depth {
            return (self.log_right / self.log_log, 0.0);
        }
        let determinant = self.log_log * self.depth_depth - self.log_depth * self.log_depth;
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
        let (variance, log_determinant) = self.covariance();
        let log_evidence = 0.5 * (log_determinant - chi_squared - self.log_variances)
            + problem.log_prior(angle_rad);
        Node { log_young, variance, chi_squared, log_evidence }
    }

    /// The variance of ln E, and the logarithm of the determinant of the covariance.
    fn covariance(&self) -> (f64, f64) {
        if !self.has_depth {
            return (self.log_log.recip(), -self.log_log.ln());
        }
        let determinant = self.log_log * self.depth_depth - self.log_depth * self.log_depth;
        (self.depth_depth / determinant, -determinant.ln())
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
