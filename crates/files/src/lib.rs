//! Every file that a person writes or hands in: text in, values or all faults out.
//!
//! Nothing here opens a file. A reader never stops at the first fault: each fault has its line, its
//! column, and advice ([`Faults`]).
//!
//! - [`settings`] reads TOML. Protocol and scene files are read with it in their own crates, because
//!   their values are types of these crates.
//! - [`rig_file`] is the description of a rig; [`sensor`] and [`samples`] are the sections that it
//!   shares with scene files.
//! - [`instrument`] has the files of analyzers and axis drives.
//! - [`service_file`] has the settings of the daemon.
//! - [`sweep_file`] is a sweep of any instrument, for the fit.
//! - [`FileKind`] recognises a file of another kind than the expected one.

#![deny(clippy::disallowed_methods)]

mod fault;
pub mod instrument;
mod kind;
pub mod rig_file;
pub mod samples;
pub mod sensor;
pub mod service_file;
pub mod settings;
pub mod sweep_file;

pub use fault::{Complaint, Fault, Faults, Location};
pub use kind::FileKind;
