//! The verdict of the checker on a run, recorded beside its report.

use std::{fs, path::Path};

use rig_model::with_causes;
use rig_report::RunVerdict;
use rig_store::{Reader, RunId};
use rig_verify::{Finding, JournalError, Verdict};

use crate::run_folder;

/// The file in the folder of a run.
pub(crate) const FILE: &str = "verify.json";

/// Checks the journal of a run and records the verdict in the folder of the run.
///
/// # Errors
/// [`JournalError`] if the journal cannot be checked. A verdict that cannot be recorded is no error:
/// the directory may be read-only.
pub(crate) fn of(data: &Path, reader: &Reader, run: RunId) -> Result<Verdict, JournalError> {
    let verdict = rig_verify::verify(data, &run.to_string())?;
    let folder = run_folder::of(data, reader, run);
    let record = || {
        let text = serde_json::to_vec_pretty(&verdict)?;
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(FILE), text)
    };
    if let Err(error) = record() {
        tracing::warn!(%error, folder = %folder.display(), "the verdict cannot be recorded");
    }
    Ok(verdict)
}

/// The same, for results and reports. A journal that cannot be checked is not sound.
pub(crate) fn for_report(data: &Path, reader: &Reader, run: RunId) -> RunVerdict {
    match of(data, reader, run) {
        Ok(verdict) => RunVerdict {
            sentence: verdict.sentence(),
            findings: verdict.findings.iter().map(Finding::to_string).collect(),
        },
        Err(error) => {
            let sentence = format!("not checked: {}", with_causes(&error));
            RunVerdict { findings: vec![sentence.clone()], sentence }
        }
    }
}
