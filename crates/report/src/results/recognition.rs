//! Recognition of the samples of the blind touches, by several methods side by side.

use rig_analysis::{
    classify::{Classifier, Decision},
    cluster, score,
};

use super::{
    classification::Classification,
    stiffness::{Stiffness, TouchStiffness},
};
use crate::data::RunData;

/// The result of one method.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Recognition {
    /// Method of the classification.
    pub(crate) method: Method,
    /// Number of classified blind touches.
    pub(crate) trials: u32,
    /// Recognised blind touches. A touch that a method refuses is not recognised.
    pub(crate) correct: u32,
    /// For each blind touch, the sample it was taken for.
    pub(crate) taken_for: Vec<Option<usize>>,
}

/// A method of recognition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Method {
    /// The paper's: k-means on the shifts. Each cluster gets the sample afterwards so that most touches
    /// agree.
    KMeans,
    /// k-means on the logarithms of the shifts, with the same assignment.
    KMeansLog,
    /// Stiffness, with the angle compensated when it is known, in classes calibrated by the main
    /// touches.
    CalibratedStiffness,
}

impl Method {
    /// The word in files.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::KMeans => "k-means",
            Self::KMeansLog => "k-means-log",
            Self::CalibratedStiffness => "calibrated-stiffness",
        }
    }

    /// The words in the report.
    pub(crate) const fn describe(self) -> &'static str {
        match self {
            Self::KMeans => "k-means on the shifts",
            Self::KMeansLog => "k-means on the logarithms of the shifts",
            Self::CalibratedStiffness => "stiffness by the model, in calibrated classes",
        }
    }
}

impl Recognition {
    /// Share of recognised touches.
    pub(crate) fn rate(&self) -> f64 {
        f64::from(self.correct) / f64::from(self.trials)
    }

    /// Wilson's 95 % interval of the rate.
    pub(crate) fn interval(&self) -> (f64, f64) {
        score::wilson_95(self.correct, self.trials)
    }

    fn new(method: Method, labels: &[usize], taken_for: Vec<Option<usize>>) -> Self {
        let is_correct = |(label, taken): &(&usize, &Option<usize>)| **taken == Some(**label);
        let correct = labels.iter().zip(&taken_for).filter(is_correct).count();
        let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        Self { method, trials: count(labels.len()), correct: count(correct), taken_for }
    }
}

/// Every method that this run allows; none without blind touches.
pub(crate) fn recognitions(
    data: &RunData,
    classification: Option<&Classification>,
    stiffness: Option<&Stiffness>,
) -> Vec<Recognition> {
    let Some(classification) = classification else { return Vec::new() };
    let labels: Vec<usize> = classification.trials.iter().map(|trial| trial.sample).collect();
    let label_of = &classification.score.label_of;
    let taken_for = classification.trials.iter().map(|trial| label_of[trial.cluster]).collect();
    let by_logarithm = k_means_log(classification, &labels, data.samples().len());
    let by_stiffness = stiffness.and_then(|found| calibrated(found, data.samples().len()));
    let methods = [
        Some((Method::KMeans, taken_for)),
        by_logarithm.map(|taken_for| (Method::KMeansLog, taken_for)),
        by_stiffness.map(|taken_for| (Method::CalibratedStiffness, taken_for)),
    ];
    let recognition = |(method, taken_for)| Recognition::new(method, &labels, taken_for);
    methods.into_iter().flatten().map(recognition).collect()
}

fn k_means_log(
    classification: &Classification,
    labels: &[usize],
    samples: usize,
) -> Option<Vec<Option<usize>>> {
    let classes = classification.centres_hz.len();
    // A shift that is not positive has no logarithm, and k-means then has no answer.
    let logs: Vec<f64> = classification.trials.iter().map(|trial| trial.shift_hz.ln()).collect();
    let clustering = cluster::optimal(&logs, classes).ok()?;
    let score = score::score(labels, &clustering.clusters, samples, classes);
    Some(clustering.clusters.iter().map(|&cluster| score.label_of[cluster]).collect())
}

/// The likeliest sample of each blind touch, by classes calibrated on the main touches; `None` when
/// these do not give every sample a class.
fn calibrated(stiffness: &Stiffness, samples: usize) -> Option<Vec<Option<usize>>> {
    let usable = stiffness.main.iter().filter_map(|reading| {
        let young = reading.young.ok()?;
        Some((young.mpa, reading.sample))
    });
    let (values, labels): (Vec<f64>, Vec<usize>) = usable.unzip();
    let classifier = Classifier::calibrated(&values, &labels, samples).ok()?;
    let taken_for = |reading: &TouchStiffness| {
        let young = reading.young.ok()?;
        match classifier.classify(young.mpa, young.sigma_mpa / young.mpa)? {
            Decision::Class { class, .. } => Some(class),
            Decision::Unknown { .. } => None,
        }
    };
    Some(stiffness.blind.iter().map(taken_for).collect())
}
