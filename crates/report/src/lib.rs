//! The results of a run from its records, as HTML, text, JSON and CSV.
//!
//! [`RunResults`] is built once, by the analysis of `rig-analysis`, and every output is a view of it;
//! [`export`] has the tables of the records themselves. The same records give the same bytes. The
//! page of the report asks no other host for anything. Writers are passed in: nothing here does I/O.

#![deny(clippy::disallowed_methods)]

mod between;
mod data;
pub mod export;
mod html;
mod results;
mod summary;
#[cfg(test)]
mod tests;
mod text;
mod units;

pub use html::{RunVerdict, document, trend};
pub use results::{
    RunResults,
    aim::{AimPartSummary, AimSummary},
    budget::StiffnessBudget,
    status::TouchStatus,
    touches::TouchRow,
};
pub use summary::{
    ClassificationSummary, DailyCheckSummary, EvidenceSummary, ModelSummary, RecognitionSummary,
    RunSummary, ShiftSummary, StiffnessSummary, TermSummary,
};
pub use units::with_sigma;
