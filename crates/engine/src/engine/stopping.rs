//! The reaction to any fault: end the operation in progress, stop, retract, then latch or be ready.

use rig_model::{Clearance, Mm, Position, RigTime, Target};

use super::{Activity, Engine, HadRun, reach::Reach};
use crate::{
    Effect, Event, Fault, Operation, Report, RunStatus,
    fault::StopReason,
    operation::{Pending, limit, retract},
    recovery::{Recovery, RecoveryReport, RecoveryStep},
};

impl Engine {
    /// Stops both axes, finds the linear stage and retracts, because of this fault; then the rig is
    /// latched. Nothing is lowered or turned. For a rig that this engine has not prepared: does
    /// nothing later.
    pub fn leave_contact(&mut self, now: RigTime, fault: Fault, effects: &mut Vec<Effect>) {
        if !matches!(self.activity, Activity::Unprepared) {
            return;
        }
        let clearance = self.interlock.clearance();
        self.reach = Reach::left(fault.jump());
        self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
        self.last_fault = Some(fault.clone());
        // Nobody has asked the drives yet who they are and where, and whether they move.
        self.may_turn = true;
        let (recovery, step) = Recovery::begin(now, self.patience, RecoveryReport::Lost);
        self.activity = Activity::Retracting(recovery, StopReason::Fault(fault), false);
        self.follow_recovery(now, step, effects);
        self.settle(effects);
    }

    /// Ends the present activity, now or when the operation in progress has ended.
    pub(super) fn stop(&mut self, now: RigTime, reason: StopReason, effects: &mut Vec<Effect>) {
        if let StopReason::Fault(fault) = &reason {
            let clearance = self.interlock.clearance();
            self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
            self.last_fault = Some(fault.clone());
        }
        match &mut self.activity {
            // The first cause stays; a fault replaces an abort.
            Activity::Stopping(first, _) | Activity::Retracting(_, first, _) => {
                if matches!(first, StopReason::Abort { .. }) {
                    *first = reason;
                }
                return;
            }
            Activity::Latched(_) => return self.stop_trying(now, effects),
            _ => {}
        }
        (self.wait_until, self.reading_by) = (None, None);
        let had_run = matches!(
            self.activity,
            Activity::Running(_)
                | Activity::Waiting(..)
                | Activity::Deciding(_)
                | Activity::Paused(_)
        );
        self.activity = Activity::Stopping(reason, had_run);
        if self.pending.is_none() {
            return self.recover(now, effects);
        }
        self.interrupt(now, effects);
        // The axes have an owner of their own: the way out does not wait for the analyzer.
        let is_measuring =
            |pending: &mut Pending| matches!(pending.operation, Operation::Measure { .. });
        if self.pending.take_if(is_measuring).is_some() {
            self.recover(now, effects);
        }
    }

    /// Has the operation in flight end early, and gives it the time of a stop for that.
    pub(super) fn interrupt(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        let allowed = limit(&Operation::StopMotion, self.linear_mm(), self.rotary_deg());
        let Some(pending) = &mut self.pending else { return };
        pending.is_interrupted = true;
        pending.deadline = now + allowed;
        self.flush(effects);
        effects.push(Effect::Interrupt);
    }

    /// Latches at once, with the operation in flight still unanswered.
    pub(super) fn freeze(&mut self, fault: Fault) {
        self.escalate(fault.clone());
        self.attempts = None;
        let activity = std::mem::replace(&mut self.activity, Activity::Idle);
        match activity {
            Activity::Stopping(StopReason::Fault(first), had_run)
            | Activity::Retracting(_, StopReason::Fault(first), had_run) => {
                self.finish_faulted(first, had_run);
            }
            Activity::Latched(first) => self.activity = Activity::Latched(first),
            _ => self.finish_faulted(fault, false),
        }
    }

    /// A fault on the way out: it is recorded once, and replaces an abort as the cause.
    pub(super) fn escalate(&mut self, fault: Fault) {
        let clearance = self.interlock.clearance();
        if self.last_fault.as_ref() != Some(&fault) {
            self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
            self.last_fault = Some(fault.clone());
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
        let cause = match &reason {
            StopReason::Fault(fault) => RecoveryReport::of(fault),
            StopReason::Abort { .. } => RecoveryReport::Done,
        };
        let (recovery, step) = Recovery::begin(now, self.patience, cause);
        self.activity = Activity::Retracting(recovery, reason, had_run);
        self.follow_recovery(now, step, effects);
    }

    /// An operation of the recovery has ended.
    pub(super) fn retracting(
        &mut self,
        now: RigTime,
        result: Result<Report, Fault>,
        effects: &mut Vec<Effect>,
    ) {
        let Activity::Retracting(recovery, ..) = &mut self.activity else { return };
        let is_finding = recovery.is_finding();
        let result = result.and_then(|report| self.take_found(report, is_finding));
        let report = RecoveryReport::of_result(&result);
        if let Err(fault) = result {
            self.escalate(fault);
        }
        let (clearance, up) = (self.interlock.clearance(), self.up());
        if let Activity::Retracting(recovery, ..) = &mut self.activity {
            let step = recovery.ended(now, report, (clearance, self.may_turn), up);
            self.follow_recovery(now, step, effects);
        }
    }

    /// Takes in where the linear stage has stopped, or was found again.
    pub(super) fn take_found(&mut self, report: Report, is_finding: bool) -> Result<Report, Fault> {
        let at = match report {
            Report::Stopped(at) => at,
            Report::LinearAt(at) if is_finding => Some(at),
            _ => None,
        };
        if let Some(at) = at {
            self.reach.find(at, &self.limits.linear)?;
            self.linear = Some(at);
        }
        Ok(report)
    }

    fn is_high(&self, at: Position<Mm>) -> bool {
        let linear = &self.limits.linear;
        linear.rest_target().position().offset(linear.tolerance()) < at
    }

    /// The target of a way out: the clear position, or the place above it where the probe was read back.
    pub(super) fn up(&self) -> Target<Mm> {
        let linear = &self.limits.linear;
        let highest = linear.soft().max;
        let above = self.linear.filter(|at| self.is_high(*at));
        let above = above.map(|at| if highest < at { highest } else { at });
        above.and_then(|at| linear.target(at).ok()).unwrap_or(linear.rest_target())
    }

    /// A pause of the recovery is over.
    pub(super) fn wait_is_over(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        if let Activity::Retracting(recovery, ..) = &mut self.activity {
            let step = recovery.waited();
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
            RecoveryStep::Retract(to) => return self.retract(now, to, effects),
            RecoveryStep::Wait(pause) => {
                self.wait_until = Some(now + pause);
                return;
            }
            RecoveryStep::Finished(clearance) => clearance,
        };
        let activity = std::mem::replace(&mut self.activity, Activity::Idle);
        let Activity::Retracting(recovery, reason, had_run) = activity else { return };
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
        if recovery.is_worth_trying() {
            self.go_on_trying(now, recovery);
        }
    }

    /// Takes the probe up, or reads back that it is.
    pub(super) fn retract(&mut self, now: RigTime, to: Target<Mm>, effects: &mut Vec<Effect>) {
        self.issue(now, retract(&self.limits, to), effects);
    }

    pub(super) fn finish_faulted(&mut self, fault: Fault, had_run: HadRun) {
        if had_run {
            self.notes.push(Event::RunFinished(RunStatus::Faulted));
        }
        self.activity = Activity::Latched(fault);
    }
}
