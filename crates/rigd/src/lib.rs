//! The daemon: command line, configuration, HTTP, and the wiring that carries the engine's effects
//! out and reports back.

mod aim;
mod archive;
mod bench_check;
mod beside;
mod block_runs;
pub mod calibrations;
pub mod cli;
mod commissioning;
mod corrections;
mod descents;
mod describe;
mod doctor;
mod durable;
mod endpoint;
pub mod faults;
pub mod files;
mod hint;
pub mod http;
mod instruments;
mod interruption;
mod live;
pub mod loaded_rig;
mod local_time;
mod notify;
pub mod operator;
mod place;
mod predict;
pub mod protocol_file;
mod queue;
mod reason;
#[cfg(feature = "simulator")]
pub mod rehearse;
pub mod rig;
mod rig_view;
pub mod run_files;
mod selftest;
mod sensitivity;
mod sensor_check;
mod shipper;
pub mod simulation;
mod sweep_form;
mod sweeps;
mod telemetry;
pub mod tokens;
pub mod transcripts;
mod verdict;
