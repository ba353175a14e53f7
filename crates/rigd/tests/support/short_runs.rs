//! Data directories with short runs on the simulated bench, and commands on them.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

/// The output of a command on a data directory.
pub(crate) fn rigd(data: &Path, args: &[&str], environment: &[(&str, String)]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(args)
        .args(["--data", data.to_str().unwrap()])
        .envs(environment.iter().map(|(name, value)| (name, value)))
        .current_dir(root)
        .output()
        .unwrap()
}

/// The JSON of a command that succeeds.
#[track_caller]
pub(crate) fn json(data: &Path, args: &[&str]) -> Value {
    let output = rigd(data, &[args, &["--json"]].concat(), &[]);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A folder with a data directory `data` with this number of runs of four touches.
pub(crate) fn with_runs(count: usize) -> TempDir {
    let folder = TempDir::new().unwrap();
    run_short(folder.path(), count);
    folder
}

/// Makes this number of runs of four touches in the data directory `data` of a folder.
pub(crate) fn run_short(folder: &Path, count: usize) {
    let smoke = include_str!("../../../../config/protocols/smoke.toml");
    let short = smoke
        .replace("directions = [\"front\", \"back\", \"left\"]", "directions = [\"left\"]")
        .replace("angles_deg = [0, 45]", "angles_deg = [30]")
        .replace("trials = 6", "trials = 2");
    let protocol = folder.join("short.toml");
    fs::write(&protocol, short).unwrap();
    for _ in 0..count {
        let run = rigd(&folder.join("data"), &["run", protocol.to_str().unwrap()], &[]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    }
}
