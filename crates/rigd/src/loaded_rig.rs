//! Loads a rig file and the scene that it names, for opening the rig.

use std::path::{Path, PathBuf};

use rig_commission::Basis;
use rig_contact::SensorDescription;
use rig_files::{
    Complaint, Faults, FileKind,
    rig_file::{Connection, Pace, RigFile, Simulation},
};
use rig_model::{AnalyzerRange, RigLimits};
use rig_store::{Digest, Source};
use sha2::{Digest as _, Sha256};

use crate::files::read;
pub use crate::{files::FileError, instruments::Instruments, simulation::LoadedScene};

/// A rig file with its scene.
#[derive(Debug)]
pub struct LoadedRig {
    /// Where the rig file is; empty for one that no file has.
    pub path: PathBuf,
    /// The rig file.
    pub file: RigFile,
    /// What its devices must be told.
    pub instruments: Instruments,
    /// Its text, for the journal.
    pub source: Source,
    /// The scene of a simulated rig.
    pub scene: Option<LoadedScene>,
}

/// The facts about a rig that a protocol is checked against.
#[derive(Debug, Clone)]
pub struct RigFacts {
    /// Name of the rig.
    pub name: String,
    /// Limits of the bench for every protocol.
    pub limits: RigLimits,
    /// Names of the samples of a simulated rig. On a real bench, a person places the samples.
    pub known_samples: Option<Vec<String>>,
    /// Names and stiffness of the samples that are known, MPa, for what is expected of touches.
    pub stiffness_mpa: Vec<(String, f64)>,
    /// The sensor of the rig file.
    pub sensor: SensorDescription,
    /// Position of the rotary axis at the zero of its drive, degrees.
    pub rotary_zero_deg: f64,
    /// What calibrations of this rig rest on.
    pub basis: Basis,
    /// The data directory whose calibrations a run would cite; `None` where nothing is known of it.
    pub data: Option<PathBuf>,
    /// Whether the rig is simulated.
    pub is_simulated: bool,
    /// Whether time passes as fast as the simulation computes.
    pub is_virtual_time: bool,
}

/// A missing scene that a rig file names.
#[derive(Debug, thiserror::Error)]
#[error("scene = \"{}\": {instead}", scene.display())]
struct NoScene {
    scene: PathBuf,
    instead: String,
}

impl Complaint for NoScene {}

impl LoadedRig {
    /// Reads a rig file and the scene that it names.
    ///
    /// # Errors
    /// [`FileError`], with every fault of the file.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let (name, text) = read(path, FileKind::Rig)?;
        let mut file = RigFile::read(&name, &text).map_err(FileError::Faults)?;
        let instruments = Instruments::load(path, &file)?;
        file.limits.analyzer.shortest_integration_s =
            instruments.analyzer.shortest_integration_s(AnalyzerRange::RESONANCE_HZ);
        file.limits.analyzer.min_level_v = instruments.analyzer.level_v.0;
        file.limits.motion.slowest_mm_per_s =
            instruments.linear.speed.slowest_per_s(&file.linear.scale);
        let scene = file.scene(path).map(|scene| LoadedScene::load(&scene)).transpose();
        let scene = scene.map_err(|error| at_its_name(error, &name, &file.connection))?;
        if scene.is_some() {
            instruments.check_simulated(path, &file)?;
        }
        let source = Source { name: file.name.clone(), toml: text };
        Ok(Self { path: path.to_owned(), file, instruments, source, scene })
    }

    /// SHA-256 of the rig file and the instrument files, from which everything is known that moves it.
    pub fn digest(&self) -> Digest {
        let mut all = Sha256::new();
        let own = self.instruments.own_files.into_iter().flatten();
        for text in [&self.source].into_iter().chain(own).map(|file| file.toml.as_bytes()) {
            all.update((text.len() as u64).to_le_bytes());
            all.update(text);
        }
        Digest::from_bytes(all.finalize().into())
    }

    /// The facts that a protocol is checked against.
    pub fn facts(&self) -> RigFacts {
        let names = |loaded: &LoadedScene| {
            loaded.known_samples().into_iter().map(|(name, _)| name).collect()
        };
        RigFacts {
            name: self.file.name.clone(),
            limits: self.file.limits,
            known_samples: self.scene.as_ref().map(names),
            stiffness_mpa: self.known_samples(),
            sensor: self.file.sensor.clone(),
            rotary_zero_deg: self.file.rotary.scale.zero.value(),
            basis: self.basis(),
            data: None,
            is_simulated: self.is_simulated(),
            is_virtual_time: self.is_virtual_time(),
        }
    }

    /// Names and stiffness, MPa, of the known samples: those of the scene on a simulated rig, those of
    /// the rig file on a real one.
    pub fn known_samples(&self) -> Vec<(String, f64)> {
        if let Some(loaded) = &self.scene {
            return loaded.known_samples();
        }
        let samples = self.file.samples.iter();
        samples.map(|sample| (sample.name.clone(), sample.stiffness_mpa)).collect()
    }

    /// Whether the rig is simulated.
    pub const fn is_simulated(&self) -> bool {
        self.scene.is_some()
    }

    /// What calibrations of this rig rest on.
    pub fn basis(&self) -> Basis {
        Basis::of(&self.file, self.instruments.drive_files())
    }

    /// Whether the rig is simulated, on a bench whose drives move it as the rig file says. Its person sees that, and
    /// it needs no calibration.
    pub fn is_put_together_as_described(&self) -> bool {
        self.scene.as_ref().is_some_and(|scene| scene.is_described_by(&self.file))
    }

    /// Whether time passes as fast as the simulation computes.
    pub const fn is_virtual_time(&self) -> bool {
        matches!(&self.file.connection, Connection::Simulated(Simulation { pace, .. }) if matches!(pace, Pace::Virtual))
    }
}

impl RigFacts {
    /// These facts for runs in a data directory, whose calibrations they cite.
    #[must_use]
    pub fn with_data(self, data: &Path) -> Self {
        Self { data: Some(data.to_owned()), ..self }
    }
}

/// Makes a missing scene a fault of the rig file.
fn at_its_name(error: FileError, rig: &str, connection: &Connection) -> FileError {
    match (error, connection) {
        (
            FileError::Missing { instead, .. },
            Connection::Simulated(Simulation { scene, scene_location, .. }),
        ) => {
            let mut faults = Faults::new(rig);
            faults.refuse(*scene_location, &NoScene { scene: scene.clone(), instead });
            FileError::Faults(faults)
        }
        (error, _) => error,
    }
}
