//! Extra uncertainty when the dwell time is unknown.
//!
//! A sweep that goes on before the motion has settled reads every point a little as it read the one
//! before. To first order that is what a resonance a little further along looks like, and no fit can
//! tell; to second order it is not, and a strong resonance shows it. Between the two lie sweeps of
//! weak sensors that look settled and are off by several standard deviations.
//!
//! So what the readings do not exclude goes into the uncertainty: each dwell that there may have
//! been, and one that was long enough, is as likely as any other before the readings are seen. What
//! is then still likely counts with the error that overlooking it would be.

use rig_model::Reading;

use crate::{
    Resonance,
    circuit::trace::{CIRCUIT, ModelEstimate, Timing, Trace},
    diagnose::alternatives::Fitted,
};

/// Beyond this twice the log-likelihood nothing else is possible, and numbers overflow.
const CERTAIN: f64 = 500.0;

/// What must be added to the relative variance of the resonance, where readings of ten cycles have
/// noise of this variance.
pub(crate) fn variance(fitted: &Fitted<'_>, noise: f64) -> f64 {
    let (mut all, mut sum) = (1.0, 0.0);
    for found in fitted.dwells() {
        // Twice the log-likelihood of size 1 less that of size 0, the estimate being normal.
        let gain = (2.0 * found.size - 1.0) / (found.size_variance * noise);
        let odds = (0.5 * gain.min(CERTAIN)).exp();
        all += odds;
        sum += odds * found.error.powi(2);
    }
    sum / all
}

/// A resonance found in readings about which nothing else is unusual.
pub(crate) fn widened(
    found: &Resonance,
    at: ModelEstimate,
    readings: &[Reading],
    unit_farad: f64,
) -> Resonance {
    let trace = Trace::of(readings, Timing::Unknown, unit_farad);
    let has_loss = found.loss_tangent_sigma().is_some();
    let free = if has_loss { CIRCUIT } else { CIRCUIT - 1 };
    let fitted = Fitted::at(&trace, at, free);
    let relative = variance(&fitted, found.noise_at_ten_cycles.powi(2));
    found.widened(relative * found.resonance_hz.powi(2))
}
