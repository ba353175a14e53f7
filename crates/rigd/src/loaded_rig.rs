//! Loads a rig file and the scene that it names, for opening the rig.

use std::path::{Path, PathBuf};

use rig_files::{
    Complaint, Faults, FileKind,
    rig_file::{Connection, Pace, RigFile, Simulation},
};
use rig_model::RigLimits;
use rig_sim::world::Scene;
use rig_store::Source;

pub use crate::files::FileError;
use crate::files::read;

/// A rig file with its scene.
#[derive(Debug)]
pub struct LoadedRig {
    /// Where the rig file is; empty for one that no file has.
    pub path: PathBuf,
    /// The rig file.
    pub file: RigFile,
    /// Its text, for the journal.
    pub source: Source,
    /// The scene of a simulated rig.
    pub scene: Option<LoadedScene>,
}

/// The scene of a simulated rig.
#[derive(Debug)]
pub struct LoadedScene {
    /// Contents of the simulated bench.
    pub scene: Scene,
    /// Its text, for the journal.
    pub source: Source,
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
        let file = RigFile::read(&name, &text).map_err(FileError::Faults)?;
        let scene = file.scene(path).map(|scene| LoadedScene::load(&scene)).transpose();
        let scene = scene.map_err(|error| at_its_name(error, &name, &file.connection))?;
        let source = Source { name: file.name.clone(), toml: text };
        Ok(Self { path: path.to_owned(), file, source, scene })
    }

    /// The facts that a protocol is checked against.
    pub fn facts(&self) -> RigFacts {
        let names = |loaded: &LoadedScene| {
            loaded.scene.samples.iter().map(|sample| sample.name.clone()).collect()
        };
        RigFacts {
            name: self.file.name.clone(),
            limits: self.file.limits,
            known_samples: self.scene.as_ref().map(names),
            is_simulated: self.is_simulated(),
            is_virtual_time: self.is_virtual_time(),
        }
    }

    /// Names and stiffness, MPa, of the known samples: those of the scene on a simulated rig, those of
    /// the rig file on a real one.
    pub fn known_samples(&self) -> Vec<(String, f64)> {
        if let Some(loaded) = &self.scene {
            let samples = loaded.scene.samples.iter();
            return samples.map(|sample| (sample.name.clone(), sample.stiffness_mpa)).collect();
        }
        let samples = self.file.samples.iter();
        samples.map(|sample| (sample.name.clone(), sample.stiffness_mpa)).collect()
    }

    /// Whether the rig is simulated.
    pub const fn is_simulated(&self) -> bool {
        self.scene.is_some()
    }

    /// Whether time passes as fast as the simulation computes.
    pub const fn is_virtual_time(&self) -> bool {
        matches!(&self.file.connection, Connection::Simulated(Simulation { pace, .. }) if matches!(pace, Pace::Virtual))
    }
}

impl LoadedScene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// [`FileError`], with every fault of the file.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let (name, toml) = read(path, FileKind::Scene)?;
        let scene = rig_sim::scene::read(&name, &toml).map_err(FileError::Faults)?;
        // The journal has no path, so that a run gives the same bytes wherever its files are.
        let source = Source { name: scene.name.clone(), toml };
        Ok(Self { scene, source })
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
