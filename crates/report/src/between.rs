//! The reference of a touch between the one before it and the one after it, in runs whose references the drift asks for.
//!
//! The run knows the reference before a touch. When the next one has been measured, both say what the free resonance was
//! during the touch, each with the drift in the time between. Their mean, weighted with the inverse variances, is that of
//! a random walk; if the sweeps are exact, it is the straight line between both.

use std::collections::{BTreeMap, BTreeSet};

use rig_analysis::reference::{NextSweep, Reference};
use rig_protocol::{NoLoadPolicy, Protocol};
use rig_record::{Prompt, Record, RunStarted, Sweep, SweepOutcome, SweepPurpose, Touch};

/// A reference, or the sweep in contact of a touch.
#[derive(Debug, Clone, Copy)]
struct Measured {
    number: u64,
    hz: f64,
    sigma_hz: f64,
    /// The time for which it holds, s on the clock of its readings.
    at_s: f64,
}

impl Measured {
    fn of(sweep: &Sweep) -> Option<Self> {
        let SweepOutcome::Accepted { resonance_hz, sigma_hz, effective_time_s, .. } = sweep.outcome
        else {
            return None;
        };
        let (first, last) = (sweep.readings.first()?, sweep.readings.last()?);
        let middle_s = 0.5 * (first.started_s + last.started_s);
        let at_s = effective_time_s.unwrap_or(middle_s);
        Some(Self { number: sweep.number, hz: resonance_hz, sigma_hz, at_s })
    }
}

/// The references so far, and what lies between them.
#[derive(Debug, Default)]
pub(crate) struct Between {
    /// Whether the drift says when the reference is measured.
    is_by_drift: bool,
    before: Option<Measured>,
    /// The last sweep in contact.
    contact: Option<Measured>,
    /// The sweeps in contact of the measured touches since the last reference.
    open: Vec<Measured>,
    /// The reference that closes them, until the next record says that it is no jump. A vague one is measured again: the
    /// first one closes them, and the last one is that of the touches that follow.
    next: Option<[Measured; 2]>,
    /// The reference of each measured touch, by its sweep in contact.
    of_touches: BTreeMap<u64, Reference>,
    /// The references after which the resonance has jumped.
    jumped: BTreeSet<u64>,
}

impl Between {
    /// Takes a record, and moves the references of the touches between two.
    pub(crate) fn take(&mut self, record: &Record, touches: &mut [Touch]) {
        match record {
            Record::RunStarted(started) => self.is_by_drift = is_by_drift(started),
            Record::ReferenceJumped(jumped) => {
                self.jumped.insert(jumped.no_load_sweep);
                self.close_at_jump();
            }
            Record::Sweep(sweep) if sweep.purpose == SweepPurpose::NoLoad => {
                let first = self.next.map(|[first, _]| first);
                let found = Measured::of(sweep);
                self.next = found.map(|last| [first.unwrap_or(last), last]).or(self.next);
            }
            Record::Sweep(sweep) => {
                self.close(touches);
                self.contact = Measured::of(sweep);
            }
            Record::TouchResult(touch) => {
                self.of_touches.insert(touch.sweep, reference(touch));
                let own = self.contact.filter(|contact| contact.number == touch.sweep);
                self.open.extend(own.filter(|_| self.is_by_drift));
            }
            // A turn may change the resonance, and another clock begins with another epoch.
            Record::PromptAnswered(_) | Record::StepStarted(_) => self.close(touches),
            Record::PromptAsked(asked) if matches!(asked.prompt, Prompt::TurnSensor { .. }) => {
                self.forget(touches);
            }
            Record::Resumed(_) | Record::Amended(_) | Record::RunFinished(_) => {
                self.forget(touches);
            }
            _ => {}
        }
    }

    /// The reference after the touch with this sweep in contact, if it lies between two.
    pub(crate) fn next_of(&self, sweep: u64) -> Option<u64> {
        Some(self.of_touches.get(&sweep)?.next?.sweep)
    }

