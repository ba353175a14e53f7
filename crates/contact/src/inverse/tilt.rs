//! Stiffness, contact angle and azimuth together, from several touches of one site.
//!
//! A turn of the probe about its own axis turns the lean of the surface from front to left to back.
//! The shift depends on that direction, which identifies the angle. Depth identifies it much less,
//! because depth and angle enter shallow contacts only as one product.
//!
//! The result is the posterior over a grid of angles and azimuths, refined where it is high. Least
//! squares eliminates the stiffness at each node. This needs no start values, allows several maxima,
//! and gives valid intervals near the ends of the angle's range, where a covariance would not. The
//! prior is even in the angle, in the azimuth, and in the logarithm of the stiffness.

use std::f64::consts::{PI, TAU};

use super::{InverseError, RELATIVE_SIGMA_MAX, TissueKind};
use crate::{Contact, ContactLaw, Depth, Friction, Models, Pose, Refusal, Tier};

mod grid;
mod node;

use grid::Posterior;

/// One touch of the site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiteTouch {
    /// The measured shift, Hz.
    pub shift_hz: f64,
    /// Standard deviations of the shift.
    pub sigmas: ShiftSigmas,
    /// Turn of the probe about its own axis, from the front towards the left, rad.
    pub spin_rad: f64,
    /// Depth along the probe.
    pub depth: Depth,
}

/// The standard deviations of a shift by cause. The causes are independent.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ShiftSigmas {
    /// From the resonance in contact, Hz.
    pub resonance_hz: f64,
    /// From the reference, Hz.
    pub reference_hz: f64,
    /// From the variation of the sample from one point to the next, Hz.
    pub sample_hz: f64,
}

impl ShiftSigmas {
    /// A shift whose only error is that of its resonance in contact, Hz.
    pub const fn of_resonance(resonance_hz: f64) -> Self {
        Self { resonance_hz, reference_hz: 0.0, sample_hz: 0.0 }
    }

    /// The standard deviation of all causes together, Hz.
    pub fn whole_hz(&self) -> f64 {
        self.resonance_hz.hypot(self.reference_hz).hypot(self.sample_hz)
    }
}

/// The model of the touches and the uncertainty of their depths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchModel {
    /// Model of the vibration.
    pub tier: Tier,
    /// Law of contact radius and force.
    pub law: ContactLaw,
    /// Behaviour along the surface.
    pub friction: Friction,
    /// The assumed tissue properties.
    pub kind: TissueKind,
    /// Standard deviation of the depth error that all touches share, mm: the surface is found once.
    pub shared_depth_sigma_mm: f64,
    /// Standard deviation of the independent depth error of each touch, mm.
    pub depth_sigma_mm: f64,
}

/// Prior of the contact angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AnglePrior {
    /// A set angle with its standard deviation.
    Known {
        /// The angle, rad.
        angle_rad: f64,
        /// Standard deviation of the angle, rad.
        sigma_rad: f64,
    },
    /// An even distribution from zero to a largest angle.
    Within {
        /// The largest angle, rad.
        max_rad: f64,
    },
}

/// Prior of the azimuth of the surface's normal at zero spin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AzimuthPrior {
    /// The azimuth, rad.
    Known(f64),
    /// An even distribution over the full circle.
    Unknown,
}

/// A quantity with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Mean of the posterior.
    pub value: f64,
    /// Standard deviation of the posterior.
    pub sigma: f64,
    /// The 2.5 % quantile.
    pub low: f64,
    /// The 97.5 % quantile.
    pub high: f64,
}

impl Interval {
    /// Whether the 95 % interval contains `truth`.
    pub fn contains(&self, truth: f64) -> bool {
        self.low <= truth && truth <= self.high
    }
}

/// The variance of ln E by cause.
///
/// The first five are variances of the stiffness at a known tilt, averaged over the tilts that the touches
/// leave. The last is the variance of that stiffness over these tilts. Their sum is the whole variance.
///
/// # Source
/// The law of total variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogVariances {
    /// From the resonances in contact.
    pub resonance: f64,
    /// From the references.
    pub reference: f64,
    /// From the variation of the sample from one point to the next.
    pub sample: f64,
    /// From the independent depth error of each touch.
    pub own_depth: f64,
    /// From the depth error that all touches share.
    pub shared_depth: f64,
    /// From the angle and the azimuth, as far as the touches leave them unknown.
    pub tilt: f64,
}

impl LogVariances {
    /// The variance of all causes together.
    pub fn sum(&self) -> f64 {
        let Self { resonance, reference, sample, own_depth, shared_depth, tilt } = *self;
        resonance + reference + sample + own_depth + shared_depth + tilt
    }
}

