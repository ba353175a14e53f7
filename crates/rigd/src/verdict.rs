//! The verdict of the checker on a run, in words.

use std::path::Path;

use rig_model::with_causes;
use rig_report::RunVerdict;
use rig_store::RunId;
use rig_verify::{Finding, Verdict};

/// Checks the journal of a run for results and reports. A journal that cannot be checked is not sound.
pub(crate) fn for_report(data: &Path, run: RunId) -> RunVerdict {
    match rig_verify::verify(data, &run.to_string()) {
        Ok(verdict) => in_words(&verdict),
        Err(error) => {
            let sentence = format!("not checked: {}", with_causes(&error));
            RunVerdict { findings: vec![sentence.clone()], sentence }
        }
    }
}

/// A verdict in words.
pub(crate) fn in_words(verdict: &Verdict) -> RunVerdict {
    RunVerdict {
        sentence: verdict.sentence(),
        findings: verdict.findings.iter().map(Finding::to_string).collect(),
    }
}
