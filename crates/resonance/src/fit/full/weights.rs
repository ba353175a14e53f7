//! Weights of readings from rounding and pick-up, in addition to their integration.

use super::{CLEARLY, Model};
use crate::{FitOptions, diagnose::alternatives::Fitted, diagnose::mains, diagnose::outliers};

/// Rounds in which noise is told from rounding, and the least part of the rounding that is noise.
const ROUNDS: usize = 4;
const NOISE_MIN: f64 = 1e-3;
/// More than all readings wrong together would be.
const CORRELATION_MAX: f64 = 30.0;
/// Multiples of the mains frequency that may disturb one sweep.
const PICK_UPS_MAX: usize = 3;

impl Model {
    /// Weighs the readings by their rounding as well, which is known better than the noise.
    pub(super) fn weigh_rounding(&mut self, options: &FitOptions) {
        let (count, weight) = self.trace.used();
        let rounding: f64 =
            self.trace.samples.iter().zip(&self.trace.added).map(|(s, r)| s.weight * r).sum();
        let least = NOISE_MIN * rounding * weight / (count * count) as f64;
        for _ in 0..ROUNDS {
            self.known = match &options.noise {
                Some(prior) => prior.at_ten_cycles.powi(2),
                None => self.neighbours(),
            };
            self.known = self.known.max(least);
            self.trace.weigh(self.known);
            self.found = self.trace.minimum(self.found.at, self.found.free);
        }
    }

    /// Weighs the readings by pick-up where nothing else explains better that they scatter there, and
    /// says whether there is any.
    pub(super) fn weigh_pick_up(&mut self, options: &FitOptions) -> bool {
        for _ in 0..PICK_UPS_MAX {
            let (sizes, _) = outliers::sizes(&self.trace, &self.found);
            let Some(found) = mains::strongest(&self.trace, &sizes) else { break };
            let others = Fitted::new(&self.trace, &self.found).alternatives();
            let rival = others.iter().map(|other| self.gain(other.saved, options));
            if found.gain < rival.fold(0.0, f64::max) + CLEARLY {
                break;
            }
            self.trace.added.resize(found.added.len(), 0.0);
            for (all, more) in self.trace.added.iter_mut().zip(&found.added) {
                *all += more;
            }
            self.trace.weigh(found.variance);
            self.found = self.trace.minimum(self.found.at, self.found.free);
            self.mains_hz = self.mains_hz.or(Some(found.near_hz));
        }
        self.mains_hz.is_some()
    }

    /// How many times the variance of what is fitted exceeds that for independent errors: those of
    /// rounding come in runs. With a correlation of ρ between neighbours their differences show 1 − ρ
    /// of the variance, and what is fitted has (1 + ρ)/(1 − ρ) times its variance.
    pub(super) fn correlation(&self) -> f64 {
        // Readings that were not taken in a row of even steps have no runs.
        if self.known == 0.0 || self.trace.weighed_for.is_some() || !self.trace.timing.is_steady() {
            return 1.0;
        }
        let variance = self.cost() / self.degrees();
        (2.0 * variance / self.neighbours() - 1.0).clamp(1.0, CORRELATION_MAX)
    }
}
