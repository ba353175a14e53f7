//! Protocol TOML in; a checked plan of addressable steps out.
//!
//! [`Protocol::read`] takes the text of a protocol file and never fails: it keeps the faults.
//! [`Plan::new`] checks the protocol against the limits of a rig and returns a plan, or all faults
//! of the file, alone and on this rig, each with line and column.
//!
//! The shipped protocol files, with their comments, are the manual of the keys. This crate makes no
//! decision about motion: it lays out poses and prompts, and the engine replays them.

#![deny(clippy::disallowed_methods)]

mod aim;
mod check;
mod descent;
mod expected_drift;
mod fault;
mod layout;
mod plan;
mod protocol;
mod summary;
mod sweep;

#[cfg(test)]
mod tests;

pub use aim::{
    AIM_KEYS, AimPlan, AimSettings, ErrorPart, ExpectedTouch, NoSensitivity, PartTimes, Percents,
    Sensitivity, TouchModel, Wanted,
};
pub use descent::descent_speed;
pub use plan::{
    Action, Approach, Phase, Plan, Pose, Prompt, RefusalPolicy, Step, StepId, Touch, TouchSettings,
};
pub use protocol::{AngleKnowledge, ModelOrigin, NoLoadPolicy, Protocol};
pub use summary::Summary;
