//! A host that was held up: a stopped process, a computer that swaps or sleeps.
//!
//! The drives go on by themselves, and every position is read back after a move. Readings of the
//! analyzer are different: their times are taken by the host, and the fit rests on them. A measurement
//! that was under way is made again.

use std::time::Duration;

use rig_model::RigTime;

use super::Engine;
use crate::{Effect, Event, Fault, Operation, OperationId, fault::StopReason};

/// Number of times that one measurement is repeated. A computer that is held up more often is not fit
/// to measure.
const REPEATS_MAX: u32 = 3;

/// Additional settling of a repeated measurement, s: the motion that the discarded readings have left
/// must be over. The sharpest sensor rings for some tenths of a second.
const SETTLE_S: f64 = 2.0;

impl Engine {
    pub(super) fn stalled(&mut self, now: RigTime, lasted: Duration, effects: &mut Vec<Effect>) {
        self.spoil_stream(effects);
        if let Some(pending) = &mut self.pending {
            // In this time its report could not be taken.
            pending.deadline = pending.deadline + lasted;
        }
        let mut attempts = 0;
        let measuring = self.pending.as_mut().filter(|pending| {
            matches!(pending.operation, Operation::Measure { .. }) && !pending.is_interrupted
        });
        let is_measured_again = measuring.is_some();
        if let Some(pending) = measuring {
            pending.is_held_up = true;
            attempts = pending.repeats + 1;
        }
        self.notes.push(Event::Stalled { lasted, is_measured_again });
        if attempts > REPEATS_MAX {
            self.stop(now, StopReason::Fault(Fault::HeldUp { attempts, lasted }), effects);
        }
    }

    /// Makes a measurement again during which the host was held up; `false` for any other operation.
    pub(super) fn measure_again(
        &mut self,
        now: RigTime,
        id: OperationId,
        effects: &mut Vec<Effect>,
    ) -> bool {
        let Some(held_up) = self.pending.take_if(|pending| pending.id == id && pending.is_held_up)
        else {
            return false;
        };
        let mut operation = held_up.operation;
        if let Operation::Measure { points, .. } = &mut operation
            && let Some(first) = points.first_mut()
            && held_up.repeats == 0
        {
            first.settle_s += SETTLE_S;
        }
        self.issue(now, operation, effects);
        if let Some(pending) = &mut self.pending {
            pending.repeats = held_up.repeats + 1;
        }
        true
    }
}
