//! Protocol TOML in; a checked plan of addressable steps out.
//!
//! [`Protocol::read`] takes the text of a protocol file and never fails: it keeps what it found
//! wrong. [`Plan::new`] holds the protocol against a bench and gives either a plan, or everything
//! that is wrong with the file by itself and on this bench, each fault with line and column.
//!
//! What a protocol may say is shown, with comments, in the files that are shipped with the daemon.
//! This crate decides no motion: it lays out poses and prompts, and the engine replays them.

#![deny(clippy::disallowed_methods)]

mod check;
mod layout;
mod plan;
mod protocol;
mod refusal;
mod summary;
mod sweep;

#[cfg(test)]
mod tests;

pub use plan::{Action, Approach, Phase, Plan, Pose, Prompt, Step, StepId, Touch, TouchSettings};
pub use protocol::{AngleKnowledge, Protocol};
pub use summary::Summary;
