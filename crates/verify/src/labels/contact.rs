//! Whether a sweep of a touch has felt a contact.

use num_complex::Complex64;

use super::{Labels, SweepFacts};
use crate::{
    finding::{Check, Findings},
    fit,
    settings::Settings,
};

/// A touch without a shift of this many standard deviations is refused: no contact was felt.
const NO_SHIFT_SIGMAS: f64 = 6.0;
/// So is one that changes the impedance at the free resonance by less than this part of the threshold by which
/// the search felt a contact.
const NO_CHANGE_PART: f64 = 0.5;
/// Relative difference by which two computations of that change may lie on different sides of the limit.
const ROUNDING: f64 = 1e-6;

impl Labels {
    /// Checks that a touch with an accepted sweep has a result if its contact was felt, and none otherwise.
    pub(super) fn felt(
        &self,
        seq: u64,
        is_result: bool,
        (shift_hz, sigma_hz): (f64, f64),
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let limit_hz = NO_SHIFT_SIGMAS * sigma_hz;
        let change = self.change();
        let least =
            settings.map(|settings| NO_CHANGE_PART * settings.protocol.approach.contact_threshold);
        let compare = |is_beyond: fn(f64, f64) -> bool| {
            change.zip(least).is_some_and(|(change, least)| is_beyond(change, least))
        };
        if is_result && shift_hz <= limit_hz {
            let what = "the shift of a result: no contact was felt, Hz";
            findings.add(Check::Shift, seq, what, format!("more than {limit_hz}"), shift_hz);
        } else if is_result && compare(|change, least| change < least * (1.0 - ROUNDING)) {
            let what = "the change of the impedance of a result: no contact was felt";
            let (change, least) = (change.unwrap_or_default(), least.unwrap_or_default());
            findings.add(Check::Shift, seq, what, format!("more than {least}"), change);
        } else if !is_result
            && limit_hz < shift_hz
            && !compare(|change, least| change < least * (1.0 + ROUNDING))
        {
            let what = "the shift of a touch that is refused although its sweep is not, Hz";
            findings.within(Check::Shift, seq, what, "less", shift_hz, Some(limit_hz.to_string()));
        }
    }

    /// The change of the impedance at the free resonance from the free sensor to that in contact, relative;
    /// `None` if a circuit is not recorded.
    fn change(&self) -> Option<f64> {
        let [free, touch] = [self.reference.as_ref()?, self.sweep.as_ref()?];
        let (at_hz, _) = *free.outcome.as_ref().ok()?;
        let [free, touch] = [free, touch].map(|facts| impedance(facts, at_hz));
        let free = free?;
        Some((touch? - free).norm() / free.norm())
    }
}

/// The impedance of the circuit that a sweep found, ohm.
fn impedance(facts: &SweepFacts, at_hz: f64) -> Option<Complex64> {
    let (resonance_hz, _) = *facts.outcome.as_ref().ok()?;
    Some(fit::impedance(&facts.circuit?, resonance_hz, at_hz))
}
