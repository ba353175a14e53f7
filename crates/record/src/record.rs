//! The records of a journal.
//!
//! These types belong to the file format. They mirror the vocabulary of the rig without being it,
//! so that a change of the code cannot silently change what old journals mean. Every quantity has
//! its unit in its name; positions are in mm on the linear axis and in degrees on the rotary one.

mod aim;
mod motion;
mod person;
mod resume;
mod start;
mod sweep;
mod touch;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use aim::{Aim, AimPart, AimSettings};
pub use motion::{
    Axis, CheckedSurface, Descent, Intent, LostSurface, Move, MoveReason, Onset, Surface,
    SurfaceReading, WayPoint,
};
pub use person::{Operator, Prompt, PromptAnswered, PromptAsked, RefusalAnswered, RefusalAsked};
pub use resume::{Amended, Amendment, Archived, Change, GivenUp, Resumed};
pub use start::{
    Action, CitedCalibration, Device, Expected, PlanSize, RunStarted, Sample, ScrewMap, Source,
    StepStarted,
};
pub use sweep::{
    BenchSettings, Circuit, Extra, FitNoise, FitSettings, FitTiming, NearCircuit, ReadingFlag,
    ReadingRecord, Sweep, SweepOutcome, SweepPurpose,
};
pub use touch::{
    Direction, Halfway, Phase, Pose, ReferenceJumped, RefusedTouch, Touch, TouchPosition,
    TouchSettings,
};

/// One record of a journal.
///
/// Its JSON holds the kind under `kind`, and only finite numbers: anything else is refused when it
/// is appended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Record {
    /// A run began: everything needed to repeat it.
    RunStarted(RunStarted),
    /// The rig went to the next step of the plan.
    StepStarted(StepStarted),
    /// A prompt was shown.
    PromptAsked(PromptAsked),
    /// A person answered.
    PromptAnswered(PromptAnswered),
    /// A person was asked about a refused touch.
    RefusalAsked(RefusalAsked),
    /// What was done after a refused touch.
    RefusalAnswered(RefusalAnswered),
    /// An axis is about to be moved. On disk before the frame leaves when the probe may go down.
    Intent(Intent),
    /// An axis was moved and read back.
    Moved(Move),
    /// The probe went down evenly while the impedance was read without a pause.
    Descended(Descent),
    /// The surface of the sample was found.
    SurfaceFound(Surface),
    /// The surface of the sample was not found.
    SurfaceNotFound(LostSurface),
    /// The surface was looked for again after the sweep of a touch.
    SurfaceChecked(CheckedSurface),
    /// The impedance was measured over a range of frequencies.
    Sweep(Sweep),
    /// A touch gave its frequency shift.
    TouchResult(Touch),
    /// A touch was made and gave no frequency shift.
    TouchRefused(RefusedTouch),
    /// The free resonance has jumped between two references.
    ReferenceJumped(ReferenceJumped),
    /// A person gave a command.
    Operator(Operator),
    /// Something failed; the rig is latched.
    Fault(Fault),
    /// A latched rig has tried again to retract.
    RetractTried(RetractTried),
    /// The last frames on a port, as they were when a fault was seen.
    BlackBox(BlackBox),
    /// The rig changed its state.
    StateChanged(StateChanged),
    /// The computer or the program was held up.
    Stalled(Stalled),
    /// The wall clock of the computer was set.
    ClockJumped(ClockJumped),
    /// A run that had not been completed was resumed: the new clock, and the changes since.
    Resumed(Resumed),
    /// A person gave up a run that had not been completed.
    GivenUp(GivenUp),
    /// A touch of a run is measured again or left out: the first record of an amendment.
    Amended(Amended),
    /// The readings of a run were moved to an archive: the first record of the note that stays.
    Archived(Archived),
    /// The end of a run, or of a part of it: only [`Record::Resumed`] or [`Record::GivenUp`] can
    /// follow, and nothing once the run is sealed.
    RunFinished(RunFinished),
}

impl Record {
    /// The kinds of records that an archive takes out of the journal: readings and frames, which no check
    /// of another run needs. They are most of its bytes.
    pub const ARCHIVED_KINDS: [&str; 6] = [
        "sweep",
        "descended",
        "surface_found",
        "surface_not_found",
        "surface_checked",
        "black_box",
    ];

