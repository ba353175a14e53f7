//! The way out of whatever goes wrong: end the operation in flight, stop, retract, latch or be ready.

use rig_model::{Clearance, RigTime};

use super::{Activity, Engine, HadRun};
use crate::{
    Effect, Event, Fault, Operation, RunStatus,
    fault::StopReason,
    operation::limit,
    recovery::{Recovery, RecoveryStep},
};

impl Engine {
    /// Ends whatever is going on, now or as soon as the operation in flight has ended.
    pub(super) fn stop(&mut self, now: RigTime, reason: StopReason, effects: &mut Vec<Effect>) {
        if let StopReason::Fault(fault) = &reason {
            let clearance = self.interlock.clearance();
            self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
        }
        match &mut self.activity {
            // The first cause stays; a graver one takes the place of an abort.
            Activity::Stopping(first, _) | Activity::Retracting(_, first, _) => {
                if matches!(first, StopReason::Abort { .. }) {
                    *first = reason;
                }
                return;
            }
            Activity::Latched(_) => return,
            _ => {}
        }
        self.wait_until = None;
        let had_run = matches!(
            self.activity,
            Activity::Running(_) | Activity::Waiting(..) | Activity::Paused(_)
        );
        self.activity = Activity::Stopping(reason, had_run);
        match &mut self.pending {
            Some(pending) => {
                pending.is_interrupted = true;
                let allowed = limit(&Operation::StopMotion, self.linear_mm(), self.rotary_deg());
                if let Some(pending) = &mut self.pending {
                    pending.deadline = now + allowed;
                }
                self.flush(effects);
                effects.push(Effect::Interrupt);
            }
            None => self.recover(now, effects),
        }
    }

    /// Latches at once, with the operation in flight still unanswered.
    pub(super) fn freeze(&mut self, fault: Fault) {
        self.escalate(fault.clone());
        let activity = std::mem::replace(&mut self.activity, Activity::Idle);
        match activity {
            Activity::Stopping(StopReason::Fault(first), had_run)
            | Activity::Retracting(_, StopReason::Fault(first), had_run) => {
                self.finish_faulted(first, had_run);
            }
            _ => self.finish_faulted(fault, false),
        }
    }

    pub(super) fn escalate(&mut self, fault: Fault) {
        let clearance = self.interlock.clearance();
        self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
        if let Activity::Retracting(recovery, ..) = &mut self.activity
            && fault.is_linear_lost()
        {
            recovery.give_up();
        }
        if let Activity::Stopping(reason, _) | Activity::Retracting(_, reason, _) =
            &mut self.activity
            && matches!(reason, StopReason::Abort { .. })
        {
            *reason = StopReason::Fault(fault);
        }
    }

    pub(super) fn recover(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        let activity = std::mem::replace(&mut self.activity, Activity::Idle);
        let Activity::Stopping(reason, had_run) = activity else {
            self.activity = activity;
            return;
        };
        let is_linear_lost = matches!(&reason, StopReason::Fault(fault) if fault.is_linear_lost());
        let (recovery, step) = Recovery::begin(is_linear_lost);
        self.activity = Activity::Retracting(recovery, reason, had_run);
        self.follow_recovery(now, step, effects);
    }

    pub(super) fn retracting(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        let clearance = self.interlock.clearance();
        if let Activity::Retracting(recovery, ..) = &mut self.activity {
            let step = recovery.ended(clearance, &self.limits);
            self.follow_recovery(now, step, effects);
        }
    }

    pub(super) fn follow_recovery(
        &mut self,
        now: RigTime,
        step: RecoveryStep,
        effects: &mut Vec<Effect>,
    ) {
        let clearance = match step {
            RecoveryStep::Do(operation) => return self.issue(now, operation, effects),
            RecoveryStep::Finished(clearance) => clearance,
        };
        let activity = std::mem::replace(&mut self.activity, Activity::Idle);
        let Activity::Retracting(_, reason, had_run) = activity else { return };
        match reason {
            StopReason::Abort { .. } if clearance == Clearance::Clear => {
                if had_run {
                    self.notes.push(Event::RunFinished(RunStatus::Aborted));
                }
            }
            // An abort whose retract cannot be proven is no longer in order.
            StopReason::Abort { .. } => {
                let fault = Fault::NotProvenClear;
                self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
                self.finish_faulted(fault, had_run);
            }
            StopReason::Fault(fault) => self.finish_faulted(fault, had_run),
        }
    }

    pub(super) fn finish_faulted(&mut self, fault: Fault, had_run: HadRun) {
        if had_run {
            self.notes.push(Event::RunFinished(RunStatus::Faulted));
        }
        self.activity = Activity::Latched(fault);
    }
}
