//! What happened, for the journal and for whoever watches.

use rig_model::{Clearance, Deg, Mm, Position, Reading, SweepRequest};
use rig_protocol::{Prompt, StepId, Touch};
use rig_resonance::{Estimate, FitOptions, Refusal, Resonance, Verdict};

use crate::{Fault, Surface};

/// What became of a run.
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

/// A finished sweep with its outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishedSweep {
    /// What it was for.
    pub purpose: SweepPurpose,
    /// Every reading, in the order taken.
    pub readings: Vec<Reading>,
    /// Number of readings at the beginning that only located the resonance. The outcome rests on
    /// the others.
    pub probe_readings: usize,
    /// The fitted resonance, or the reason why there is none.
    pub outcome: Verdict,
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
    /// Its address.
    pub step: StepId,
    /// What was touched, and how.
    pub touch: Touch,
    /// The reference it is compared with.
    pub no_load: Resonance,
    /// The tilt of the sample as read back.
    pub rotary: Position<Deg>,
    /// What came of it.
    pub outcome: TouchOutcome,
}

/// What came of a touch.
#[derive(Debug, Clone, PartialEq)]
pub enum TouchOutcome {
    /// A resonance in contact.
    Measured {
        /// How the probe stood.
        contact: Contact,
        /// The resonance.
        loaded: Resonance,
    },
    /// None to be relied on.
    Refused {
        /// How the probe stood, when it came to that.
        contact: Option<Contact>,
        /// Why.
        refusal: Refusal,
    },
}

/// How the probe stands in a sample.
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
    /// Whether it gave no resonance.
    pub const fn is_refused(&self) -> bool {
        matches!(self.outcome, TouchOutcome::Refused { .. })
    }

    /// Frequency shift and its standard deviation, Hz, when the resonance was accepted.
    pub fn shift_hz(&self) -> Option<(f64, f64)> {
        let TouchOutcome::Measured { loaded, .. } = &self.outcome else { return None };
        let shift = loaded.resonance_hz - self.no_load.resonance_hz;
        Some((shift, loaded.sigma_hz.hypot(self.no_load.sigma_hz)))
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
    StateChanged(RigState),
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
        /// Whether this shows the probe to be clear.
        is_clear: bool,
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
    /// It has been decided how a sweep goes on.
    Planned {
        /// Readings that it has so far.
        readings: usize,
        /// What was computed for it, in readings with their slopes.
        work: u64,
    },
    /// A sweep begins.
    SweepBegun {
        /// What it is for.
        purpose: SweepPurpose,
        /// What is asked of it.
        request: SweepRequest,
    },
    /// Readings of the sweep under way.
    Measured {
        /// Those by which the analyzer stands, in the order taken.
        readings: Vec<Reading>,
        /// What all of them so far say, once they say something.
        estimate: Option<Estimate>,
    },
    /// The surface has been sought and not found; why follows.
    SurfaceNotFound {
        /// Every position tried, with its reading.
        trail: Vec<(Position<Mm>, Reading)>,
    },
    /// A sweep is done.
    SweepFinished(Box<FinishedSweep>),
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
pub enum RigState {
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
