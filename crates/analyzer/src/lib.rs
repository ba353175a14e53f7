//! Drivers of impedance analyzers.
//!
//! A [`Dialect`] is the messages of an instrument file and the rules of a transport; an [`Analyzer`] owns
//! the port and carries measurements out. A reading is returned only when the instrument has
//! confirmed the frequency and reports no error.

mod analyzer;
mod answer;
mod correct;
mod error;
mod instrument_port;
mod message;
mod point;
mod points;
mod questions;
mod resynchronise;
mod trace;
mod traces;

pub use analyzer::Analyzer;
pub use error::{AnalyzerError, EventStatus, UnexpectedTerminator};
pub use instrument_port::TransportSettings;
pub use point::integration_s;
pub use rig_files::instrument::dialect::Dialect;
pub use rig_scpi::Identity;
