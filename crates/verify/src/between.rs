//! The reference of a touch between two sweeps of the free sensor, in runs whose references the drift asks for.
//!
//! Both sweeps say what the free resonance was during the touch, each with its own variance and with the drift in the time
//! between; their weighted mean is the reference.

use std::collections::{BTreeMap, BTreeSet};

use crate::record::{Outcome, Prompt, Record, Sweep, TouchResult};

/// An accepted sweep of the free sensor.
#[derive(Debug, Clone, Copy)]
struct Reference {
    number: u64,
    hz: f64,
    variance_hz2: f64,
    at_s: f64,
    /// References on different stretches have the sensor turned, or the clock begun again, between them.
    stretch: usize,
}

/// What a run says of its references, in its order.
#[derive(Debug, Default)]
pub(crate) struct Between {
    references: Vec<Reference>,
    stretch: usize,
    /// Sweeps after which the resonance has jumped.
    jumped: BTreeSet<u64>,
    /// For each accepted sweep, the time for which it holds, s.
    times_s: BTreeMap<u64, f64>,
    /// For each touch, the number of references before its result.
    places: BTreeMap<String, usize>,
}

impl Between {
    pub(crate) fn take(&mut self, record: &Record) {
        match record {
            Record::Sweep(sweep) => self.sweep(sweep),
            Record::TouchResult(touch) => {
                self.places.insert(touch.touch.step.clone(), self.references.len());
            }
            Record::ReferenceJumped(jumped) => {
                self.jumped.insert(jumped.no_load_sweep);
            }
            Record::PromptAsked(asked) if matches!(asked.prompt, Prompt::TurnSensor { .. }) => {
                self.stretch += 1;
            }
            Record::Resumed(_) | Record::Amended(_) => self.stretch += 1,
            _ => {}
        }
    }

    fn sweep(&mut self, sweep: &Sweep) {
        let Outcome::Accepted { resonance_hz, sigma_hz, effective_time_s, .. } = sweep.outcome
        else {
            return;
        };
        let (Some(first), Some(last)) = (sweep.readings.first(), sweep.readings.last()) else {
            return;
        };
        let middle_s = f64::midpoint(first.started_s, last.started_s);
        let at_s = effective_time_s.unwrap_or(middle_s);
        self.times_s.insert(sweep.number, at_s);
        if sweep.purpose == "no_load" {
            self.references.push(Reference {
                number: sweep.number,
                hz: resonance_hz,
                variance_hz2: sigma_hz * sigma_hz,
                at_s,
                stretch: self.stretch,
            });
        }
    }

    /// Gives a touch the reference between both of its neighbours, if it has two.
    pub(crate) fn refer(&self, touch: &mut TouchResult) {
        let Some(&place) = self.places.get(&touch.touch.step) else { return };
        let before = place.checked_sub(1).and_then(|last| self.references.get(last));
        let (Some(before), Some(next)) = (before, self.references.get(place)) else { return };
        let Some(at_s) = self.times_s.get(&touch.sweep) else { return };
        let is_between = before.number == touch.no_load_sweep
            && before.stretch == next.stretch
            && !self.jumped.contains(&before.number);
        let (since_s, until_s) = (at_s - before.at_s, next.at_s - at_s);
        let drift_hz2 = touch.drift_sigma_hz.powi(2);
        if !is_between || drift_hz2 == 0.0 || since_s <= 0.0 || until_s <= 0.0 {
            return;
        }
        let of_before_hz2 = before.variance_hz2 + drift_hz2;
        let of_next_hz2 = next.variance_hz2 + drift_hz2 * until_s / since_s;
        let no_load_hz =
            (before.hz * of_next_hz2 + next.hz * of_before_hz2) / (of_before_hz2 + of_next_hz2);
        // Two independent values with these variances, weighted with their inverse.
        let reference_hz2 = 1.0 / (1.0 / of_before_hz2 + 1.0 / of_next_hz2);
        touch.no_load_hz = no_load_hz;
        touch.shift_hz = touch.resonance_hz - no_load_hz;
        touch.shift_sigma_hz = touch.sigma_hz.hypot(reference_hz2.sqrt());
    }
}
