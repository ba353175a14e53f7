//! Loads a protocol file and checks it against a rig.

use std::path::Path;

use rig_files::{Faults, FileKind};
use rig_protocol::{Plan, Protocol, Summary};
use rig_store::Source;

use crate::{
    files::read,
    loaded_rig::{FileError, RigFacts},
};

/// A protocol that a rig can run.
#[derive(Debug, Clone)]
pub struct LoadedProtocol {
    /// Steps of the protocol.
    pub plan: Plan,
    /// Number of steps, extremes and duration.
    pub summary: Summary,
    /// The text, for the journal.
    pub source: Source,
}

impl LoadedProtocol {
    /// Reads a protocol file and checks it against the rig.
    ///
    /// # Errors
    /// [`FileError`], with every fault of the file.
    pub fn load(path: &Path, rig: &RigFacts) -> Result<Self, FileError> {
        let (name, text) = read(path, FileKind::Protocol)?;
        Self::check(&name, &text, rig).map_err(FileError::Faults)
    }

    /// Checks the text of a protocol against the rig; `file` names it in the faults.
    ///
    /// # Errors
    /// Every fault of the text, each with its place.
    pub fn check(file: &str, text: &str, rig: &RigFacts) -> Result<Self, Faults> {
        FileKind::Protocol.expect(file, text)?;
        let protocol = Protocol::read(file, text);
        let plan = Plan::new(&protocol, &rig.limits, rig.known_samples.as_deref())?;
        let summary = plan.summary(&rig.limits);
        let source = Source { name: plan.name.clone(), toml: text.to_owned() };
        Ok(Self { plan, summary, source })
    }
}
