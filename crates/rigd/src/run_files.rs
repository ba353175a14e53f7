//! The files of a run: the report and the data, in a folder of its own.

mod manifest;
mod staged;

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use rig_report::{
    RunResults, RunSummary, RunVerdict,
    export::{self, ExportError, TableFormat, TableName},
};
use rig_store::{Chain, Reader, Run, RunId, StoreError};
use rig_verify::JournalError;
use schemars::JsonSchema;
use serde::Serialize;

use crate::{local_time, verdict};
use manifest::{FolderFile, MANIFEST, Origin, README, RO_CRATE};
use staged::StagedFolder;
pub(crate) use staged::copy as copy_folder;

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
    /// The journal cannot be checked.
    #[error(transparent)]
    Journal(#[from] JournalError),
}

/// The results of a run for programs, and its files.
#[derive(Debug, Serialize, JsonSchema)]
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

/// A longer name of a folder is cut, bytes. A file name has 255 at most, and while the folder is written it has more.
const NAME_MAX: usize = 160;

/// The folder of the files of a run: the day of its beginning and its short name. Other characters than letters, digits,
/// `-`, `_` and `.` are `_`; such a name, and one that is cut, ends in a part of the run's id, because that of another run
/// may read the same.
pub(crate) fn folder(data: &Path, run: &Run) -> PathBuf {
    let day = run.started_at.get(..10).unwrap_or("unknown");
    let is_kept = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.');
    let short = run.short_name();
    let mut name = short.replace(|c| !is_kept(c), "_");
    let end = (0..=NAME_MAX).rev().find(|end| name.is_char_boundary(*end)).unwrap_or(0);
    name.truncate(end);
    if name != short {
        name = format!("{name}_{}", own_part(&run.id.to_string()));
    }
    root(data).join(format!("{day}_{name}"))
}

/// The directory of the folders of all runs.
pub(crate) fn root(data: &Path) -> PathBuf {
    data.join("runs")
}

/// The random end of the id of a run: its beginning is the time.
fn own_part(id: &str) -> &str {
    id.rsplit('-').next().unwrap_or(id)
}

/// The report in the folder of a run.
pub(crate) fn report(data: &Path, run: &Run) -> PathBuf {
    folder(data, run).join(REPORT)
}

/// Size of the files in the folder of a run, bytes; those that cannot be read count nothing.
pub(crate) fn size_of_folder(folder: &Path) -> u64 {
    let files = fs::read_dir(folder).into_iter().flatten().flatten();
    files.filter_map(|file| Some(file.metadata().ok()?.len())).sum()
}

