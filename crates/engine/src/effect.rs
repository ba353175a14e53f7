//! What goes into the engine and what comes out of it.

use std::time::Duration;

use rig_model::{
    AxisError, Clearance, Deg, DriveLevel, Mm, Position, Reading, RigTime, SweepPoint,
    SweepRequest, Target,
};
use rig_protocol::{Plan, Prompt, StepId, Touch};
use rig_resonance::{Resonance, Verdict};

use crate::InterlockError;

/// Tells one operation from another, so that a late report is never taken for a present one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct OperationId(pub u64);

/// Something for the devices to do. One is in flight at a time, and none is ever abandoned.
#[derive(Debug, Clone, PartialEq)]
pub enum Operation {
    /// Home the linear stage if it is not homed. It homes upwards.
    PrepareLinear,
    /// Home the rotary stage if it is not homed.
    PrepareRotary,
    /// Move the probe up or down and read back where it is.
    MoveLinear {
        /// Where to.
        target: Target<Mm>,
        /// How fast, mm/s.
        speed_mm_per_s: f64,
    },
    /// Tilt the sample and read back where it is.
    MoveRotary {
        /// Where to.
        target: Target<Deg>,
        /// How fast, °/s.
        speed_deg_per_s: f64,
    },
    /// Measure the impedance at these frequencies, in this order.
    Measure {
        /// The frequencies, each with its settling and integration.
        points: Vec<SweepPoint>,
        /// The level of the drive.
        level: DriveLevel,
    },
    /// Stop both axes where they are.
    StopMotion,
}

/// What an operation achieved.
#[derive(Debug, Clone, PartialEq)]
pub enum Report {
    /// The linear stage stands here, read back after the move.
    LinearAt(Position<Mm>),
    /// The rotary stage stands here, read back after the move.
    RotaryAt(Position<Deg>),
    /// The readings, one for each point asked for, or fewer if the operation was interrupted.
    Measured(Vec<Reading>),
    /// Both axes have stopped.
    Stopped,
}

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

/// What became of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunStatus {
    /// Every step was done.
    Completed,
    /// A person ended it early, and the probe is clear.
    Aborted,
    /// A fault ended it.
    Faulted,
}

impl RunStatus {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Aborted => "aborted",
            Self::Faulted => "faulted",
        }
    }
}

/// What a sweep is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SweepPurpose {
    /// The free sensor, as the reference of the touches after it.
    NoLoad,
    /// The sensor on the sample.
    Touch,
    /// A person asked for it.
    Manual,
}

/// A finished sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepOutcome {
    /// What it was for.
    pub purpose: SweepPurpose,
    /// Every reading, in the order taken.
    pub readings: Vec<Reading>,
    /// How many of the first readings only served to find the resonance. The verdict rests on the
    /// others.
    pub looks: usize,
    /// What they say.
    pub verdict: Verdict,
}

/// A finished touch.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchResult {
    /// Its address.
    pub step: StepId,
    /// What was touched, and how.
    pub touch: Touch,
    /// The reference it is compared with.
    pub no_load: Resonance,
    /// The resonance in contact, when there is one.
    pub loaded: Option<Resonance>,
    /// Where the surface was found.
    pub surface: Position<Mm>,
    /// Standard uncertainty of that place, mm.
    pub surface_sigma_mm: f64,
    /// Depth below it as read back, along the probe, mm.
    pub indentation_mm: f64,
}

impl TouchResult {
    /// Frequency shift and its standard deviation, Hz, when the resonance was accepted.
    pub fn shift_hz(&self) -> Option<(f64, f64)> {
        self.loaded.as_ref().map(|loaded| {
            let shift = loaded.resonance_hz - self.no_load.resonance_hz;
            (shift, loaded.sigma_hz.hypot(self.no_load.sigma_hz))
        })
    }
}

/// Why the probe is lowered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoweringPurpose {
    /// To find the surface of the sample.
    FindSurface,
    /// To press into it.
    Indent,
    /// A person moves it.
    ByHand,
}

