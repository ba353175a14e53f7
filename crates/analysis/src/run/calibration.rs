//! The common factor of all stiffnesses of a run, from its samples of known stiffness.

use rig_contact::inverse::InverseError;

use super::{RunSample, RunTouches, RunYoung};
use crate::{
    budget::{Budget, Part},
    calibration::{Comparison, calibrate},
    model::{ModelReading, RunModel},
    stiffness::{SampleStiffness, Young},
};

/// The correction of the sensor's description by the run.
#[derive(Debug, Clone, PartialEq)]
pub struct RunCalibration {
    /// Mean free resonance measured, over that of the sensor described.
    pub resonance_ratio: f64,
    /// Every stiffness was divided by this.
    pub factor: f64,
    /// Relative standard deviation of the factor.
    pub sigma_rel: f64,
    /// Where the factor comes from.
    pub source: ScaleSource,
    /// The change of the factor's logarithm for a unit of each learnt term of the model.
    gradient: Vec<f64>,
    /// Covariance of these terms.
    covariance: Vec<Vec<f64>>,
    /// Relative standard deviation that a misfit of the model adds.
    added_rel: f64,
}

/// The source of the factor of a calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ScaleSource {
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
#[derive(Debug, Clone, PartialEq)]
pub struct ComparedAt {
    /// Contact angle, degrees; all when there is none.
    pub angle_deg: Option<f64>,
    /// For each main touch or site, whether it is compared.
    pub is_there: Vec<bool>,
}

/// The stiffness of a touch or site before the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Index of the sample.
    pub sample: usize,
    /// The stiffness, or its refusal.
    pub found: Result<ModelReading, InverseError>,
}

impl RunCalibration {
    /// Compares touches with the known stiffness of their samples. Without a known sample, the factor
    /// is as uncertain as the description and the resonance ratio say.
    pub(super) fn of(
        main: &[Reading],
        at: &ComparedAt,
        touches: &RunTouches<'_>,
        model: &RunModel,
    ) -> Self {
        let there = main.iter().zip(&at.is_there).filter(|(_, is_there)| **is_there);
        let compared = |(reading, _): (&Reading, &bool)| {
            let known_mpa = touches.known_mpa[reading.sample]?;
            Some((reading.sample, known_mpa, reading.found.as_ref().ok()?.clone()))
        };
        let compared: Vec<(usize, f64, ModelReading)> = there.filter_map(compared).collect();
        let comparison = |&(sample, known_mpa, ref found): &(usize, f64, ModelReading)| {
            let Young { mpa: young_mpa, sigma_mpa } = found.young;
            Comparison { sample, young_mpa, sigma_mpa, known_mpa }
        };
        let comparisons: Vec<Comparison> = compared.iter().map(comparison).collect();
        let covariance = model.covariance().to_vec();
        let check = model.check();
        let described = Self {
            resonance_ratio: touches.resonance_ratio,
            factor: 1.0,
            // A resonance that is off by a stiffer beam instead of a lighter tip makes a shift of
            // the same contact smaller instead of larger.
            sigma_rel: touches.scale_rel.hypot(2.0 * (touches.resonance_ratio - 1.0)),
            source: ScaleSource::Described,
            gradient: vec![0.0; covariance.len()],
            covariance,
            added_rel: check.map_or(0.0, |check| check.added_rel),
        };
        let Some(scale) = calibrate(&comparisons) else { return described };
        // As in the factor, each sample has the same weight.
        let samples: Vec<usize> = compared.iter().map(|one| one.0).collect();
        let of_sample = |sample: usize| {
            let of_sample = compared.iter().filter(move |one| one.0 == sample);
            mean_gradient(of_sample.map(|one| &one.2))
        };
        let mut distinct = samples;
        distinct.sort_unstable();
        distinct.dedup();
        let means: Vec<Vec<f64>> = distinct.into_iter().map(of_sample).collect();
        Self {
            factor: scale.factor,
            sigma_rel: scale.sigma_rel,
            source: ScaleSource::Known { samples: scale.samples, angle_deg: at.angle_deg },
            gradient: mean(means.iter().map(Vec::as_slice)),
            ..described
        }
    }

