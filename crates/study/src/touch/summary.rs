//! The runs of a setting.

use std::collections::BTreeMap;

use super::trial::Trial;

/// An error beyond this many stated standard deviations is wrong without notice.
const WRONG_SIGMAS: f64 = 5.0;

/// The runs of a setting together.
#[derive(Debug, Clone)]
pub(super) struct Summary {
    trials: Vec<Trial>,
}

/// A ratio over paired runs: the geometric mean, and two standard errors of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ratio {
    pub(super) mean: f64,
    pub(super) two_sigmas: f64,
}

impl Summary {
    pub(super) fn of(trials: &[Trial]) -> Self {
        Self { trials: trials.to_vec() }
    }

    fn count(&self, of: impl Fn(&Trial) -> usize) -> usize {
        self.trials.iter().map(of).sum()
    }

    pub(super) fn planned(&self) -> usize {
        self.count(|trial| trial.planned)
    }

    pub(super) fn refused(&self) -> usize {
        self.count(|trial| trial.refused)
    }

    pub(super) fn not_reached(&self) -> usize {
        self.count(|trial| trial.not_reached)
    }

    pub(super) fn measured(&self) -> usize {
        self.planned() - self.refused() - self.not_reached()
    }

    /// Number of runs that ended before their last touch, and why the first of them did.
    pub(super) fn ended(&self) -> Option<(usize, &str)> {
        let mut ended = self.trials.iter().filter_map(|trial| trial.ended.as_deref());
        let first = ended.next()?;
        Some((1 + ended.count(), first))
    }

    /// What must never happen on a bench.
    pub(super) fn violations(&self) -> usize {
        self.count(|trial| trial.violations.len())
    }

    /// Stiffnesses that are wrong without notice.
    pub(super) fn wrong(&self) -> usize {
        let is_wrong = |(error, sigma): &&(f64, f64)| WRONG_SIGMAS * sigma < error.abs();
        self.count(|trial| trial.errors.iter().filter(is_wrong).count())
    }

    /// Mean rig time for each planned touch of the runs that came to their end, s.
    pub(super) fn touch_s(&self) -> Option<f64> {
        mean(self.trials.iter().filter_map(Trial::touch_s))
    }

    /// Root mean square of the errors of all runs.
    pub(super) fn rms(&self) -> Option<f64> {
        let errors = || self.trials.iter().flat_map(|trial| &trial.errors);
        mean(errors().map(|(error, _)| error * error)).map(f64::sqrt)
    }

    /// Largest error.
    pub(super) fn largest(&self) -> Option<f64> {
        let errors = self.trials.iter().flat_map(|trial| &trial.errors);
        errors.map(|(error, _)| error.abs()).max_by(f64::total_cmp)
    }

    /// The errors over those of another setting with the same seeds.
    pub(super) fn over(&self, base: &Self) -> Option<Ratio> {
        let pairs = self.trials.iter().zip(&base.trials);
        let logs: Vec<f64> =
            pairs.filter_map(|(own, base)| Some((own.rms()? / base.rms()?).ln())).collect();
        let n = logs.len() as f64;
        let mean = mean(logs.iter().copied())?;
        let squares: f64 = logs.iter().map(|log| (log - mean).powi(2)).sum();
        let sigma = (squares / (n - 1.0).max(1.0) / n).sqrt();
        Some(Ratio { mean: mean.exp(), two_sigmas: 2.0 * sigma * mean.exp() })
    }

    /// Mean time in each phase for each planned touch, s.
    pub(super) fn phases_s(&self) -> BTreeMap<&'static str, f64> {
        let mut sums = BTreeMap::new();
        for trial in &self.trials {
            for (phase, seconds) in &trial.phases_s {
                *sums.entry(*phase).or_insert(0.0) += seconds / self.planned() as f64;
            }
        }
        sums
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    (count > 0.0).then(|| sum / count)
}
