//! Summary of many trials.

use rig_analysis::score::wilson_95;

use super::protocol::Trial;

/// The counts and errors of a group of trials.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TrialSummary {
    pub(super) trials: u32,
    pub(super) recognised: u32,
    /// Trials with a stiffness.
    pub(super) found: u32,
    covered: u32,
    within_3_percent: u32,
    sum: f64,
    squares: f64,
}

impl TrialSummary {
    pub(super) fn of<'a>(trials: impl IntoIterator<Item = &'a Trial>) -> Self {
        let mut summary = Self::default();
        for trial in trials {
            summary.trials += 1;
            summary.recognised += u32::from(trial.recognised_as == Some(trial.sample));
            let Some(stiffness) = trial.stiffness else { continue };
            summary.found += 1;
            summary.covered += u32::from(stiffness.is_covered);
            summary.within_3_percent += u32::from(stiffness.error_rel.abs() <= 0.03);
            summary.sum += stiffness.error_rel;
            summary.squares += stiffness.error_rel * stiffness.error_rel;
        }
        summary
    }

    /// Trials without a stiffness.
    pub(super) const fn refused(&self) -> u32 {
        self.trials - self.found
    }

    /// The share of recognised trials. Refused trials count as not recognised.
    pub(super) fn recognition(&self) -> Option<Share> {
        Share::of(self.recognised, self.trials)
    }

    /// The share of 95 % intervals that contain the truth.
    pub(super) fn coverage(&self) -> Option<Share> {
        Share::of(self.covered, self.found)
    }

    /// Mean relative error.
    pub(super) fn bias(&self) -> Option<f64> {
        (self.found > 0).then(|| self.sum / f64::from(self.found))
    }

    /// Root mean square of the relative errors.
    pub(super) fn rms(&self) -> Option<f64> {
        (self.found > 0).then(|| (self.squares / f64::from(self.found)).sqrt())
    }

    /// The share of relative errors of at most 3 %.
    pub(super) fn within_3_percent(&self) -> Option<f64> {
        Some(Share::of(self.within_3_percent, self.found)?.value)
    }
}

/// A share with its 95 % interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Share {
    pub(super) value: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Share {
    fn of(part: u32, whole: u32) -> Option<Self> {
        let (low, high) = wilson_95(part, whole);
        (whole > 0).then(|| Self { value: f64::from(part) / f64::from(whole), low, high })
    }
}
