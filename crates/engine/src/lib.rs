//! Decides the next operation of the rig, without I/O and without a clock.
//!
//! ```text
//!             command ──▶ ┌────────┐ ──▶ Effect::Note      (into the journal, in order)
//!   report of an          │ Engine │ ──▶ Effect::Commit    (and on disk before anything else)
//!   operation  ─────────▶ │        │ ──▶ Effect::Do        (one operation at a time)
//!   time passed ────────▶ └────────┘ ──▶ Effect::Interrupt (end the running one early)
//! ```
//!
//! The engine knows no device. It commands a linear axis, a rotary axis and an analyzer, and gets a
//! report of each operation. Every operation that lowers the probe or turns the sample passes the
//! [`Interlock`].

#![deny(clippy::disallowed_methods)]

mod command;
mod contact_sense;
mod descent;
mod drift;
mod effect;
mod engine;
mod event;
mod fault;
mod heights;
mod interlock;
mod level;
mod listening;
mod machine;
mod no_load;
mod operation;
mod recovery;
mod refusal;
mod run;
mod search;
mod slip;
mod sweep;
mod touch;

pub use command::{Command, CommandRefusal, TouchPlace};
pub use contact_sense::{ContactSenseFault, TouchRefusal};
pub use descent::{Descended, DescentEnd};
pub use drift::Drift;
pub use effect::{Effect, Input};
pub use engine::{Admitted, Engine, Progress, Snapshot};
pub use event::{
    Contact, Event, FinishedSweep, Halfway, LoweringPurpose, RigState, RunPhase, RunStatus,
    SweepPurpose, TouchOutcome, TouchResult,
};
pub use fault::{Device, Failure, FailureKind, Fault, Jump, LeftRig};
pub use interlock::{Interlock, InterlockError};
pub use level::{LevelCheck, Levels};
pub use operation::{Operation, OperationId, Report};
pub use refusal::{RefusalAnswer, RefusedTouch};
pub use search::{Search, SearchStep, Surface};
pub use slip::Slip;