    /// The reference of a touch, of which others may have a part.
    pub(crate) fn reference(&self, touch: &Touch) -> Reference {
        self.of_touches.get(&touch.sweep).copied().unwrap_or_else(|| reference(touch))
    }

    /// Whether the resonance has not jumped after this reference.
    pub(crate) fn is_steady(&self, no_load_sweep: u64) -> bool {
        !self.jumped.contains(&no_load_sweep)
    }

    fn forget(&mut self, touches: &mut [Touch]) {
        self.close(touches);
        (self.before, self.contact) = (None, None);
        self.open.clear();
    }

    fn close_at_jump(&mut self) {
        self.before = self.next.take().map(|[_, last]| last);
        self.open.clear();
    }

    /// The last reference closes the touches before it.
    fn close(&mut self, touches: &mut [Touch]) {
        let Some([next, last]) = self.next.take() else { return };
        for contact in std::mem::take(&mut self.open) {
            let touch = touches.iter_mut().find(|touch| touch.sweep == contact.number);
            if let (Some(before), Some(touch)) = (self.before, touch)
                && touch.no_load_sweep == before.number
                && let Some(reference) = self.of_touches.get_mut(&contact.number)
            {
                reference.next = move_reference(touch, (before, contact.at_s, next));
            }
        }
        self.before = Some(last);
    }
}

fn is_by_drift(started: &RunStarted) -> bool {
    let chosen = started.aim.as_ref().and_then(|aim| NoLoadPolicy::of_word(&aim.settings.no_load));
    let policy = chosen.unwrap_or_else(|| {
        Protocol::read(&started.protocol.name, &started.protocol.toml).no_load()
    });
    policy == NoLoadPolicy::ByDrift
}

/// The reference of a touch as the run knew it.
const fn reference(touch: &Touch) -> Reference {
    Reference {
        sweep: touch.no_load_sweep,
        sigma_hz: touch.no_load_sigma_hz,
        drift_sigma_hz: touch.drift_sigma_hz,
        next: None,
    }
}

/// Moves the reference of a touch in contact at this time, s. Returns the part of the second one; `None` if it could not.
fn move_reference(
    touch: &mut Touch,
    (before, at_s, next): (Measured, f64, Measured),
) -> Option<NextSweep> {
    let (since_s, until_s) = (at_s - before.at_s, next.at_s - at_s);
    // A run that has not learnt its drift says nothing of it.
    if !(touch.drift_sigma_hz > 0.0 && since_s > 0.0 && until_s > 0.0) {
        return None;
    }
    let drift_hz2 = [1.0, until_s / since_s].map(|part| part * touch.drift_sigma_hz.powi(2));
    let variances = [before.sigma_hz.powi(2) + drift_hz2[0], next.sigma_hz.powi(2) + drift_hz2[1]];
    let of_next = variances[0] / (variances[0] + variances[1]);
    let weights = [1.0 - of_next, of_next];
    let mean = |values: [f64; 2]| values[0] * weights[0].powi(2) + values[1] * weights[1].powi(2);
    let held = (touch.no_load_hz, touch.no_load_sigma_hz.hypot(touch.drift_sigma_hz));
    touch.no_load_hz = before.hz + of_next * (next.hz - before.hz);
    touch.no_load_sigma_hz = mean([before.sigma_hz.powi(2), next.sigma_hz.powi(2)]).sqrt();
    touch.drift_sigma_hz = mean(drift_hz2).sqrt();
    touch.shift_hz += held.0 - touch.no_load_hz;
    let of_reference_hz2 = touch.no_load_sigma_hz.powi(2) + touch.drift_sigma_hz.powi(2);
    let variance_hz2 = touch.shift_sigma_hz.powi(2) - held.1.powi(2) + of_reference_hz2;
    touch.shift_sigma_hz = variance_hz2.max(of_reference_hz2).sqrt();
    let Measured { number: sweep, sigma_hz, .. } = next;
    Some(NextSweep { sweep, sigma_hz, weight: of_next, since_s, until_s })
}

#[cfg(test)]
#[path = "between/tests.rs"]
mod tests;
