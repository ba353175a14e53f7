//! The uncertainty budget of a stiffness: its standard deviation, split by cause.
//!
//! The parts are to first order and independent, so that their squares add up to the square of the
//! standard deviation.
//!
//! # Source
//! JCGM 100:2008, Guide to the expression of uncertainty in measurement, equation (10).

use rig_contact::inverse::OneTouch;

use crate::stiffness::{Compensation, PosedTouch};

/// A cause of uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The resonance in contact.
    Sweep,
    /// The reference and its drift.
    Reference,
    /// The position of the surface.
    Surface,
    /// The depth below the surface.
    Depth,
    /// The contact angle.
    Angle,
    /// The constants of the sensor: the factor that samples of known stiffness give, or the assumed error
    /// of the description.
    Sensor,
    /// The model: the terms that were learnt, and the misfit of the main touches.
    Model,
    /// The scatter of the touches of a sample beyond all of these.
    Sample,
}

impl Part {
    /// All parts, in the order of the outputs.
    pub const ALL: [Self; 8] = [
        Self::Sweep,
        Self::Reference,
        Self::Surface,
        Self::Depth,
        Self::Angle,
        Self::Sensor,
        Self::Model,
        Self::Sample,
    ];

    /// The word in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sweep => "sweep",
            Self::Reference => "reference",
            Self::Surface => "surface",
            Self::Depth => "depth",
            Self::Angle => "angle",
            Self::Sensor => "sensor",
            Self::Model => "model",
            Self::Sample => "sample",
        }
    }
}

/// The variance of a stiffness by cause, relative to the square of the stiffness.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Budget([f64; Part::ALL.len()]);

impl Budget {
    /// The relative standard deviation that a part causes.
    pub fn of(&self, part: Part) -> f64 {
        self.0[part as usize].sqrt()
    }

    /// The relative standard deviation of all parts together.
    pub fn total(&self) -> f64 {
        self.0.iter().sum::<f64>().sqrt()
    }

    /// The same with another relative standard deviation of a part.
    #[must_use]
    pub const fn with(mut self, part: Part, relative: f64) -> Self {
        self.0[part as usize] = relative * relative;
        self
    }

    /// The parts of a touch alone. The variance of the shift is split as that of its two resonances, that of
    /// the depth as that of surface and indentation.
    pub(crate) fn of_touch(model: &Compensation, touch: &PosedTouch, one: &OneTouch) -> Self {
        let reference = share(touch.reference_sigma_hz, touch.sigma_hz);
        let surface = share(model.surface_sigma_mm, model.depth_sigma_mm);
        let variance = |sigma_mpa: f64| (sigma_mpa / one.young_mpa).powi(2);
        let (shift, depth) = (variance(one.sigma_of_shift_mpa), variance(one.sigma_of_depth_mpa));
        let mut parts = Self::default();
        parts.0[..=Part::Angle as usize].copy_from_slice(&[
            shift * (1.0 - reference),
            shift * reference,
            depth * surface,
            depth * (1.0 - surface),
            variance(one.sigma_of_angle_mpa),
        ]);
        parts
    }

    /// The parts of a mean with these weights, whose touches are independent.
    pub(crate) fn mean(all: impl Iterator<Item = (f64, Self)>) -> Self {
        let (mut sum, mut parts) = (0.0, [0.0; Part::ALL.len()]);
        for (weight, budget) in all {
            sum += weight;
            for (part, own) in parts.iter_mut().zip(budget.0) {
                *part += weight * weight * own;
            }
        }
        Self(parts.map(|part| part / (sum * sum)))
    }
}

/// The part of a variance.
fn share(sigma: f64, whole: f64) -> f64 {
    if whole > 0.0 { (sigma / whole).powi(2).min(1.0) } else { 0.0 }
}
