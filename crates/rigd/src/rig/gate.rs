//! The interlock between the shell and the drivers: it sees every operation before a driver does, and
//! its end.

use std::{cell::RefCell, rc::Rc, time::Duration};

use rig_engine::{Device, Failure, FailureKind, Operation, Report};
use rig_interlock::{Interlock, Outcome, PortCommand, Proven, Refusal, Word};
use rig_link::Clock;
use rig_model::{Mm, Position, RigLimits};

use super::slot::Ended;

/// The one interlock of the rig, before both ports.
#[derive(Debug, Clone)]
pub(super) struct Gate {
    interlock: Rc<RefCell<Interlock>>,
    clock: Clock,
}

impl Gate {
    /// `proven` is what calibrations show of the drives.
    pub(super) fn new(limits: &RigLimits, proven: Proven, clock: Clock) -> Self {
        Self { interlock: Rc::new(RefCell::new(Interlock::new(*limits, proven))), clock }
    }

    /// Calibrations on the disk show this of the drives.
    pub(super) fn prove(&self, proven: Proven) {
        self.interlock.borrow_mut().prove(proven);
    }

    /// Admits a step of commissioning. After this it must be brought to its [`end`](Self::step_ended).
    pub(super) fn admit_step(&self, step: &PortCommand) -> Result<(), Refusal> {
        self.interlock.borrow_mut().admit(self.clock.now(), step)
    }

    /// An admitted step has ended.
    pub(super) fn step_ended(&self, step: &PortCommand, outcome: &Outcome) {
        self.interlock.borrow_mut().ended(self.clock.now(), step, outcome);
    }

    /// Whether the linear stage must be read back before the operation.
    pub(super) fn needs_reading(&self, operation: &Operation) -> bool {
        self.interlock.borrow().needs_reading(self.clock.now(), &command(operation))
    }

    /// Whether the rotary stage must be read back before the operation.
    pub(super) fn needs_tilt(&self, operation: &Operation) -> bool {
        self.interlock.borrow().needs_tilt(self.clock.now(), &command(operation))
    }

    /// Nothing was done for this long.
    pub(super) fn held_up(&self, lasted: Duration) {
        self.interlock.borrow_mut().held_up(lasted);
    }

    /// Admits an operation. After this it must be brought to its [`end`](Self::ended).
    pub(super) fn admit(&self, operation: &Operation) -> Result<(), Failure> {
        let admitted = self.interlock.borrow_mut().admit(self.clock.now(), &command(operation));
        admitted.map_err(refused)
    }

    /// Admits the readings of a descent. After this they must be brought to their
    /// [`end`](Self::stream_ended).
    pub(super) fn admit_stream(&self) -> Result<(), Failure> {
        let admitted = self.interlock.borrow_mut().admit(self.clock.now(), &PortCommand::Stream);
        admitted.map_err(refused)
    }

    /// The readings of a descent have ended.
    pub(super) fn stream_ended(&self) {
        let (now, stream) = (self.clock.now(), PortCommand::Stream);
        self.interlock.borrow_mut().ended(now, &stream, &Outcome::Interrupted);
    }

    /// An admitted operation has ended. `is_interrupted` says that its result is not used.
    pub(super) fn ended(&self, operation: &Operation, ended: &Ended, is_interrupted: bool) {
        let outcome = match ended {
            Ok(Report::LinearAt(at) | Report::LinearHomed(at) | Report::Descended { at, .. }) => {
                Outcome::LinearAt(*at)
            }
            Ok(Report::RotaryAt(at)) => Outcome::RotaryAt(*at),
            Ok(
                Report::Measured(_)
                | Report::Stopped(_)
                | Report::RotaryStopped(_)
                | Report::Unhomed,
            ) => Outcome::Done,
            Err(failure) if failure.kind == FailureKind::Interrupted => Outcome::Interrupted,
            Err(_) if is_interrupted && matches!(operation, Operation::Measure { .. }) => {
                Outcome::Interrupted
            }
            Err(_) => Outcome::Failed,
        };
        self.interlock.borrow_mut().ended(self.clock.now(), &command(operation), &outcome);
    }

