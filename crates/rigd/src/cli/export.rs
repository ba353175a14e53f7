//! `rigd export`: runs in the forms that other programs read.

use std::{
    fs::{self, File},
    io::{self, BufWriter, IsTerminal, Write},
    path::{Path, PathBuf},
};

use clap::{Args, ValueEnum};
use rig_record::{Record, StoredRecord};
use rig_report::{
    RunResults,
    export::{self, ExportError, Hdf5Export, RunColumns, TableExport, TableFormat, TableName},
};
use rig_store::{Pages, Reader, Run, Sweep};

use super::{
    Failure,
    args::DataArgs,
    output_file::{self, OutputKind},
    runs::results_of,
};

#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    /// Runs: each its name such as `smoke-7`, its id or enough of it, or `latest`. A table of several
    /// runs has a first column `run`
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<String>,
    #[command(flatten)]
    data: DataArgs,
    /// What to write
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// With `--format csv` or `parquet`: which table
    #[arg(long, value_enum, default_value_t = ExportTable::Touches)]
    table: ExportTable,
    /// With `--format touchstone`: the number of the sweep, of one run
    #[arg(long, value_name = "N")]
    sweep: Option<u64>,
    /// File to write instead of stdout; a directory for `jsonl` of several runs and for `touchstone`
    /// without --sweep. A file that is there is replaced only if it is such an output
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExportFormat {
    /// One table with units in its header
    Csv,
    /// One table as Apache Parquet, with types, units and descriptions
    Parquet,
    /// All tables of the runs as HDF5, with units and descriptions
    Hdf5,
    /// Every record, one JSON object a line
    Jsonl,
    /// The event model of bluesky, one JSON object a line
    Documents,
    /// One sweep as a reflection coefficient (.s1p), or a file for each sweep
    Touchstone,
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

impl ExportArgs {
    /// What a file has.
    fn kind(&self) -> OutputKind {
        match self.format {
            ExportFormat::Csv => OutputKind::Csv(self.table.name()),
            ExportFormat::Sweeps => OutputKind::Csv(TableName::Sweeps),
            ExportFormat::Readings => OutputKind::Csv(TableName::Readings),
            ExportFormat::Searches => OutputKind::Csv(TableName::Searches),
            ExportFormat::Parquet => OutputKind::Parquet,
            ExportFormat::Hdf5 => OutputKind::Hdf5,
            ExportFormat::Jsonl => OutputKind::Records,
            ExportFormat::Documents => OutputKind::Documents,
            ExportFormat::Touchstone => OutputKind::Touchstone,
        }
    }
}

impl ExportTable {
    const fn name(self) -> TableName {
        match self {
            Self::Touches => TableName::Touches,
            Self::Sweeps => TableName::Sweeps,
            Self::Readings => TableName::Readings,
            Self::Searches => TableName::Searches,
        }
    }
}

/// A run, with what reads its journal.
type Found = (Reader, Run);

pub(super) fn export(args: &ExportArgs) -> Result<(), Failure> {
    let runs: Vec<Found> =
        args.runs.iter().map(|wanted| args.data.find(wanted)).collect::<Result<_, _>>()?;
    match args.format {
        ExportFormat::Csv => table(args, &runs, args.table.name(), TableFormat::Csv),
        ExportFormat::Parquet => table(args, &runs, args.table.name(), TableFormat::Parquet),
        ExportFormat::Sweeps => table(args, &runs, TableName::Sweeps, TableFormat::Csv),
        ExportFormat::Readings => table(args, &runs, TableName::Readings, TableFormat::Csv),
        ExportFormat::Searches => table(args, &runs, TableName::Searches, TableFormat::Csv),
        ExportFormat::Documents => {
            let mut out = writer(args)?;
            for run in &runs {
                let (results, records) = read(run)?;
                export::documents(&results, &records, &mut out)?;
            }
            end(out)
        }
        ExportFormat::Hdf5 => hdf5(args, &runs),
        ExportFormat::Jsonl => jsonl(args, &runs),
        ExportFormat::Touchstone => touchstone(args, &runs),
    }
}

/// One table of all runs.
fn table(
    args: &ExportArgs,
    runs: &[Found],
    name: TableName,
    format: TableFormat,
) -> Result<(), Failure> {
    if format == TableFormat::Parquet {
        not_to_a_terminal(args, "Parquet")?;
    }
    let mut out = writer(args)?;
    let mut table = TableExport::new(name, format, runs.len() > 1, &mut out)?;
    for found in runs {
        if name == TableName::Touches {
            let (results, records) = read(found)?;
            table.add(&results, &records)?;
            continue;
        }
        let (reader, run) = found;
        let mut pages = reader.amended_pages(run.id)?;
        let of = RunColumns::new(run, pages.epochs().to_vec(), pages.is_simulated());
        each_page(reader, &mut pages, |page| table.add_records(&of, page))?;
    }
    table.finish()?;
    end(out)
}

/// Gives the records of a run a few at a time, so that they need not fit in memory.
fn each_page(
    reader: &Reader,
    pages: &mut Pages,
    mut take: impl FnMut(&[StoredRecord]) -> Result<(), ExportError>,
) -> Result<(), Failure> {
    loop {
        let page = reader.next_page(pages)?;
        if page.is_empty() {
            return Ok(());
        }
        take(&page)?;
    }
}

/// All tables of all runs in one file.
fn hdf5(args: &ExportArgs, runs: &[Found]) -> Result<(), Failure> {
    not_to_a_terminal(args, "HDF5")?;
    let mut export = Hdf5Export::new(runs.len() > 1);
    for run in runs {
        let (results, records) = read(run)?;
        export.add(&results, &records)?;
    }
    let mut out = writer(args)?;
    out.write_all(&export.finish()).map_err(|source| Failure::System { what: "output", source })?;
    end(out)
}

fn not_to_a_terminal(args: &ExportArgs, what: &'static str) -> Result<(), Failure> {
    let is_terminal = args.out.is_none() && io::stdout().is_terminal();
    if is_terminal { Err(Failure::NoFile { what }) } else { Ok(()) }
}

/// The records of one run, or a file for each run.
fn jsonl(args: &ExportArgs, runs: &[Found]) -> Result<(), Failure> {
    if let [(reader, run)] = runs {
        let mut out = writer(args)?;
        each_page(reader, &mut reader.pages(run.id)?, |page| export::jsonl(page, &mut out))?;
        return end(out);
    }
    let folder = folder(args, "the records of several runs")?;
    for (reader, run) in runs {
        let name = format!("{}_records.jsonl", run.short_name());
        file_in(folder, &name, args.kind(), |out| {
            each_page(reader, &mut reader.pages(run.id)?, |page| export::jsonl(page, out))
        })?;
    }
    Ok(())
}

/// One sweep, or a file for each sweep.
fn touchstone(args: &ExportArgs, runs: &[Found]) -> Result<(), Failure> {
    let sweeps = |(reader, run): &Found| -> Result<Vec<Sweep>, Failure> {
        let of = |stored: &StoredRecord| match stored.record() {
            Ok(Record::Sweep(sweep)) => Some(sweep),
            _ => None,
        };
        Ok(reader.amended(run.id)?.iter().filter_map(of).collect())
    };
    if let ([found], Some(number)) = (runs, args.sweep) {
        let sweep = sweeps(found)?.into_iter().find(|sweep| sweep.number == number);
        let sweep = sweep.ok_or_else(|| Failure::NoSweep { run: found.1.short_name(), number })?;
        let mut out = writer(args)?;
        export::touchstone(&sweep, &mut out)?;
        return end(out);
    }
    let folder = folder(args, "Touchstone, a file for each sweep,")?;
    for found in runs {
        for sweep in sweeps(found)? {
            let name = format!("{}_sweep-{}.s1p", found.1.short_name(), sweep.number);
            file_in(folder, &name, args.kind(), |out| Ok(export::touchstone(&sweep, out)?))?;
        }
    }
    Ok(())
}

/// The results of a run, and its records with those of its amendments behind them.
fn read((reader, run): &Found) -> Result<(RunResults, Vec<StoredRecord>), Failure> {
    let records = reader.amended(run.id)?;
    Ok((results_of(run, &records)?, records))
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> Failure {
    let path = path.to_path_buf();
    |source| Failure::File { path, source }
}

/// The file of `--out`, or stdout.
fn writer(args: &ExportArgs) -> Result<Box<dyn Write + Send>, Failure> {
    Ok(match &args.out {
        Some(path) => Box::new(BufWriter::new(output_file::create(path, args.kind())?)),
        None => Box::new(BufWriter::new(io::stdout())),
    })
}

fn end(mut out: Box<dyn Write + Send>) -> Result<(), Failure> {
    out.flush().map_err(|source| Failure::System { what: "output", source })
}

/// The folder of `--out`, which is made.
fn folder<'a>(args: &'a ExportArgs, what: &'static str) -> Result<&'a PathBuf, Failure> {
    let folder = args.out.as_ref().ok_or(Failure::NoFolder { what })?;
    fs::create_dir_all(folder).map_err(failed(folder))?;
    Ok(folder)
}

fn file_in(
    folder: &Path,
    name: &str,
    kind: OutputKind,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let path = folder.join(name);
    let mut out = BufWriter::new(output_file::create(&path, kind)?);
    write(&mut out)?;
    out.flush().map_err(failed(&path))
}
