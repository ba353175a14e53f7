//! Loads a protocol file and checks it against a rig.

use std::path::Path;

use rig_files::{Faults, FileKind};
use rig_model::RigLimits;
use rig_protocol::{
    ExpectedTouch, NoSensitivity, Plan, Protocol, Sensitivity, Summary, TouchModel,
};
use rig_store::{RunStarted, Source};

use crate::{
    aim,
    files::read,
    loaded_rig::{FileError, RigFacts},
    sensitivity::RigModel,
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
    /// File of the calibration by which the aim expects the error of depths; `None` without one, or without an aim.
    pub(crate) screw_file: Option<String>,
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
        let model = RigModel::new(rig);
        let loaded = Self::new(&protocol, text, &rig.limits, rig.known_samples.as_deref(), &model)?;
        Ok(Self { screw_file: model.screw_file(), ..loaded })
    }

    /// The protocol of a run on a rig with these limits, with the settings that the run had chosen for its aim.
    ///
    /// # Errors
    /// Every fault of the text on this rig.
    pub(crate) fn of_run(
        started: &RunStarted,
        limits: &RigLimits,
        known_samples: Option<&[String]>,
    ) -> Result<Self, Faults> {
        let Source { name, toml } = &started.protocol;
        FileKind::Protocol.expect(name, toml)?;
        let protocol = Protocol::read(name, toml);
        let chosen = started.aim.as_ref().and_then(|aim| aim::chosen(&aim.settings));
        let protocol = match chosen {
            Some(chosen) => protocol.with_chosen(&chosen),
            None => protocol,
        };
        Self::new(&protocol, toml, limits, known_samples, &NoModel)
    }

    fn new(
        protocol: &Protocol,
        text: &str,
        limits: &RigLimits,
        known_samples: Option<&[String]>,
        model: &dyn TouchModel,
    ) -> Result<Self, Faults> {
        let plan = Plan::new(protocol, limits, known_samples, model)?;
        let summary = plan.summary(limits);
        let source = Source { name: plan.name.clone(), toml: text.to_owned() };
        Ok(Self { plan, summary, source, screw_file: None })
    }
}

/// A run has chosen its settings when it began; nothing is expected again.
struct NoModel;

impl TouchModel for NoModel {
    fn sensitivity(&self, _: &ExpectedTouch<'_>) -> Result<Sensitivity, NoSensitivity> {
        Err(NoSensitivity::OutsideModel)
    }
}
