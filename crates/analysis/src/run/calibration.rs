//! The common factor of all stiffnesses of a run, from its samples of known stiffness, and the uncertainty of what
//! is calibrated by it.

use rig_contact::inverse::InverseError;

use super::{RunSample, RunTouches, RunYoung, SharedReferences};
use crate::{
    budget::{Budget, Part},
    calibration::{Comparison, calibrate, weights},
    model::{
        BY_CHANCE, Chi2Expected, Entering, ModelReading, RunModel, TouchErrors, Verdict,
        chi2_probability,
    },
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
    /// Relative standard deviation of the factor by the description of the sensor, which takes it to be one.
    pub described_rel: f64,
    /// The change of the factor's logarithm for a unit of each term of the model.
    gradient: Vec<f64>,
    /// How the errors of the main touches enter the factor.
    in_factor: Entering,
    /// The variance of the factor by the scatter between samples, or between the touches of a sample, over the stated
    /// one, if that is beyond chance.
    excess: f64,
    errors: TouchErrors,
    /// Variances of the terms of the model that are not learnt, at their places in a gradient.
    not_learnt: Vec<f64>,
    /// Relative standard deviation that the misfit of the model adds to every result.
    misfit_rel: f64,
    /// Relative standard deviation of a touch beyond the stated one, under a model that holds.
    scatter_rel: f64,
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

/// A normal variable is as far from its mean in one of a hundred cases.
const SIGMAS_OF_ONE_PERCENT: f64 = 2.575_829;

impl RunCalibration {
    /// By how many standard deviations the factor differs from that of the description, if chance makes as much in
    /// less than one of a hundred runs; `None` otherwise.
    ///
    /// The division by the factor takes an error that all compared samples share out of every stiffness. The residuals
    /// need not show it.
    pub fn beyond_description(&self) -> Option<f64> {
        let sigmas = self.factor.ln().abs() / self.sigma_rel.hypot(self.described_rel);
        (sigmas > SIGMAS_OF_ONE_PERCENT).then_some(sigmas)
    }

    /// Compares touches with the known stiffness of their samples. Without a known sample, the factor
    /// is as uncertain as the description and the resonance ratio say.
    pub(super) fn of(
        main: &[Reading],
        shared: &SharedReferences,
        at: &ComparedAt,
        touches: &RunTouches<'_>,
        model: &RunModel,
    ) -> Self {
        let own = |reading: &Reading| Some(reading.found.as_ref().ok()?.budget.total().powi(2));
        let own: Vec<Option<f64>> = main.iter().map(own).collect();
        let errors = model.errors().clone().with_others(&own, shared.main.clone());
        let terms = model.covariance().len();
        let is_learnt = |term: usize| term < model.learnt().len();
        let variance =
            |term: usize| if is_learnt(term) { 0.0 } else { model.covariance()[term][term] };
        let check = model.check();
        let added_rel = check.map_or(0.0, |check| check.added_rel);
        // Under a model that holds, what scatters beyond the stated is each touch by itself.
        let holds = check.is_none_or(|check| check.verdict == Verdict::Holds);
        let (misfit_rel, scatter_rel) = if holds { (0.0, added_rel) } else { (added_rel, 0.0) };
        // A resonance that is off by a stiffer beam instead of a lighter tip makes a shift of
        // the same contact smaller instead of larger.
        let described_rel = touches.scale_rel.hypot(2.0 * (touches.resonance_ratio - 1.0));
        let described = Self {
            resonance_ratio: touches.resonance_ratio,
            factor: 1.0,
            sigma_rel: described_rel,
            described_rel,
            source: ScaleSource::Described,
            gradient: vec![0.0; terms],
            in_factor: errors.none(),
            excess: 1.0,
            errors,
            not_learnt: (0..terms).map(variance).collect(),
            misfit_rel,
            scatter_rel,
        };
        let compared = |index: usize| {
            let Reading { sample, ref found } = main[index];
            let young_mpa = found.as_ref().ok().filter(|_| at.is_there[index])?.young.mpa;
            let known_mpa = touches.known_mpa[sample]?;
            Some((index, Comparison { sample, young_mpa, known_mpa }))
        };
        let (indices, comparisons): (Vec<usize>, Vec<Comparison>) =
            (0..main.len()).filter_map(compared).unzip();
        let Some(scale) = calibrate(&comparisons) else { return described };
        let (mut in_factor, mut gradient) = (described.in_factor.clone(), vec![0.0; terms]);
        for (index, weight) in indices.into_iter().zip(weights(&comparisons)) {
            in_factor[index] = weight;
            if let Ok(found) = &main[index].found {
                add(&mut gradient, weight, &found.gradient);
            }
        }
        let variance = described.errors.variance(&in_factor);
        let freedom = scale.samples as f64 - 1.0;
        // What the samples share, such as an error of the depth at one place of the stages, does not scatter between them.
        let common = described.common_of_samples(&in_factor, main, freedom);
        let scattering = variance - common;
        let between = excess(scale.scatter_rel.map_or(0.0, |rel| rel * rel / scattering), freedom);
        let beyond = between.max(described.excess_within(&comparisons, main));
        let excess = (beyond * scattering + common) / variance;
        Self {
            factor: scale.factor,
            sigma_rel: (excess * variance).sqrt(),
            source: ScaleSource::Known { samples: scale.samples, angle_deg: at.angle_deg },
            gradient,
            in_factor,
            excess,
            ..described
        }
    }

    /// The budget of a calibrated result with these parts of its own.
    ///
    /// The errors of the main touches enter it directly, through the factor and through the learnt terms. As
    /// one sum they have one variance.
    fn whole(&self, own: Budget, directly: &Directly, gradient: &[f64]) -> Budget {
        let mut less = gradient.to_vec();
        add(&mut less, -1.0, &self.gradient);
        let [through_factor, through_learnt] = self.through(directly, gradient);
        let of_factor = self.errors.variance(&through_factor);
        let of_learnt = self.errors.variance(&through_learnt);
        let sum = |own: &Entering| -> Entering {
            let others = through_factor.iter().zip(&through_learnt);
            own.iter().zip(others).map(|(own, (factor, learnt))| own + factor + learnt).collect()
        };
        let variance =
            self.errors.variance_at_points(&sum(&directly.measured), &sum(&directly.points));
        let shared = own
            .with(Part::Sensor, of_factor.sqrt())
            .with(Part::Model, of_learnt.sqrt())
            .sharing(variance.max(0.0).sqrt());
        let of_sensor = shared.of(Part::Sensor) * self.excess.sqrt();
        let of_sensor = match self.source {
            ScaleSource::Known { .. } => of_sensor,
            ScaleSource::Described => self.sigma_rel,
        };
        let not_learnt: f64 =
            less.iter().zip(&self.not_learnt).map(|(by, variance)| by * by * variance).sum();
        let of_model = shared.of(Part::Model).hypot(not_learnt.sqrt()).hypot(self.misfit_rel);
        shared.with(Part::Sensor, of_sensor).with(Part::Model, of_model)
    }

    /// The mean, over the compared samples, of the excess of their touches at all angles. With one sample it is all
    /// that shows how the touches scatter.
    fn excess_within(&self, comparisons: &[Comparison], main: &[Reading]) -> f64 {
        let mut samples: Vec<usize> = comparisons.iter().map(|one| one.sample).collect();
        samples.sort_unstable();
        samples.dedup();
        let excess = |&sample: &usize| {
            let of_sample = main.iter().enumerate().filter(|(_, one)| one.sample == sample);
            let found =
                of_sample.filter_map(|(index, one)| Some((index, one.found.as_ref().ok()?)));
            self.excess_of_touches(&found.collect::<Vec<_>>())
        };
        samples.iter().map(excess).sum::<f64>() / samples.len() as f64
    }

    /// The mean covariance of the means of two different samples that give the factor.
    fn common_of_samples(&self, in_factor: &Entering, main: &[Reading], freedom: f64) -> f64 {
        let all = self.errors.variance(in_factor);
        let mut samples: Vec<usize> = main.iter().map(|reading| reading.sample).collect();
        samples.sort_unstable();
        samples.dedup();
        let within = |sample: usize| {
            let mut of_sample = in_factor.clone();
            let others = main.iter().enumerate().filter(|(_, one)| one.sample != sample);
            others.for_each(|(index, _)| of_sample[index] = 0.0);
            self.errors.variance(&of_sample)
        };
        let between = all - samples.into_iter().map(within).sum::<f64>();
        // Each sample has the same weight.
        if freedom > 0.0 { between * (freedom + 1.0) / freedom } else { 0.0 }
    }

    /// Calibrates the stiffness of the main touch or site with this index.
    pub(super) fn main_touch(
        &self,
        reading: &Reading,
        index: usize,
    ) -> Result<RunYoung, InverseError> {
        let found = reading.found.as_ref().map_err(|error| *error)?;
        let mut directly = Directly::none(&self.errors);
        directly.measured[index] = 1.0;
        Ok(self.young(found, self.whole(found.budget, &directly, &found.gradient)))
    }

    /// Calibrates the stiffness of a blind touch or site, with the covariance of its error with those of the main touches
    /// by their references.
    pub(super) fn blind_touch(
        &self,
        reading: &Reading,
        shared: &[f64],
    ) -> Result<RunYoung, InverseError> {
        let found = reading.found.as_ref().map_err(|error| *error)?;
        let directly = Directly::none(&self.errors);
        let others = self.whole(Budget::default(), &directly, &found.gradient);
        let budget = others.plus(&found.budget);
        let [through_factor, through_learnt] = self.through(&directly, &found.gradient);
        let entering = through_factor.iter().zip(&through_learnt).map(|(a, b)| a + b);
        let common: f64 = entering.zip(shared).map(|(by, shared)| by * shared).sum();
        let budget = if common == 0.0 {
            budget
        } else {
            let variance = budget.total().powi(2) + 2.0 * common;
            budget.sharing(variance.max(0.0).sqrt())
        };
        Ok(self.young(found, budget))
    }

    fn young(&self, found: &ModelReading, budget: Budget) -> RunYoung {
        let Young { mpa, sigma_mpa } = found.young;
        let own = Young { mpa: mpa / self.factor, sigma_mpa: sigma_mpa / self.factor };
        let of_sample = budget.of(Part::Sample).hypot(self.scatter_rel);
        RunYoung { own, budget: budget.with(Part::Sample, of_sample) }
    }

    /// How the errors of the main touches enter a result of this gradient through the factor and the learnt terms.
    fn through(&self, directly: &Directly, gradient: &[f64]) -> [Entering; 2] {
        let mut less = gradient.to_vec();
        add(&mut less, -1.0, &self.gradient);
        let through_factor: Entering = (self.in_factor.iter().zip(&directly.of_factor))
            .map(|(all, direct)| direct - all)
            .collect();
        [through_factor, self.errors.through_learnt(&less)]
    }

    /// Calibrates the mean stiffness of a sample with these touches, each with its index.
    ///
    /// The factor is also from the compared touches of the sample itself, so that their errors go partly out
    /// of its stiffness. The error of a touch enters by its weight in the mean less that in the factor.
    pub(super) fn sample<'a>(
        &self,
        found: &SampleStiffness,
        touches: impl Iterator<Item = (usize, &'a Reading)>,
        known_mpa: Option<f64>,
    ) -> RunSample {
        let young_mpa = found.young_mpa / self.factor;
        let readings: Vec<(usize, &ModelReading)> = touches
            .filter_map(|(index, reading)| Some((index, reading.found.as_ref().ok()?)))
            .collect();
        let all: f64 = readings.iter().map(|(_, reading)| weight(reading)).sum();
        let mut directly = Directly::none(&self.errors);
        let mut gradient = vec![0.0; self.gradient.len()];
        for &(index, reading) in &readings {
            let in_mean = weight(reading) / all;
            directly.of_factor[index] = self.in_factor[index];
            directly.measured[index] = in_mean - self.in_factor[index];
            add(&mut gradient, in_mean, &reading.gradient);
        }
        directly.points.clone_from(&directly.measured);
        let enters =
            |(index, reading): &(usize, &ModelReading)| (directly.measured[*index], reading.budget);
        let own = Budget::weighted(readings.iter().map(enters));
        let of_references = own.of(Part::Reference).powi(2)
            + self.errors.of_references(&directly.measured, &directly.measured);
        let own = own.with(Part::Reference, of_references.max(0.0).sqrt());
        let squares: f64 = directly.points.iter().map(|by| by * by).sum();
        let of_points = (self.errors.of_point() * squares).sqrt();
        let own = own.with(Part::Sample, own.of(Part::Sample).hypot(of_points));
        let beyond = (self.excess_of_touches(&readings) - 1.0).sqrt() * own.total();
        let budget = self.whole(own, &directly, &gradient);
        let budget = budget.with(Part::Sample, budget.of(Part::Sample).hypot(beyond));
        RunSample {
            sample: found.sample,
            young_mpa,
            sigma_mpa: budget.total() * young_mpa,
            budget,
            spread_mpa: found.spread_mpa.map(|spread| spread / self.factor),
            known_mpa,
            sets_scale: self.is_all_from(&readings),
            touches: found.touches,
        }
    }

    /// Whether the factor is from one known sample, and from all of these touches of it.
    fn is_all_from(&self, readings: &[(usize, &ModelReading)]) -> bool {
        matches!(self.source, ScaleSource::Known { samples: 1, .. })
            && readings.iter().all(|(index, _)| self.in_factor[*index] != 0.0)
    }

    /// The variance of the touches of a sample about their mean over the stated one, if that is beyond chance.
    ///
    /// # Source
    /// Birge, Phys. Rev. 40 (1932) 207.
    fn excess_of_touches(&self, readings: &[(usize, &ModelReading)]) -> f64 {
        let one = |(_, reading): &(usize, &ModelReading)| {
            let variance = reading.budget.total().powi(2) + self.errors.of_point();
            (reading.young.mpa.ln(), 1.0 / variance)
        };
        let all: f64 = readings.iter().map(|reading| one(reading).1).sum();
        let mean = readings.iter().map(one).map(|(log, weight)| weight * log).sum::<f64>() / all;
        let chi2: f64 =
            readings.iter().map(one).map(|(log, weight)| weight * (log - mean).powi(2)).sum();
        let freedom = readings.len() as f64 - 1.0;
        let weights: Vec<f64> = readings.iter().map(|reading| one(reading).1).collect();
        let indices: Vec<usize> = readings.iter().map(|(index, _)| *index).collect();
        let expected = Chi2Expected::of_freedom(freedom, 1.0).sharing(
            &vec![0; weights.len()],
            &weights,
            &self.errors.shared_by(&indices),
        );
        let is_beyond = freedom > 0.0 && expected.probability(chi2) < BY_CHANCE;
        if is_beyond { (chi2 / expected.mean).max(1.0) } else { 1.0 }
    }
}

/// How the error of each main touch enters a result directly, and not through the learnt terms.
struct Directly {
    /// Its measurement, less its part of the factor if that is not an error of the calibration to this result.
    measured: Entering,
    /// The stiffness of its point against that of the sample, in the same way.
    points: Entering,
    /// Its part of the factor that is counted above.
    of_factor: Entering,
}

impl Directly {
    fn none(errors: &TouchErrors) -> Self {
        Self { measured: errors.none(), points: errors.none(), of_factor: errors.none() }
    }
}

/// χ² for each degree of freedom, if it is larger than one beyond chance; one otherwise.
fn excess(chi2_per_dof: f64, freedom: f64) -> f64 {
    let is_beyond = freedom > 0.0 && chi2_probability(chi2_per_dof * freedom, freedom) < BY_CHANCE;
    if is_beyond { chi2_per_dof.max(1.0) } else { 1.0 }
}

/// The weight of a touch in the mean of its sample.
fn weight(reading: &ModelReading) -> f64 {
    (reading.young.mpa / reading.young.sigma_mpa).powi(2)
}

/// Adds a multiple of a vector.
fn add(sum: &mut [f64], by: f64, to: &[f64]) {
    sum.iter_mut().zip(to).for_each(|(sum, value)| *sum += by * value);
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;
    use rig_contact::SensorDescription;

    use super::*;
    use crate::{run::calibrated, stiffness::Compensation};

    const KNOWN_MPA: [f64; 5] = [0.045, 0.104, 0.235, 0.320, 0.649];
    const ERROR_REL: f64 = 0.03;

    /// Samples of this known stiffness, whose points do not scatter, and a description with 10 %.
    const fn comparing(known_mpa: &[Option<f64>]) -> RunTouches<'_> {
        RunTouches {
            main: &[],
            blind: &[],
            known_mpa,
            sample_rel: 0.0,
            depth_correlation: None,
            reference_hz2: None,
            resonance_ratio: 1.0,
            scale_rel: 0.1,
        }
    }

    /// Two known samples that seem stiffer by this factor, within a percent.
    fn with_factor(factor: f64) -> RunCalibration {
        let described = Compensation::new(&SensorDescription::reference(), 0.002);
        let model = RunModel::of_sites(&described, &[], &[]);
        let known_mpa = [Some(0.1), Some(0.3)];
        let run = comparing(&known_mpa);
        let reading = |(sample, mpa): (usize, f64)| {
            let young = Young { mpa: factor * mpa, sigma_mpa: 0.01 * factor * mpa };
            let budget = Budget::default().with(Part::Sweep, 0.01);
            Reading { sample, found: Ok(ModelReading { young, budget, gradient: Vec::new() }) }
        };
        let main = [(0, 0.1), (1, 0.3)].map(reading);
        let at = ComparedAt { angle_deg: Some(0.0), is_there: vec![true; 2] };
        calibrated(&run, [&main, &[]], &SharedReferences::default(), &at, &model).calibration
    }

    /// A logarithm of 0.25 is two and a half standard deviations of 10 %, and one of 0.27 is 2.7.
    #[test]
    fn a_factor_that_the_description_does_not_allow_is_said_to_be_beyond_it() {
        for factor in [1.0, 1.1, 0.25_f64.exp(), (-0.25_f64).exp()] {
            assert_eq!(with_factor(factor).beyond_description(), None, "{factor}");
        }
        for factor in [0.27_f64.exp(), (-0.27_f64).exp()] {
            let sigmas = with_factor(factor).beyond_description().unwrap();
            assert!((2.6..2.7).contains(&sigmas), "{factor}: {sigmas}");
        }
    }

    /// Root mean squares of the errors of the samples and of their stated standard deviations, when only the
    /// first of them are known. The touches err independently, by this many times what is stated of each; the first
    /// three of each sample are compared.
    fn found_and_stated(known: usize, beyond: f64) -> (f64, f64) {
        const TRIALS: u32 = 1000;
        let touches: [bool; 12] = std::array::from_fn(|touch| touch < 3);
        let described = Compensation::new(&SensorDescription::reference(), 0.002);
        let model = RunModel::of_sites(&described, &[], &[]);
        let known_mpa: Vec<Option<f64>> =
            KNOWN_MPA.iter().enumerate().map(|(i, mpa)| (i < known).then_some(*mpa)).collect();
        let run = comparing(&known_mpa);
        let is_there = KNOWN_MPA.iter().flat_map(|_| touches).collect();
        let at = ComparedAt { angle_deg: Some(0.0), is_there };
        let (mut errors, mut stated) = (0.0, 0.0);
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut normal = || {
            // The sum of twelve even numbers has a variance of one.
            let even = (0..12).map(|_| f64::from(random.next_u32()) / f64::from(u32::MAX));
            even.sum::<f64>() - 6.0
        };
        for _ in 0..TRIALS {
            let mut reading = |sample: usize| {
                let mpa = 1.1 * KNOWN_MPA[sample] * (beyond * ERROR_REL * normal()).exp();
                let young = Young { mpa, sigma_mpa: ERROR_REL * mpa };
                let budget = Budget::default().with(Part::Sweep, ERROR_REL);
                Reading { sample, found: Ok(ModelReading { young, budget, gradient: Vec::new() }) }
            };
            let main: Vec<Reading> =
                (0..KNOWN_MPA.len()).flat_map(|sample| [sample; 12]).map(&mut reading).collect();
            let found =
                calibrated(&run, [&main, &[]], &SharedReferences::default(), &at, &model).samples;
            for sample in &found {
                errors += (sample.young_mpa / KNOWN_MPA[sample.sample]).ln().powi(2);
                stated += (sample.sigma_mpa / sample.young_mpa).powi(2);
                let together = sample.budget.total() * sample.young_mpa;
                assert!((together / sample.sigma_mpa - 1.0).abs() < 1e-9, "{sample:?}");
            }
        }
        let all = f64::from(TRIALS) * KNOWN_MPA.len() as f64;
        ((errors / all).sqrt(), (stated / all).sqrt())
    }

    /// The errors of the touches of a sample are in its mean and in the factor. As independent of each other
    /// they would make the stated standard deviation 13 % too large with five known samples. Stated is the larger
    /// of two estimates: a few per cent above either, but more where the scatter is that of two samples.
    #[test]
    fn a_sample_is_as_uncertain_as_its_touches_make_it_beside_the_factor() {
        for (known, least) in [(1, 0.91), (2, 0.8), (5, 0.91)] {
            let (found, stated) = found_and_stated(known, 1.0);
            let ratio = found / stated;
            assert!((least..1.03).contains(&ratio), "{known} known: {found} of {stated}");
        }
    }

    /// With one known sample nothing else shows by how much its touches, which give the factor, err more than stated.
    #[test]
    fn touches_that_scatter_beyond_the_stated_make_the_factor_as_uncertain() {
        for (known, largest) in [(1, 1.1), (2, 1.1), (5, 1.1)] {
            let (found, stated) = found_and_stated(known, 2.5);
            let ratio = found / stated;
            assert!((0.8..largest).contains(&ratio), "{known} known: {found} of {stated}");
        }
    }
}
