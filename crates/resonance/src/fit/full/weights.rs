//! Weights of readings from rounding and pick-up, in addition to their integration.

use super::{CLEARLY, Model};
use crate::{FitOptions, diagnose::alternatives::Fitted, diagnose::mains, diagnose::outliers};

/// Number of rounds that separate noise from rounding, and smallest noise relative to the rounding.
const ROUNDS: usize = 4;
const NOISE_MIN: f64 = 1e-3;
/// Largest correlation factor; above that of fully correlated readings.
const CORRELATION_MAX: f64 = 30.0;
/// Largest number of mains harmonics that may disturb one sweep.
const PICK_UPS_MAX: usize = 3;

impl Model {
    /// Weights the readings by their rounding too, which is better known than the noise.
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

    /// Down-weights readings with mains pick-up if no other cause explains their scatter better, and
    /// returns whether there is any.
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

    /// Ratio of the variance of the fitted quantities to that for independent errors; rounding errors
    /// occur in runs. With a correlation ρ between neighbours their differences show 1 − ρ of the
    /// variance, and the fitted quantities have (1 + ρ)/(1 − ρ) times their variance.
    pub(super) fn correlation(&self) -> f64 {
        // Readings that are not in sequence at even steps have no runs.
        if self.known == 0.0 || self.trace.weighed_for.is_some() || !self.trace.timing.is_steady() {
            return 1.0;
        }
        let variance = self.cost() / self.degrees();
        (2.0 * variance / self.neighbours() - 1.0).clamp(1.0, CORRELATION_MAX)
    }
}
