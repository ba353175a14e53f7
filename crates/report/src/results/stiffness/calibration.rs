//! The common factor of all stiffnesses of a run, from its samples of known stiffness.

use rig_analysis::{
    calibration::{Comparison, calibrate},
    stiffness::{self, Young},
};
use rig_record::Sample;

use super::values::{SampleStiffness, TouchStiffness};

/// The correction of the sensor's description by the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Calibration {
    /// Mean free resonance measured, over that of the sensor described.
    pub(crate) resonance_ratio: f64,
    /// Every stiffness was divided by this.
    pub(crate) factor: f64,
    /// Relative standard deviation of the factor.
    pub(crate) sigma_rel: f64,
    pub(crate) source: ScaleSource,
}

/// The source of the factor of a calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ScaleSource {
    /// From known samples.
    Known {
        /// Number of samples.
        samples: usize,
        /// Contact angle of the compared touches, degrees; all angles when it is unknown.
        angle_deg: Option<f64>,
    },
    /// Without known samples: the factor is one.
    Described,
}

/// The main touches or sites that are compared with known samples.
pub(super) struct ComparedAt {
    /// Contact angle, degrees; all when there is none.
    pub(super) angle_deg: Option<f64>,
    /// For each main touch or site, whether it is compared.
    pub(super) is_there: Vec<bool>,
}

impl Calibration {
    /// Compares touches with the known stiffness of their samples. Without a known sample, the factor
    /// is as uncertain as `scale_rel` and the resonance ratio say.
    pub(super) fn of(
        main: &[TouchStiffness],
        at: ComparedAt,
        samples: &[Sample],
        resonance_ratio: f64,
        scale_rel: f64,
    ) -> Self {
        let there = main.iter().zip(at.is_there).filter(|(_, is_there)| *is_there);
        let compared = |(touch, _): (&TouchStiffness, bool)| {
            let young = touch.young.ok()?;
            Some(Comparison {
                sample: touch.sample,
                young_mpa: young.mpa,
                sigma_mpa: young.sigma_mpa,
                known_mpa: samples[touch.sample].stiffness_mpa?,
            })
        };
        let comparisons: Vec<Comparison> = there.filter_map(compared).collect();
        match calibrate(&comparisons) {
            Some(scale) => Self {
                resonance_ratio,
                factor: scale.factor,
                sigma_rel: scale.sigma_rel,
                source: ScaleSource::Known { samples: scale.samples, angle_deg: at.angle_deg },
            },
            // A resonance that is off by a stiffer beam instead of a lighter tip makes a shift of
            // the same contact smaller instead of larger.
            None => Self {
                resonance_ratio,
                factor: 1.0,
                sigma_rel: scale_rel.hypot(2.0 * (resonance_ratio - 1.0)),
                source: ScaleSource::Described,
            },
        }
    }

    /// A calibrated stiffness with the uncertainty of the calibration, which all share.
    pub(super) fn with_its_sigma(&self, young: Young) -> Young {
        Young { sigma_mpa: young.sigma_mpa.hypot(self.sigma_rel * young.mpa), ..young }
    }

    /// Calibrates the stiffness of a touch or site.
    pub(super) fn touch(&self, touch: TouchStiffness) -> TouchStiffness {
        let young = |young: Young| Young {
            mpa: young.mpa / self.factor,
            sigma_mpa: young.sigma_mpa / self.factor,
        };
        TouchStiffness { young: touch.young.map(young), ..touch }
    }

    /// Calibrates the mean stiffness of a sample.
    pub(super) fn sample(
        &self,
        found: &stiffness::SampleStiffness,
        known_mpa: Option<f64>,
    ) -> SampleStiffness {
        let young_mpa = found.young_mpa / self.factor;
        // The scatter shows the variation over the sample; that of a few touches may be small by
        // chance.
        let scatter = |spread: f64| spread / (found.touches as f64).sqrt();
        let own_mpa = found.sigma_mpa.max(found.spread_mpa.map_or(0.0, scatter)) / self.factor;
        SampleStiffness {
            sample: found.sample,
            young_mpa,
            sigma_mpa: own_mpa.hypot(self.sigma_rel * young_mpa),
            spread_mpa: found.spread_mpa.map(|spread| spread / self.factor),
            known_mpa,
            touches: found.touches,
        }
    }
}
