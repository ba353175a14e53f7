//! A command of a person or a program.

use rig_model::{AxisError, Clearance, Deg, Mm, Position, SweepRequest};
use rig_protocol::{Plan, StepId};

use crate::{RefusalAnswer, RigState};

/// A command of a person or a program.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Find the linear stage, prove the probe clear, and home the rotary stage if it is not homed.
    Prepare,
    /// A person states that nothing is below the probe, down to the end of its travel: a linear stage
    /// that is not homed is homed in any direction, and the rig is prepared. It acknowledges a fault.
    HomeLinear,
    /// Replay a plan.
    Run(Box<Plan>),
    /// Replay the rest of a plan whose run had not been completed.
    Continue {
        /// Plan of the run, checked against the rig.
        plan: Box<Plan>,
        /// Number of steps that are done.
        from: usize,
        /// Whether a touch among them was refused.
        has_refusals: bool,
    },
    /// Measure the resonance at the present pose.
    Sweep(SweepRequest),
    /// Move the probe up or down, no deeper than any touch may go.
    MoveLinear(Position<Mm>),
    /// Tilt the sample.
    MoveRotary(Position<Deg>),
    /// Leave out a touch of the run under way that has not begun.
    Skip(StepId),
    /// Pause before the next step, with the probe clear.
    Pause,
    /// Continue a paused run.
    Resume,
    /// End the run or sweep, and retract.
    Abort,
    /// Answer the open prompt: the person has done the work.
    Answer,
    /// Say what to do after a refused touch.
    Decide {
        /// The touch.
        step: StepId,
        /// What to do.
        answer: RefusalAnswer,
    },
    /// Stop everything, retract and latch.
    Stop,
    /// The cause of the fault is understood; prepare the rig again.
    Acknowledge,
}

impl Command {
    /// The command in messages.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Prepare => "prepare",
            Self::HomeLinear => "home with nothing below the probe",
            Self::Run(_) => "run",
            Self::Continue { .. } => "continue",
            Self::Sweep(_) => "sweep",
            Self::MoveLinear(_) => "move the linear stage",
            Self::MoveRotary(_) => "move the rotary stage",
            Self::Skip(_) => "skip",
            Self::Pause => "pause",
            Self::Resume => "resume",
            Self::Abort => "abort",
            Self::Answer | Self::Decide { .. } => "answer",
            Self::Stop => "stop",
            Self::Acknowledge => "acknowledge",
        }
    }
}

/// Where a touch of the run under way is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TouchPlace {
    /// It has not begun.
    Ahead,
    /// It has begun, or is over.
    Begun,
    /// A person has left it out.
    LeftOut,
}

impl TouchPlace {
    const fn name(self) -> &'static str {
        match self {
            Self::Ahead => "is ahead",
            Self::Begun => "has begun",
            Self::LeftOut => "is left out already",
        }
    }
}

impl CommandRefusal {
    /// This refusal in the words by which a person calls the command.
    #[must_use]
    pub fn for_command(self, command: &'static str) -> Self {
        match self {
            Self::State { state, .. } => Self::State { command, state },
            Self::NotClear { clearance, .. } => Self::NotClear { command, clearance },
            other => other,
        }
    }
}

/// The reason why a command was refused. Nothing has changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CommandRefusal {
    /// The state forbids the command.
    #[error("cannot {command} while the rig is {}", .state.name())]
    State {
        /// Name of the command.
        command: &'static str,
        /// State of the rig.
        state: RigState,
    },
    /// The command needs a clear probe, and the probe is not clear.
    #[error("cannot {command} while the probe is {}", .clearance.text())]
    NotClear {
        /// Name of the command.
        command: &'static str,
        /// Clearance of the probe.
        clearance: Clearance,
    },
    /// The run under way has no such touch.
    #[error("the run under way has no touch {step}")]
    NoSuchTouch {
        /// The touch.
        step: StepId,
    },
    /// The touch is not ahead in the run under way.
    #[error("touch {step} {}", place.name())]
    NotAhead {
        /// The touch.
        step: StepId,
        /// Where it is instead.
        place: TouchPlace,
    },
    /// The target is outside the limits of the linear stage.
    #[error(transparent)]
    LinearTarget(AxisError<Mm>),
    /// The target is outside the limits of the rotary stage.
    #[error(transparent)]
    RotaryTarget(AxisError<Deg>),
    /// The target is deeper than any touch may go.
    #[error("linear stage: target {wanted} is below {floor}, the deepest that a touch may go here")]
    TooDeep {
        /// The requested position.
        wanted: Position<Mm>,
        /// The lowest position allowed at this tilt.
        floor: Position<Mm>,
    },
    /// How deep a touch may go depends on the tilt, and the last turn ended without a read-back.
    #[error(
        "linear stage: target {wanted} is below {rest}, and the tilt is not known: the last turn was not \
         completed"
    )]
    TiltUnknown {
        /// The requested position.
        wanted: Position<Mm>,
        /// The clear position, below which the tilt counts.
        rest: Position<Mm>,
    },
    /// The target is further below the highest surface than one move may lead.
    #[error(
        "linear stage: target {wanted} is below {lowest}, the lowest target of one move from here"
    )]
    TooFar {
        /// The requested position.
        wanted: Position<Mm>,
        /// The lowest target of one move from here.
        lowest: Position<Mm>,
    },
}
