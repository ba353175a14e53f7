//! Stiffness, contact angle and azimuth together, from several touches of one place.
//!
//! Turning the probe about its own axis turns the surface's lean from front to left to back, which
//! the bimorph feels differently: that tells the angle. Depth tells it much worse, because in
//! shallow contacts depth and angle enter only as one product.
//!
//! The answer is the posterior over a grid of angles and azimuths, refined where it is high, with
//! the stiffness eliminated at each node by least squares: no start values, no single maximum, and
//! intervals that hold near the ends of the angle's range, where a covariance would not. The prior
//! is even in the angle, in the azimuth, and in the logarithm of the stiffness.

use std::f64::consts::{PI, TAU};

use super::{InverseError, RELATIVE_SIGMA_MAX, TissueKind};
use crate::{Contact, ContactLaw, Depth, Friction, Models, Pose, Refusal, Tier};

mod grid;
mod node;

use grid::Posterior;

/// One touch of the place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// The shift measured, Hz.
    pub shift_hz: f64,
    /// Its standard deviation, Hz.
    pub sigma_hz: f64,
    /// How far the probe was turned about its own axis, from the front towards the left, rad.
    pub spin_rad: f64,
    /// How deep.
    pub depth: Depth,
}

/// How the touches were made, and by which model they are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probing {
    /// The model.
    pub tier: Tier,
    /// The contact law.
    pub law: ContactLaw,
    /// What happens sideways.
    pub friction: Friction,
    /// What is taken as known of the tissue.
    pub kind: TissueKind,
    /// Standard deviation of the depth that all touches share, mm: one surface, found once.
    pub shared_depth_sigma_mm: f64,
    /// Standard deviation of the depth of each touch by itself, mm.
    pub depth_sigma_mm: f64,
}

/// What is known of the contact angle beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AnglePrior {
    /// The angle is set, with this standard deviation.
    Known {
        /// The angle, rad.
        angle_rad: f64,
        /// Its standard deviation, rad.
        sigma_rad: f64,
    },
    /// Any angle from zero up is as likely as any other.
    Within {
        /// The largest angle, rad.
        max_rad: f64,
    },
}

/// What is known beforehand of the azimuth of the surface's normal at zero spin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AzimuthPrior {
    /// It is this, rad.
    Known(f64),
    /// It may be any.
    Unknown,
}

/// A quantity with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// The mean of what is believed.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// The end below which lies 2.5 % of what is believed.
    pub low: f64,
    /// The end above which lies 2.5 %.
    pub high: f64,
}

impl Interval {
    /// Whether the 95 % interval contains `truth`.
    pub fn contains(&self, truth: f64) -> bool {
        self.low <= truth && truth <= self.high
    }
}

/// What several touches say together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltInference {
    /// Young's modulus, MPa; the mean is that of the logarithm.
    pub young_mpa: Interval,
    /// The contact angle, rad.
    pub angle_rad: Interval,
    /// The azimuth at zero spin, rad, in (−π, π] about its value; as given when it was known.
    pub azimuth_rad: Interval,
    /// Whether the touches say more of the angle than was known before: its standard deviation is
    /// below half of the prior's.
    pub is_angle_identified: bool,
    /// The same for the azimuth.
    pub is_azimuth_identified: bool,
    /// How stiffness and angle trade against each other, from −1 to 1: near either, the touches
    /// know a combination of the two and neither by itself.
    pub correlation: f64,
    /// The smallest sum of squared deviations over their variances.
    pub chi_squared: f64,
    /// Number of touches less that of unknowns, zero at least.
    pub freedom: usize,
}

/// The standard deviation of an even distribution over an interval of length one.
const EVEN_SIGMA: f64 = 0.288_675_134_594_812_9;
/// Of the prior's standard deviation, below which the touches have said something.
const IDENTIFIED_BELOW: f64 = 0.5;

