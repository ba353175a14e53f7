//! A bench in a folder of its own, runs on it, and copies of its journal as a crash leaves them.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    time::Duration,
};

use rig_engine::{RigState, RunStatus};
use rig_store::{Reader, Record, RunId, Touch};
use rigd::{
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, RigHandle, RigThread},
};
use tempfile::TempDir;

pub(crate) fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config")
}

/// A simulated rig on which a sample has the same stiffness each time it is placed.
pub(crate) fn write_rig(folder: &Path) -> PathBuf {
    let rig = fs::read_to_string(config().join("rigs/simulated.toml")).unwrap();
    let scene = fs::read_to_string(config().join("scenes/paper.toml")).unwrap();
    let even: String = scene
        .lines()
        .map(|line| match line.split_once(" = ") {
            Some((key @ ("mounting_mm" | "slope_deg" | "stiffness_rel" | "screw_mm"), _)) => {
                format!("{key} = 0.0\n")
            }
            _ => format!("{line}\n"),
        })
        .collect();
    fs::write(folder.join("scene.toml"), even).unwrap();
    let path = folder.join("rig.toml");
    fs::write(&path, rig.replace("../scenes/paper.toml", "scene.toml")).unwrap();
    path
}

/// Four touches with two prompts each way, and two blind touches.
pub(crate) fn write_protocol(folder: &Path) -> PathBuf {
    write_short(folder, "[\"front\", \"left\"]")
}

pub(crate) fn write_short(folder: &Path, directions: &str) -> PathBuf {
    let text = fs::read_to_string(config().join("protocols/smoke.toml")).unwrap();
    let short = text
        .replace(
            "directions = [\"front\", \"back\", \"left\"]",
            &format!("directions = {directions}"),
        )
        .replace("angles_deg = [0, 45]", "angles_deg = [30]")
        .replace("trials = 6", "trials = 2");
    assert!(short.contains("angles_deg = [30]") && short.contains("trials = 2"));
    let path = folder.join("short.toml");
    fs::write(&path, short).unwrap();
    path
}

/// The rig of a folder, in a directory of its own.
pub(crate) struct Bench {
    pub(crate) handle: RigHandle,
    pub(crate) thread: RigThread,
}

impl Bench {
    pub(crate) fn open(rig: &Path, data: &Path) -> Self {
        let (handle, thread) = rig::open(LoadedRig::load(rig).unwrap(), data.to_owned()).unwrap();
        Self { handle, thread }
    }

    /// Starts a protocol as soon as the rig is idle.
    pub(crate) async fn start(&self, rig: &Path, protocol: &Path) -> RunId {
        self.wait_for(RigState::Idle).await;
        let facts = LoadedRig::load(rig).unwrap().facts();
        let protocol = LoadedProtocol::load(protocol, &facts).unwrap();
        self.handle.run(protocol, "Ada").await.unwrap()
    }

    pub(crate) async fn wait_for(&self, state: RigState) {
        let mut status = self.handle.status();
        let reached = status.wait_for(|status| status.snapshot.state == state);
        tokio::time::timeout(Duration::from_secs(60), reached).await.unwrap().unwrap();
    }

    pub(crate) async fn ended(&self, run: RunId) -> RunStatus {
        let mut status = self.handle.status();
        let is_ended = |status: &rig::Status| {
            status.run.as_ref().is_some_and(|view| view.id == run && view.ending.is_some())
                && status.snapshot.state != RigState::Running
        };
        let ended = tokio::time::timeout(Duration::from_secs(60), status.wait_for(is_ended));
        ended.await.unwrap().unwrap().run.as_ref().unwrap().ending.unwrap()
    }

    pub(crate) async fn close(self) {
        self.handle.close().await;
        self.thread.join();
    }
}

/// Replays a protocol to its end.
pub(crate) async fn replay(rig: &Path, protocol: &Path, data: &Path) -> RunId {
    let bench = Bench::open(rig, data);
    let run = bench.start(rig, protocol).await;
    assert_eq!(bench.ended(run).await, RunStatus::Completed);
    bench.close().await;
    run
}

/// A copy of a journal as a crash behind the event `last` would have left it.
pub(crate) fn crashed(whole: &Path, last: u64) -> TempDir {
    let folder = TempDir::new().unwrap();
    fs::copy(whole.join("rigd.db"), folder.path().join("rigd.db")).unwrap();
    let database = rusqlite::Connection::open(folder.path().join("rigd.db")).unwrap();
    database
        .execute_batch(&format!(
            "DELETE FROM seals;
             DELETE FROM records WHERE id > {last};
             DELETE FROM stretches WHERE run NOT IN (SELECT run FROM records);
             DELETE FROM runs WHERE key NOT IN (SELECT run FROM records);
             UPDATE runs SET status = 'running';"
        ))
        .unwrap();
    folder
}

pub(crate) fn touches(reader: &Reader, run: RunId) -> BTreeMap<String, Vec<Touch>> {
    let mut touches = BTreeMap::<_, Vec<Touch>>::new();
    for stored in reader.records(run).unwrap() {
        if let Record::TouchResult(touch) = stored.record().unwrap() {
            touches.entry(touch.touch.step.clone()).or_default().push(touch);
        }
    }
    touches
}

/// The run has every touch of the whole one, once, with the same shift, and is sealed.
#[track_caller]
pub(crate) fn check_same(
    data: &Path,
    run: RunId,
    whole: &BTreeMap<String, Vec<Touch>>,
    here: &str,
) {
    let reader = Reader::open(data).unwrap();
    assert!(reader.run(run).unwrap().is_sealed, "{here}");
    assert_eq!(reader.broken_link().unwrap(), None, "{here}");
    let found = touches(&reader, run);
    assert!(found.keys().eq(whole.keys()), "{here}: {:?}", found.keys());
    for (step, touches) in &found {
        assert_eq!(touches.len(), 1, "{here}: {step}");
        let (found, known) = (&touches[0], &whole[step][0]);
        let sigma_hz = found.shift_sigma_hz.hypot(known.shift_sigma_hz);
        let difference = (found.shift_hz - known.shift_hz).abs() / sigma_hz;
        assert!(difference < 6.0, "{here}: {step} differs by {difference} sigma");
    }
}

/// Runs the program to its end.
/// A bench in a folder of its own, whose run was cut off by a crash.
pub(crate) struct Interrupted {
    folder: TempDir,
    /// The rig file.
    pub(crate) rig: String,
    /// The data directory.
    pub(crate) data: PathBuf,
}

impl Interrupted {
    /// The crash is behind the event `last`.
    pub(crate) fn behind(last: u64) -> Self {
        let folder = TempDir::new().unwrap();
        let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
        let rig = rig.to_str().unwrap().to_owned();
        let run = rigd(folder.path(), &["run", protocol.to_str().unwrap(), "--rig", &rig]);
        assert!(run.status.success());
        let data = folder.path().join("data");
        let crash = crashed(&data, last);
        fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();
        Self { folder, rig, data }
    }

    /// A command on it.
    pub(crate) fn rigd(&self, args: &[&str]) -> Output {
        rigd(self.folder.path(), args)
    }
}

pub(crate) fn rigd(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(args)
        .args(["--data", folder.join("data").to_str().unwrap()])
        .current_dir(config().parent().unwrap())
        .stdin(Stdio::null())
        .output()
        .unwrap()
}