/// The joint result of several touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltInference {
    /// Young's modulus, MPa; its value is the geometric mean.
    pub young_mpa: Interval,
    /// The variance of the logarithm of Young's modulus by cause.
    pub log_variances: LogVariances,
    /// The contact angle, rad.
    pub angle_rad: Interval,
    /// The azimuth at zero spin, rad, within π of its value. A known azimuth is returned as given.
    pub azimuth_rad: Interval,
    /// Whether the touches identify the angle: its standard deviation is below half of the prior's.
    pub is_angle_identified: bool,
    /// Whether the touches identify the azimuth.
    pub is_azimuth_identified: bool,
    /// Correlation of stiffness and angle, from −1 to 1. Near either end the touches determine only a
    /// combination of the two.
    pub correlation: f64,
    /// The smallest sum of squared deviations over their variances.
    pub chi_squared: f64,
    /// Number of touches less the number of unknowns, at least zero.
    pub freedom: usize,
}

/// The standard deviation of an even distribution over an interval of length one.
const EVEN_SIGMA: f64 = 0.288_675_134_594_812_9;
/// Largest share of the prior's standard deviation at which a quantity counts as identified.
const IDENTIFIED_BELOW: f64 = 0.5;

/// Stiffness, angle and azimuth of one site from its touches.
///
/// # Errors
/// [`InverseError::NoTouches`]; [`InverseError::NotPositive`] for a standard deviation or bound;
/// [`InverseError::NoContact`] when the mean shift is not positive; [`InverseError::Refused`] when
/// no angle allows such contacts; [`InverseError::Inconsistent`] when no stiffness and tilt explain
/// the touches; [`InverseError::TooUncertain`] when the stiffness is not known to half of itself.
pub fn infer_tilt(
    models: &Models,
    touches: &[SiteTouch],
    touch_model: &TouchModel,
    angle: AnglePrior,
    azimuth: AzimuthPrior,
) -> Result<TiltInference, InverseError> {
    check(touches, touch_model, angle)?;
    let start = start_log(models, touches, touch_model, angle)?;
    let problem = Problem { models, touches, touch_model, angle, azimuth };
    let Some(posterior) = Posterior::explore(&problem, start) else {
        return Err(refusal_everywhere(&problem, start));
    };
    let unknowns = 1
        + usize::from(matches!(angle, AnglePrior::Within { .. }))
        + usize::from(matches!(azimuth, AzimuthPrior::Unknown));
    let freedom = touches.len().saturating_sub(unknowns);
    let chi_squared = posterior.chi_squared();
    // Angle and azimuth are bounded, and explain less than a full degree of freedom each.
    if chi_squared > largest_chi_squared(touches.len() - 1) {
        return Err(InverseError::Inconsistent { chi_squared, freedom });
    }
    let log = posterior.log_young();
    let young = log.value.exp();
    if log.sigma.is_nan() || log.sigma > RELATIVE_SIGMA_MAX {
        let (relative, limit) = (log.sigma, RELATIVE_SIGMA_MAX);
        return Err(InverseError::TooUncertain { relative, limit });
    }
    let young_mpa = Interval {
        value: young,
        sigma: young * log.sigma,
        low: log.low.exp(),
        high: log.high.exp(),
    };
    let angle_rad = posterior.angle();
    let azimuth_rad = match azimuth {
        AzimuthPrior::Known(value) => Interval { value, sigma: 0.0, low: value, high: value },
        AzimuthPrior::Unknown => posterior.azimuth(),
    };
    let angle_before = match angle {
        AnglePrior::Known { sigma_rad, .. } => sigma_rad,
        AnglePrior::Within { max_rad } => max_rad * EVEN_SIGMA,
    };
    Ok(TiltInference {
        young_mpa,
        log_variances: posterior.log_variances(),
        angle_rad,
        azimuth_rad,
        is_angle_identified: angle_rad.sigma < IDENTIFIED_BELOW * angle_before,
        is_azimuth_identified: matches!(azimuth, AzimuthPrior::Unknown)
            && azimuth_rad.sigma < IDENTIFIED_BELOW * TAU * EVEN_SIGMA,
        correlation: posterior.correlation(),
        chi_squared,
        freedom,
    })
}

/// The inference problem.
struct Problem<'a> {
    models: &'a Models,
    touches: &'a [SiteTouch],
    touch_model: &'a TouchModel,
    angle: AnglePrior,
    azimuth: AzimuthPrior,
}

