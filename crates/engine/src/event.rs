//! Events, for the journal and for clients.

use std::time::Duration;

use rig_model::{Clearance, Deg, DriveLevel, Mm, Position, Reading, SweepRequest, Window};
use rig_protocol::{Prompt, StepId, Touch};
use rig_resonance::{Estimate, FitOptions, FitOutcome, Onset, Resonance};

use crate::{Descended, Fault, RefusalAnswer, Surface, TouchRefusal};

/// The end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunStatus {
    /// Every step was done, and every touch was measured.
    Completed,
    /// A person ended it early, and the probe is clear.
    Aborted,
    /// A fault ended it.
    Faulted,
    /// Every step was done, and at least one touch was refused.
    CompletedWithRefusals,
}

impl RunStatus {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Aborted => "aborted",
            Self::Faulted => "faulted",
            Self::CompletedWithRefusals => "completed_with_refusals",
        }
    }
}

/// The purpose of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SweepPurpose {
    /// The free sensor, as the reference of the touches after it.
    NoLoad,
    /// The sensor on the sample.
    Touch,
    /// A person or a program requested the sweep.
    Manual,
}

impl SweepPurpose {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoLoad => "no_load",
            Self::Touch => "touch",
            Self::Manual => "manual",
        }
    }
}

/// What a run is doing within a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RunPhase {
    /// Between two steps.
    Between,
    /// The rig goes to where a person can work, and waits for the person.
    Prompt,
    /// The rotary stage turns to the pose.
    Rotation,
    /// The reference is being measured.
    NoLoadSweep,
    /// The baseline of the approach is being read.
    Baseline,
    /// The surface is being searched for.
    Search,
    /// The probe goes to its depth.
    Indentation,
    /// The tissue relaxes.
    Dwell,
    /// The resonance in contact is being measured.
    Sweep,
    /// The surface is looked for again, to see whether steps were lost.
    SlipCheck,
    /// The probe goes to its clear position.
    Retract,
    /// After the last touch, the clear probe is read once more.
    Confirmation,
}

/// A finished sweep with its outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishedSweep {
    /// Purpose of the sweep.
    pub purpose: SweepPurpose,
    /// Level of the drive.
    pub level: DriveLevel,
    /// Every reading, in the order taken.
    pub readings: Vec<Reading>,
    /// Number of readings at the beginning that only located the resonance. The outcome rests on
    /// the others.
    pub probe_readings: usize,
    /// The fitted resonance, or the reason why there is none.
    pub outcome: FitOutcome,
    /// The time for which an accepted resonance holds, s on the clock of the readings.
    pub effective_time_s: Option<f64>,
    /// The settings of the fit.
    pub fit: FitOptions,
    /// The standard deviation without which no resonance was accepted, Hz.
    pub target_hz: Option<f64>,
}

/// A finished touch.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchResult {
    /// Address of the step.
    pub step: StepId,
    /// Sample and pose.
    pub touch: Touch,
    /// The no-load resonance before the touch.
    pub no_load: Resonance,
    /// The tilt of the sample as read back.
    pub rotary: Position<Deg>,
    /// Outcome of the touch.
    pub outcome: TouchOutcome,
}

/// The outcome of a touch.
#[expect(clippy::large_enum_variant, reason = "a touch has one outcome, which is kept once")]
#[derive(Debug, Clone, PartialEq)]
pub enum TouchOutcome {
    /// A resonance in contact.
    Measured {
        /// Position of the probe in the sample.
        contact: Contact,
        /// The resonance in contact.
        loaded: Resonance,
        /// The measurement on the way to the depth, if the protocol asks for it.
        halfway: Option<Halfway>,
        /// How far the free resonance drifts in the time since its reference, Hz; a standard deviation.
        drift_sigma_hz: f64,
    },
    /// No trusted resonance.
    Refused {
        /// Position of the probe in the sample, if it was reached.
        contact: Option<Contact>,
        /// Why the touch has no resonance.
        refusal: TouchRefusal,
    },
}

/// The measurement of a touch at a smaller depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Halfway {
    /// Position of the probe in the sample.
    pub contact: Contact,
    /// The resonance there.
    pub loaded: Resonance,
}

/// The position of the probe in a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Where the surface was found.
    pub surface: Surface,
    /// The linear stage as read back.
    pub linear: Position<Mm>,
}

impl Contact {
    /// Depth below the surface, along the probe, mm.
    pub fn indentation_mm(&self) -> f64 {
        self.surface.position.value() - self.linear.value()
    }
}

impl TouchResult {
    /// Whether the touch has no frequency shift.
    pub const fn is_refused(&self) -> bool {
        matches!(self.outcome, TouchOutcome::Refused { .. })
    }
}

/// The purpose of a move downwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoweringPurpose {
    /// To find the surface of the sample.
    FindSurface,
    /// To press into it.
    Indent,
    /// To move it for a person.
    ByHand,
}

