//! No simulated bench: these types have no value, so that nothing of them is in the program.

use std::{convert::Infallible, path::Path};

use rig_commission::{Answer, Asked};
use rig_engine::Event;
use rig_files::rig_file::RigFile;
use rig_link::Endpoint;
use rig_store::Source;

use crate::{files::FileError, instruments::SimulatedMakes};

/// No bench can be simulated.
#[derive(Debug, Clone)]
pub enum SimHandle {}

/// No scene can be set up, so none fails.
pub type SceneError = Infallible;

/// No scene can be loaded.
#[derive(Debug)]
pub enum LoadedScene {}

impl LoadedScene {
    /// Refuses every scene.
    ///
    /// # Errors
    /// Always [`FileError::Missing`].
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let instead = "this rigd was built without the simulator; name the ports of a bench \
                       (connection = \"ports\"), or use a rigd with the simulator";
        Err(FileError::Missing { path: path.to_owned(), instead: instead.to_owned() })
    }

    pub(crate) const fn source(&self) -> &Source {
        match *self {}
    }

    pub(crate) const fn is_described_by(&self, _: &RigFile) -> bool {
        match *self {}
    }

    pub(crate) const fn known_samples(&self) -> Vec<(String, f64)> {
        match *self {}
    }
}

/// Nobody is at the bench.
#[derive(Debug)]
pub(crate) enum BenchPerson {}

impl BenchPerson {
    pub(crate) const fn look(&mut self) {
        match *self {}
    }

    pub(crate) const fn answer(&mut self, _: Asked) -> Answer {
        match *self {}
    }
}

/// No rig is simulated.
#[derive(Debug, Clone)]
pub(crate) enum Simulation {}

impl Simulation {
    #[expect(clippy::needless_pass_by_value, reason = "as with the simulator")]
    pub(crate) const fn start(
        _: &RigFile,
        _: SimulatedMakes,
        scene: LoadedScene,
        _: Option<SimHandle>,
    ) -> Result<Self, SceneError> {
        match scene {}
    }

    pub(crate) const fn handle(&self) -> SimHandle {
        match *self {}
    }

    pub(crate) const fn analyzer(&self, _: &RigFile) -> Endpoint {
        match *self {}
    }

    pub(crate) const fn bus(&self, _: &RigFile) -> Endpoint {
        match *self {}
    }

    pub(crate) const fn sees_nothing_below(&self) -> bool {
        match *self {}
    }

    pub(crate) const fn person(&self, _: u64) -> Option<BenchPerson> {
        match *self {}
    }

    pub(crate) const fn follow_hand(&self, _: Asked, _: Answer) {
        match *self {}
    }

    pub(crate) const fn answers(&self, _: &Event) -> bool {
        match *self {}
    }

    pub(crate) const fn follow(&self, _: &Event, _: &[String]) {
        match *self {}
    }
}
