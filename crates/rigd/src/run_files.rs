//! The files of a run: the report and the data, in a folder of its own.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use rig_report::{
    RunResults, RunSummary,
    export::{self, ExportError},
};
use rig_store::{Chain, Reader, RunId, StoreError};
use serde::Serialize;

/// The files of a run.
#[derive(Debug)]
pub struct RunFiles {
    /// The results of the run.
    pub results: RunResults,
    /// One HTML file.
    pub report: PathBuf,
    /// The folder with the tables and the records.
    pub data: PathBuf,
}

/// Why the files of a run cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RunFilesError {
    /// A file cannot be written.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The journal cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A table cannot be made.
    #[error(transparent)]
    Export(#[from] ExportError),
}

/// Folder of the files of a run. Its name says whether the run was simulated.
pub fn folder(data: &Path, reader: &Reader, run: RunId) -> PathBuf {
    let suffix = if reader.is_simulated(run) { "-simulated" } else { "" };
    data.join("runs").join(format!("{run}{suffix}"))
}

/// The results of a run for programs, and its files.
#[derive(Debug, Serialize)]
pub struct ResultsView {
    #[serde(flatten)]
    summary: RunSummary,
    /// Path of the report, an HTML file.
    report: PathBuf,
    /// The folder with the data.
    data: PathBuf,
}

impl ResultsView {
    /// The results of a run whose files are in `folder`.
    pub fn new(results: &RunResults, folder: PathBuf) -> Self {
        Self { summary: results.summary(), report: folder.join(REPORT), data: folder }
    }
}

const REPORT: &str = "report.html";

/// Writes the report and the data of a run.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write(data: &Path, run: RunId) -> Result<RunFiles, RunFilesError> {
    let reader = Reader::open(data)?;
    let folder = folder(data, &reader, run);
    fs::create_dir_all(&folder)
        .map_err(|source| RunFilesError::File { path: folder.clone(), source })?;
    let report = folder.join(REPORT);
    let (results, chain) = write_report(&reader, run, &report)?;
    rig_store::intact(run, &chain.check)?;
    let records = reader.amend(run, chain.records.clone())?;
    let file = |name: &str, table: &dyn Fn(&mut Vec<u8>) -> Result<(), ExportError>| {
        let mut bytes = Vec::new();
        table(&mut bytes)?;
        write_file(&folder.join(name), &bytes)
    };
    file("touches.csv", &|out| results.touches_csv(out))?;
    file("sweeps.csv", &|out| export::sweeps_csv(&records, out))?;
    file("readings.csv", &|out| export::readings_csv(&records, out))?;
    file("searches.csv", &|out| export::searches_csv(&records, out))?;
    file("records.jsonl", &|out| export::jsonl(&chain.records, out))?;
    Ok(RunFiles { results, report, data: folder })
}

/// Writes the report of a run to a file, and returns its results and records.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write_report(
    reader: &Reader,
    run: RunId,
    path: &Path,
) -> Result<(RunResults, Chain), RunFilesError> {
    let (run, chain) = (reader.run(run)?, reader.chain(run)?);
    let records = reader.amend(run.id, chain.records.clone())?;
    let results = RunResults::new(&run, &records).map_err(StoreError::from)?;
    write_file(path, results.html(&chain.check).as_bytes())?;
    Ok((results, chain))
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), RunFilesError> {
    fs::write(path, bytes)
        .map_err(|source| RunFilesError::File { path: path.to_path_buf(), source })
}
