//! The uncertainty budget of a stiffness: its standard deviation, split by cause.
//!
//! The parts are to first order, and their squares add up to the square of the standard deviation. Parts that share
//! errors have what they share divided among them.
//!
//! # Source
//! JCGM 100:2008, Guide to the expression of uncertainty in measurement, equation (10).

use rig_contact::inverse::{LogVariances, OneTouch, TiltInference};

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
    /// The contact angle. Where it is inferred, that of angle and azimuth as far as the touches leave them
    /// unknown.
    Angle,
    /// The constants of the sensor: the factor that samples of known stiffness give, or the assumed error
    /// of the description. For a known sample, the factor as far as the other samples give it: its own touches
    /// are in the other parts.
    Sensor,
    /// The model: the terms that were learnt, the way to hold the depth that was not taken, and the misfit of
    /// the main touches.
    Model,
    /// The sample: its variation between the points that were touched, and the scatter of its touches or sites beyond
    /// all of these.
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

    /// This budget with another relative standard deviation of a part.
    #[must_use]
    pub const fn with(mut self, part: Part, relative: f64) -> Self {
        self.0[part as usize] = relative * relative;
        self
    }

    /// The parts of a touch alone. The variance of the shift is split as that of its two resonances, that of
    /// the depth as that of surface and indentation.
    pub(crate) fn of_touch(model: &Compensation, touch: &PosedTouch, one: &OneTouch) -> Self {
        let reference = share(touch.reference_sigma_hz, touch.sigma_hz);
        let surface = share(model.surface_sigma_mm, model.sigma_of_depth_mm(touch));
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

    /// The parts of a site alone, whose angle was inferred. The variance of the depth is split as that of a
    /// touch; a depth error that the touches share is that of the surface, which is found once.
    pub(crate) fn of_site(model: &Compensation, found: &TiltInference) -> Self {
        let LogVariances { resonance, reference, sample, own_depth, shared_depth, tilt } =
            found.log_variances;
        let surface = share(model.surface_sigma_mm, model.depth_sigma_mm);
        let mut parts = Self::default();
        parts.0[..=Part::Angle as usize].copy_from_slice(&[
            resonance,
            reference,
            shared_depth + own_depth * surface,
            own_depth * (1.0 - surface),
            tilt,
        ]);
        parts.0[Part::Sample as usize] = sample;
        parts
    }

    /// The parts of two independent errors together.
    #[must_use]
    pub(crate) fn plus(mut self, other: &Self) -> Self {
        self.0.iter_mut().zip(other.0).for_each(|(own, other)| *own += other);
        self
    }

    /// Parts that share errors, with the relative standard deviation of their sum: what they have in common is
    /// divided among them in proportion.
    #[must_use]
    pub(crate) fn sharing(mut self, total_rel: f64) -> Self {
        let alone = self.total();
        if alone > 0.0 {
            let by = (total_rel / alone).powi(2);
            self.0.iter_mut().for_each(|part| *part *= by);
        }
        self
    }

    /// The parts of a weighted sum of independent relative errors.
    pub(crate) fn weighted(all: impl Iterator<Item = (f64, Self)>) -> Self {
        let mut parts = [0.0; Part::ALL.len()];
        for (weight, budget) in all {
            for (part, own) in parts.iter_mut().zip(budget.0) {
                *part += weight * weight * own;
            }
        }
        Self(parts)
    }
}

/// The part of a variance.
fn share(sigma: f64, whole: f64) -> f64 {
    if whole > 0.0 { (sigma / whole).powi(2).min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use rig_contact::{
        Contact, Depth, Pose, SensorDescription, Tier,
        inverse::{AzimuthPrior, ShiftSigmas, SiteTouch},
    };

    use super::*;

    const DEPTH: Depth = Depth::Indentation { along_probe_mm: 0.4 };

    /// The budget of three directions of one site at 20°.
    fn budget(model: &Compensation, sigmas: ShiftSigmas) -> (Budget, f64) {
        let tissue = rig_contact::Tissue::soft(0.32).unwrap();
        let touches = [0.0_f64, 90.0, 180.0].map(|degrees| {
            let spin_rad = degrees.to_radians();
            let contact = Contact::new(Pose::new(0.35, -spin_rad).unwrap(), DEPTH);
            let shift_hz =
                model.models.predict(Tier::Reference, &tissue, &contact).unwrap().shift_hz;
            SiteTouch { shift_hz, sigmas, spin_rad, depth: DEPTH }
        });
        let found = model.of_site(&touches, 45.0_f64.to_radians(), AzimuthPrior::Unknown).unwrap();
        (Budget::of_site(model, &found), found.young_mpa.sigma / found.young_mpa.value)
    }

    #[test]
    fn a_site_has_the_parts_of_the_causes_that_it_has_and_no_others() {
        let described = Compensation {
            shared_depth_sigma_mm: 0.0,
            depth_sigma_mm: 0.0,
            surface_sigma_mm: 0.0,
            ..Compensation::new(&SensorDescription::reference(), 0.0)
        };
        let own = |mm: f64, surface_mm: f64| Compensation {
            depth_sigma_mm: mm,
            surface_sigma_mm: surface_mm,
            ..described.clone()
        };
        let shared = Compensation { shared_depth_sigma_mm: 0.01, ..described.clone() };
        let sweep = ShiftSigmas::of_resonance(0.1);
        let (reference_hz, sample_hz) = (0.1, 0.2);
        let rows = [
            (described.clone(), sweep, vec![Part::Sweep]),
            (
                described.clone(),
                ShiftSigmas { reference_hz, ..sweep },
                vec![Part::Sweep, Part::Reference],
            ),
            (
                described.clone(),
                ShiftSigmas { sample_hz, ..sweep },
                vec![Part::Sweep, Part::Sample],
            ),
            (own(0.01, 0.0), sweep, vec![Part::Sweep, Part::Depth]),
            (own(0.01, 0.01), sweep, vec![Part::Sweep, Part::Surface]),
            (own(0.01, 0.005), sweep, vec![Part::Sweep, Part::Surface, Part::Depth]),
            (shared, sweep, vec![Part::Sweep, Part::Surface]),
        ];
        for (model, sigmas, expected) in rows {
            let (budget, sigma_rel) = budget(&model, sigmas);
            for part in Part::ALL {
                // Shifts with an error leave the angle uncertain.
                let is_there = expected.contains(&part) || part == Part::Angle;
                assert_eq!(
                    budget.of(part) > 1e-6,
                    is_there,
                    "{part:?} of {expected:?}: {budget:?}"
                );
            }
            assert!((budget.total() / sigma_rel - 1.0).abs() < 1e-9, "{budget:?}");
        }
    }
}
