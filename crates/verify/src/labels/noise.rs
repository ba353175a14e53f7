//! The noise that a sweep states as known before it: it comes from the no-load sweeps before, so that one
//! sweep alone cannot state a small one. The readings of a short sweep do not contradict that, because
//! the free decay explains more than the noise.

use crate::{
    finding::{Check, Findings},
    record::{FitNoise, Sweep},
};

/// Degrees of freedom of what is known before the first sweep.
const FIRST_DEGREES: f64 = 4.0;
/// Rounding of numbers that are derived from others, relative.
const ROUNDING: f64 = 1e-6;

/// The stated noise so far, since a reference that knew none.
#[derive(Debug, Default)]
pub(super) struct NoiseChain {
    last: Option<FitNoise>,
    /// Values (two for each reading) of accepted no-load sweeps: since the last stated noise, and of all.
    values: f64,
    values_of_all: f64,
}

impl NoiseChain {
    /// The one stated last.
    pub(super) const fn last(&self) -> Option<FitNoise> {
        self.last
    }

    pub(super) fn sweep(&mut self, seq: u64, sweep: &Sweep, is_accepted: bool, to: &mut Findings) {
        let stated = sweep.fit.as_ref().and_then(|fit| fit.noise);
        let is_no_load = sweep.purpose == "no_load";
        if is_no_load && stated.is_none() {
            *self = Self::default();
        }
        if let Some(noise) = stated.filter(|_| is_no_load || sweep.purpose == "touch") {
            self.check(seq, sweep.number, noise, to);
            (self.last, self.values) = (Some(noise), 0.0);
        }
        if is_no_load && is_accepted {
            let values = 2.0 * sweep.readings.len() as f64;
            self.values += values;
            self.values_of_all += values;
        }
    }

    fn check(&self, seq: u64, number: u64, noise: FitNoise, findings: &mut Findings) {
        let most = FIRST_DEGREES + self.values_of_all;
        let found = noise.degrees_of_freedom;
        if found.is_nan() || found > most * (1.0 + ROUNDING) {
            let what = format!(
                "sweep {number}: the degrees of freedom of the noise known before, from the values of the \
                 no-load sweeps before"
            );
            findings.within(Check::Sigma, seq, what, "no more", found, Some(most.to_string()));
        }
        let Some(last) = self.last else { return };
        let known = last.degrees_of_freedom;
        // Readings without any noise lower the variance by this much at most.
        let least = last.at_ten_cycles * (known / (known + self.values)).sqrt() * (1.0 - ROUNDING);
        let is_new = self.values > 0.0;
        let is_same = (noise.at_ten_cycles / last.at_ten_cycles - 1.0).abs() <= ROUNDING;
        if !(if is_new { noise.at_ten_cycles >= least } else { is_same }) {
            let what = format!("sweep {number}: the noise known before, relative");
            let limit = if is_new { least } else { last.at_ten_cycles };
            let expected = if is_new { "at least that of the sweeps before" } else { "the same" };
            let found = noise.at_ten_cycles;
            findings.within(Check::Sigma, seq, what, expected, found, Some(limit.to_string()));
        }
    }
}
