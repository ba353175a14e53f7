//! The stream of readings of a descent: each one is decided about when it comes, and one that does not come ends
//! the descent.

use rig_model::{Reading, RigTime};

use super::{Activity, Engine};
use crate::{
    Effect, Operation, OperationId,
    descent::{Streamed, Vigil},
};

impl Engine {
    /// A descent begins with this operation.
    pub(super) fn expect_readings(&mut self, now: RigTime, operation: &Operation) {
        self.reading_by = match (&self.activity, operation) {
            (Activity::Running(run), Operation::Descend { .. }) => run.first_reading_by(now),
            _ => None,
        };
    }

    /// A reading has come. One of another descent, or after its end was asked for, says nothing.
    pub(super) fn streamed(
        &mut self,
        now: RigTime,
        id: OperationId,
        reading: Reading,
        effects: &mut Vec<Effect>,
    ) {
        let is_of_descent = self.pending.as_ref().is_some_and(|pending| pending.id == id);
        if is_of_descent && self.reading_by.is_some() {
            self.go_on(now, Streamed::Reading(reading), effects);
        }
    }

    /// The next reading is due.
    pub(super) fn miss_reading(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        if self.reading_by.is_some_and(|by| by <= now) {
            self.go_on(now, Streamed::Nothing, effects);
        }
    }

    /// The times of the readings of a descent are wrong.
    pub(super) fn spoil_stream(&mut self, effects: &mut Vec<Effect>) {
        if let Some(by) = self.reading_by {
            self.go_on(by, Streamed::HeldUp, effects);
        }
    }

    fn go_on(&mut self, now: RigTime, streamed: Streamed, effects: &mut Vec<Effect>) {
        self.reading_by = None;
        let Activity::Running(run) = &mut self.activity else { return };
        match run.streamed(now, streamed) {
            Vigil::Until(by) => self.reading_by = Some(by),
            Vigil::Halt => effects.push(Effect::EndDescent),
        }
    }
}