/// An event, for the journal and for clients.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The state of the rig has changed.
    StateChanged(RigState),
    /// A step of the plan begins.
    StepStarted {
        /// Its index in the plan.
        index: usize,
    },
    /// A prompt for a person.
    PromptAsked(Prompt),
    /// A person has answered a prompt.
    PromptAnswered {
        /// Action that the person is asked for.
        prompt: Prompt,
        /// Name of the operator.
        by: String,
    },
    /// A touch was refused, and a person is asked what to do.
    RefusalAsked {
        /// Why it has no result.
        refusal: TouchRefusal,
    },
    /// What a person or the protocol does after a refused touch.
    RefusalAnswered {
        /// The answer.
        answer: RefusalAnswer,
        /// Name of the operator, or `protocol`.
        by: String,
        /// Why the touch was refused.
        refusal: TouchRefusal,
        /// The window of the repeated sweep, if it is a wider one.
        window: Option<Window>,
    },
    /// The probe is about to go down, at most as far as this.
    Intent {
        /// The lowest position of the moves that follow.
        down_to: Position<Mm>,
        /// Purpose of the move.
        purpose: LoweringPurpose,
    },
    /// The linear stage has moved.
    LinearMoved {
        /// Target of the linear stage, mm.
        target: Position<Mm>,
        /// Position of the linear stage after the move, mm.
        read_back: Position<Mm>,
        /// Whether this shows the probe to be clear.
        is_clear: bool,
    },
    /// The rotary stage has moved.
    RotaryMoved {
        /// Target of the rotary stage, degrees.
        target: Position<Deg>,
        /// Position of the rotary stage after the move, degrees.
        read_back: Position<Deg>,
    },
    /// The surface has been found.
    SurfaceFound {
        /// Position of the linear stage.
        position: Position<Mm>,
        /// Standard uncertainty, mm.
        sigma_mm: f64,
        /// The fit of a descent; `None` for a search in steps.
        onset: Option<Onset>,
        /// Every position tried, with its reading.
        trail: Vec<(Position<Mm>, Reading)>,
    },
    /// The probe has gone down with a stream of readings.
    Descended(Box<Descended>),
    /// The planner has decided on the next readings of a sweep.
    Planned {
        /// Number of readings so far.
        readings: usize,
        /// Counted work of the planner, in readings with their derivatives.
        work: u64,
    },
    /// A sweep begins.
    SweepBegun {
        /// Purpose of the sweep.
        purpose: SweepPurpose,
        /// Request of the sweep.
        request: SweepRequest,
    },
    /// Readings of the sweep under way.
    Measured {
        /// The readings without a flag, in the order taken.
        readings: Vec<Reading>,
        /// Estimate from all readings so far, if there is one.
        estimate: Option<Estimate>,
    },
    /// The surface was not found. The reason follows in another event, unless the search in steps goes on.
    SurfaceNotFound {
        /// Every position tried, with its reading.
        trail: Vec<(Position<Mm>, Reading)>,
        /// Why a descent has not found it. The search in steps follows.
        reason: Option<String>,
    },
    /// After a sweep in contact the surface was looked for again.
    SurfaceChecked {
        /// Every position, with its reading: above the surface, then below it. If the probe seemed to
        /// touch above it, the clear probe and the place above it once more come in between.
        trail: Vec<(Position<Mm>, Reading)>,
    },
    /// A sweep is done.
    SweepFinished(Box<FinishedSweep>),
    /// A touch is done and the probe is clear.
    TouchFinished(Box<TouchResult>),
    /// No drift explains the last reference: the resonance has jumped in the time since the one before it.
    ReferenceJumped {
        /// How far it, or a vague one before it, is from where the drift lets it be expected, Hz.
        off_hz: f64,
        /// Its standard deviation there, Hz.
        sigma_hz: f64,
        /// The measured touches in between, whose shifts may be wrong by it.
        touches: Vec<StepId>,
    },
    /// A finished touch is contradicted by what was measured next, and refused.
    TouchDoubted(Box<TouchResult>),
    /// A command of a person or a program.
    Operator {
        /// Name of the command.
        action: &'static str,
        /// Name of the operator.
        by: String,
    },
    /// The first fault; the rig leaves contact and latches.
    Faulted {
        /// Its cause, with the device.
        fault: Fault,
        /// Clearance of the probe at that time.
        clearance: Clearance,
    },
    /// The host was held up.
    Stalled {
        /// For how long.
        lasted: Duration,
        /// Whether a measurement was under way, whose readings are discarded and measured again.
        is_measured_again: bool,
    },
    /// A latched rig has tried again to find the linear drive and to retract.
    RetractTried {
        /// Counts from 1.
        attempt: u32,
        /// Why it failed.
        fault: Option<Fault>,
        /// Clearance of the probe after it.
        clearance: Clearance,
    },
    /// A run has ended.
    RunFinished(RunStatus),
}

/// The state of the rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RigState {
    /// Homing, and proving that the probe is clear.
    Preparing,
    /// Ready for a command.
    Idle,
    /// A run or a sweep is under way.
    Running,
    /// Waiting for the answer to a prompt.
    WaitingForPerson,
    /// Paused between two steps, probe clear.
    Paused,
    /// Stopping and retracting.
    Retracting,
    /// Nothing moves until the fault is acknowledged.
    Latched,
}

impl RigState {
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