    /// The relative standard deviation that touches with this gradient share by the learnt terms and the
    /// misfit of the model.
    fn model_rel(&self, gradient: &[f64]) -> f64 {
        let less: Vec<f64> =
            gradient.iter().zip(&self.gradient).map(|(own, all)| own - all).collect();
        let row = |values: &Vec<f64>| values.iter().zip(&less).map(|(a, b)| a * b).sum::<f64>();
        let variance: f64 =
            less.iter().zip(&self.covariance).map(|(own, values)| own * row(values)).sum();
        variance.max(0.0).sqrt().hypot(self.added_rel)
    }

    /// The parts of a touch or a sample, with those that all share.
    const fn whole(&self, own: Budget, model_rel: f64) -> Budget {
        own.with(Part::Sensor, self.sigma_rel).with(Part::Model, model_rel)
    }

    /// Calibrates the stiffness of a touch or site.
    pub(super) fn touch(&self, reading: &Reading) -> Result<RunYoung, InverseError> {
        let found = reading.found.as_ref().map_err(|error| *error)?;
        let Young { mpa, sigma_mpa } = found.young;
        let own = Young { mpa: mpa / self.factor, sigma_mpa: sigma_mpa / self.factor };
        let model_rel = self.model_rel(&found.gradient);
        let budget = self.whole(found.budget, model_rel);
        Ok(RunYoung { own, common_rel: model_rel.hypot(self.sigma_rel), budget })
    }

    /// Calibrates the mean stiffness of a sample with these touches.
    pub(super) fn sample<'a>(
        &self,
        found: &SampleStiffness,
        touches: impl Iterator<Item = &'a Reading> + Clone,
        known_mpa: Option<f64>,
    ) -> RunSample {
        let young_mpa = found.young_mpa / self.factor;
        // The scatter shows the variation over the sample; that of a few touches may be small by
        // chance.
        let scatter = |spread: f64| spread / (found.touches as f64).sqrt();
        let own_mpa = found.sigma_mpa.max(found.spread_mpa.map_or(0.0, scatter)) / self.factor;
        let readings = touches.filter_map(|reading| reading.found.as_ref().ok());
        let model_rel = self.model_rel(&mean_gradient(readings.clone()));
        let weighted = |reading: &ModelReading| {
            let Young { mpa, sigma_mpa } = reading.young;
            ((mpa / sigma_mpa).powi(2), reading.budget)
        };
        let own = Budget::mean(readings.map(weighted));
        let beyond = ((own_mpa / young_mpa).powi(2) - own.total().powi(2)).max(0.0);
        let of_sample = own.of(Part::Sample).hypot(beyond.sqrt());
        let budget = self.whole(own.with(Part::Sample, of_sample), model_rel);
        RunSample {
            sample: found.sample,
            young_mpa,
            sigma_mpa: own_mpa.hypot(model_rel.hypot(self.sigma_rel) * young_mpa),
            budget,
            spread_mpa: found.spread_mpa.map(|spread| spread / self.factor),
            known_mpa,
            touches: found.touches,
        }
    }
}

fn mean_gradient<'a>(readings: impl Iterator<Item = &'a ModelReading>) -> Vec<f64> {
    mean(readings.map(|reading| reading.gradient.as_slice()))
}

/// The mean of vectors of one length; empty without any.
fn mean<'a>(all: impl Iterator<Item = &'a [f64]>) -> Vec<f64> {
    let (mut sum, mut count) = (Vec::new(), 0.0);
    for one in all {
        sum.resize(one.len(), 0.0);
        sum.iter_mut().zip(one).for_each(|(sum, value): (&mut f64, &f64)| *sum += value);
        count += 1.0;
    }
    sum.into_iter().map(|sum| sum / count).collect()
}
