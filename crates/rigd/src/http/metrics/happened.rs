//! What the journal says since the daemon was started.

use std::collections::BTreeMap;

use rig_store::{Reader, Record, StoredRecord, Sweep, SweepOutcome, SweepPurpose};

use super::no_load::{NoLoad, Reference};
use crate::http::Problem;

/// Records read at a time.
const PAGE: u32 = 512;
/// Pages read for one request; the next request goes on.
const PAGES_MAX: usize = 40;
/// Different reasons that are told apart. The sentences have no numbers, so that they are some twenty.
const REASONS_MAX: usize = 64;

/// What has happened since the daemon was started, from its journal.
#[derive(Debug, Clone, Default)]
pub(in crate::http) struct Happened {
    last_event: u64,
    pub(super) measured: u64,
    pub(super) refused: BTreeMap<String, u64>,
    pub(super) sweeps: BTreeMap<&'static str, u64>,
    pub(super) runs: BTreeMap<&'static str, u64>,
    pub(super) faults: u64,
    pub(super) stalls: u64,
    /// The last resonance and its standard deviation, Hz.
    pub(super) resonance_hz: Option<(f64, f64)>,
    /// The resonances without a sample, once there is one.
    pub(super) no_load: Option<NoLoad>,
}

impl Happened {
    /// Reads what is new.
    pub(super) fn go_on(&mut self, reader: &Reader, first_event: u64) -> Result<(), Problem> {
        if first_event == 0 {
            // The daemon has noted nothing yet.
            return Ok(());
        }
        if self.last_event == 0 {
            self.last_event = first_event.saturating_sub(1);
        }
        for _ in 0..PAGES_MAX {
            let page = reader.events_after(self.last_event, PAGE)?;
            for stored in &page {
                self.last_event = stored.event;
                self.count(stored);
            }
            if page.len() < PAGE as usize {
                break;
            }
        }
        Ok(())
    }

    fn count(&mut self, stored: &StoredRecord) {
        let is_wanted = matches!(
            stored.kind.as_str(),
            "touch_result" | "touch_refused" | "sweep" | "run_finished" | "fault" | "stalled"
        );
        let Some(Ok(record)) = is_wanted.then(|| stored.record()) else { return };
        match record {
            Record::TouchResult(_) => self.measured += 1,
            Record::TouchRefused(touch) => self.refuse(class(&touch.reason)),
            Record::Sweep(sweep) => self.sweep(&sweep),
            Record::RunFinished(finished) => {
                *self.runs.entry(finished.status.name()).or_default() += 1;
            }
            Record::Fault(_) => self.faults += 1,
            Record::Stalled(_) => self.stalls += 1,
            _ => {}
        }
    }

    fn sweep(&mut self, sweep: &Sweep) {
        let SweepOutcome::Accepted { resonance_hz, sigma_hz, circuit, .. } = sweep.outcome else {
            *self.sweeps.entry("refused").or_default() += 1;
            return;
        };
        *self.sweeps.entry("accepted").or_default() += 1;
        self.resonance_hz = Some((resonance_hz, sigma_hz));
        if sweep.purpose == SweepPurpose::NoLoad {
            let quality_factor = circuit.map(|circuit| circuit.quality_factor);
            let found = Reference { resonance_hz, sigma_hz, quality_factor };
            match &mut self.no_load {
                Some(no_load) => no_load.add(found),
                None => self.no_load = Some(NoLoad::first(found)),
            }
        }
    }

    fn refuse(&mut self, reason: String) {
        let is_known = self.refused.contains_key(&reason) || self.refused.len() < REASONS_MAX;
        let reason = if is_known { reason } else { "another".to_owned() };
        *self.refused.entry(reason).or_default() += 1;
    }
}

/// The words of a reason before its first number.
fn class(reason: &str) -> String {
    let end = reason.find(|letter: char| letter.is_ascii_digit() || ":;,(".contains(letter));
    reason[..end.unwrap_or(reason.len())].trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_with_other_numbers_are_the_same_reason() {
        let reasons = [
            ("no resonance between 120.0 Hz and 165.0 Hz", "no resonance between"),
            ("stray: 12 readings", "stray"),
            ("the resonance is nonlinear", "the resonance is nonlinear"),
        ];
        for (reason, expected) in reasons {
            assert_eq!(class(reason), expected);
        }
        let mut happened = Happened::default();
        for number in 0..200_u8 {
            happened.refuse(format!("reason {}", char::from(number)));
        }
        assert_eq!(happened.refused.len(), REASONS_MAX + 1);
    }

    #[test]
    fn only_accepted_sweeps_without_a_sample_say_how_the_sensor_drifts() {
        let accepted = |resonance_hz| SweepOutcome::Accepted {
            resonance_hz,
            sigma_hz: 0.02,
            effective_time_s: None,
            circuit: None,
            extra: None,
            left_out: 0,
        };
        let refused = || SweepOutcome::Refused { reason: "no resonance".to_owned() };
        let mut happened = Happened::default();
        for (purpose, outcome, drift_hz) in [
            (SweepPurpose::NoLoad, refused(), None),
            (SweepPurpose::Touch, accepted(150.0), None),
            (SweepPurpose::NoLoad, accepted(140.5), Some(0.0)),
            (SweepPurpose::Touch, accepted(151.0), Some(0.0)),
            (SweepPurpose::NoLoad, accepted(140.25), Some(-0.25)),
            (SweepPurpose::Manual, accepted(139.0), Some(-0.25)),
            (SweepPurpose::NoLoad, refused(), Some(-0.25)),
            (SweepPurpose::NoLoad, accepted(140.75), Some(0.25)),
        ] {
            let (step, pose, fit) = (None, None, None);
            let readings = Vec::new();
            happened.sweep(&Sweep {
                number: 1,
                purpose,
                step,
                pose,
                level_v: None,
                readings,
                probe_readings: 0,
                fit,
                outcome,
            });
            assert_eq!(happened.no_load.map(|no_load| no_load.drift_hz()), drift_hz, "{purpose:?}");
        }
        assert_eq!(happened.no_load.map(|no_load| no_load.last().sigma_hz), Some(0.02));
        assert_eq!(happened.sweeps["refused"], 2);
    }
}
