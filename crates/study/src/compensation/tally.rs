//! What many trials say together.

use rig_analysis::score::wilson_95;

use super::protocol::Trial;

/// The trials of a group.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub(super) trials: u32,
    pub(super) recognised: u32,
    /// Trials that gave a stiffness.
    pub(super) found: u32,
    covered: u32,
    within_3_percent: u32,
    sum: f64,
    squares: f64,
}

impl Tally {
    pub(super) fn of<'a>(trials: impl IntoIterator<Item = &'a Trial>) -> Self {
        let mut tally = Self::default();
        for trial in trials {
            tally.trials += 1;
            tally.recognised += u32::from(trial.taken_for == Some(trial.sample));
            let Some(found) = trial.found else { continue };
            tally.found += 1;
            tally.covered += u32::from(found.is_covered);
            tally.within_3_percent += u32::from(found.error_rel.abs() <= 0.03);
            tally.sum += found.error_rel;
            tally.squares += found.error_rel * found.error_rel;
        }
        tally
    }

    /// Trials that were refused a stiffness.
    pub(super) const fn refused(&self) -> u32 {
        self.trials - self.found
    }

    /// The share recognised, and its 95 % interval; refused trials are not.
    pub(super) fn recognition(&self) -> Option<(f64, (f64, f64))> {
        let interval = wilson_95(self.recognised, self.trials);
        Some((share(self.recognised, self.trials)?, interval))
    }

    /// The share of 95 % intervals that hold the truth, and the 95 % interval of that.
    pub(super) fn coverage(&self) -> Option<(f64, (f64, f64))> {
        Some((share(self.covered, self.found)?, wilson_95(self.covered, self.found)))
    }

    /// Mean relative error.
    pub(super) fn bias(&self) -> Option<f64> {
        (self.found > 0).then(|| self.sum / f64::from(self.found))
    }

    /// Root mean square of the relative errors.
    pub(super) fn rms(&self) -> Option<f64> {
        (self.found > 0).then(|| (self.squares / f64::from(self.found)).sqrt())
    }

    /// The share of errors of at most 3 %.
    pub(super) fn within_3_percent(&self) -> Option<f64> {
        share(self.within_3_percent, self.found)
    }
}

fn share(part: u32, whole: u32) -> Option<f64> {
    (whole > 0).then(|| f64::from(part) / f64::from(whole))
}
