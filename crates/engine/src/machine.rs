//! The interface between the engine and the state machines of a run: events in, steps out.

use std::time::Duration;

use rig_model::{Deg, Mm, Position, Reading, RigLimits, RigTime, Target};
use rig_protocol::{Plan, Pose, Prompt};
use rig_resonance::{Bench, Onset, Resonance};

use crate::{
    Event, Fault, LoweringPurpose, Operation, RefusalAnswer, Report,
    drift::Drift,
    interlock::Proven,
    listening::{Driven, Listening},
    search::Surface,
};

/// The next step of a machine.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum MachineStep<T> {
    /// Carry out this operation.
    Do(Operation),
    /// Retract to here, at the clear position or below it, and prove the probe clear.
    Retract(Target<Mm>),
    /// Note the intent to lower the probe, make it durable, and allow it.
    Declare { down_to: Position<Mm>, purpose: LoweringPurpose },
    /// Wait for this time.
    Wait(Duration),
    /// Ask a person and wait for the answer.
    Ask(Prompt),
    /// Ask a person what to do after a refused touch.
    Decide,
    /// Retract and end the run.
    Abort { by: String },
    /// Wait for a person to continue.
    Pause,
    /// The machine is finished.
    Done(T),
    /// The machine cannot continue.
    Fault(Fault),
}

impl<T> MachineStep<T> {
    /// Hands the step to the machine that started this one; `done` converts the final result.
    pub(crate) fn and_then<U>(self, done: impl FnOnce(T) -> MachineStep<U>) -> MachineStep<U> {
        match self {
            Self::Do(operation) => MachineStep::Do(operation),
            Self::Retract(target) => MachineStep::Retract(target),
            Self::Declare { down_to, purpose } => MachineStep::Declare { down_to, purpose },
            Self::Wait(duration) => MachineStep::Wait(duration),
            Self::Ask(prompt) => MachineStep::Ask(prompt),
            Self::Decide => MachineStep::Decide,
            Self::Abort { by } => MachineStep::Abort { by },
            Self::Pause => MachineStep::Pause,
            Self::Fault(fault) => MachineStep::Fault(fault),
            Self::Done(value) => done(value),
        }
    }
}

/// An event that wakes a machine.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum MachineEvent {
    Begin,
    LinearAt(Position<Mm>),
    RotaryAt(Position<Deg>),
    Readings(Vec<Reading>),
    Descended { at: Position<Mm>, way: Vec<(RigTime, Position<Mm>)> },
    Stopped,
    Declared,
    Waited,
    Answered { by: String },
    Decided { answer: RefusalAnswer, by: String },
    Resumed,
}

impl MachineEvent {
    /// The fault of an event that the machine does not expect in this phase. It is a bug, and the
    /// rig stops safely.
    pub(crate) fn out_of_order(&self, during: &'static str) -> Fault {
        let what = match self {
            Self::Begin => "a beginning",
            Self::LinearAt(_) => "a position of the linear stage",
            Self::Descended { .. } => "the end of a descent",
            Self::RotaryAt(_) => "a position of the rotary stage",
            Self::Readings(_) => "readings",
            Self::Stopped => "a standstill",
            Self::Declared => "a declaration",
            Self::Waited => "the end of a wait",
            Self::Answered { .. } | Self::Decided { .. } => "an answer",
            Self::Resumed => "a resumption",
        };
        Fault::OutOfOrder { what, during }
    }
}

impl From<Report> for MachineEvent {
    fn from(report: Report) -> Self {
        match report {
            Report::LinearAt(position) | Report::LinearHomed(position) => Self::LinearAt(position),
            Report::RotaryAt(position) => Self::RotaryAt(position),
            Report::Measured(readings) => Self::Readings(readings),
            Report::Descended { at, way } => Self::Descended { at, way },
            // No machine finds a stage.
            Report::Stopped(_) | Report::RotaryStopped(_) | Report::Unhomed => Self::Stopped,
        }
    }
}

/// The surroundings of a machine while it handles an event.
pub(crate) struct MachineContext<'a> {
    pub(crate) now: RigTime,
    pub(crate) plan: &'a Plan,
    pub(crate) limits: &'a RigLimits,
    pub(crate) probe: Proven,
    /// The knowledge of the bench, once it is surveyed.
    pub(crate) bench: Option<Bench>,
    /// The drift of the free resonance.
    pub(crate) drift: &'a Drift,
    /// The drive of the sensor, if it is known.
    pub(crate) driven: Option<Driven>,
    pub(crate) notes: &'a mut Vec<Event>,
}

impl MachineContext<'_> {
    /// The readings at the no-load resonance.
    pub(crate) fn listening<'b>(&'b self, no_load: &'b Resonance) -> Listening<'b> {
        Listening { now: self.now, no_load, plan: self.plan, driven: self.driven }
    }

    pub(crate) fn rotate_to<T>(&self, pose: Pose) -> MachineStep<T> {
        match self.limits.rotary.target(pose.direction.rotary_position(pose.angle)) {
            Ok(target) => MachineStep::Do(Operation::MoveRotary {
                target,
                speed_deg_per_s: self.limits.motion.rotary_speed_deg_per_s,
            }),
            Err(error) => MachineStep::Fault(Fault::RotaryTarget(error)),
        }
    }

    pub(crate) fn move_linear<T>(&self, to: Position<Mm>, speed_mm_per_s: f64) -> MachineStep<T> {
        match self.limits.linear.target(to) {
            Ok(target) => MachineStep::Do(Operation::MoveLinear { target, speed_mm_per_s }),
            Err(error) => MachineStep::Fault(Fault::LinearTarget(error)),
        }
    }

    /// Retracts before a turn to the pose that comes next, or to the clear position.
    pub(crate) fn retract<T>(&self, next: Option<Pose>) -> MachineStep<T> {
        MachineStep::Retract(self.probe.clear_before(next, self.limits))
    }

    pub(crate) fn surface_not_found(
        &mut self,
        trail: Vec<(Position<Mm>, Reading)>,
        reason: Option<String>,
    ) {
        self.notes.push(Event::SurfaceNotFound { trail, reason });
    }

    pub(crate) fn surface_found(
        &mut self,
        surface: Surface,
        onset: Option<Onset>,
        trail: Vec<(Position<Mm>, Reading)>,
    ) {
        let Surface { position, sigma_mm } = surface;
        self.notes.push(Event::SurfaceFound { position, sigma_mm, onset, trail });
    }
}
