//! The folder of a run: whole, verified, and exported in every form.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use rig_verify::StatedModel;
use serde_json::Value;
use tempfile::TempDir;

fn rigd(data: &Path, args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(args)
        .args(["--data", data.to_str().unwrap()])
        .current_dir(root)
        .output()
        .unwrap()
}

/// A data directory with this number of runs.
fn with_runs(count: usize) -> TempDir {
    let data = TempDir::new().unwrap();
    // Touches are swept on a grid of settled points, as Touchstone wants them.
    let smoke = include_str!("../../../config/protocols/smoke.toml");
    let (head, contact) = smoke.split_once("[contact_sweep]").unwrap();
    let grid = "max_hz = 260\nmethod = \"uniform\"\nsettle_s = 0.2\npoints = 61";
    let contact = contact.replace("max_hz = 260", grid);
    assert!(contact.contains(grid), "{contact}");
    let protocol = data.path().join("protocol.toml");
    fs::write(&protocol, format!("{head}[contact_sweep]{contact}")).unwrap();
    for _ in 0..count {
        let run = rigd(data.path(), &["run", protocol.to_str().unwrap()]);
        // Some of the touches are refused.
        assert_eq!(run.status.code(), Some(6), "{}", String::from_utf8_lossy(&run.stderr));
    }
    data
}

