//! The uncertainty of a resonance that is nearly as broad as the sweep.
//!
//! Readings within one linewidth show little of the curve, so that the cost rises much slower on one
//! side of the resonance than its curvature indicates.

use super::Model;
use crate::{FitOptions, Reason, circuit::trace::ModelEstimate, numeric::dense::Cholesky};

/// Linewidth over the span of the readings from which the profile of the likelihood counts.
pub(crate) const BROAD: f64 = 0.5;
/// Distances from the resonance at which the profile is computed, in standard deviations.
const SIGMAS: [f64; 4] = [-4.0, -2.0, 2.0, 4.0];
/// Weight of the frequency at which the resonance is held, over its own.
const HELD: f64 = 1e8;
/// Smallest rise of the cost, so that a flat profile has a finite width.
const RISE_MIN: f64 = 1e-3;

/// Linewidth of the rival, over the span of the readings, that they must exclude, and twice the
/// log-likelihood that it must lose. Chance makes a capacitor or a broader resonance lose that much once in
/// ten thousand sweeps.
const RIVAL: f64 = 2.0;
const LOSS: f64 = 16.0;

impl Model {
    /// Widens the uncertainty of a broad resonance to that of its profile, and records if the readings may
    /// come from a resonance that is broader than the sweep.
    pub(super) fn try_broader(&mut self, options: &FitOptions) {
        let hz = self.trace.samples.iter().map(|sample| sample.visit.frequency_hz);
        let (low_hz, high_hz) =
            hz.fold((f64::INFINITY, 0.0_f64), |(low, high), hz| (low.min(hz), high.max(hz)));
        let (at, span_hz) = (self.found.at, high_hz - low_hz);
        let is_broad = at.resonance_hz / at.q > BROAD * span_hz;
        let inverse = Cholesky::new(&self.found.normal.matrix, self.found.free, 0.0)
            .map(|factor| factor.inverse_leading(self.found.free));
        let Some(inverse) = inverse.filter(|_| is_broad && self.trace.timing.is_steady()) else {
            return;
        };
        let variance = inverse[0][0] * self.noise(options).variance();
        let widest = SIGMAS.map(|sigmas| {
            let wanted = at.resonance_hz.ln() + sigmas * variance.sqrt();
            let start = ModelEstimate { resonance_hz: wanted.exp(), ..at };
            let lost = self.lost(start, 0, inverse[0][0], options);
            sigmas * sigmas * variance / lost.max(RISE_MIN)
        });
        let profile = widest.into_iter().fold(variance, f64::max) - variance;
        self.widened = self.widened.max(profile);
        let rival = ModelEstimate { q: at.resonance_hz / (RIVAL * span_hz), ..at };
        if self.lost(rival, 1, inverse[1][1], options) < LOSS {
            let (found, limit) = (RIVAL * span_hz, span_hz);
            let broad = Reason::NotASensor { quantity: "linewidth in Hz", found, limit };
            self.reason.get_or_insert(broad);
        }
    }

    /// Twice the log-likelihood that is lost if the resonance (`unknown` 0) or the quality factor (1) is
    /// held at that of `start`; `unit` is its variance for noise of variance 1.
    fn lost(&self, start: ModelEstimate, unknown: usize, unit: f64, options: &FitOptions) -> f64 {
        let value = |at: &ModelEstimate| [at.resonance_hz.ln(), at.q.ln()][unknown];
        let wanted = value(&start);
        let precision = HELD / unit;
        let (_, held, _) = self.trace.solve_with(start, self.found.free, |at, normal| {
            let away = value(at) - wanted;
            normal.matrix[unknown][unknown] += precision;
            normal.gradient[unknown] += precision * away;
            normal.cost += precision * away * away;
        });
        -self.gain(self.found.normal.cost - held.cost, options)
    }
}
