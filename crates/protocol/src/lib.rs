//! Protocol TOML in; a checked plan of addressable steps out.

#![deny(clippy::disallowed_methods)]

mod plan;

pub use plan::{Action, Approach, Phase, Plan, Pose, Prompt, Step, StepId, Touch, TouchSettings};