/// The folder of the first run.
fn folder(data: &Path) -> PathBuf {
    let folders = fs::read_dir(data.join("runs")).unwrap().map(|entry| entry.unwrap().path());
    folders.into_iter().find(|path| path.to_str().unwrap().ends_with("_smoke-1")).unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// One file is found, and why.
#[track_caller]
fn check_found(output: &Output, file: &str, what: &str) {
    assert_eq!(output.status.code(), Some(7));
    let view: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(view["is_sound"], true, "the journal is sound");
    let found = view["files"].as_array().unwrap();
    assert_eq!((found.len(), &found[0]["file"]), (1, &file.into()), "{view}");
    assert!(found[0]["what"].as_str().unwrap().contains(what), "{view}");
}

/// The model of the run is learnt and judged by rigd, and computed again by the checker.
#[test]
fn the_checker_confirms_chi_squared_of_the_model_and_refutes_another() {
    let data = with_runs(1);
    let view = |arguments: &[&str]| -> Value {
        serde_json::from_slice(&rigd(data.path(), arguments).stdout).unwrap()
    };
    let verified = view(&["verify", "latest", "--json"]);
    let model = &view(&["show", "latest", "--json"])["model"];
    assert_eq!(verified["model"]["is_confirmed"], true, "{verified}");
    let stated = StatedModel {
        tangential_ratio: model["tangential_ratio"]["value"].as_f64().unwrap(),
        arm_mm: model["arm_mm"]["value"].as_f64().unwrap(),
        is_held_by_stage: model["depth"] == "stage",
        learnt: ["tangential_ratio", "arm_mm"]
            .into_iter()
            .filter(|term| !model[term]["sigma"].is_null())
            .count(),
        chi2_per_dof: model["chi2_per_dof"].as_f64().unwrap(),
        degrees_of_freedom: serde_json::from_value(model["degrees_of_freedom"].clone()).unwrap(),
    };
    let run = verified["run"].as_str().unwrap();
    let confirmed = |stated: StatedModel| {
        rig_verify::verify_model(data.path(), run, &stated).unwrap().is_confirmed
    };
    assert_eq!(confirmed(stated), Some(true));
    for other in [
        StatedModel { chi2_per_dof: stated.chi2_per_dof + 0.02, ..stated },
        StatedModel { degrees_of_freedom: stated.degrees_of_freedom + 1, ..stated },
        StatedModel { tangential_ratio: stated.tangential_ratio + 0.1, ..stated },
        StatedModel { is_held_by_stage: !stated.is_held_by_stage, ..stated },
    ] {
        assert_eq!(confirmed(other), Some(false), "{other:?}");
    }
}

/// The references of its touches lie between two sweeps of the free sensor, on a bench that drifts.
#[test]
fn the_checker_confirms_chi_squared_of_a_run_with_references_by_drift() {
    let data = TempDir::new().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let write = |name: &str, of: &str, from: &str, to: &str| {
        let text = fs::read_to_string(root.join(of)).unwrap();
        assert!(text.contains(from), "{from}");
        let path = data.path().join(name);
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let walk = ("walk_hz_per_sqrt_hour = 0.1", "walk_hz_per_sqrt_hour = 1.0");
    let scene = write("scene.toml", "scenes/paper.toml", walk.0, walk.1);
    let rig = write("rig.toml", "rigs/simulated.toml", "../scenes/paper.toml", &scene);
    let policy = ("# no_load = \"every-sample\"", "no_load = \"by-drift\"");
    let protocol = write("by-drift.toml", "protocols/three-direction.toml", policy.0, policy.1);
    let run = rigd(data.path(), &["run", &protocol, "--rig", &rig, "--json"]);
    let run: Value = serde_json::from_slice(&run.stdout).unwrap();
    // Touches that share the sweep before them have references of their own between it and the next one.
    let touches = run["touch_results"].as_array().unwrap();
    let of = |key: &str| {
        touches.iter().map(|touch| touch[key].to_string()).collect::<BTreeSet<_>>().len()
    };
    assert!(
        of("no_load_hz") > of("no_load_sweep") + 10,
        "{} and {}",
        of("no_load_hz"),
        of("no_load_sweep")
    );
    let verified = rigd(data.path(), &["verify", "latest", "--json"]);
    let verified: Value = serde_json::from_slice(&verified.stdout).unwrap();
    assert_eq!(verified["model"]["is_confirmed"], true, "{}", verified["model"]);
}

#[test]
fn a_file_that_differs_from_the_manifest_is_found_and_the_folder_can_be_written_again() {
    let data = with_runs(1);
    let folder = folder(data.path());
    let verify = || rigd(data.path(), &["verify", "latest", "--json"]);
    assert!(verify().status.success(), "{}", stdout(&verify()));
    fs::write(folder.join("notes.txt"), "the sample was dry").unwrap();
    assert!(verify().status.success(), "a note of a person is no finding");

    let touches = fs::read_to_string(folder.join("touches.csv")).unwrap();
    fs::write(folder.join("touches.csv"), touches.replace("\"main\"", "\"mein\"")).unwrap();
    check_found(&verify(), "touches.csv", "SHA-256");
    fs::write(folder.join("touches.csv"), format!("{touches}\n")).unwrap();
    check_found(&verify(), "touches.csv", "bytes");
    fs::remove_file(folder.join("touches.csv")).unwrap();
    check_found(&verify(), "touches.csv", "missing");
    assert!(rigd(data.path(), &["report", "latest"]).status.success());
    let manifest = folder.join("manifest.json");
    let text = fs::read_to_string(&manifest).unwrap();
    let origin: Value = serde_json::from_str(&text).unwrap();
    for id in ["run_id", "journal_id", "bench_id"] {
        assert_eq!(origin[id].as_str().unwrap().len(), 36, "{id}");
    }
    let commit = origin["commit"].as_str().unwrap();
    assert!(commit.len() == 10 && origin["software"].as_str().unwrap().contains(commit), "{text}");
    let digest = text.split("\"digest\": \"").nth(1).unwrap()[..64].to_owned();
    fs::write(&manifest, text.replace(&digest, &"0".repeat(64))).unwrap();
    check_found(&verify(), "manifest.json", "rigd report");
    fs::remove_file(&manifest).unwrap();
    check_found(&verify(), "manifest.json", "missing");

    assert!(rigd(data.path(), &["report", "latest"]).status.success());
    assert!(verify().status.success(), "{}", stdout(&verify()));
    assert_eq!(fs::read_to_string(folder.join("touches.csv")).unwrap(), touches);
    let notes = fs::read_to_string(folder.join("notes.txt")).unwrap();
    assert_eq!(notes, "the sample was dry");
}

#[test]
fn one_or_several_runs_are_exported_in_every_form() {
    let data = with_runs(2);
    let export = |args: &[&str]| rigd(data.path(), &[&["export"], args].concat());
    let both = stdout(&export(&["smoke-1", "smoke-2", "--format", "csv", "--table", "sweeps"]));
    let one = stdout(&export(&["smoke-2", "--format", "sweeps"]));
    assert!(both.starts_with("run,sweep,purpose,"), "{both}");
    let second: Vec<&str> =
        both.lines().filter_map(|line| line.strip_prefix("\"smoke-2\",")).collect();
    assert_eq!(second, one.lines().skip(1).collect::<Vec<_>>());
    assert_eq!(both.matches("\n\"smoke-1\",").count(), second.len());

    let parquet = export(&["smoke-1", "--format", "parquet", "--table", "readings"]);
    assert!(parquet.stdout.starts_with(b"PAR1") && parquet.stdout.ends_with(b"PAR1"));
    assert_eq!(parquet.stdout, fs::read(folder(data.path()).join("readings.parquet")).unwrap());
    let documents = stdout(&export(&["smoke-1", "smoke-2", "--format", "documents"]));
    assert_eq!(documents.lines().filter(|line| line.contains("\"name\":\"stop\"")).count(), 2);

    // A file that `rigd fit` reads, with the resonance of the run.
    let touchstone = data.path().join("sweep.s1p");
    let path = touchstone.to_str().unwrap();
    assert!(
        export(&["smoke-1", "--format", "touchstone", "--sweep", "2", "--out", path])
            .status
            .success()
    );
    let fit =
        Command::new(env!("CARGO_BIN_EXE_rigd")).args(["fit", path, "--json"]).output().unwrap();
    assert!(fit.status.success(), "{}", String::from_utf8_lossy(&fit.stderr));

    let many = data.path().join("many");
    let path = many.to_str().unwrap();
    let sweeps = one.lines().count() - 1;
    for (format, files) in [("touchstone", 2 * sweeps), ("jsonl", 2)] {
        let without = export(&["smoke-1", "smoke-2", "--format", format]);
        assert_eq!(without.status.code(), Some(2), "{format} needs a directory");
        let out = export(&["smoke-1", "smoke-2", "--format", format, "--out", path]);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        assert_eq!(fs::read_dir(&many).unwrap().count(), files, "{format}");
        fs::remove_dir_all(&many).unwrap();
    }
    let none = export(&["smoke-1", "--format", "touchstone", "--sweep", "999"]);
    assert_eq!(none.status.code(), Some(3));
}

/// Runs a command as a user who may only read.
fn rigd_as_reader(data: &Path, args: &[&str]) -> Output {
    use std::os::unix::{fs::MetadataExt, process::CommandExt};
    const NOBODY: u32 = 65_534;
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.args(args).args(["--data", data.to_str().unwrap()]).current_dir("/");
    // Nothing is forbidden to root.
    if fs::metadata(data).unwrap().uid() == 0 {
        command.uid(NOBODY);
    }
    command.output().unwrap()
}

/// Sets the rights to a directory and to all in it: to read, and to write or not.
fn set_rights(directory: &Path, is_writable: bool) {
    use std::os::unix::fs::PermissionsExt;
    let bits = |path: &Path| match (path.is_dir(), is_writable) {
        (true, false) => 0o555,
        (false, false) => 0o444,
        (true, true) => 0o755,
        (false, true) => 0o644,
    };
    let mut paths = vec![directory.to_owned()];
    while let Some(path) = paths.pop() {
        if path.is_dir() {
            paths.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        }
        fs::set_permissions(&path, fs::Permissions::from_mode(bits(&path))).unwrap();
    }
}

#[test]
fn a_data_directory_that_may_only_be_read_is_verified_and_reported() {
    use std::os::unix::fs::PermissionsExt;
    let data = with_runs(1);
    set_rights(data.path(), false);
    let elsewhere = TempDir::new().unwrap();
    fs::set_permissions(elsewhere.path(), fs::Permissions::from_mode(0o777)).unwrap();
    let report = elsewhere.path().join("report.html");
    let report = report.to_str().unwrap();
    let verified = rigd_as_reader(data.path(), &["verify", "latest"]);
    let reported = rigd_as_reader(data.path(), &["report", "latest", "--out", report]);
    let nowhere = rigd_as_reader(data.path(), &["report", "latest", "--out", "/proc/report.html"]);
    let here = rigd_as_reader(data.path(), &["report", "latest"]);
    set_rights(data.path(), true);
    let said = |output: &Output| String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(verified.status.success(), "{}", said(&verified));
    assert!(reported.status.success(), "{}", said(&reported));
    let text = fs::read_to_string(report).unwrap();
    assert!(!text.contains("the journal cannot be read"), "the journal was not checked");
    // The advice is another command than the one that was given.
    assert_eq!(here.status.code(), Some(1));
    assert!(said(&here).contains("--out FILE"), "{}", said(&here));
    assert_eq!(nowhere.status.code(), Some(1));
    assert!(!said(&nowhere).contains("--out FILE"), "{}", said(&nowhere));
}

#[test]
fn an_output_replaces_a_file_of_its_kind_and_no_other() {
    let data = with_runs(1);
    let out = data.path().join("out");
    let path = out.to_str().unwrap();
    let outputs: [&[&str]; 10] = [
        &["report", "smoke-1"],
        &["export", "smoke-1", "--format", "csv"],
        &["export", "smoke-1", "--format", "sweeps"],
        &["export", "smoke-1", "--format", "readings"],
        &["export", "smoke-1", "--format", "searches"],
        &["export", "smoke-1", "--format", "parquet"],
        &["export", "smoke-1", "--format", "hdf5"],
        &["export", "smoke-1", "--format", "jsonl"],
        &["export", "smoke-1", "--format", "documents"],
        &["export", "smoke-1", "--format", "touchstone", "--sweep", "2"],
    ];
    let write = |args: &[&str]| rigd(data.path(), &[args, &["--out", path]].concat());
    let refuse = |args: &[&str], what: &str| {
        let before = fs::read(&out).unwrap();
        let refused = write(args);
        let said = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(1), "{args:?} over {what}: {said}");
        assert!(said.contains("it is left as it is"), "{args:?} over {what}: {said}");
        assert!(fs::read(&out).unwrap() == before, "{args:?} over {what}");
    };
    for (index, args) in outputs.iter().enumerate() {
        fs::write(&out, "name = \"protocol\"\n").unwrap();
        refuse(args, "a protocol");
        // Nothing is lost with an empty file.
        fs::write(&out, "").unwrap();
        for _ in 0..2 {
            let done = write(args);
            let said = String::from_utf8_lossy(&done.stderr);
            assert!(done.status.success(), "{args:?}: {said}");
        }
        let other = outputs[(index + 1) % outputs.len()];
        refuse(other, &format!("{args:?}"));
    }
    // A table of several runs has one column more.
    fs::remove_file(&out).unwrap();
    for runs in [&["smoke-1"][..], &["smoke-1", "smoke-1"], &["smoke-1"]] {
        let args = [&["export", "--format", "csv"], runs].concat();
        assert!(write(&args).status.success(), "{runs:?}");
    }
}

/// What is left of a journal whose end was lost, and what is said of one without a list of runs.
#[test]
fn a_journal_that_was_cut_is_salvaged_and_no_advice_leads_in_a_circle() {
    let data = with_runs(1);
    let whole = fs::read(data.path().join("rigd.db")).unwrap();
    for (bytes, code) in [(whole.len() / 2, 0), (4096, 1)] {
        let cut = TempDir::new().unwrap();
        fs::write(cut.path().join("rigd.db"), &whole[..bytes]).unwrap();
        let shown = rigd(cut.path(), &["runs"]);
        let said = String::from_utf8_lossy(&shown.stderr);
        assert!(said.contains("`rigd salvage NEW --data DIR`"), "{said}");
        let new = cut.path().join("new");
        let salvaged = rigd(cut.path(), &["salvage", new.to_str().unwrap()]);
        let said = String::from_utf8_lossy(&salvaged.stderr);
        assert_eq!(salvaged.status.code(), Some(code), "{said}");
        if code == 0 {
            let runs = rigd(&new, &["runs", "--json"]);
            let runs: Value = serde_json::from_slice(&runs.stdout).unwrap();
            assert_eq!(
                (&runs[0]["name"], &runs[0]["status"]),
                (&"smoke-1".into(), &"interrupted".into())
            );
        } else {
            assert!(said.contains("nothing is copied") && !said.contains("rigd salvage"), "{said}");
        }
    }
}

/// Names that read the same in a folder, one that is too long for it, and a run of a journal that was lost.
#[test]
fn no_folder_takes_the_place_of_that_of_another_run() {
    let data = TempDir::new().unwrap();
    let smoke = include_str!("../../../config/protocols/smoke.toml");
    let protocol = data.path().join("protocol.toml");
    let run = |name: &str| {
        let named = smoke.replace("name = \"smoke\"", &format!("name = \"{name}\""));
        assert!(named.contains(name), "{name}");
        fs::write(&protocol, named).unwrap();
        let run = rigd(data.path(), &["run", protocol.to_str().unwrap(), "--json"]);
        let view: Value = serde_json::from_slice(&run.stdout).unwrap();
        assert_eq!(view["is_sound"], true, "{view}");
        PathBuf::from(view["data"].as_str().unwrap())
    };
    let long = "長".repeat(250);
    let mut folders: Vec<PathBuf> = ["a b", "a+b", "a_b", &long].map(run).to_vec();
    for file in ["rigd.db", "rigd.db-wal", "rigd.db-shm"] {
        let _gone = fs::remove_file(data.path().join(file));
    }
    folders.push(run("a_b"));
    assert_eq!(folders[2], folders[4], "the second of both has the name");
    let found = fs::read_dir(data.path().join("runs")).unwrap().count();
    assert_eq!(found, folders.len());
}

/// What a person reads when a record is damaged is what the checker found, with the exit code of a journal that is not sound.
#[test]
fn amendments_are_checked_with_their_run_and_a_damaged_digest_is_a_finding() {
    let data = with_runs(1);
    let skip = ["skip", "smoke-1", "main/5/front/0/1", "--why", "a test"];
    let skipped = rigd(data.path(), &skip);
    assert!(skipped.status.success(), "{}", String::from_utf8_lossy(&skipped.stderr));
    let verified = rigd(data.path(), &["verify", "smoke-1"]);
    assert!(verified.status.success(), "{}", stdout(&verified));
    assert!(stdout(&verified).contains("smoke-1: 1 amendment: sound: "), "{}", stdout(&verified));
    for (kind, count) in [("amendment", "1 amendment: 1 not sound"), ("run", "not sound: ")] {
        let database = rusqlite::Connection::open(data.path().join("rigd.db")).unwrap();
        let damage = "UPDATE records SET digest = zeroblob(32) WHERE seq = 2 AND run IN (SELECT key FROM runs WHERE kind = ?1)";
        assert_eq!(database.execute(damage, [kind]).unwrap(), 1, "{kind}");
        let verified = rigd(data.path(), &["verify", "smoke-1"]);
        assert_eq!(verified.status.code(), Some(7), "{kind}: {}", stdout(&verified));
        assert!(stdout(&verified).contains(count), "{kind}: {}", stdout(&verified));
    }
}

#[test]
fn a_sweep_whose_time_ends_before_its_first_reading_is_refused_in_a_sound_journal() {
    let data = TempDir::new().unwrap();
    let smoke = include_str!("../../../config/protocols/smoke.toml");
    let (head, contact) = smoke.split_once("[contact_sweep]").unwrap();
    let limit = |line: &str| line.starts_with("time_limit_s").then_some("time_limit_s = 0.01");
    let contact: Vec<_> = contact.lines().map(|line| limit(line).unwrap_or(line)).collect();
    let protocol = data.path().join("protocol.toml");
    fs::write(&protocol, format!("{head}[contact_sweep]{}", contact.join("\n"))).unwrap();
    let run = rigd(data.path(), &["run", protocol.to_str().unwrap()]);
    assert_eq!(run.status.code(), Some(6), "{}", String::from_utf8_lossy(&run.stderr));
    let verified = rigd(data.path(), &["verify", "latest"]);
    assert!(verified.status.success(), "{}", stdout(&verified));
}