    /// The word under which the record is stored.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::RunStarted(_) => "run_started",
            Self::StepStarted(_) => "step_started",
            Self::PromptAsked(_) => "prompt_asked",
            Self::PromptAnswered(_) => "prompt_answered",
            Self::RefusalAsked(_) => "refusal_asked",
            Self::RefusalAnswered(_) => "refusal_answered",
            Self::Intent(_) => "intent",
            Self::Moved(_) => "moved",
            Self::Descended(_) => "descended",
            Self::SurfaceFound(_) => "surface_found",
            Self::SurfaceNotFound(_) => "surface_not_found",
            Self::SurfaceChecked(_) => "surface_checked",
            Self::Sweep(_) => "sweep",
            Self::TouchResult(_) => "touch_result",
            Self::TouchRefused(_) => "touch_refused",
            Self::ReferenceJumped(_) => "reference_jumped",
            Self::Operator(_) => "operator",
            Self::Fault(_) => "fault",
            Self::RetractTried(_) => "retract_tried",
            Self::BlackBox(_) => "black_box",
            Self::StateChanged(_) => "state_changed",
            Self::Stalled(_) => "stalled",
            Self::ClockJumped(_) => "clock_jumped",
            Self::Resumed(_) => "resumed",
            Self::GivenUp(_) => "given_up",
            Self::Amended(_) => "amended",
            Self::Archived(_) => "archived",
            Self::RunFinished(_) => "run_finished",
        }
    }
}

/// Whether the probe was known to be away from the sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clearance {
    /// Shown clear by a read-back.
    Clear,
    /// Lowered and not shown clear since.
    InContact,
    /// No read-back has shown the probe clear or in contact.
    Unknown,
}

/// A fault that latched the rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// The step in which it happened, in a run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<String>,
    /// The cause of the fault.
    pub cause: String,
    /// Clearance of the probe.
    pub probe: Clearance,
    /// Hint for the next action.
    pub hint: String,
    /// The lowest and the highest position to which the last moves can have led the linear stage, mm, if it was read back
    /// elsewhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_moves_mm: Option<[f64; 2]>,
}

/// The last frames on a port.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct BlackBox {
    /// Name of the port in the rig file.
    pub port: String,
    /// The frames, oldest first.
    pub frames: Vec<Frame>,
}

/// Bytes that passed a port together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Frame {
    /// When, on the rig's clock, in µs.
    pub rig_us: u64,
    /// Whether they were sent to the device; otherwise they came from it.
    pub is_sent: bool,
    /// The bytes in hexadecimal.
    pub hex: String,
}

/// A change of state.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StateChanged {
    /// Name of the new state.
    pub state: String,
    /// The reason, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// After the patience of the recovery, a latched rig has tried again to find the linear drive and to
/// retract.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RetractTried {
    /// Counts from 1.
    pub attempt: u32,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// Clearance of the probe after it.
    pub probe: Clearance,
}

/// The computer or the program did nothing for a while: it was stopped, or slept.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stalled {
    /// For how long, s.
    pub stalled_s: f64,
    /// Whether a measurement was under way, whose readings were discarded and measured again.
    pub is_measured_again: bool,
}

/// The wall clock was set. Nothing but the times in people's words depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ClockJumped {
    /// By how much, s; negative if it was set back.
    pub jump_s: f64,
}

/// The end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Every step was done, and every touch was measured.
    Completed,
    /// Every step was done, and at least one touch was refused.
    CompletedWithRefusals,
    /// A person ended it early.
    Aborted,
    /// A fault ended it.
    Faulted,
    /// The program ended during the run, and the run was given up; or the program ended during a
    /// session.
    Interrupted,
}

impl Ending {
    /// All ends.
    pub const ALL: [Self; 5] = [
        Self::Completed,
        Self::CompletedWithRefusals,
        Self::Aborted,
        Self::Faulted,
        Self::Interrupted,
    ];

    /// Whether nothing is left to be measured.
    pub const fn is_complete(self) -> bool {
        matches!(self, Self::Completed | Self::CompletedWithRefusals)
    }

    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::CompletedWithRefusals => "completed_with_refusals",
            Self::Aborted => "aborted",
            Self::Faulted => "faulted",
            Self::Interrupted => "interrupted",
        }
    }
}

/// The end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunFinished {
    /// How the run ended.
    pub status: Ending,
}
