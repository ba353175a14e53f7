//! What speaks against a circuit that was found.

use rig_model::Window;

use crate::{Reason, Resonance, Side};

/// Five parameters and two readings more, so that something is left to judge by.
pub(crate) const POINTS_MIN: usize = 7;
/// Twice the log-likelihood that a resonance must gain over a capacitor. Chance gains 40 once in a
/// million sweeps: three parameters, one of them tried at up to a few hundred places.
pub(crate) const GAIN_MIN: f64 = 40.0;
/// A tenth of the linewidth: beyond it the model is no longer linear over what noise does.
const NOISE_MAX_LINEWIDTHS: f64 = 0.1;
/// Half the linewidth: beyond it a result says no more than a glance at the peak. What is between is
/// not noise but what other causes might do, none of which the readings ask for.
pub(crate) const SIGMA_MAX_LINEWIDTHS: f64 = 0.5;

/// More than the square of the coupling factor k33 of the softest ceramics, 0.56.
const K_SQUARED_MAX: f64 = 0.6;

/// Whether there is a resonance at all.
pub(crate) fn doubt_existence(found: &Resonance, gain: f64) -> Option<Reason> {
    // What is not a number must be refused as well, here and below.
    let exists = gain > GAIN_MIN && found.figure_of_merit > 0.0;
    (!exists).then_some(Reason::NoResonance { found: gain, needed: GAIN_MIN })
}

/// Whether it lies inside the window.
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

/// Whether it can be a sensor at all: something else may look a little like a resonance.
pub(crate) fn doubt_circuit(found: &Resonance, window: Window) -> Option<Reason> {
    let circuit = found.circuit();
    let span_hz = window.max_hz - window.min_hz;
    [
        ("linewidth in Hz", circuit.linewidth_hz(), span_hz),
        ("coupling factor squared", circuit.k_eff_squared(), K_SQUARED_MAX),
    ]
    .into_iter()
    .find(|(_, found, limit)| {
        // What is not a number is no sensor either.
        let is_possible = found < limit;
        !is_possible
    })
    .map(|(quantity, found, limit)| Reason::NotASensor { quantity, found, limit })
}

/// Whether it is known well enough, with this uncertainty by noise alone.
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
