//! A rig file with the scene it names, read and checked: everything that is needed to open a rig.

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

/// A rig that can be opened.
#[derive(Debug)]
pub struct LoadedRig {
    /// What the rig file says.
    pub file: RigFile,
    /// Its text, for the journal.
    pub source: Source,
    /// What stands on the bench, when it is simulated.
    pub scene: Option<LoadedScene>,
}

/// A scene behind a simulated rig.
#[derive(Debug)]
pub struct LoadedScene {
    /// What the scene file says.
    pub scene: Scene,
    /// Its text, for the journal.
    pub source: Source,
}

/// What a protocol is checked against.
#[derive(Debug, Clone)]
pub struct RigFacts {
    /// Name of the rig.
    pub name: String,
    /// Its bench.
    pub limits: RigLimits,
    /// The samples that there are. A real bench takes what the person puts there.
    pub known_samples: Option<Vec<String>>,
    /// Whether nothing in the rig is real.
    pub is_simulated: bool,
    /// Whether time passes as fast as the simulation can go.
    pub is_virtual_time: bool,
}

/// A scene that a rig file names and that is not there.
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
        Ok(Self { file, source, scene })
    }

    /// What a protocol is checked against.
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

    /// The samples whose stiffness is known, and how stiff they are, MPa. A simulated rig knows its
    /// own.
    pub fn known_samples(&self) -> Vec<(String, f64)> {
        if let Some(loaded) = &self.scene {
            let samples = loaded.scene.samples.iter();
            return samples.map(|sample| (sample.name.clone(), sample.stiffness_mpa)).collect();
        }
        let samples = self.file.samples.iter();
        samples.map(|sample| (sample.name.clone(), sample.stiffness_mpa)).collect()
    }

    /// Whether nothing in the rig is real.
    pub const fn is_simulated(&self) -> bool {
        self.scene.is_some()
    }

    /// Whether time passes as fast as the simulation can go.
    pub const fn is_virtual_time(&self) -> bool {
        matches!(&self.file.connection, Connection::Simulated(Simulation { pace, .. }) if matches!(pace, Pace::Virtual))
    }
}

impl LoadedScene {
    fn load(path: &Path) -> Result<Self, FileError> {
        let (name, toml) = read(path, FileKind::Scene)?;
        let scene = rig_sim::scene::read(&name, &toml).map_err(FileError::Faults)?;
        // Not the path, so that the same run gives the same bytes wherever its files are.
        let source = Source { name: scene.name.clone(), toml };
        Ok(Self { scene, source })
    }
}

/// A scene that is not there is a fault of the rig file that names it.
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
