//! A latched rig whose linear drive did not answer in time keeps trying to retract, while a person is told.
//!
//! ```text
//!              patience over            30 s                 found            clear
//!  recovery ──────────────▶ Latched ──────────▶ find drive ────────▶ retract ──────▶ Latched, clear
//!                              ▲                     │ no answer        │ not clear
//!                              └─────────────────────┴──────────────────┘
//! ```
//!
//! An attempt finds the drive and retracts; it lowers and turns nothing. A rotary stage that has not answered its stop gets
//! it again in each attempt. A stop or an acknowledgement ends the attempts.

use std::time::Duration;

use rig_model::{Clearance, RigTime};

use super::{Activity, Engine};
use crate::{
    Effect, Event, Fault, Report,
    recovery::{Preparing, Recovery, RecoveryReport, RecoveryStep},
};

/// Pause between two attempts: a person who mends the bus sees the probe go up soon, and a line that is
/// dead is not flooded.
const PAUSE: Duration = Duration::from_secs(30);

/// Number of attempts before the rig only waits: those of a day.
const ATTEMPTS_MAX: u32 = 2880;

/// The attempts of a latched rig.
#[derive(Debug)]
pub(super) struct Attempts {
    recovery: Recovery,
    /// The number of the attempt under way, or of the last one.
    number: u32,
    /// A person has acknowledged the fault while an operation was in flight: the rig is prepared so
    /// when it ends.
    then: Option<Preparing>,
}

impl Engine {
    /// Number of attempts so far, if the rig goes on trying.
    pub(super) fn attempts(&self) -> Option<u32> {
        self.attempts.as_ref().map(|attempts| attempts.number)
    }

    /// The recovery has given up because the linear drive did not answer in time.
    pub(super) fn go_on_trying(&mut self, now: RigTime, recovery: Recovery) {
        self.attempts = Some(Attempts { recovery, number: 0, then: None });
        self.wait_until = Some(now + PAUSE);
    }

    /// The pause between two attempts is over.
    pub(super) fn try_again(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        let Some(attempts) = &mut self.attempts else { return };
        attempts.number += 1;
        let step = attempts.recovery.again(now);
        self.follow_attempt(now, step, None, effects);
    }

    /// An operation in flight has ended on a latched rig.
    pub(super) fn attempt_ended(
        &mut self,
        now: RigTime,
        result: Result<Report, Fault>,
        effects: &mut Vec<Effect>,
    ) {
        let Some(attempts) = &mut self.attempts else { return };
        if let Some(first) = attempts.then {
            return self.prepare(now, first, effects);
        }
        let is_finding = attempts.recovery.is_finding();
        let result = result.and_then(|report| self.take_found(report, is_finding));
        let report = RecoveryReport::of_result(&result);
        let (clearance, up) = (self.interlock.clearance(), self.up());
        if let Some(attempts) = &mut self.attempts {
            let step = attempts.recovery.ended(now, report, (clearance, self.may_turn), up);
            self.follow_attempt(now, step, result.err(), effects);
        }
    }

    fn follow_attempt(
        &mut self,
        now: RigTime,
        step: RecoveryStep,
        fault: Option<Fault>,
        effects: &mut Vec<Effect>,
    ) {
        match step {
            RecoveryStep::Do(operation) => return self.issue(now, operation, effects),
            RecoveryStep::Retract(to) => return self.retract(now, to, effects),
            RecoveryStep::Wait(_) | RecoveryStep::Finished(_) => {}
        }
        let Some(attempts) = &self.attempts else { return };
        let (attempt, clearance) = (attempts.number, self.interlock.clearance());
        self.notes.push(Event::RetractTried { attempt, fault, clearance });
        if (clearance != Clearance::Clear || self.may_turn)
            && attempts.recovery.is_worth_trying()
            && attempt < ATTEMPTS_MAX
        {
            self.wait_until = Some(now + PAUSE);
        } else {
            self.attempts = None;
        }
    }

    /// A person stops the attempts, also the one under way.
    pub(super) fn stop_trying(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        if self.attempts.take().is_some() {
            self.wait_until = None;
            self.interrupt(now, effects);
        }
    }

    /// A person acknowledges the fault. Returns whether an operation in flight must end first.
    pub(super) fn end_attempts(
        &mut self,
        now: RigTime,
        first: Preparing,
        effects: &mut Vec<Effect>,
    ) -> bool {
        self.wait_until = None;
        let is_busy = self.pending.is_some() && matches!(self.activity, Activity::Latched(_));
        if let Some(attempts) = self.attempts.as_mut().filter(|_| is_busy) {
            attempts.then = Some(first);
            self.interrupt(now, effects);
            return true;
        }
        self.attempts = None;
        false
    }
}