/// Stiffness, angle and azimuth of one place from its touches.
///
/// # Errors
/// [`InverseError::NoTouches`]; [`InverseError::NotPositive`] for a standard deviation or bound;
/// [`InverseError::NoContact`] when the mean shift is not positive; [`InverseError::Refused`] when
/// no angle allows such contacts; [`InverseError::Inconsistent`] when no stiffness and tilt explain
/// the touches; [`InverseError::TooUncertain`] when the stiffness is not known to half of itself.
pub fn infer_tilt(
    models: &Models,
    touches: &[Touch],
    probing: &Probing,
    angle: AnglePrior,
    azimuth: AzimuthPrior,
) -> Result<TiltInference, InverseError> {
    check(touches, probing, angle)?;
    let start = start_log(models, touches, probing, angle)?;
    let question = Question { models, touches, probing, angle, azimuth };
    let Some(posterior) = Posterior::explore(&question, start) else {
        return Err(refusal_everywhere(&question, start));
    };
    let unknowns = 1
        + usize::from(matches!(angle, AnglePrior::Within { .. }))
        + usize::from(matches!(azimuth, AzimuthPrior::Unknown));
    let freedom = touches.len().saturating_sub(unknowns);
    let chi_squared = posterior.chi_squared();
    // Angle and azimuth are bounded, and cannot explain everything that they are counted for.
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

/// All that the posterior is asked.
struct Question<'a> {
    models: &'a Models,
    touches: &'a [Touch],
    probing: &'a Probing,
    angle: AnglePrior,
    azimuth: AzimuthPrior,
}

impl Question<'_> {
    /// The contact of a touch at an angle and an azimuth at zero spin.
    fn contact(&self, touch: &Touch, angle_rad: f64, azimuth_rad: f64) -> Option<Contact> {
        let pose = Pose::new(angle_rad, azimuth_rad - touch.spin_rad).ok()?;
        let Probing { law, friction, .. } = *self.probing;
        Some(Contact { pose, depth: touch.depth, law, friction })
    }

    /// The prior of an angle, as a logarithm without its constant.
    fn log_prior(&self, angle_rad: f64) -> f64 {
        match self.angle {
            AnglePrior::Known { angle_rad: known, sigma_rad } => {
                -0.5 * ((angle_rad - known) / sigma_rad).powi(2)
            }
            AnglePrior::Within { .. } => 0.0,
        }
    }
}

fn check(touches: &[Touch], probing: &Probing, angle: AnglePrior) -> Result<(), InverseError> {
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
    for touch in touches {
        positive("standard deviation of a shift", touch.sigma_hz)?;
    }
    for found in [probing.shared_depth_sigma_mm, probing.depth_sigma_mm] {
        if !(found.is_finite() && found >= 0.0) {
            return Err(InverseError::NotPositive { what: "standard deviation of a depth", found });
        }
    }
    match angle {
        AnglePrior::Known { sigma_rad, .. } => {
            positive("standard deviation of the angle", sigma_rad)
        }
        AnglePrior::Within { max_rad } => positive("largest angle", max_rad.min(0.5 * PI)),
    }
}

/// The logarithm of a stiffness near the answer: that of the mean shift, upright or at the known
/// angle.
fn start_log(
    models: &Models,
    touches: &[Touch],
    probing: &Probing,
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
    let contact =
        Contact { pose, depth: touches[0].depth, law: probing.law, friction: probing.friction };
    Ok(models.young_of_shift_mpa(probing.tier, shift_hz, probing.kind, &contact)?.ln())
}

fn mean_shift_hz(touches: &[Touch]) -> f64 {
    touches.iter().map(|touch| touch.shift_hz).sum::<f64>() / touches.len() as f64
}

/// Why no node of the grid has an answer: what the model says at its smallest angle.
fn refusal_everywhere(question: &Question<'_>, start_log: f64) -> InverseError {
    let Probing { tier, kind, law, friction, .. } = *question.probing;
    let angle_rad = match question.angle {
        AnglePrior::Known { angle_rad, .. } => angle_rad,
        AnglePrior::Within { .. } => 0.0,
    };
    let pose = Pose::new(angle_rad, 0.0).unwrap_or(Pose::UPRIGHT);
    let refusal = question.touches.iter().find_map(|touch| {
        let contact = Contact { pose, depth: touch.depth, law, friction };
        let tissue = kind.with(start_log.exp()).ok()?;
        question.models.predict(tier, &tissue, &contact).err()
    });
    let shift_hz = mean_shift_hz(question.touches);
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
