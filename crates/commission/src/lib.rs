//! What must be shown of a bench before its rig may move, how a person shows it, and the records of it.
//!
//! ```text
//!   Standing::of(records, basis) ──▶ the steps that are missing, and why
//!          ▲                               │
//!   Calibration (a TOML file each)         ▼
//!          ▲                   procedure::carry_out(step, bench)
//!          └──── Finding ◀────────── asks the person, moves by short steps
//! ```
//!
//! A [`Bench`] asks and moves: a terminal, a client, or a simulated person. No step trusts a sign, a scale or a
//! length that an earlier one has not shown, and none of them changes the rig file: a wrong value ends with the
//! key and the value to put there.

#![deny(clippy::disallowed_methods)]

mod agreement;
mod basis;
mod bench;
mod change;
pub mod check;
pub mod control;
mod finding;
pub mod homing;
mod kind;
pub mod latency;
pub mod metrology;
mod probe_radius;
pub mod procedure;
mod question;
mod record;
pub mod repeatability;
pub mod sensor;
mod standing;
mod step;

pub use basis::Basis;
pub use bench::{Bench, Jog, JogAxis, Jogged, NotDone, Order};
pub use change::BenchChange;
pub use finding::{Change, Finding, Value, Verdict};
pub use kind::Kind;
pub use probe_radius::{prior_by_blocks, prior_by_rule, probe_radius};
pub use question::{Answer, Asked, Choice, NotAnAnswer};
pub use record::{
    Calibration, Circumstances, HOLDS_S, NoTemperature, UnreadableCalibration, Unwritable,
    file_name, temperature,
};
pub use standing::{Standing, Why, checks, holding, is_homing_begun, last_accepted, last_change};
pub use step::Step;
