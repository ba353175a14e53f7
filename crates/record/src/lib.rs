//! The contents of a journal: types of records, the chain of their digests, runs and their ids.
//!
//! `rig-store` writes and reads these; `rig-report` makes results of them. Nothing here does I/O.

#![deny(clippy::disallowed_methods)]

mod chain;
mod confirmed;
mod digest;
mod record;
mod run;
mod seal;

pub use chain::{Chain, ChainCheck, Flaw, StoredRecord, UnreadableRecord};
pub use confirmed::Confirmed;
pub use digest::{Digest, DigestPart};
pub use record::{
    Action, Aim, AimPart, AimSettings, Amended, Amendment, Archived, Axis, BenchSettings, BlackBox,
    Change, CheckedSurface, Circuit, CitedCalibration, Clearance, ClockJumped, Descent, Device,
    Direction, Ending, Expected, Extra, Fault, FitNoise, FitSettings, FitTiming, Frame, GivenUp,
    Halfway, Intent, LostSurface, Move, MoveReason, NearCircuit, Onset, Operator, Phase, PlanSize,
    Pose, Prompt, PromptAnswered, PromptAsked, ReadingFlag, ReadingRecord, Record, ReferenceJumped,
    RefusalAnswered, RefusalAsked, RefusedTouch, Resumed, RetractTried, RunFinished, RunStarted,
    Sample, ScrewMap, Source, Stalled, StateChanged, StepStarted, Surface, SurfaceReading, Sweep,
    SweepOutcome, SweepPurpose, Touch, TouchPosition, TouchSettings, WayPoint,
};
pub use run::{NotARunId, Run, RunId, RunKind, RunStatus};
pub use seal::{ListEntry, SealedRun, Stretch, seal};
