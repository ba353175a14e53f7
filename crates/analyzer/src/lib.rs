//! Drivers of impedance analyzers.
//!
//! A [`Dialect`] is a command set and the rules of a transport, both data; an [`Analyzer`] owns
//! the port and carries measurements out. A reading is returned only when the instrument has
//! confirmed the frequency and reports no error.

mod analyzer;
mod dialect;
mod error;
mod hioki;
mod instrument_port;
mod lcr;
mod message;
mod point;
mod points;
mod questions;
mod resynchronise;
mod trace;
mod traces;

pub use analyzer::Analyzer;
pub use dialect::{
    Dialect, HIOKI_IM3536, HP_4284A, Handshake, HighPower, KEYSIGHT_E4980A, KEYSIGHT_E4990A,
    Resolution, TONGHUI_TH283X, TransportRules,
};
pub use error::{AnalyzerError, EventStatus, UnexpectedTerminator};
pub use instrument_port::TransportSettings;
pub use rig_scpi::Identity;
