//! The report of a run: one HTML file with figures, tables and provenance, and the same results as
//! JSON and as text.
//!
//! Everything is made from the records of the journal alone, by the analysis of `rig-analysis`; the
//! same records give the same results. The page asks no other host for anything.

mod data;
mod figures;
mod html;
mod page;
mod provenance;
mod recognition;
mod results;
mod stiffness;
mod summary;
mod tables;
#[cfg(test)]
mod tests;
mod text;
mod touches;
mod units;

use std::{io::Write, path::Path};

use rig_record::{Chain, Run, StoredRecord, UnreadableRecord};
use rig_store::export::ExportError;

use data::RunData;
use results::RunResults;
pub use summary::{
    ClassificationSummary, RecognitionSummary, RunSummary, ShiftSummary, StiffnessSummary,
};
pub use touches::{TouchRow, TouchStatus};

/// The report as one HTML file.
///
/// A damaged journal gives the report of what stands before the damage, and says so.
///
/// # Errors
/// [`UnreadableRecord`] when a record cannot be understood.
pub fn render(run: &Run, chain: &Chain) -> Result<String, UnreadableRecord> {
    let data = RunData::read(&chain.records)?;
    let results = RunResults::of(&data);
    Ok(page::page(run, &chain.verdict, &data, &results))
}

/// The results for programs. The report and the data are those in `folder`.
///
/// # Errors
/// [`UnreadableRecord`] when a record cannot be understood.
pub fn summary(
    run: &Run,
    records: &[StoredRecord],
    folder: &Path,
) -> Result<RunSummary, UnreadableRecord> {
    let data = RunData::read(records)?;
    Ok(summary::summary(run, &data, &RunResults::of(&data), folder))
}

/// The results for a person at a terminal: the table of shifts, the sensitivity, the stiffness of
/// the samples and the rate of recognition.
///
/// # Errors
/// [`UnreadableRecord`] when a record cannot be understood.
pub fn text(run: &Run, records: &[StoredRecord]) -> Result<String, UnreadableRecord> {
    let data = RunData::read(records)?;
    Ok(text::text(run, &data, &RunResults::of(&data)))
}

/// The table of touches as CSV: one row for every planned touch, with what became of it.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn touches_csv(
    run: &Run,
    records: &[StoredRecord],
    out: &mut impl Write,
) -> Result<(), ExportError> {
    let data = RunData::read(records)?;
    let rows = touches::rows(run, &data, &RunResults::of(&data));
    touches::csv(run, &data, &rows, out)
}
