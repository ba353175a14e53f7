//! The runs of a setting.

use std::collections::BTreeMap;

use super::trial::Trial;

/// 95 % of a normal variable lie within this.
const WITHIN_SIGMAS: f64 = 1.96;
/// An error beyond this many stated standard deviations is wrong without notice.
const WRONG_SIGMAS: f64 = 5.0;

/// The runs of a setting together.
#[derive(Debug, Clone)]
pub(super) struct Summary {
    trials: Vec<Trial>,
}

/// A ratio over paired runs, and two standard errors of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ratio {
    pub(super) ratio: f64,
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

    /// Number of runs that came to their end, which have a time, and of all.
    pub(super) fn timed(&self) -> (usize, usize) {
        (self.trials.iter().filter_map(Trial::touch_s).count(), self.trials.len())
    }

    /// Share of the stated 95 % intervals that have the truth.
    pub(super) fn coverage(&self) -> Option<f64> {
        let errors = self.trials.iter().flat_map(|trial| &trial.errors);
        mean(errors.map(|(error, sigma)| f64::from(error.abs() < WITHIN_SIGMAS * sigma)))
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

    /// The root mean square of the errors over that of another setting with the same seeds. Its standard error is that of
    /// the results without one seed each, as the jackknife has it.
    pub(super) fn over(&self, base: &Self) -> Option<Ratio> {
        let squares = |trial: &Trial| -> (f64, f64) {
            let errors = trial.errors.iter();
            (errors.map(|(error, _)| error * error).sum(), trial.errors.len() as f64)
        };
        let pairs = || self.trials.iter().zip(&base.trials).enumerate();
        let without = |left_out: Option<usize>| -> Option<f64> {
            let kept = pairs().filter(|(run, _)| Some(*run) != left_out);
            let sum = |(own, base): ((f64, f64), (f64, f64)), (a, b): (&Trial, &Trial)| {
                let ((x, n), (y, m)) = (squares(a), squares(b));
                ((own.0 + x, own.1 + n), (base.0 + y, base.1 + m))
            };
            let none = ((0.0, 0.0), (0.0, 0.0));
            let ((own, n), (base, m)) = kept.map(|(_, pair)| pair).fold(none, sum);
            (n > 0.0 && base > 0.0).then(|| (own / n / (base / m)).sqrt())
        };
        let ratio = without(None)?;
        let parts: Vec<f64> = pairs().filter_map(|(run, _)| without(Some(run))).collect();
        let middle = mean(parts.iter().copied())?;
        let spread: f64 = parts.iter().map(|part| (part - middle).powi(2)).sum();
        let n = parts.len() as f64;
        Some(Ratio { ratio, two_sigmas: 2.0 * ((n - 1.0) / n * spread).sqrt() })
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
