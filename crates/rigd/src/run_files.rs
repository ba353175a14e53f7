//! What a run leaves as files: the report and the data, in a folder of its own.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use rig_store::{Reader, RunId, StoreError, export};

use crate::report;

/// The files of a run.
#[derive(Debug)]
pub struct RunFiles {
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
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The journal cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A table cannot be made.
    #[error(transparent)]
    Export(#[from] export::ExportError),
}

/// Where the files of a run are. The name says whether the run was simulated.
pub fn folder(data: &Path, reader: &Reader, run: RunId) -> PathBuf {
    let suffix = if reader.is_simulated(run) { "-simulated" } else { "" };
    data.join("runs").join(format!("{run}{suffix}"))
}

/// Writes the report and the data of a run.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write(data: &Path, run: RunId) -> Result<RunFiles, RunFilesError> {
    let reader = Reader::open(data)?;
    let folder = folder(data, &reader, run);
    fs::create_dir_all(&folder)
        .map_err(|source| RunFilesError::File { path: folder.clone(), source })?;
    let report = folder.join("report.html");
    write_report(&reader, run, &report)?;
    let records = reader.records(run)?;
    let mut bytes = Vec::new();
    report::touches_csv(&reader.run(run)?, &records, &mut bytes)?;
    write_file(&folder.join("touches.csv"), &bytes)?;
    bytes.clear();
    export::sweeps_csv(&records, &mut bytes)?;
    write_file(&folder.join("sweeps.csv"), &bytes)?;
    bytes.clear();
    export::readings_csv(&records, &mut bytes)?;
    write_file(&folder.join("readings.csv"), &bytes)?;
    bytes.clear();
    export::searches_csv(&records, &mut bytes)?;
    write_file(&folder.join("searches.csv"), &bytes)?;
    bytes.clear();
    export::jsonl(&records, &mut bytes)?;
    write_file(&folder.join("records.jsonl"), &bytes)?;
    Ok(RunFiles { report, data: folder })
}

/// Writes the report of a run to a file.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write_report(reader: &Reader, run: RunId, path: &Path) -> Result<(), RunFilesError> {
    let html = report::render(&reader.run(run)?, &reader.chain(run)?).map_err(StoreError::from)?;
    write_file(path, html.as_bytes())
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), RunFilesError> {
    fs::write(path, bytes)
        .map_err(|source| RunFilesError::File { path: path.to_path_buf(), source })
}