impl Problem<'_> {
    /// The contact of a touch at an angle and an azimuth at zero spin.
    fn contact(&self, touch: &SiteTouch, angle_rad: f64, azimuth_rad: f64) -> Option<Contact> {
        let pose = Pose::new(angle_rad, azimuth_rad - touch.spin_rad).ok()?;
        let TouchModel { law, friction, .. } = *self.touch_model;
        Some(Contact { pose, depth: touch.depth, law, friction })
    }

    /// The logarithm of the prior of an angle, without its constant.
    fn log_prior(&self, angle_rad: f64) -> f64 {
        match self.angle {
            AnglePrior::Known { angle_rad: known, sigma_rad } => {
                -0.5 * ((angle_rad - known) / sigma_rad).powi(2)
            }
            AnglePrior::Within { .. } => 0.0,
        }
    }
}

fn check(
    touches: &[SiteTouch],
    touch_model: &TouchModel,
    angle: AnglePrior,
) -> Result<(), InverseError> {
    if touches.is_empty() {
        return Err(InverseError::NoTouches);
    }
    let positive = |what, found: f64| {
        if found.is_finite() && found > 0.0 {
            Ok(())
        } else {
            Err(InverseError::NotPositive { what, found })
        }
    };
    let not_negative = |what, found: f64| {
        if found.is_finite() && found >= 0.0 {
            Ok(())
        } else {
            Err(InverseError::NotPositive { what, found })
        }
    };
    for touch in touches {
        let ShiftSigmas { resonance_hz, reference_hz, sample_hz } = touch.sigmas;
        let what = "standard deviation of a shift";
        [resonance_hz, reference_hz, sample_hz]
            .into_iter()
            .try_for_each(|found| not_negative(what, found))?;
        positive(what, touch.sigmas.whole_hz())?;
    }
    for found in [touch_model.shared_depth_sigma_mm, touch_model.depth_sigma_mm] {
        not_negative("standard deviation of a depth", found)?;
    }
    match angle {
        AnglePrior::Known { sigma_rad, .. } => {
            positive("standard deviation of the angle", sigma_rad)
        }
        AnglePrior::Within { max_rad } => positive("largest angle", max_rad.min(0.5 * PI)),
    }
}

/// The logarithm of a stiffness near the result: the stiffness of the mean shift, with the probe
/// upright or at the known angle.
fn start_log(
    models: &Models,
    touches: &[SiteTouch],
    touch_model: &TouchModel,
    angle: AnglePrior,
) -> Result<f64, InverseError> {
    let shift_hz = mean_shift_hz(touches);
    if !(shift_hz.is_finite() && shift_hz > 0.0) {
        return Err(InverseError::NoContact { shift_hz });
    }
    let angle_rad = match angle {
        AnglePrior::Known { angle_rad, .. } => angle_rad,
        AnglePrior::Within { .. } => 0.0,
    };
    let pose = Pose::new(angle_rad, 0.0).unwrap_or(Pose::UPRIGHT);
    let contact = Contact {
        pose,
        depth: touches[0].depth,
        law: touch_model.law,
        friction: touch_model.friction,
    };
    Ok(models.young_of_shift_mpa(touch_model.tier, shift_hz, touch_model.kind, &contact)?.ln())
}

fn mean_shift_hz(touches: &[SiteTouch]) -> f64 {
    touches.iter().map(|touch| touch.shift_hz).sum::<f64>() / touches.len() as f64
}

/// The refusal when no node of the grid has a result: that of the model at its smallest angle.
fn refusal_everywhere(problem: &Problem<'_>, start_log: f64) -> InverseError {
    let TouchModel { tier, kind, law, friction, .. } = *problem.touch_model;
    let angle_rad = match problem.angle {
        AnglePrior::Known { angle_rad, .. } => angle_rad,
        AnglePrior::Within { .. } => 0.0,
    };
    let pose = Pose::new(angle_rad, 0.0).unwrap_or(Pose::UPRIGHT);
    let refusal = problem.touches.iter().find_map(|touch| {
        let contact = Contact { pose, depth: touch.depth, law, friction };
        let tissue = kind.with(start_log.exp()).ok()?;
        problem.models.predict(tier, &tissue, &contact).err()
    });
    let shift_hz = mean_shift_hz(problem.touches);
    let limit = tier.validity().stiffness_ratio_max;
    refusal.unwrap_or(Refusal::OutOfReach { tier, shift_hz, limit }).into()
}

/// The sum of squares that chance exceeds once in a million times, by Wilson and Hilferty's
/// approximation.
fn largest_chi_squared(freedom: usize) -> f64 {
    const NORMAL_QUANTILE: f64 = 4.753;
    let n = freedom.max(1) as f64;
    let width = 2.0 / (9.0 * n);
    n * (1.0 - width + NORMAL_QUANTILE * width.sqrt()).powi(3)
}

#[cfg(test)]
mod tests;
