//! What each impedance analyzer must be told.
//!
//! A dialect is a [command set](Dialect) and the quirks of a transport, both data; an [`Analyzer`]
//! owns the port and carries measurements out. A reading is returned only when the instrument has
//! confirmed the frequency and reports no error.

mod analyzer;
mod answer;
mod dialect;
mod error;
mod hioki;
mod identity;
mod wire;

pub use analyzer::Analyzer;
pub use dialect::{DIALECTS, Dialect, HIOKI_IM3536, dialect_by_name};
pub use error::{AnalyzerError, EventStatus};
pub use identity::Identity;
