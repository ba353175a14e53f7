//! Shared harness of the whole-system tests: the shipped simulated rig in a directory of its own.

pub mod forge;
pub mod stops;

use std::{
    fs,
    path::{Path, PathBuf},
};

use rig_engine::{Command, RigState, RunStatus};
use rig_sim::control;
use rig_store::{Reader, RunId, StoredRecord};
use rigd::{
    loaded_rig::{LoadedRig, RigFacts},
    protocol_file::LoadedProtocol,
    rig::{self, RigHandle, RigThread, Status},
};
use tempfile::TempDir;

/// A file of the repository.
pub fn shipped(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The text of a file of the repository.
///
/// # Panics
/// When there is no such file.
pub fn text(path: &str) -> String {
    fs::read_to_string(shipped(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// A text with other texts in it.
///
/// # Panics
/// When one is not there to be changed.
pub fn changed(text: &str, changes: &[(&str, &str)]) -> String {
    changes.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "there is no {from:?} in {text}");
        text.replace(from, to)
    })
}

/// The touches of the smoke protocol on sample 5 from the front, at these contact angles, such as `[0, 30]`.
///
/// # Panics
/// When the protocol is not as it was.
pub fn touches_of_smoke(angles_deg: &str) -> String {
    let angles = format!("angles_deg = {angles_deg}");
    let changes = [
        ("samples = [\"1\", \"5\"]", "samples = [\"5\"]"),
        ("directions = [\"front\", \"back\", \"left\"]", "directions = [\"front\"]"),
        ("angles_deg = [0, 45]", &*angles),
    ];
    let text = changed(&text("config/protocols/smoke.toml"), &changes);
    let (touches, _) = text.split_once("[blind]").expect("smoke has blind touches");
    touches.to_owned()
}

/// An open simulated rig with its journal.
#[derive(Debug)]
pub struct TestRig {
    /// Speaks to the rig.
    pub handle: RigHandle,
    /// The limits for protocols.
    pub facts: RigFacts,
    thread: Option<RigThread>,
    data: TempDir,
}

impl TestRig {
    /// Opens the shipped simulated rig, at virtual time, and waits until it is in service.
    ///
    /// # Panics
    /// When it does not come into service: the test has failed.
    pub async fn open() -> Self {
        Self::open_changed(&[]).await
    }

    /// Opens the shipped simulated rig with other texts in its file.
    ///
    /// # Panics
    /// When a text is not there to be changed, or the rig does not come into service.
    pub async fn open_changed(changes: &[(&str, &str)]) -> Self {
        Self::open_bench(changes, &[]).await
    }

    /// Opens the shipped simulated rig with other texts in its file and in its scene.
    ///
    /// # Panics
    /// When a text is not there to be changed, or the rig does not come into service.
    pub async fn open_bench(rig: &[(&str, &str)], scene: &[(&str, &str)]) -> Self {
        let data = TempDir::new().expect("a temporary directory");
        let scene = changed(&text("config/scenes/paper.toml"), scene);
        fs::write(data.path().join("scene.toml"), scene).expect("a temporary file");
        // The scene is named from where the rig file is.
        let text = changed(&text("config/rigs/simulated.toml"), rig);
        let text = changed(&text, &[("../scenes/paper.toml", "scene.toml")]);
        let path = data.path().join("rig.toml");
        fs::write(&path, text).expect("a temporary file");
        let rig = LoadedRig::load(&path).unwrap_or_else(|error| panic!("{error}"));
        let facts = rig.facts();
        let (handle, thread) = rig::open(rig, data.path().to_owned()).expect("the rig opens");
        let this = Self { handle, facts, thread: Some(thread), data };
        this.wait_for("service", |status| status.snapshot.state == RigState::Idle).await;
        this
    }

    /// Waits for a condition of the status.
    ///
    /// # Panics
    /// When the rig closes first.
    pub async fn wait_for(&self, what: &str, condition: impl Fn(&Status) -> bool) -> Status {
        let mut status = self.handle.status();
        let found = status.wait_for(|status| condition(status)).await;
        found.unwrap_or_else(|_| panic!("the rig closed before: {what}")).clone()
    }

    /// A protocol from its text.
    ///
    /// # Panics
    /// When it has faults: the test has failed.
    pub fn protocol(&self, text: &str) -> LoadedProtocol {
        LoadedProtocol::check("test", text, &self.facts).unwrap_or_else(|faults| panic!("{faults}"))
    }

    /// Replays a protocol to its end.
    ///
    /// # Panics
    /// When the rig does not take it.
    pub async fn run(&self, protocol: LoadedProtocol) -> (RunId, RunStatus) {
        let run = self.handle.run(protocol, "test").await.expect("the rig is idle");
        (run, self.ended(run).await)
    }

    /// Waits for the end of a run.
    ///
    /// # Panics
    /// When the rig closes first.
    pub async fn ended(&self, run: RunId) -> RunStatus {
        let ended = |status: &Status| {
            let view = status.run.as_ref().filter(|view| view.id == run);
            view.and_then(|view| view.ending)
        };
        let status = self.wait_for("the end of the run", |status| ended(status).is_some()).await;
        ended(&status).expect("it was waited for")
    }

    /// The data directory.
    pub fn data(&self) -> &Path {
        self.data.path()
    }

    /// A reader of the journal.
    ///
    /// # Panics
    /// When there is none.
    pub fn reader(&self) -> Reader {
        Reader::open(self.data.path()).expect("the rig has a journal")
    }

    /// The records of a run.
    ///
    /// # Panics
    /// When the journal is damaged.
    pub fn records(&self, run: RunId) -> Vec<StoredRecord> {
        self.reader().records(run).expect("the journal is sound")
    }

    /// Gives a command.
    ///
    /// # Errors
    /// The answer of the rig.
    pub async fn command(&self, command: Command) -> Result<(), rig::RequestRefusal> {
        self.handle.command(command, None, "test").await
    }

    /// Lets a fault of the simulator's menu happen, in the words of its control interface.
    ///
    /// # Panics
    /// When there is no such fault.
    pub fn fault(&self, words: &str) {
        let simulation = self.handle.simulation().expect("the rig is simulated");
        simulation.with(|now, rig| {
            control::execute(now, rig, words).unwrap_or_else(|error| panic!("{words}: {error}"));
        });
    }

    /// Closes the rig and waits for its thread.
    pub async fn close(mut self) {
        self.handle.close().await;
        if let Some(thread) = self.thread.take() {
            thread.join();
        }
    }
}
