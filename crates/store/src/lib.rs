//! Append-only journal of every run in SQLite, each record chained by its digest; queries and
//! exports.
//!
//! One data directory holds one database, `rigd.db`, with one writer. [`Store`] is that writer: it
//! begins runs and appends [`Record`]s to them. [`Reader`]s are separate connections, as many as
//! wanted, also in other processes; they see what has been committed. `rig-report` computes the
//! results of a run; `rigd` decides when a record is written, and what follows an error.
//!
//! A record is never changed. Its digest covers the digest before it, so that [`Reader::verify`]
//! finds the first record that was lost or altered. The digest covers neither wall time nor the id
//! of the run: two runs of the same protocol with the same seed have the same chain.
//!
//! A run that was completed or given up is sealed, and nothing can be added to it. Any other one can
//! be opened again with [`Store::reopen`]. What the list of runs says of a run is under digests of
//! its own.
//!
//! [`excerpt`] copies a sealed run to a journal of its own, for an archive. [`Store::archive`] then takes
//! its readings out of this one. Their digests stay, so that the chain of the run still holds, and so does
//! everything that tells where the axes were.

mod backup;
mod directory;
mod error;
mod excerpt;
mod journal;
mod lock;
mod memory;
mod reader;
mod restore;
mod salvage;
mod schema;
mod sql;
#[cfg(test)]
mod tests;

pub use backup::{BackedUpRun, back_up};
pub(crate) use directory::copy_beside;
pub use directory::make_directory;
pub use error::{PathAct, SqliteError, StoreError};
pub use excerpt::excerpt;
pub use journal::{Journal, Store};
pub use memory::{DiskFailure, MemoryDisk};
pub use reader::{
    HOMING, Interruption, Jump, PREPARE, Pages, ProbeWord, Reader, RunEnd, Shipment, intact,
};
pub use restore::restore;
pub use rig_record::{
    Action, Aim, AimPart, AimSettings, Amended, Amendment, Archived, Axis, BenchSettings, BlackBox,
    Chain, ChainCheck, Change, CheckedSurface, Circuit, CitedCalibration, Clearance, ClockJumped,
    Confirmed, Descent, Device, Digest, Direction, Ending, Expected, Extra, Fault, FitNoise,
    FitSettings, FitTiming, Flaw, Frame, GivenUp, Halfway, Intent, ListEntry, LostSurface, Move,
    MoveReason, NearCircuit, Onset, Operator, Phase, PlanSize, Pose, Prompt, PromptAnswered,
    PromptAsked, ReadingFlag, ReadingRecord, Record, ReferenceJumped, RefusalAnswered,
    RefusalAsked, RefusedTouch, Resumed, RetractTried, Run, RunFinished, RunId, RunKind,
    RunStarted, RunStatus, Sample, ScrewMap, SealedRun, Source, Stalled, StateChanged, StepStarted,
    StoredRecord, Stretch, Surface, SurfaceReading, Sweep, SweepOutcome, SweepPurpose, Touch,
    TouchPosition, TouchSettings, WayPoint,
};
pub use salvage::{SalvagedRun, salvage};
pub use schema::FORMAT;
