//! Whether a refused sweep is refused for a reason that its readings bear out.
//!
//! A reason says what the readings do not show: no resonance, one outside of the window, or readings far
//! from the rest. A sweep that determines a resonance of its own contradicts it. Other reasons say that the
//! readings show something other than a resonance, which this checker does not model.

use crate::{
    finding::{Check, Findings},
    fit::{self, Fitted, Motion, Stated},
    record::{Circuit, Outcome, Reading, Sweep},
    results::{READINGS_MIN, most_scatter},
};

/// At most this many sweeps of a run are fitted, spread evenly over it: those without a resonance take
/// long to fit.
const SWEEPS_MAX: usize = 24;
/// Sweeps with more readings are not fitted: the time of a fit grows with the cube of the readings of a stay.
/// Accepted sweeps of a run have some twenty.
const READINGS_MAX: usize = 100;
/// Frequencies of the window from which a fit begins.
const BEGINS: u32 = 8;
/// The standard deviations of the resonance, in linewidths, and of the motional capacitance, relative to it,
/// with which a sweep determines a resonance.
const DETERMINED: f64 = 0.1;
/// The scatter of sound readings lies within this many standard deviations of χ².
const SCATTER_SIGMAS: f64 = 6.0;
/// The same without any that is far from the rest: one in ten adds more.
const SCATTER_SIGMAS_OF_ALL: f64 = 1.0;
/// A resonance lies within a window if its ends are further than this many standard deviations.
const WINDOW_SIGMAS: f64 = 6.0;

/// A refused sweep with its record, and the last circuit that was accepted before it.
#[derive(Debug, Clone)]
pub(crate) struct Refused {
    pub(crate) seq: u64,
    pub(crate) sweep: Box<Sweep>,
    pub(crate) before: Circuit,
}

/// Adds a finding for each sweep whose readings contradict the reason of its refusal.
pub(crate) fn check(sweeps: &[Refused], findings: &mut Findings) {
    let judged: Vec<(&Refused, &str, f64)> = sweeps
        .iter()
        .filter_map(|refused| match &refused.sweep.outcome {
            Outcome::Refused { reason } => {
                Some((refused, reason.as_str(), scatter_sigmas(reason)?))
            }
            Outcome::Accepted { .. } => None,
        })
        .collect();
    let every = judged.len().div_ceil(SWEEPS_MAX).max(1);
    for (Refused { seq, sweep, before }, reason, sigmas) in judged.into_iter().step_by(every) {
        if let Some(found) = determined(sweep, before, sigmas) {
            let what = format!("sweep {} is refused, but its readings determine", sweep.number);
            let expected = format!("{:.3} Hz ± {:.3} Hz", found.resonance_hz, found.sigma_hz);
            findings.add(Check::Resonance, *seq, what, expected, reason);
        }
    }
}

/// How far the scatter may be from that of the noise if the reason is not borne out; `None` for reasons that
/// say nothing that is checked here.
fn scatter_sigmas(reason: &str) -> Option<f64> {
    if reason.starts_with("no resonance: a capacitor") || reason.starts_with("resonance near") {
        return Some(SCATTER_SIGMAS);
    }
    reason.contains("readings are far from the rest").then_some(SCATTER_SIGMAS_OF_ALL)
}

/// The resonance within the window of a sweep that its readings determine, if the noise is known.
fn determined(sweep: &Sweep, before: &Circuit, sigmas: f64) -> Option<Fitted> {
    let readings = sweep.readings.iter().filter(|reading| fit::has_place(reading));
    let readings: Vec<Reading> = readings.copied().collect();
    let usable = readings.iter().filter(|reading| fit::is_usable(reading)).count();
    let settings = sweep.fit.as_ref()?;
    let noise = settings.noise?;
    if !(READINGS_MIN..=READINGS_MAX).contains(&usable) {
        return None;
    }
    let [min_hz, max_hz] = settings.window_hz;
    let step_hz = (max_hz - min_hz) / f64::from(BEGINS);
    let begins = (0..BEGINS).map(|n| min_hz + (f64::from(n) + 0.5) * step_hz);
    let motion = Motion::of(settings);
    let fits =
        begins.filter_map(|hz| fit::fit(&readings, motion, Some(noise), Stated::alone(hz, before)));
    let found = fits.min_by(|a, b| a.scatter.total_cmp(&b.scatter))?;
    let linewidth_hz = found.resonance_hz / found.circuit.quality_factor;
    let sigma_hz = found.sigma_hz.max(found.with_mode_hz);
    let margin_hz = WINDOW_SIGMAS * sigma_hz;
    let is_within = (min_hz + margin_hz..=max_hz - margin_hz).contains(&found.resonance_hz);
    let is_sharp =
        sigma_hz < DETERMINED * linewidth_hz && found.circuit_sigma.capacitance_ratio < DETERMINED;
    let is_sound = found.scatter <= most_scatter(Some(noise), found.degrees, sigmas);
    (is_within && is_sharp && is_sound).then_some(found)
}
