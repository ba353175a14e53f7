//! Checks of a fitted circuit.

use rig_model::Window;

use crate::{Reason, Resonance, Side, circuit::trace::ModelEstimate};

/// Smallest number of readings: five parameters and two more, to leave residuals for the checks.
pub(crate) const POINTS_MIN: usize = 7;
/// Twice the log-likelihood that a resonance must gain over a capacitor. Chance reaches 40 once in a
/// million sweeps: three parameters, one of them tried at up to a few hundred places.
pub(crate) const GAIN_MIN: f64 = 40.0;
/// Largest standard deviation from noise, in linewidths; above it the model is not linear over the
/// noise.
const NOISE_MAX_LINEWIDTHS: f64 = 0.1;
/// Largest total standard deviation, in linewidths; above it a result is no better than a glance at the
/// peak. The excess over the noise comes from possible causes that the readings do not require.
pub(crate) const SIGMA_MAX_LINEWIDTHS: f64 = 0.5;

/// Largest coupling factor squared; above k33² of the softest ceramics, 0.56.
const K_SQUARED_MAX: f64 = 0.6;

/// Smallest loss tangent: that of a sensor without losses, behind the largest phase error that an analyzer has. A fit must lie this
/// many standard deviations below.
const LOSS_TANGENT_MIN: f64 = -0.1;
const LOSS_SIGMAS: f64 = 4.0;

/// The static capacitance of a sensor is that of its last resonance, within this part of it and this many standard deviations:
/// it changes with the temperature, and not in contact.
const CAPACITANCE_REL: f64 = 0.3;
const CAPACITANCE_SIGMAS: f64 = 4.0;

/// Largest mean distance of the readings of a grid, in linewidths. With more, a resonance can hide between
/// them, and one or two wrong readings resemble one.
const SPACING_MAX_LINEWIDTHS: f64 = 5.0;

/// Checks that there is a resonance.
pub(crate) fn doubt_existence(found: &Resonance, gain: f64) -> Option<Reason> {
    // NaN must be refused too, here and below.
    let exists = gain > GAIN_MIN && found.figure_of_merit > 0.0;
    (!exists).then_some(Reason::NoResonance { found: gain, needed: GAIN_MIN })
}

/// Checks that the resonance lies inside the window.
pub(crate) fn doubt_place(found: &Resonance, window: Window) -> Option<Reason> {
    let estimate_hz = found.resonance_hz;
    let side = if estimate_hz < window.min_hz {
        Side::Below
    } else if estimate_hz > window.max_hz {
        Side::Above
    } else {
        return None;
    };
    Some(Reason::OutsideWindow { side, estimate_hz, window })
}

/// Checks that the circuit can be a sensor, because other devices may resemble a resonance.
pub(crate) fn doubt_circuit(found: &Resonance, window: Window) -> Option<Reason> {
    let circuit = found.circuit();
    let span_hz = window.max_hz - window.min_hz;
    [
        ("linewidth in Hz", circuit.linewidth_hz(), span_hz),
        ("coupling factor squared", circuit.k_eff_squared(), K_SQUARED_MAX),
    ]
    .into_iter()
    .find(|(_, found, limit)| {
        // NaN must be refused too.
        let is_possible = found < limit;
        !is_possible
    })
    .map(|(quantity, found, limit)| Reason::NotASensor { quantity, found, limit })
}

/// Checks that the sensor takes power from the drive, given the circuit fitted, whose loss may be below zero.
pub(crate) fn doubt_loss(at: &ModelEstimate, found: &Resonance) -> Option<Reason> {
    let (loss_tangent, sigma) = (at.g / at.c0, found.loss_tangent_sigma().unwrap_or(0.0));
    let is_below = loss_tangent + LOSS_SIGMAS * sigma < LOSS_TANGENT_MIN;
    let (quantity, limit) = ("loss tangent", LOSS_TANGENT_MIN);
    is_below.then_some(Reason::NotASensor { quantity, found: loss_tangent, limit })
}

/// Checks that the static capacitance is that of the last circuit of the sensor. All readings beside the antiresonance look like
/// those at the resonance of a sensor with a small one.
pub(crate) fn doubt_capacitance(
    found: &Resonance,
    (last_farad, last_sigma_farad): (f64, f64),
) -> Option<Reason> {
    let sigma_farad = found.c0_sigma_farad().hypot(last_sigma_farad);
    let allowed_farad = CAPACITANCE_REL * last_farad + CAPACITANCE_SIGMAS * sigma_farad;
    let off_farad = found.c0_farad - last_farad;
    let is_that = off_farad.abs() <= allowed_farad;
    let limit_farad = last_farad + allowed_farad.copysign(off_farad);
    let [found, limit] = [found.c0_farad, limit_farad].map(|farad| 1e9 * farad);
    let quantity = "static capacitance in nF";
    (!is_that).then_some(Reason::NotASensor { quantity, found, limit })
}

/// Checks that the readings, spread over a span, can show a resonance as narrow as the one found.
pub(crate) fn doubt_resolution(found: &Resonance, span: Window, readings: usize) -> Option<Reason> {
    let spacing_hz = (span.max_hz - span.min_hz) / (readings - 1) as f64;
    let limit = SPACING_MAX_LINEWIDTHS * found.resonance_hz / spacing_hz;
    let is_resolved = found.q < limit;
    let quantity = "quality factor";
    (!is_resolved).then_some(Reason::NotASensor { quantity, found: found.q, limit })
}

/// Checks the uncertainty, given the part that comes from noise alone, Hz.
pub(crate) fn doubt_precision(found: &Resonance, sigma_by_noise_hz: f64) -> Option<Reason> {
    let linewidth_hz = found.circuit().linewidth_hz();
    let [by_noise, by_all] = [
        (sigma_by_noise_hz, NOISE_MAX_LINEWIDTHS * linewidth_hz),
        (found.sigma_hz, SIGMA_MAX_LINEWIDTHS * linewidth_hz),
    ]
    .map(|(sigma_hz, limit_hz)| {
        let is_precise = sigma_hz < limit_hz;
        (!is_precise).then_some(Reason::TooNoisy { sigma_hz, limit_hz })
    });
    by_noise.or(by_all)
}
