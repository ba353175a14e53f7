//! The daemon: command line, configuration, HTTP, and the wiring that carries the engine's effects
//! out and reports back.

pub mod report;
pub mod rig_file;
