//! The records of a run in the forms that other programs read.
//!
//! The same records give the same bytes. Except for two columns of the touches and for the documents,
//! they contain no wall time and no id of the run, so that two runs of one protocol with the same
//! seed give the same files.

mod arrow;
mod column;
mod documents;
mod error;
mod hdf5;
mod parquet;
mod records;
mod sealed;
mod table;
#[cfg(test)]
mod tests;
mod touches;
mod touchstone;
mod values;

use std::io::Write;

pub use column::{Column, ColumnKind, TableName};
pub use documents::documents;
pub use error::ExportError;
pub use hdf5::Hdf5Export;
use records::{Ends, Take};
use rig_record::{Run, StoredRecord, Sweep};
pub use sealed::{SealDocument, Signature, sealed};
pub use table::TableFormat;
use table::{Table, TableValue};
pub use touchstone::touchstone;

use crate::results::RunResults;

/// Every record in order, one JSON object a line: `seq`, `rig_us`, `digest` and the `record`.
///
/// # Errors
/// Errors of the writer.
pub fn jsonl(records: &[StoredRecord], out: &mut (impl Write + ?Sized)) -> Result<(), ExportError> {
    for StoredRecord { seq, rig_us, digest, payload, .. } in records {
        writeln!(
            out,
            r#"{{"seq":{seq},"rig_us":{rig_us},"digest":"{digest}","record":{payload}}}"#
        )?;
    }
    Ok(())
}

/// What the rows of records say of their run.
#[derive(Debug)]
pub struct RunColumns {
    run: String,
    ends: Ends,
}

impl RunColumns {
    /// For a run, the ascending epochs of all its records and of those of its amendments, and whether no real
    /// device took part.
    pub fn new(run: &Run, epochs: Vec<u64>, is_simulated: bool) -> Self {
        Self { run: run.short_name(), ends: Ends::new(epochs, is_simulated) }
    }
}

/// Writes a table of one or several runs.
#[derive(Debug)]
pub struct TableExport<W: Write + Send> {
    name: TableName,
    table: Table<W>,
    /// The first column names the run.
    is_of_several: bool,
}

impl<W: Write + Send> TableExport<W> {
    /// A table. With `is_of_several`, its first column names the run.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn new(
        name: TableName,
        format: TableFormat,
        is_of_several: bool,
        out: W,
    ) -> Result<Self, ExportError> {
        let mut columns = name.columns();
        if is_of_several {
            columns.insert(0, column::RUN);
        }
        Ok(Self { name, table: Table::new(columns, format, out)?, is_of_several })
    }

    /// Adds the rows of a run: its results, and its records with those of its amendments behind them.
    ///
    /// # Errors
    /// Errors of the writer, or a record that cannot be understood.
    pub fn add(
        &mut self,
        results: &RunResults,
        records: &[StoredRecord],
    ) -> Result<(), ExportError> {
        let table = &mut self.table;
        rows(self.name, results, records, self.is_of_several, &mut |row| table.row(row))
    }

    /// Adds the rows of some records of a run, which come in order. The table of touches has none: its rows are
    /// made of results.
    ///
    /// # Errors
    /// As for [`Self::add`].
    pub fn add_records(
        &mut self,
        of: &RunColumns,
        records: &[StoredRecord],
    ) -> Result<(), ExportError> {
        let table = &mut self.table;
        let mut take = named(&of.run, self.is_of_several, |row| table.row(row));
        of_records(self.name, records, &of.ends, &mut take)
    }

    /// Writes what is left.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn finish(self) -> Result<(), ExportError> {
        self.table.finish()
    }
}

/// Gives each row of a table of a run. With `is_of_several`, its first value names the run.
fn rows(
    name: TableName,
    results: &RunResults,
    records: &[StoredRecord],
    is_of_several: bool,
    take: Take<'_>,
) -> Result<(), ExportError> {
    let run = results.run.short_name();
    let mut take = named(&run, is_of_several, take);
    if name == TableName::Touches {
        let (run_id, is_simulated) = (results.run.id.to_string(), results.data.is_simulated());
        let mut touches = results.touches.iter();
        return touches.try_for_each(|row| take(&touches::touch(row, &run_id, is_simulated)));
    }
    of_records(name, records, &Ends::of(records), &mut take)
}

/// Takes rows whose first value, with `is_of_several`, becomes the name of the run.
fn named(
    run: &str,
    is_of_several: bool,
    mut take: impl FnMut(&[TableValue<'_>]) -> Result<(), ExportError>,
) -> impl FnMut(&[TableValue<'_>]) -> Result<(), ExportError> {
    move |row| {
        if is_of_several { take(&[&[TableValue::Text(run)], row].concat()) } else { take(row) }
    }
}

/// Gives each row that records make.
fn of_records(
    name: TableName,
    records: &[StoredRecord],
    ends: &Ends,
    take: Take<'_>,
) -> Result<(), ExportError> {
    match name {
        TableName::Touches => Ok(()),
        TableName::Sweeps => records::sweeps(records, ends, take),
        TableName::Readings => records::readings(records, ends, take),
        TableName::Searches => records::searches(records, ends, take),
    }
}

/// A table of one run.
///
/// # Errors
/// As for [`TableExport::add`].
pub fn table(
    name: TableName,
    format: TableFormat,
    results: &RunResults,
    records: &[StoredRecord],
    out: impl Write + Send,
) -> Result<(), ExportError> {
    let mut export = TableExport::new(name, format, false, out)?;
    export.add(results, records)?;
    export.finish()
}

/// One row for each reading of a sweep, as CSV, with the columns of the table of readings except those
/// that name the sweep.
///
/// # Errors
/// Errors of the writer.
pub fn sweep_csv(sweep: &Sweep, out: &mut (impl Write + Send)) -> Result<(), ExportError> {
    let columns = [&column::READING[..], &column::FIT].concat();
    let mut table = Table::new(columns, TableFormat::Csv, out)?;
    records::of_one_sweep(sweep, &mut |row| table.row(row))?;
    table.finish()
}
