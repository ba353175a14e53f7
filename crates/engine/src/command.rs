//! What a person or a program can ask for.

use rig_model::{AxisError, Clearance, Deg, Mm, Position, SweepRequest};
use rig_protocol::Plan;

use crate::RigState;

/// What a person or a program can ask for.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Home what is not homed, and prove the probe clear.
    Prepare,
    /// Replay a plan.
    Run(Box<Plan>),
    /// Measure the resonance at the present pose.
    Sweep(SweepRequest),
    /// Move the probe up or down, no deeper than any touch may go.
    MoveLinear(Position<Mm>),
    /// Tilt the sample.
    MoveRotary(Position<Deg>),
    /// Wait at the next step that begins with the probe clear.
    Pause,
    /// Go on.
    Resume,
    /// End the run in order.
    Abort,
    /// What was asked of a person has been done.
    Answer,
    /// Stop everything, retract and latch.
    Stop,
    /// The cause of the fault is understood; prepare the rig again.
    Acknowledge,
}

impl Command {
    /// The command as one word.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Prepare => "prepare",
            Self::Run(_) => "run",
            Self::Sweep(_) => "sweep",
            Self::MoveLinear(_) => "move the linear stage",
            Self::MoveRotary(_) => "move the rotary stage",
            Self::Pause => "pause",
            Self::Resume => "resume",
            Self::Abort => "abort",
            Self::Answer => "answer",
            Self::Stop => "stop",
            Self::Acknowledge => "acknowledge",
        }
    }
}

/// Why a command was not taken. Nothing has changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CommandRefusal {
    /// The state forbids it.
    #[error("cannot {command} while the rig is {}", .state.name())]
    State {
        /// The command.
        command: &'static str,
        /// The state.
        state: RigState,
    },
    /// It begins with the probe clear, and the probe is not.
    #[error("cannot {command} while the probe is {}", .clearance.name())]
    NotClear {
        /// The command.
        command: &'static str,
        /// What is known of the probe.
        clearance: Clearance,
    },
    /// The linear stage may not go there.
    #[error(transparent)]
    LinearTarget(AxisError<Mm>),
    /// The rotary stage may not go there.
    #[error(transparent)]
    RotaryTarget(AxisError<Deg>),
    /// No touch goes as deep.
    #[error("linear stage: target {wanted} is below {floor}, the deepest that a touch may go here")]
    TooDeep {
        /// The position asked for.
        wanted: Position<Mm>,
        /// The lowest position allowed at this tilt.
        floor: Position<Mm>,
    },
}
