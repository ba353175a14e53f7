//! Summary of the runs of a truth.

use rig_analysis::{
    model::{Pattern, Verdict},
    score::wilson_95,
};

use super::trial::Found;

/// Counts and sums over runs.
#[derive(Debug, Clone, Default)]
pub(super) struct Summary {
    runs: u32,
    strained: u32,
    rejected: u32,
    /// Runs with each pattern: friction, arm, depth, one sample, known samples.
    patterns: [u32; 5],
    blind: u32,
    recognised: u32,
    found: u32,
    covered: u32,
    squares: f64,
    samples: u32,
    samples_covered: u32,
    chi2_sum: f64,
    ratio_sum: f64,
    arm_sum: f64,
    arm_learnt: u32,
    held_by_stage: u32,
}

impl Summary {
    pub(super) fn of<'a>(runs: impl IntoIterator<Item = &'a Found>) -> Self {
        let mut all = Self::default();
        for found in runs {
            all.add(found);
        }
        all
    }

    fn add(&mut self, found: &Found) {
        self.runs += 1;
        self.strained += u32::from(found.verdict == Verdict::Strained);
        self.rejected += u32::from(found.verdict == Verdict::Rejected);
        match found.pattern {
            Some(Pattern::Friction) => self.patterns[0] += 1,
            Some(Pattern::Arm) => self.patterns[1] += 1,
            Some(Pattern::Depth) => self.patterns[2] += 1,
            Some(Pattern::Sample(_)) => self.patterns[3] += 1,
            Some(Pattern::Known(_)) => self.patterns[4] += 1,
            None => {}
        }
        for is_recognised in &found.recognised {
            self.blind += 1;
            self.recognised += u32::from(*is_recognised);
        }
        for (error_rel, is_covered) in found.errors.iter().flatten() {
            self.found += 1;
            self.covered += u32::from(*is_covered);
            self.squares += error_rel * error_rel;
        }
        for is_covered in &found.samples_covered {
            self.samples += 1;
            self.samples_covered += u32::from(*is_covered);
        }
        self.chi2_sum += found.chi2_per_dof;
        self.ratio_sum += found.tangential_ratio;
        self.arm_sum += found.arm_mm;
        self.arm_learnt += u32::from(found.is_arm_learnt);
        self.held_by_stage += u32::from(found.is_held_by_stage);
    }

    fn of_runs(&self, count: u32) -> f64 {
        f64::from(count) / f64::from(self.runs)
    }

    /// Share of recognised blind touches.
    pub(super) fn recognition(&self) -> f64 {
        f64::from(self.recognised) / f64::from(self.blind)
    }

    /// Root mean square of the relative errors of blind touches.
    pub(super) fn rms(&self) -> f64 {
        (self.squares / f64::from(self.found)).sqrt()
    }

    /// Share of blind touches whose interval contains the truth.
    pub(super) fn coverage(&self) -> f64 {
        f64::from(self.covered) / f64::from(self.found)
    }

    /// The same of the samples.
    pub(super) fn samples_coverage(&self) -> f64 {
        f64::from(self.samples_covered) / f64::from(self.samples)
    }

    /// Share of runs whose model is strained or rejected.
    pub(super) fn noticed(&self) -> f64 {
        self.of_runs(self.strained + self.rejected)
    }

    /// Wilson's 95 % interval of that share.
    pub(super) fn noticed_95(&self) -> (f64, f64) {
        wilson_95(self.strained + self.rejected, self.runs)
    }

    /// Share of runs whose model is rejected.
    pub(super) fn rejected(&self) -> f64 {
        self.of_runs(self.rejected)
    }

    /// The most frequent pattern with its share of the runs.
    pub(super) fn pattern(&self) -> Option<(&'static str, f64)> {
        let names = ["friction", "arm", "depth", "one sample", "known samples"];
        let best = names.into_iter().zip(self.patterns).max_by_key(|(_, count)| *count)?;
        (best.1 > 0).then(|| (best.0, self.of_runs(best.1)))
    }

    /// Mean χ² for each degree of freedom.
    pub(super) fn chi2_per_dof(&self) -> f64 {
        self.chi2_sum / f64::from(self.runs)
    }

    /// Mean tangential ratio.
    pub(super) fn ratio(&self) -> f64 {
        self.ratio_sum / f64::from(self.runs)
    }

    /// Mean arm, mm.
    pub(super) fn arm_mm(&self) -> f64 {
        self.arm_sum / f64::from(self.runs)
    }

    /// Share of runs that learnt the arm.
    pub(super) fn arm_learnt(&self) -> f64 {
        self.of_runs(self.arm_learnt)
    }

    /// Share of runs that found the depth held by the stage.
    pub(super) fn held_by_stage(&self) -> f64 {
        self.of_runs(self.held_by_stage)
    }
}
