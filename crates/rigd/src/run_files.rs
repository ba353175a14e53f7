//! The files of a run: the report and the data, in a folder of its own.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use rig_report::{
    RunResults, RunSummary, RunVerdict,
    export::{self, ExportError},
};
use rig_store::{Chain, Reader, RunId, StoreError};
use serde::Serialize;
use sha2::{Digest as _, Sha256};

use crate::{run_folder, verdict};

/// The files of a run.
#[derive(Debug)]
pub struct RunFiles {
    /// The results of the run.
    pub results: RunResults,
    /// What the checker says of its journal.
    pub verdict: RunVerdict,
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

/// The results of a run for programs, and its files.
#[derive(Debug, Serialize)]
pub struct ResultsView {
    #[serde(flatten)]
    summary: RunSummary,
    /// Whether the checker found nothing in the journal.
    is_sound: bool,
    /// What it found, each in a sentence.
    findings: Vec<String>,
    /// Path of the report, an HTML file.
    report: PathBuf,
    /// The folder with the data.
    data: PathBuf,
}

impl ResultsView {
    /// The results of a run whose files are in `folder`.
    pub fn new(results: &RunResults, verdict: &RunVerdict, folder: PathBuf) -> Self {
        Self {
            summary: results.summary(),
            is_sound: verdict.is_sound(),
            findings: verdict.findings.clone(),
            report: folder.join(REPORT),
            data: folder,
        }
    }
}

const REPORT: &str = "report.html";

/// Writes the report and the data of a run.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write(data: &Path, run: RunId) -> Result<RunFiles, RunFilesError> {
    let reader = Reader::open(data)?;
    let folder = run_folder::of(data, &reader, run);
    fs::create_dir_all(&folder)
        .map_err(|source| RunFilesError::File { path: folder.clone(), source })?;
    let report = folder.join(REPORT);
    let (results, chain, verdict) = write_report(data, &reader, run, &report)?;
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
    write_manifest(&folder, &results, &chain, &verdict)?;
    Ok(RunFiles { results, verdict, report, data: folder })
}

/// Writes the report of a run to a file, and returns its results and records.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write_report(
    data: &Path,
    reader: &Reader,
    run: RunId,
    path: &Path,
) -> Result<(RunResults, Chain, RunVerdict), RunFilesError> {
    let (run, chain) = (reader.run(run)?, reader.chain(run)?);
    let records = reader.amend(run.id, chain.records.clone())?;
    let results = RunResults::new(&run, &records).map_err(StoreError::from)?;
    let verdict = verdict::for_report(data, reader, run.id);
    write_file(path, results.html(&chain.check, &verdict).as_bytes())?;
    Ok((results, chain, verdict))
}

/// What is in the folder of a run, for somebody who has only the folder.
#[derive(Debug, Serialize)]
struct Manifest<'a> {
    run_id: String,
    name: String,
    status: &'static str,
    started_at: &'a str,
    finished_at: Option<&'a str>,
    /// Digest of the last record of the journal.
    digest: Option<String>,
    /// Whether the checker found nothing in the journal.
    is_sound: bool,
    /// What it found, each in a sentence.
    findings: &'a [String],
    files: Vec<ManifestFile>,
}

/// A file in the folder of a run.
#[derive(Debug, Serialize)]
struct ManifestFile {
    name: String,
    bytes: u64,
    sha256: String,
}

const MANIFEST: &str = "manifest.json";

fn write_manifest(
    folder: &Path,
    results: &RunResults,
    chain: &Chain,
    verdict: &RunVerdict,
) -> Result<(), RunFilesError> {
    let failed = |path: &Path, source| RunFilesError::File { path: path.to_path_buf(), source };
    let listed = fs::read_dir(folder).map_err(|source| failed(folder, source))?;
    let mut paths: Vec<PathBuf> = listed.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.retain(|path| path.is_file() && !path.ends_with(MANIFEST));
    paths.sort();
    let of_file = |path: &PathBuf| {
        let bytes = fs::read(path).map_err(|source| failed(path, source))?;
        let hash = Sha256::digest(&bytes);
        Ok(ManifestFile {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            bytes: bytes.len() as u64,
            sha256: rig_store::Digest::from_bytes(hash.into()).to_string(),
        })
    };
    let run = results.run();
    let manifest = Manifest {
        run_id: run.id.to_string(),
        name: run.short_name(),
        status: run.status.name(),
        started_at: &run.started_at,
        finished_at: run.finished_at.as_deref(),
        digest: chain.records.last().map(|last| last.digest.to_string()),
        is_sound: verdict.is_sound(),
        findings: &verdict.findings,
        files: paths.iter().map(of_file).collect::<Result<_, RunFilesError>>()?,
    };
    let path = folder.join(MANIFEST);
    let text = serde_json::to_vec_pretty(&manifest)
        .map_err(|error| failed(&path, io::Error::other(error)))?;
    write_file(&path, &text)
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), RunFilesError> {
    fs::write(path, bytes)
        .map_err(|source| RunFilesError::File { path: path.to_path_buf(), source })
}
