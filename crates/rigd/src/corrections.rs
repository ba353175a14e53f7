//! The corrections of the analyzer for cable and fixture that were made: a list in the data directory, the latest last.

use std::{io, path::Path};

use clap::ValueEnum;
use rig_store::{CitedCalibration, Digest};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

/// Its file in a data directory.
pub(crate) const FILE: &str = "corrections.json";

/// A correction, by what is between the terminals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum CorrectionKind {
    /// Nothing, with the terminals as far apart as in the measurement
    Open,
    /// A wire that joins them
    Short,
    /// A known impedance
    Load,
}

impl CorrectionKind {
    pub(crate) const ALL: [Self; 3] = [Self::Open, Self::Short, Self::Load];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Short => "short",
            Self::Load => "load",
        }
    }
}

/// A correction that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Correction {
    pub(crate) what: CorrectionKind,
    /// When, UTC.
    pub(crate) at: String,
    pub(crate) cable: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) length_m: Option<f64>,
    /// The identity of the analyzer.
    pub(crate) analyzer: String,
    pub(crate) operator: String,
}

/// The corrections of a data directory; none without the file.
///
/// # Errors
/// The file cannot be read.
pub(crate) fn read(data: &Path) -> io::Result<Vec<Correction>> {
    match std::fs::read(data.join(FILE)) {
        Ok(bytes) => Ok(serde_json::from_slice(&bytes)?),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

/// The last correction of each kind that was made for this analyzer.
pub(crate) fn last_of(
    made: &[Correction],
    kind: CorrectionKind,
    analyzer: &str,
) -> Option<Correction> {
    let is_it = |made: &&Correction| made.what == kind && made.analyzer == analyzer;
    made.iter().rfind(is_it).cloned()
}

/// What a run says of the corrections that were made for its analyzer. Whether they are on is not asked.
///
/// # Errors
/// The file cannot be read.
pub(crate) fn cited(data: &Path, analyzer: &str) -> io::Result<Vec<CitedCalibration>> {
    let made = read(data)?;
    let last = CorrectionKind::ALL.into_iter().filter_map(|kind| last_of(&made, kind, analyzer));
    last.map(|correction| {
        let entry = serde_json::to_vec(&correction)?;
        let Correction { what, at, cable, length_m, operator, .. } = correction;
        let length = length_m.map_or_else(String::new, |metres| format!(", {metres} m"));
        Ok(CitedCalibration {
            kind: what.name().to_owned(),
            made: at,
            person: operator,
            file: FILE.to_owned(),
            sha256: Digest::from_bytes(Sha256::digest(entry).into()).to_string(),
            verdict: None,
            screw: None,
            cable: Some(format!("{cable}{length}")),
        })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_cites_the_last_correction_of_each_kind_that_was_made_for_its_analyzer() {
        let folder = tempfile::tempdir().unwrap();
        assert!(cited(folder.path(), "A").unwrap().is_empty());
        let made = |what, at: &str, analyzer: &str| Correction {
            what,
            at: at.to_owned(),
            cable: "RG174, blue".to_owned(),
            length_m: Some(1.0),
            analyzer: analyzer.to_owned(),
            operator: "ada".to_owned(),
        };
        let all = [
            made(CorrectionKind::Open, "1", "A"),
            made(CorrectionKind::Short, "2", "B"),
            made(CorrectionKind::Open, "3", "A"),
        ];
        std::fs::write(folder.path().join(FILE), serde_json::to_vec(&all).unwrap()).unwrap();
        let found = cited(folder.path(), "A").unwrap();
        let told: Vec<_> = found.iter().map(|one| (&*one.kind, &*one.made)).collect();
        assert_eq!(told, [("open", "3")]);
        assert_eq!(found[0].cable.as_deref(), Some("RG174, blue, 1 m"));
        std::fs::write(folder.path().join(FILE), "[{}]").unwrap();
        assert!(cited(folder.path(), "A").is_err());
    }
}
