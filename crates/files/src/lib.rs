//! Every file that a person writes or hands in: text in, values or all faults out.
//!
//! Nothing here opens a file. A reader never stops at the first fault: each fault has its line, its
//! column, and advice ([`Faults`]).
//!
//! - [`settings`] reads TOML. Protocol and scene files use it from their own crates.

#![deny(clippy::disallowed_methods)]

mod fault;
pub mod settings;

pub use fault::{Complaint, Fault, Faults, Location};
