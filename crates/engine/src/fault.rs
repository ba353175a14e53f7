//! What can go wrong.

use rig_model::{AxisError, Deg, Mm, Position};
use rig_protocol::StepId;

use crate::InterlockError;

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
}

impl Device {
    /// The words that people read.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Analyzer => "analyzer",
            Self::LinearStage => "linear stage",
            Self::RotaryStage => "rotary stage",
            Self::Journal => "journal",
        }
    }
}

/// How an operation failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailureKind {
    /// It ended early because it was asked to.
    Interrupted,
    /// The device answered and said no, or is not where it was sent.
    Refused,
    /// The device did not answer, or not intelligibly.
    Line,
    /// An axis does not know where it is, or says that it is where it cannot be. No move from there
    /// is safe, not even a retract.
    Lost,
}

/// An operation that did not do what was asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// Which part of the rig.
    pub device: Device,
    /// How.
    pub kind: FailureKind,
    /// What the driver says, with all its causes.
    pub detail: String,
}

/// Why the rig had to stop.
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
    #[error("step {step} has no no-load resonance to be compared with")]
    NoReferenceBefore {
        /// The touch.
        step: StepId,
    },
    /// Something was reported that cannot have happened.
    #[error("{what} was reported in {during}, where none was asked for")]
    OutOfOrder {
        /// What was reported.
        what: &'static str,
        /// What was going on.
        during: &'static str,
    },
    /// The engine was about to do what the interlock forbids.
    #[error(transparent)]
    Interlock(InterlockError),
    /// The probe felt something where only air should be.
    #[error(
        "contact at {at}, where the search begins; the surface was expected at {expected}: \
         the impedance had changed by {change_percent:.1} %"
    )]
    ContactTooEarly {
        /// Where the probe was.
        at: Position<Mm>,
        /// Where the surface was expected.
        expected: Position<Mm>,
        /// Relative change of the impedance, in percent.
        change_percent: f64,
    },
    /// The probe went as deep as it may and felt nothing.
    #[error("no contact down to {at}; the surface was expected at {expected}")]
    NoContact {
        /// The lowest position tried.
        at: Position<Mm>,
        /// Where the surface was expected.
        expected: Position<Mm>,
    },
    /// The no-load resonance could not be measured, so nothing after it would mean anything.
    #[error("the no-load resonance was refused {attempts} times: {reason}")]
    NoReference {
        /// How often it was tried.
        attempts: u32,
        /// The last refusal.
        reason: String,
    },
    /// The analyzer gave fewer readings than asked for.
    #[error("the analyzer gave {given} of {asked} readings")]
    MissingReadings {
        /// How many came.
        given: usize,
        /// How many were asked for.
        asked: usize,
    },
    /// An operation took far longer than it can.
    #[error("{what} did not end in the time it can take")]
    Overdue {
        /// What was being done.
        what: &'static str,
    },
    /// The probe was to be retracted and could not be shown to be clear.
    #[error("the probe was retracted but could not be shown to be clear")]
    NotProvenClear,
    /// A person pressed Stop.
    #[error("stopped by {by}")]
    Stopped {
        /// Who.
        by: String,
    },
}

impl Fault {
    /// Whether it is not known any more where the linear stage is, so that it must not be moved.
    pub(crate) fn is_linear_lost(&self) -> bool {
        let Self::Device(failure) = self else { return false };
        (failure.device, failure.kind) == (Device::LinearStage, FailureKind::Lost)
    }
}

/// Why a run or a sweep is ended early.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum StopReason {
    /// A person wants it ended in order: the rig is ready again afterwards.
    Abort {
        /// Who.
        by: String,
    },
    /// Something is wrong: the rig latches afterwards.
    Fault(Fault),
}
