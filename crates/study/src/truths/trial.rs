//! The analysis of one run, as the daemon makes it.

use rig_analysis::{
    classify::{Classifier, Decision},
    model::{ModelSource, Pattern, Verdict},
    run::{RunTouches, RunYoung, at_known_angles},
    stiffness::Compensation,
};
use rig_contact::SensorDescription;

use super::truth::{NUISANCES, RunOfTruth, SURFACE_MM};
use crate::paper_bench::SAMPLES_MPA;

/// The analysis by the reference sensor.
pub(super) struct Analysis {
    described: Compensation,
    sample_rel: f64,
    scale_rel: f64,
}

/// The result of a run.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub(super) verdict: Verdict,
    pub(super) pattern: Option<Pattern>,
    pub(super) chi2_per_dof: f64,
    /// Of a run without nuisances: the chance of the best test to notice its truth.
    pub(super) noticed_at_most: f64,
    pub(super) tangential_ratio: f64,
    pub(super) arm_mm: f64,
    pub(super) is_arm_learnt: bool,
    pub(super) is_held_by_stage: bool,
    /// For each blind touch: relative error and whether the interval contains the truth; `None` for a
    /// refusal.
    pub(super) errors: Vec<Option<(f64, bool)>>,
    /// For each blind touch, whether its sample was recognised.
    pub(super) recognised: Vec<bool>,
    /// For each sample, whether the interval contains its nominal stiffness.
    pub(super) samples_covered: Vec<bool>,
}

/// Half of a 95 % interval in standard deviations.
const HALF_95: f64 = 1.959_964;

impl Analysis {
    pub(super) fn new() -> Self {
        let sensor = SensorDescription::reference();
        let uncertainty = sensor.uncertainty;
        Self {
            described: Compensation::new(&sensor, SURFACE_MM),
            sample_rel: NUISANCES.young_rel,
            scale_rel: uncertainty.scale_rel,
        }
    }

    /// The model of the rig file.
    pub(super) const fn described(&self) -> &Compensation {
        &self.described
    }

    /// The result of a run with this source of its model. All samples are known.
    pub(super) fn of(&self, run: &RunOfTruth, source: ModelSource) -> Found {
        let known_mpa = SAMPLES_MPA.map(Some);
        let touches = RunTouches {
            main: &run.main,
            blind: &run.blind,
            known_mpa: &known_mpa,
            sample_rel: self.sample_rel,
            depth_correlation: None,
            reference_hz2: None,
            resonance_ratio: 1.0,
            scale_rel: self.scale_rel,
        };
        let (found, model) = at_known_angles(&self.described, &touches, source);
        let check = model.check().expect("sixty touches of five samples leave freedom");
        let main = found.main.iter().zip(&run.main);
        let (values, labels): (Vec<f64>, Vec<usize>) = main
            .filter_map(|(young, touch)| Some((young.as_ref().ok()?.own.mpa, touch.sample)))
            .unzip();
        let classes = Classifier::calibrated(&values, &labels, SAMPLES_MPA.len()).ok();
        let error = |(young, truth_mpa): (&Result<RunYoung, _>, &f64)| {
            let whole = young.as_ref().ok()?.whole();
            let error_mpa = whole.mpa - truth_mpa;
            Some((error_mpa / truth_mpa, error_mpa.abs() <= HALF_95 * whole.sigma_mpa))
        };
        let is_recognised = |(young, sample): (&Result<RunYoung, _>, usize)| {
            let (Ok(young), Some(classes)) = (young, &classes) else { return false };
            let decision = classes.classify(young.own.mpa, young.own.sigma_mpa / young.own.mpa);
            matches!(decision, Some(Decision::Class { class, .. }) if class == sample)
        };
        let blind = run.blind.iter().map(|touch| touch.sample);
        let covered = |sample: &rig_analysis::run::RunSample| {
            (sample.young_mpa - SAMPLES_MPA[sample.sample]).abs() <= HALF_95 * sample.sigma_mpa
        };
        Found {
            verdict: check.verdict,
            pattern: check.pattern,
            chi2_per_dof: check.chi2_per_dof(),
            noticed_at_most: check.noticed_at_most(),
            tangential_ratio: model.terms().tangential_ratio,
            arm_mm: model.terms().arm_mm,
            is_arm_learnt: model.terms().arm_mm != model.described().arm_mm,
            is_held_by_stage: model.terms().deflects,
            errors: found.blind.iter().zip(&run.blind_mpa).map(error).collect(),
            recognised: found.blind.iter().zip(blind).map(is_recognised).collect(),
            samples_covered: found.samples.iter().map(covered).collect(),
        }
    }
}
