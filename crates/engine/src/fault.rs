//! Failures of devices, and faults of the rig.

use std::{fmt, time::Duration};

use rig_model::{AxisError, Deg, Mm, Position, Span};
use rig_protocol::StepId;

use crate::{ContactSenseFault, InterlockError};

/// The parts of the rig that can fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Device {
    /// The impedance analyzer.
    Analyzer,
    /// The vertical stage that carries the sensor.
    LinearStage,
    /// The stage that tilts the sample.
    RotaryStage,
    /// The journal: without it nothing may begin, and the probe may only go up.
    Journal,
    /// The interlock in front of the ports, which refused a command of the engine.
    Interlock,
}

impl Device {
    /// Name of the part in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Analyzer => "analyzer",
            Self::LinearStage => "linear stage",
            Self::RotaryStage => "rotary stage",
            Self::Journal => "journal",
            Self::Interlock => "interlock",
        }
    }
}

/// The failure of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailureKind {
    /// It was interrupted.
    Interrupted,
    /// The device refused a request.
    Refused,
    /// The device has been switched off and on.
    Restarted,
    /// rigd was held up in it.
    HeldUp,
    /// The axis was to move or to stop, and did not do so.
    Blocked,
    /// The drive has an alarm and does not move.
    Alarmed {
        /// The drive's code of the alarm.
        code: u16,
    },
    /// The drive says that its emergency stop is pressed.
    EmergencyStopped,
    /// The device did not answer, or its answer cannot be read.
    Line,
    /// The axis was told to home, and nothing showed that it did: it is where it was.
    Unmoved,
    /// An axis is elsewhere than where it came to rest. It was not sent from there.
    Moved,
    /// An axis reports a position where it cannot be. No move from there is safe, not even a retract.
    Lost,
    /// An axis does not know its position, and homing it may lead into the sample. No move is safe.
    Unhomed,
}

/// A failed operation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// The part of the rig.
    pub device: Device,
    /// Kind of the failure.
    pub kind: FailureKind,
    /// Message of the driver, with all its causes.
    pub detail: String,
}

/// The cause of a stop.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A device failed.
    #[error("{}: {}", .0.device.name(), .0.detail)]
    Device(Failure),
    /// A position that the linear stage may not go to.
    #[error(transparent)]
    LinearTarget(AxisError<Mm>),
    /// A position that the rotary stage may not go to.
    #[error(transparent)]
    RotaryTarget(AxisError<Deg>),
    /// A touch was planned with no reference measured before it.
    #[error("step {step} has no no-load resonance to compare with")]
    NoReferenceBefore {
        /// Address of the touch.
        step: StepId,
    },
    /// An unexpected report arrived.
    #[error("{what} was reported in {during}, where none was expected")]
    OutOfOrder {
        /// Kind of the unexpected report.
        what: &'static str,
        /// The activity during which it arrived.
        during: &'static str,
    },
    /// The interlock refused an operation of the engine.
    #[error(transparent)]
    Interlock(InterlockError),
    /// Contact where the search begins, or on the first way down to there.
    #[error(
        "contact at {at}, above where a surface may lie; it was expected at {expected}: \
         the impedance had changed by {change_percent:.1} %"
    )]
    ContactTooEarly {
        /// Position of the probe.
        at: Position<Mm>,
        /// Expected position of the surface.
        expected: Position<Mm>,
        /// Relative change of the impedance, in percent.
        change_percent: f64,
    },
    /// No contact down to the lowest position of the search.
    #[error("no contact down to {at}; the surface was expected at {expected}")]
    NoContact {
        /// The lowest position tried.
        at: Position<Mm>,
        /// Expected position of the surface.
        expected: Position<Mm>,
    },
    /// The no-load resonance could not be measured, so there is no reference.
    #[error("the no-load resonance was refused {}: {reason}", times(*.refused))]
    NoReference {
        /// Sweeps refused.
        refused: u32,
        /// The last refusal.
        reason: String,
    },
    /// The analyzer returned fewer readings than requested.
    #[error("the analyzer returned {given} of {asked} readings")]
    MissingReadings {
        /// Number of readings.
        given: usize,
        /// Number of requested readings.
        asked: usize,
    },
    /// An operation took far longer than it can.
    #[error("{what} did not end within its longest time")]
    Overdue {
        /// Operation that did not end.
        what: &'static str,
    },
    /// The probe was to be retracted and could not be shown to be clear.
    #[error("the probe was retracted but could not be shown to be clear")]
    NotProvenClear,
    /// The contact sense contradicts itself.
    #[error(transparent)]
    ContactSense(ContactSenseFault),
    /// The linear stage is not where its last moves can have led.
    #[error("linear stage: found at {found} after the fault, and {jump}")]
    PositionJumped {
        /// Position read back after the fault, mm.
        found: Position<Mm>,
        /// Where it can be.
        jump: Jump,
    },
    /// The last program ended without leaving the rig in order.
    #[error("{}", .0.message)]
    Interrupted(LeftRig),
    /// Signs, scales or geometry of the bench are not shown, so that no move is safe.
    #[error("the rig is not commissioned: {missing}")]
    NotCommissioned {
        /// The steps that are missing, and why.
        missing: String,
    },
    /// The host was held up again and again during one measurement.
    #[error("rigd was held up during {attempts} attempts of one measurement, the last time for {:.1} s", .lasted.as_secs_f64())]
    HeldUp {
        /// Number of attempts.
        attempts: u32,
        /// The last hold-up.
        lasted: Duration,
    },
    /// A part of this program failed.
    #[error("rigd itself failed: {what}")]
    Panicked {
        /// Message of the failure.
        what: String,
    },
    /// A person pressed Stop.
    #[error("stopped by {by}")]
    Stopped {
        /// Name of the operator.
        by: String,
    },
}

/// How the last program left the rig, from the journal.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftRig {
    /// The run, the time, the step and the position of the probe, or the fault.
    pub message: String,
    /// Whether the probe may be in the sample.
    pub may_touch: bool,
    /// Whether it was lowered or lost; otherwise the program ended on the way into service.
    pub was_lowered: bool,
    /// If the linear stage was read back elsewhere than its last moves can have led it, and the rig was not in service since.
    pub jump: Option<Jump>,
}

/// A linear stage that was read back elsewhere than its last moves can have led it: its position may be wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// Where they can have led it.
    pub last_moves: Span<Mm>,
    /// Whether a homing was begun since and has not ended, so that no position tells whether it is right.
    pub is_homing_open: bool,
}

impl fmt::Display for Jump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Span { min, max } = self.last_moves;
        write!(f, "its last moves were between {min} and {max}")?;
        if self.is_homing_open {
            write!(f, ", and a homing that was asked for since has not ended")?;
        }
        Ok(())
    }
}

impl Fault {
    /// The jump of the linear stage, if this is what it tells of.
    pub const fn jump(&self) -> Option<Jump> {
        match self {
            Self::PositionJumped { jump, .. } => Some(*jump),
            Self::Interrupted(left) => left.jump,
            _ => None,
        }
    }
}

/// The reason why a run or a sweep ends early.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum StopReason {
    /// A person aborts it: the rig is ready again afterwards.
    Abort {
        /// Name of the operator.
        by: String,
    },
    /// A fault: the rig latches afterwards.
    Fault(Fault),
}

/// How often something was, in words.
fn times(number: u32) -> String {
    match number {
        1 => "once".to_owned(),
        more => format!("{more} times"),
    }
}
