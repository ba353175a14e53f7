//! What each impedance analyzer must be told.
//!
//! A [`Dialect`] is a command set and the quirks of a transport, both data; an [`Analyzer`] owns
//! the port and carries measurements out. A reading is returned only when the instrument has
//! confirmed the frequency and reports no error.

mod analyzer;
mod dialect;
mod error;
mod footing;
mod hioki;
mod identity;
mod lcr;
mod message;
mod point;
mod points;
mod questions;
mod trace;
mod traces;
mod wire;

pub use analyzer::Analyzer;
pub use dialect::{
    Dialect, HIOKI_IM3536, HP_4284A, Handshake, HighPower, KEYSIGHT_E4980A, KEYSIGHT_E4990A,
    Quirks, Resolution, TONGHUI_TH283X,
};
pub use error::{AnalyzerError, EventStatus, WrongEnd};
pub use identity::Identity;
pub use wire::Terms;