/// Writes the report and the data of a run; of an amendment, those of the amended run. The folder has all
/// of its files or is left as it was.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write(data: &Path, run: RunId) -> Result<RunFiles, RunFilesError> {
    let reader = Reader::open(data)?;
    let run = reader.amended_run(reader.run(run)?)?;
    let chain = reader.chain(run.id)?;
    let records = reader.amend(run.id, chain.records.clone())?;
    let results = RunResults::new(&run, &records).map_err(StoreError::from)?;
    let found = rig_verify::verify(data, &run.id.to_string())?;
    let verdict = verdict::in_words(&found);

    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    let mut add = |name: &str, bytes: Vec<u8>| files.push((name.to_owned(), bytes));
    let began = local_time::local(&results.run().started_at);
    add(REPORT, results.html(&chain.check, &verdict, &began).into_bytes());
    rig_store::intact(run.id, &chain.check)?;
    for name in TableName::ALL {
        for format in TableFormat::ALL {
            let mut bytes = Vec::new();
            export::table(name, format, &results, &records, &mut bytes)?;
            add(&format!("{}.{}", name.name(), format.extension()), bytes);
        }
    }
    let (mut lines, mut documents) = (Vec::new(), Vec::new());
    export::jsonl(&chain.records, &mut lines)?;
    export::documents(&results, &records, &mut documents)?;
    add("records.jsonl", lines);
    add("documents.jsonl", documents);
    if let Some(started) = results.started() {
        let sources = [
            ("run.toml", Some(&started.protocol)),
            ("rig.toml", Some(&started.rig)),
            ("scene.toml", started.scene.as_ref()),
        ];
        for (name, source) in sources {
            if let Some(source) = source {
                add(name, source.toml.clone().into_bytes());
            }
        }
    }
    let folder = folder(data, &run);
    let json = |name: &str, value: &dyn Fn() -> serde_json::Result<Vec<u8>>| {
        let failed = |error| RunFilesError::File {
            path: folder.join(name),
            source: io::Error::other(error),
        };
        value().map_err(failed)
    };
    add("verify.json", json("verify.json", &|| serde_json::to_vec_pretty(&found))?);

    let origin = Origin::new(&results, &chain, &records, &found, reader.origin(run.id)?);
    let names: Vec<String> = files.iter().map(|(name, _)| name.clone()).collect();
    files.insert(0, (README.to_owned(), origin.readme(&names).into_bytes()));
    let mut listed: Vec<FolderFile> =
        files.iter().map(|(name, bytes)| FolderFile::new(name, bytes)).collect();
    let crate_metadata = json(RO_CRATE, &|| serde_json::to_vec_pretty(&origin.ro_crate(&listed)))?;
    listed.push(FolderFile::new(RO_CRATE, &crate_metadata));
    let manifest = json(MANIFEST, &|| serde_json::to_vec_pretty(&origin.manifest(&listed)))?;
    files.extend([(RO_CRATE.to_owned(), crate_metadata), (MANIFEST.to_owned(), manifest)]);
    keep_another_run(&folder, run.id)?;
    put(&folder, &files)?;
    Ok(RunFiles { results, verdict, report: folder.join(REPORT), data: folder })
}

/// Gives the folder of another run, such as one of a journal that was lost, a name with a part of its id.
fn keep_another_run(folder: &Path, run: RunId) -> Result<(), RunFilesError> {
    let Ok(text) = fs::read(folder.join(MANIFEST)) else { return Ok(()) };
    let manifest: serde_json::Value = serde_json::from_slice(&text).unwrap_or_default();
    let Some(other) = manifest["run_id"].as_str().filter(|other| *other != run.to_string()) else {
        return Ok(());
    };
    let mut name = folder.file_name().unwrap_or_default().to_owned();
    name.push(format!("_{}", own_part(other)));
    let kept = folder.with_file_name(name);
    fs::rename(folder, &kept).map_err(|source| RunFilesError::File { path: kept, source })
}

/// Puts files in the place of a folder.
fn put(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<(), RunFilesError> {
    let failed = |path: PathBuf| move |source| RunFilesError::File { path, source };
    let mut staged = StagedFolder::new(folder).map_err(failed(folder.to_path_buf()))?;
    for (name, bytes) in files {
        staged.write(name, bytes).map_err(failed(folder.join(name)))?;
    }
    staged.put_in_place(manifest::is_own).map_err(failed(folder.to_path_buf()))
}

/// Writes the report of a run to a file. Of a damaged journal it shows the records before the damage.
///
/// # Errors
/// [`RunFilesError`] names the file.
pub fn write_report(
    data: &Path,
    reader: &Reader,
    run: RunId,
    path: &Path,
) -> Result<(), RunFilesError> {
    let (run, chain): (_, Chain) = (reader.run(run)?, reader.chain(run)?);
    let records = reader.amend(run.id, chain.records)?;
    let results = RunResults::new(&run, &records).map_err(StoreError::from)?;
    let began = local_time::local(&run.started_at);
    let html = results.html(&chain.check, &verdict::for_report(data, run.id), &began);
    fs::write(path, html).map_err(|source| RunFilesError::File { path: path.to_path_buf(), source })
}