    /// A position was read back without an operation.
    pub(super) fn read(&self, outcome: Outcome) {
        self.interlock.borrow_mut().read(self.clock.now(), &outcome);
    }

    /// A record of the intent to go down is durable.
    pub(super) fn intent_is_durable(&self, down_to: Position<Mm>) {
        self.interlock.borrow_mut().intent_is_durable(down_to);
    }

    /// The rig has latched.
    pub(super) fn latched(&self) {
        self.interlock.borrow_mut().latched();
    }

    /// A person gives a command.
    pub(super) fn operator(&self, by: &str, word: Word) -> Result<(), Refusal> {
        self.interlock.borrow_mut().operator(self.clock.now(), by, word)
    }

    /// A stop was requested this long ago.
    pub(super) fn stop_asked(&self, waited: Duration) {
        self.interlock.borrow_mut().stop_asked(self.clock.now(), waited);
    }

    /// The frames of a stop have left.
    pub(super) fn stop_sent(&self) {
        if let Some(took) = self.interlock.borrow_mut().stop_sent(self.clock.now()) {
            tracing::error!(ms = took.as_millis(), "a stop took longer than 100 ms to the drives");
        }
    }
}

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
fn refused(refusal: Refusal) -> Failure {
    let (device, kind) = (Device::Interlock, FailureKind::Refused);
    Failure { device, kind, detail: refusal.to_string() }
}

/// An operation as the interlock sees it.
fn command(operation: &Operation) -> PortCommand {
    match *operation {
        Operation::HomeLinear { .. } => PortCommand::HomeLinear,
        Operation::PrepareRotary => PortCommand::HomeRotary,
        Operation::FindLinear { .. } | Operation::HomeUpwards => PortCommand::FindLinear,
        Operation::MoveLinear { target, speed_mm_per_s } => {
            PortCommand::MoveLinear { to: target.position(), speed_mm_per_s }
        }
        Operation::MoveRotary { target, speed_deg_per_s } => {
            PortCommand::MoveRotary { to: target.position(), speed_deg_per_s }
        }
        Operation::Descend { target, speed_mm_per_s, .. } => {
            PortCommand::Descend { to: target.position(), speed_mm_per_s }
        }
        Operation::Measure { .. } => PortCommand::Measure,
        Operation::StopMotion | Operation::StopRotary => PortCommand::Stop,
    }
}

#[cfg(test)]
#[path = "../../../model/tests/support/limits.rs"]
mod bench;

#[cfg(test)]
mod tests {
    use super::{bench::limits, *};

    #[tokio::test]
    async fn a_refused_operation_is_a_failure_of_the_interlock_with_its_reason() {
        let gate = Gate::new(&limits(), Proven::Bench, Clock::start());
        let turn = Operation::MoveRotary {
            target: limits().rotary.target(Position::new(30.0)).unwrap(),
            speed_deg_per_s: 10.0,
        };
        let failure = gate.admit(&turn).unwrap_err();
        assert_eq!((failure.device, failure.kind), (Device::Interlock, FailureKind::Refused));
        assert!(failure.detail.contains("rotary stage"), "{}", failure.detail);
        for (operation, report) in [
            (
                Operation::FindLinear { may_reset_alarm: true },
                Report::LinearAt(Position::new(bench::REST_MM)),
            ),
            (Operation::PrepareRotary, Report::RotaryAt(Position::new(0.0))),
        ] {
            gate.admit(&operation).unwrap();
            gate.ended(&operation, &Ok(report), false);
        }
        gate.admit(&turn).unwrap();
        gate.ended(&turn, &Ok(Report::RotaryAt(Position::new(30.0))), false);
    }
}
