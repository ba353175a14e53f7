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

use rig_model::Reading;

use crate::{
    Resonance,
    circuit::trace::{ModelEstimate, Timing, Trace},
    diagnose::alternatives::Fitted,
};

/// Largest twice the log-likelihood; above it other dwells are impossible and numbers overflow.
const CERTAIN: f64 = 500.0;

/// Addition to the relative variance of the resonance, for this noise variance of readings of ten
/// cycles.
pub(crate) fn variance(fitted: &Fitted<'_>, noise: f64) -> f64 {
    let (mut all, mut sum) = (1.0, 0.0);
    for found in fitted.dwells() {
        // Twice the log-likelihood of size 1 minus that of size 0, for a normal estimate.
        let gain = (2.0 * found.size - 1.0) / (found.size_variance * noise);
        let odds = (0.5 * gain.min(CERTAIN)).exp();
        all += odds;
        sum += odds * found.error.powi(2);
    }
    sum / all
}

/// The same addition to a resonance from otherwise usual readings.
pub(crate) fn relative(
    found: &Resonance,
    at: ModelEstimate,
    free: usize,
    readings: &[Reading],
    unit_farad: f64,
) -> f64 {
    let trace = Trace::of(readings, Timing::Unknown, unit_farad);
    let fitted = Fitted::at(&trace, at, free);
    variance(&fitted, found.noise_at_ten_cycles.powi(2))
}
