//! The blind touches, sorted by their shifts without their labels.

use rig_analysis::{
    cluster,
    score::{self, Score},
};
use rig_record::{Phase, Touch};

use crate::data::RunData;

/// The blind touches, sorted into clusters without their labels.
#[derive(Debug)]
pub(crate) struct Classification {
    pub(crate) trials: Vec<Trial>,
    /// Mean shift of each cluster, Hz, ascending.
    pub(crate) centres_hz: Vec<f64>,
    /// The agreement with the labels.
    pub(crate) score: Score,
}

/// One blind touch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trial {
    /// Number of the blind touch, from 1.
    pub(crate) number: u32,
    pub(crate) shift_hz: f64,
    /// Standard deviation of the shift, Hz.
    pub(crate) sigma_hz: f64,
    /// Index of the sample.
    pub(crate) sample: usize,
    /// Index of its cluster.
    pub(crate) cluster: usize,
}

impl Classification {
    /// The optimal k-means partition of the blind touches; `None` when they cannot fill the classes.
    pub(super) fn of(data: &RunData) -> Option<Self> {
        let is_blind = |touch: &&Touch| touch.touch.phase == Phase::Blind;
        let blind = data.touches.iter().filter(is_blind);
        let blind: Vec<(&Touch, usize)> =
            blind.filter_map(|touch| Some((touch, data.sample(&touch.touch.sample)?))).collect();
        let classes = usize::try_from(data.started.as_ref()?.classes?).ok()?;
        let shifts: Vec<f64> = blind.iter().map(|(touch, _)| touch.shift_hz).collect();
        let clustering = cluster::optimal(&shifts, classes).ok()?;
        let labels: Vec<usize> = blind.iter().map(|&(_, sample)| sample).collect();
        let score = score::score(&labels, &clustering.clusters, data.samples().len(), classes);
        let trial = |(&(touch, sample), &cluster): (&(&Touch, usize), &usize)| Trial {
            number: touch.touch.repeat,
            shift_hz: touch.shift_hz,
            sigma_hz: touch.shift_sigma_hz,
            sample,
            cluster,
        };
        let trials = blind.iter().zip(&clustering.clusters).map(trial).collect();
        Some(Self { trials, centres_hz: clustering.centres, score })
    }

    /// The sample that the cluster of this blind touch represents.
    pub(crate) fn class_of(&self, number: u32) -> Option<usize> {
        let trial = self.trials.iter().find(|trial| trial.number == number)?;
        self.score.label_of[trial.cluster]
    }

    /// Whether a touch is in the cluster that represents its sample.
    pub(crate) fn is_correct(&self, trial: &Trial) -> bool {
        self.score.label_of[trial.cluster] == Some(trial.sample)
    }
}
