//! `rigd restore`: a backup takes the place of a lost journal whole or not at all, also when the program is killed.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "support/preload.rs"]
mod preload;

use std::{
    fs,
    os::unix::process::ExitStatusExt,
    path::Path,
    process::{Command, Output},
};

use rig_store::{ClockJumped, Reader, Record, RunKind, Store};
use tempfile::TempDir;

const NOTES: &str = r#"{"a run": {"note": "good", "is_starred": true}}"#;
const CALIBRATION: &str = "calibrations/stop-20261125T153000Z.toml";

fn rigd(args: &[&Path], environment: &[(&str, String)]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(args)
        .envs(environment.iter().map(|(name, value)| (name, value)))
        .output()
        .unwrap()
}

fn restore(backup: &Path, data: &Path, environment: &[(&str, String)]) -> Output {
    rigd(&[Path::new("restore"), backup, Path::new("--data"), data], environment)
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder with a directory `data` and its backup `backup`, of two runs, a note and the record of a calibration.
fn backed_up() -> TempDir {
    let folder = TempDir::new().unwrap();
    let (data, backup) = (folder.path().join("data"), folder.path().join("backup"));
    let store = Store::open(&data).unwrap();
    for _ in 0..2 {
        let mut run = store.begin(RunKind::Run, "test").unwrap();
        for second in 0..3 {
            run.append(second, &Record::ClockJumped(ClockJumped { jump_s: 1.0 })).unwrap();
        }
        run.commit().unwrap();
    }
    fs::write(data.join("notes.json"), NOTES).unwrap();
    fs::create_dir(data.join("calibrations")).unwrap();
    fs::write(data.join(CALIBRATION), "format = 1").unwrap();
    let done = rigd(&[Path::new("backup"), &backup, Path::new("--data"), &data], &[]);
    assert!(done.status.success(), "{}", said(&done));
    folder
}

#[track_caller]
fn assert_restored(data: &Path, here: &str) {
    let reader = Reader::open(data).unwrap();
    let runs = reader.runs().unwrap();
    assert_eq!(runs.len(), 2, "{here}");
    assert!(runs.iter().all(|run| reader.records(run.id).unwrap().len() == 3), "{here}");
    assert_eq!(fs::read_to_string(data.join("notes.json")).unwrap(), NOTES, "{here}");
    assert_eq!(fs::read_to_string(data.join(CALIBRATION)).unwrap(), "format = 1", "{here}");
}

#[test]
fn a_backup_is_restored_once_and_never_over_anything() {
    let folder = backed_up();
    let (backup, data) = (folder.path().join("backup"), folder.path().join("new"));
    let done = restore(&backup, &data, &[]);
    let told = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(
        done.status.success() && told.starts_with("2 runs and sessions with 6 records restored to")
    );
    assert_restored(&data, "restored");
    let again = restore(&backup, &data, &[]);
    assert_eq!(again.status.code(), Some(1));
    assert!(said(&again).contains("new: is not empty: it has "), "{}", said(&again));
    // A program that writes to an empty directory.
    let used = folder.path().join("used");
    let _store = Store::open(&used).unwrap();
    let refused = restore(&backup, &used, &[]);
    assert!(said(&refused).contains("used: in use by another rigd"), "{}", said(&refused));
    // A file stands where the directory is to be, and above it.
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let beside = [file.clone(), file.join("below")].map(|to| {
        let refused = rigd(&[Path::new("backup"), &to, Path::new("--data"), &data], &[]);
        said(&refused)
    });
    assert!(beside[0].contains("file: is a file; a journal needs a directory"), "{}", beside[0]);
    assert!(beside[1].contains("file/below: "), "{}", beside[1]);
    assert!(beside[1].contains("file/below cannot be made: Not a directory"), "{}", beside[1]);
    let nothing = restore(&folder.path().join("nowhere"), &folder.path().join("other"), &[]);
    assert!(said(&nothing).contains("nowhere: holds no journal"), "{}", said(&nothing));
    assert!(!folder.path().join("other").exists());
}

#[test]
fn a_backup_with_a_flaw_is_not_restored_and_the_flaw_is_named() {
    let folder = backed_up();
    let (backup, data) = (folder.path().join("backup"), folder.path().join("new"));
    let database = rusqlite::Connection::open(backup.join("rigd.db")).unwrap();
    let change =
        "UPDATE records SET payload = replace(payload, '1.0', '2.0') WHERE run = 2 AND seq = 2";
    assert_eq!(database.execute(change, []).unwrap(), 1);
    drop(database);
    let id = Reader::open(&backup).unwrap().runs().unwrap()[0].id.to_string();
    let refused = restore(&backup, &data, &[]);
    assert_eq!(refused.status.code(), Some(7));
    let told = said(&refused);
    assert!(told.contains(&id) && told.contains("nothing was restored"), "{told}");
    assert!(!data.join("rigd.db").exists() && !data.join("notes.json").exists());
    // As it advises: what is whole goes to another directory.
    let salvaged = folder.path().join("salvaged");
    let done = rigd(&[Path::new("salvage"), &salvaged, Path::new("--data"), &backup], &[]);
    assert!(done.status.success(), "{}", said(&done));
    assert_eq!(Reader::open(&salvaged).unwrap().runs().unwrap().len(), 2);
    assert!(salvaged.join("notes.json").exists() && salvaged.join(CALIBRATION).exists());
}

#[test]
fn a_run_whose_entry_in_the_list_is_damaged_is_named_and_its_backup_is_not_whole() {
    let folder = backed_up();
    let [data, backup, new] = ["data", "again", "new"].map(|name| folder.path().join(name));
    let id = Reader::open(&data).unwrap().runs().unwrap()[1].id.to_string();
    let database = rusqlite::Connection::open(data.join("rigd.db")).unwrap();
    database.execute("UPDATE runs SET kind = 'rux' WHERE key = 1", []).unwrap();
    drop(database);
    let listed = rigd(&[Path::new("runs"), Path::new("--data"), &data], &[]);
    assert!(listed.status.success(), "{}", said(&listed));
    assert!(String::from_utf8_lossy(&listed.stdout).contains("test-1"), "{listed:?}");
    let told = said(&listed);
    assert!(told.contains(&format!("not listed: {id}")) && told.contains("rigd salvage"), "{told}");
    let shown = rigd(&[Path::new("show"), Path::new(&id), Path::new("--data"), &data], &[]);
    assert!(said(&shown).contains("rigd salvage NEW"), "{}", said(&shown));
    let copied = rigd(&[Path::new("backup"), &backup, Path::new("--data"), &data], &[]);
    assert_eq!(copied.status.code(), Some(7), "{}", said(&copied));
    assert!(said(&copied).contains("its kind is damaged"), "{}", said(&copied));
    assert_eq!(restore(&backup, &new, &[]).status.code(), Some(7));
}

#[test]
fn a_kill_at_any_call_leaves_no_journal_or_all_of_it() {
    let folder = backed_up();
    let (data, backup) = (folder.path().join("data"), folder.path().join("backup"));
    check_kills(&folder, "restored", |to, environment| restore(&backup, to, environment));
    for command in ["backup", "salvage"] {
        check_kills(&folder, &format!("by-{command}"), |to, environment| {
            rigd(&[Path::new(command), to, Path::new("--data"), &data], environment)
        });
    }
}

/// A command that makes a directory with a journal is killed at each of its calls, and begun again where it left none.
fn check_kills(folder: &TempDir, name: &str, command: impl Fn(&Path, &[(&str, String)]) -> Output) {
    let shim = preload::library("disk/kill.c", folder.path());
    let count = folder.path().join("count");
    let killed = |data: &Path, at: Option<u32>| {
        let mut environment = vec![
            ("LD_PRELOAD", shim.to_str().unwrap().to_owned()),
            ("RIGD_KILL_COUNT", count.to_str().unwrap().to_owned()),
        ];
        environment.extend(at.map(|at| ("RIGD_KILL_AT", at.to_string())));
        let output = command(data, &environment);
        (output, fs::read_to_string(&count).unwrap().parse::<u32>().unwrap())
    };
    let (output, calls) = killed(&folder.path().join(name), None);
    assert!(output.status.success() && calls > 10, "{calls} calls, {}", said(&output));
    let (mut none, mut all) = (0, 0);
    for at in 1..=calls {
        let here = format!("{name}, call {at} of {calls}");
        let data = folder.path().join(format!("{name}-{at}"));
        let (output, _) = killed(&data, Some(at));
        assert_eq!(output.status.signal(), Some(9), "{here}");
        if data.join("rigd.db").exists() {
            assert_restored(&data, &here);
            all += 1;
            continue;
        }
        none += 1;
        let again = killed(&data, None).0;
        assert!(again.status.success(), "{here}: {}", said(&again));
        assert_restored(&data, &here);
    }
    assert!(none > 0 && all > 0, "{name}: {none} without a journal, {all} with all of it");
}
