//! Extra uncertainty when the dwell time is unknown.
//!
//! In a sweep that does not wait for settling, each reading contains part of the previous one. To first
//! order this is equivalent to a shift of the resonance along the sweep, which no fit can detect; to
//! second order it differs, which is visible for a strong resonance. In between, sweeps of weak sensors
//! look settled and are wrong by several standard deviations.
//!
//! So dwells that the readings do not exclude add to the uncertainty. All trial dwells and a sufficient
//! one have equal prior probability. Each adds the square of the error of ignoring it, weighted by its
//! posterior probability.

use crate::{
    circuit::{ringup::Visit, trace::Sample},
    diagnose::alternatives::Alternative,
};

/// Trial settling times, in time constants, and integrations, in cycles.
pub(super) const DWELLS: [(f64, f64); 7] =
    [(0.0, 4.0), (0.0, 10.0), (0.5, 4.0), (0.5, 10.0), (1.0, 4.0), (2.0, 4.0), (3.0, 4.0)];
/// Largest twice the log-likelihood; above it other dwells are impossible and numbers overflow.
const CERTAIN: f64 = 500.0;

/// The visit of a sample with this dwell, for this time constant, s.
pub(super) fn visit((dwell, cycles): (f64, f64), time_constant_s: f64, sample: &Sample) -> Visit {
    Visit {
        settle_s: dwell * time_constant_s,
        integration_s: cycles / sample.visit.frequency_hz,
        rest_s: 0.0,
        ..sample.visit
    }
}

/// Addition to the relative variance of the resonance for these trial dwells, for this noise variance of
/// readings of ten cycles.
pub(crate) fn addition(dwells: impl IntoIterator<Item = Alternative>, noise: f64) -> f64 {
    let (mut all, mut sum) = (1.0, 0.0);
    for found in dwells {
        // Twice the log-likelihood of size 1 minus that of size 0, for a normal estimate.
        let gain = (2.0 * found.size - 1.0) / (found.size_variance * noise);
        let odds = (0.5 * gain.min(CERTAIN)).exp();
        all += odds;
        sum += odds * found.error.powi(2);
    }
    sum / all
}
