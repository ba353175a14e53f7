//! `rigd export`: the data of a run.

use std::io::{self, BufWriter, Write};

use clap::{Args, ValueEnum};
use rig_report::export;

use super::{Failure, args::RunArg, runs::results_of};

#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    #[command(flatten)]
    run: RunArg,
    /// What to write
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// With `--format csv`: which table
    #[arg(long, value_enum, default_value_t = ExportTable::Touches)]
    table: ExportTable,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExportFormat {
    /// One table with units in its header
    Csv,
    /// Every record, one JSON object a line
    Jsonl,
    /// As `--format csv --table sweeps`
    Sweeps,
    /// As `--format csv --table readings`: every raw reading, which `rigd fit` takes
    Readings,
    /// As `--format csv --table searches`
    Searches,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExportTable {
    /// One row a touch
    Touches,
    /// One row a sweep, with its fit
    Sweeps,
    /// One row a reading: the raw impedance
    Readings,
    /// One row a place tried on the way to a surface
    Searches,
}

pub(super) fn export(args: &ExportArgs) -> Result<(), Failure> {
    let (reader, run) = args.run.find()?;
    let records = match args.format {
        ExportFormat::Jsonl => reader.records(run.id)?,
        _ => reader.amended(run.id)?,
    };
    let mut out = BufWriter::new(io::stdout().lock());
    let table = match args.format {
        ExportFormat::Jsonl => None,
        ExportFormat::Csv => Some(args.table),
        ExportFormat::Sweeps => Some(ExportTable::Sweeps),
        ExportFormat::Readings => Some(ExportTable::Readings),
        ExportFormat::Searches => Some(ExportTable::Searches),
    };
    match table {
        None => export::jsonl(&records, &mut out)?,
        Some(ExportTable::Touches) => results_of(&run, &records)?.touches_csv(&mut out)?,
        Some(ExportTable::Sweeps) => export::sweeps_csv(&records, &mut out)?,
        Some(ExportTable::Readings) => export::readings_csv(&records, &mut out)?,
        Some(ExportTable::Searches) => export::searches_csv(&records, &mut out)?,
    }
    out.flush().map_err(|source| Failure::System { what: "stdout", source })
}
