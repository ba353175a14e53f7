//! The program as a person or a script starts it.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Starts the program in the repository, as the README does.
fn rigd(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).current_dir(repository()).output().unwrap()
}

fn stdout(output: &Output) -> &str {
    std::str::from_utf8(&output.stdout).unwrap()
}

fn stderr(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_run_ends_with_its_results_its_report_and_its_data() {
    let data = TempDir::new().unwrap();
    let dir = data.path().to_str().unwrap();
    let output = rigd(&["run", "config/protocols/smoke.toml", "--data", dir, "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let result = json(&output);
    let keys: BTreeSet<&str> = result.as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "classification",
        "data",
        "no_load_hz",
        "prompts",
        "report",
        "rig_seconds",
        "run_id",
        "sensitivity_hz_per_mpa",
        "shifts",
        "status",
        "touches",
        "wall_seconds",
    ];
    assert!(expected.iter().all(|key| keys.contains(key)), "{keys:?}");
    assert_eq!(result["status"], "completed");
    assert_eq!(result["touches"], 18);
    assert_eq!(result["shifts"].as_array().unwrap().len(), 2 * 3 * 2);
    let report = fs::read_to_string(result["report"].as_str().unwrap()).unwrap();
    assert!(report.contains("<svg") && !report.contains("src=\"http"));
    for file in ["touches.csv", "sweeps.csv", "readings.csv", "searches.csv", "records.jsonl"] {
        assert!(Path::new(result["data"].as_str().unwrap()).join(file).exists(), "{file}");
    }

    let shown = json(&rigd(&["show", "latest", "--data", dir, "--json"]));
    assert_eq!(shown, result);
    let runs = json(&rigd(&["runs", "--data", dir, "--json"]));
    assert_eq!(runs[0]["run_id"], result["run_id"]);
    let touches = rigd(&["export", "latest", "--data", dir, "--format", "csv"]);
    assert_eq!(stdout(&touches).lines().count(), 1 + 18);
    let searches = ["export", "latest", "--data", dir, "--format", "csv", "--table", "searches"];
    let searches = rigd(&searches);
    assert!(stdout(&searches).starts_with("step,direction,angle_deg,surface_mm,"));
    assert!(stdout(&searches).lines().count() > 1 + 18);
    let records = rigd(&["export", "latest", "--data", dir, "--format", "jsonl"]);
    for line in stdout(&records).lines() {
        serde_json::from_str::<Value>(line).unwrap();
    }
    let copy = data.path().join("again.html");
    let again = rigd(&["report", "latest", "--data", dir, "--out", copy.to_str().unwrap()]);
    assert!(again.status.success(), "{}", stderr(&again));
    assert_eq!(fs::read_to_string(copy).unwrap(), report);
}

#[test]
fn check_lists_the_steps_and_moves_nothing() {
    let output = rigd(&["check", "config/protocols/three-direction.toml"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let text = stdout(&output);
    assert!(text.contains("main/3/left/30/1"), "{text}");
    assert!(text.contains("can run on simulated bench: 110 touches"), "{text}");
    let view = json(&rigd(&["check", "config/protocols/three-direction.toml", "--json"]));
    assert_eq!(view["is_runnable"], true);
    assert_eq!(view["touches"], 110);
    let on_bench = rigd(&[
        "check",
        "config/protocols/three-direction.toml",
        "--rig",
        "config/rigs/bench.toml",
    ]);
    assert!(on_bench.status.success(), "{}", stderr(&on_bench));
}

#[test]
fn a_bad_protocol_is_refused_with_every_fault_and_its_place() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("bad.toml");
    let good = fs::read_to_string(repository().join("config/protocols/smoke.toml")).unwrap();
    let bad =
        good.replace("indentation_mm", "indentaton_mm").replace("trials = 6", "trials = \"six\"");
    assert_ne!(good, bad);
    fs::write(&path, bad).unwrap();
    for command in ["check", "run"] {
        let output = rigd(&[command, path.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stdout(&output).is_empty());
        let faults = stderr(&output);
        assert!(faults.contains("did you mean `indentation_mm`?"), "{faults}");
        assert!(faults.lines().count() >= 2, "{faults}");
        assert!(faults.lines().all(|line| line.starts_with(path.to_str().unwrap())), "{faults}");
    }
}

#[test]
fn failures_have_their_exit_codes() {
    let data = TempDir::new().unwrap();
    let dir = data.path().to_str().unwrap();
    let code = |args: &[&str]| rigd(args).status.code();
    assert_eq!(code(&["check", "no-such-file.toml"]), Some(1));
    assert_eq!(code(&["runs", "--data", dir]), Some(1));
    assert_eq!(code(&["fly"]), Some(2));
    let output = rigd(&["run", "config/protocols/smoke.toml", "--data", dir]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(code(&["show", "0000", "--data", dir]), Some(3));
    // Ports that are not there.
    let bench = ["--rig", "config/rigs/bench.toml"];
    let run = ["run", "config/protocols/smoke.toml", "--data", dir, bench[0], bench[1]];
    assert_eq!(code(&run), Some(1));
}
