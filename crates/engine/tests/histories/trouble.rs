//! What can go wrong on the bench while a run is played.

use std::time::Duration;

use rig_engine::{Device, Failure, FailureKind, Input, Operation, OperationId, Report, RigState};

use super::{NONSENSE, World};
use crate::drive::{Drive, DriveTrouble};

/// The disturbances of one operation.
pub(crate) const OF_ONE_OPERATION: [Trouble; 9] = [
    Trouble::Fails,
    Trouble::Loses,
    Trouble::Stalls,
    Trouble::Hangs,
    Trouble::Abort,
    Trouble::Stop,
    Trouble::Flags,
    Trouble::FlagsOnce,
    Trouble::Pause,
];

/// The disturbance of an operation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Trouble {
    /// It fails as if the line had gone dead.
    Fails,
    /// It fails because the linear stage says that it is where it cannot be.
    Loses,
    /// It reports success, but the axis has not moved.
    Stalls,
    /// It never reports.
    Hangs,
    /// A person aborts while it is under way.
    Abort,
    /// A person stops everything while it is under way.
    Stop,
    /// The analyzer gives up on the first point: its readings are flagged.
    Flags,
    /// The analyzer flags its first reading of the first point and repeats it.
    FlagsOnce,
    /// A person pauses the run during it, and resumes when the run is paused.
    Pause,
    /// The host is held up during it, and its readings are nonsense; so are those of this number of
    /// repetitions.
    HoldUp(u32),
    /// The linear drive is in trouble from here on.
    Drive(DriveTrouble),
    /// The analyzer repeats its last reading from here on.
    Freezes,
    /// The linear stage loses steps: from here on the probe is higher than it says by this, mm.
    Slips(f64),
    /// The analyzer keeps its last frequency from here on.
    StaysAtFrequency,
}

impl World {
    /// An operation that does not end: twice overdue, asked to end, and still silent.
    pub(super) fn hang(&mut self, operation: &Operation) {
        self.hang_stream(operation);
        for _ in 0..2 {
            self.now = self.engine.deadline().expect("every operation has a deadline");
            self.handle(Input::Tick);
            assert!(self.was_interrupted);
            if matches!(operation, Operation::Measure { .. }) {
                // The way out does not wait for it.
                assert!(matches!(self.in_flight, Some((_, Operation::StopMotion))));
                return;
            }
        }
        assert_eq!(self.engine.snapshot().state, RigState::Latched);
    }

    /// A trouble that lasts from here on.
    pub(super) fn let_last(&mut self, trouble: Option<Trouble>) {
        match trouble {
            Some(Trouble::Freezes) => self.frozen = self.last_read,
            Some(Trouble::Slips(slip_mm)) => self.slip_mm = slip_mm,
            Some(Trouble::StaysAtFrequency) => self.measured_hz.1 = true,
            Some(Trouble::Drive(trouble)) => self.drive = Some(Drive::new(trouble, self.now)),
            _ => {}
        }
    }

    /// The host is held up, and a measurement that is under way is nonsense.
    pub(super) fn hold_up(&mut self, id: OperationId, operation: &Operation, repeats: u32) {
        // Longer than any operation may take. The time is looked at before its report.
        let lasted = Duration::from_secs(3600);
        self.now = self.now + lasted;
        self.handle(Input::Stalled(lasted));
        self.handle(Input::Tick);
        let mut report = self.perform(operation);
        if let Report::Measured(readings) = &mut report {
            for reading in readings {
                reading.measured = NONSENSE;
            }
            if repeats > 0 {
                self.trouble = Some((self.operations, Trouble::HoldUp(repeats - 1)));
            }
        }
        self.handle(Input::Done(id, Ok(report)));
    }

    pub(crate) fn fail(&mut self, id: OperationId, kind: FailureKind) {
        let detail = "as it was told to".to_owned();
        let failure = Failure { device: Device::LinearStage, kind, detail };
        self.handle(Input::Done(id, Err(failure)));
    }
}