/// Something that happened, for the journal and for whoever watches.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The state of the rig has changed.
    StateChanged(StateWord),
    /// A step of the plan begins.
    StepStarted {
        /// Its index in the plan.
        index: usize,
    },
    /// A person is needed.
    PromptAsked(Prompt),
    /// A person has done it.
    PromptAnswered {
        /// What was asked.
        prompt: Prompt,
        /// Who.
        by: String,
    },
    /// The probe is about to go down, at most as far as this.
    Intent {
        /// The lowest position of the moves that follow.
        down_to: Position<Mm>,
        /// Why.
        purpose: LoweringPurpose,
    },
    /// The linear stage has moved.
    LinearMoved {
        /// Where it was sent.
        target: Position<Mm>,
        /// Where it is.
        read_back: Position<Mm>,
    },
    /// The rotary stage has moved.
    RotaryMoved {
        /// Where it was sent.
        target: Position<Deg>,
        /// Where it is.
        read_back: Position<Deg>,
    },
    /// The surface has been found.
    SurfaceFound {
        /// Where.
        position: Position<Mm>,
        /// Standard uncertainty, mm.
        sigma_mm: f64,
        /// Every position tried, with its reading.
        trail: Vec<(Position<Mm>, Reading)>,
    },
    /// A sweep is done.
    SweepFinished(Box<SweepOutcome>),
    /// A touch is done and the probe is clear.
    TouchFinished(Box<TouchResult>),
    /// A person did something.
    Operator {
        /// What, as one word.
        action: &'static str,
        /// Who.
        by: String,
    },
    /// Something went wrong.
    Faulted {
        /// What.
        fault: Fault,
        /// What was known of the probe then.
        clearance: Clearance,
    },
    /// A run has ended.
    RunFinished(RunStatus),
}

/// The state of the rig in a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateWord {
    /// Homing, and proving that the probe is clear.
    Preparing,
    /// Ready for a command.
    Idle,
    /// A run or a sweep is under way.
    Running,
    /// Waiting for a person to do what was asked.
    WaitingForPerson,
    /// Paused between two steps, probe clear.
    Paused,
    /// Stopping and retracting.
    Retracting,
    /// Nothing moves until the fault is acknowledged.
    Latched,
}

impl StateWord {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Preparing => "preparing",
            Self::Idle => "idle",
            Self::Running => "running",
            Self::WaitingForPerson => "waiting for a person",
            Self::Paused => "paused",
            Self::Retracting => "retracting",
            Self::Latched => "latched",
        }
    }
}

/// What the shell has to carry out, in order.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Write this into the journal.
    Note(Event),
    /// Make everything noted so far durable before going on.
    Commit,
    /// Do this and report.
    Do(OperationId, Operation),
    /// Have the operation in flight end early. It still reports.
    Interrupt,
}

/// What wakes the engine.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// An operation has ended.
    Done(OperationId, Result<Report, Failure>),
    /// The deadline that [`Engine::deadline`](crate::Engine::deadline) named has come.
    Tick,
}

/// Why a run or a sweep is ended early.
#[derive(Debug, Clone, PartialEq)]
pub enum StopReason {
    /// A person wants it ended in order: the rig is ready again afterwards.
    Abort {
        /// Who.
        by: String,
    },
    /// Something is wrong: the rig latches afterwards.
    Fault(Fault),
}

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
pub enum Denied {
    /// The state forbids it.
    #[error("cannot {command} while the rig is {}", .state.name())]
    State {
        /// The command.
        command: &'static str,
        /// The state.
        state: StateWord,
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

/// How long an operation may take before something must be wrong.
///
/// Drivers have tighter limits of their own; this one catches a driver that never reports.
pub(crate) fn limit(operation: &Operation, travel_mm: f64, travel_deg: f64) -> Duration {
    const SLACK_S: f64 = 60.0;
    let seconds = match operation {
        Operation::PrepareLinear | Operation::PrepareRotary => 300.0,
        Operation::MoveLinear { speed_mm_per_s, .. } => travel_mm / speed_mm_per_s,
        Operation::MoveRotary { speed_deg_per_s, .. } => travel_deg / speed_deg_per_s,
        // An analyzer may be a good deal slower than the integration it is asked for.
        Operation::Measure { points, .. } => {
            10.0 * points.iter().map(SweepPoint::duration_s).sum::<f64>() + points.len() as f64
        }
        Operation::StopMotion => 0.0,
    };
    Duration::from_secs_f64(seconds + SLACK_S)
}

/// What an operation is called in a message.
pub(crate) const fn name(operation: &Operation) -> &'static str {
    match operation {
        Operation::PrepareLinear => "homing the linear stage",
        Operation::PrepareRotary => "homing the rotary stage",
        Operation::MoveLinear { .. } => "a move of the linear stage",
        Operation::MoveRotary { .. } => "a move of the rotary stage",
        Operation::Measure { .. } => "a measurement",
        Operation::StopMotion => "stopping both axes",
    }
}

/// An operation in flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pending {
    pub(crate) id: OperationId,
    pub(crate) operation: Operation,
    pub(crate) deadline: RigTime,
    /// It has been asked to end early.
    pub(crate) is_interrupted: bool,
}
