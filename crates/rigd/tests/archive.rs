//! `rigd archive`: sealed runs move to an archive whole, or stay, also when the program is killed.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "support/preload.rs"]
mod preload;
#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;
#[path = "support/short_runs.rs"]
mod short_runs;

use std::{
    fs,
    os::unix::process::ExitStatusExt,
    path::{Path, PathBuf},
};

use rig_store::{ChainCheck, Reader, Record, RunId, RunKind, Store, StoreError};
use serde_json::Value;
use short_runs::{json, rigd, with_runs};

/// The runs of protocols, the latest first.
fn runs(reader: &Reader) -> Vec<RunId> {
    let runs = reader.runs().unwrap().into_iter();
    runs.filter(|run| run.kind == RunKind::Run).map(|run| run.id).collect()
}

#[track_caller]
fn assert_sound(data: &Path, run: RunId, here: &str) {
    let verdict = rig_verify::verify(data, &run.to_string()).unwrap();
    assert!(verdict.is_sound, "{here}: {:?}", verdict.findings);
}

/// Names in a directory.
fn names(directory: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(directory) else { return Vec::new() };
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name();
    let mut names: Vec<_> = entries.map(|entry| name(entry).into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_daemon_says_where_an_archived_run_is_and_has_its_readings_no_more() {
    let folder = with_runs(2);
    let (data, archive) = (folder.path().join("data"), folder.path().join("archive"));
    json(&data, &["archive", archive.to_str().unwrap(), "smoke-1"]);
    let (daemon, address) = program::Program::serve(folder.path());
    let listed = program::request(&address, "GET /api/v1/runs", "");
    let listed: Value = serde_json::from_str(listed.split_once("\r\n\r\n").unwrap().1).unwrap();
    let place = names(&archive).into_iter().find(|name| name.contains("smoke-1")).unwrap();
    assert_eq!(listed[0]["archived_to"], Value::Null);
    assert_eq!(listed[1]["archived_to"], archive.join(place).to_str().unwrap());
    assert_eq!(listed[1]["status"], "completed");
    let gone = program::request(&address, "GET /api/v1/runs/smoke-1", "");
    assert!(gone.starts_with("HTTP/1.1 410"), "{gone}");
    daemon.signal(rustix::process::Signal::TERM);
    assert!(daemon.end().0.success());
}

/// Its results are those of the archive, which is never written again.
#[test]
fn no_touch_of_an_archived_run_is_left_out() {
    let folder = with_runs(1);
    let (data, archive) = (folder.path().join("data"), folder.path().join("archive"));
    json(&data, &["archive", archive.to_str().unwrap(), "smoke-1"]);
    let touch = "main/1/left/30/1";
    let refused = rigd(&data, &["skip", "smoke-1", touch, "--why", "it slipped"], &[]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("is archived; its readings are in"), "{said}");
    let (daemon, address) = program::Program::serve(folder.path());
    let body = serde_json::json!({ "step": touch, "why": "it slipped" }).to_string();
    let refused = program::post(&address, "runs/smoke-1/skip", &body);
    assert!(refused.starts_with("HTTP/1.1 409"), "{refused}");
    daemon.signal(rustix::process::Signal::TERM);
    assert!(daemon.end().0.success());
    let all = Reader::open(&data).unwrap().runs().unwrap();
    assert!(all.iter().all(|run| run.kind != RunKind::Amendment), "{all:?}");
}

/// The journal of a program that was killed while it measured a touch of the first run again.
fn with_killed_redo(folder: &Path) -> PathBuf {
    let data = folder.join("data");
    let redo = ["redo", "smoke-1", "main/1/left/30/1", "--why", "it slipped"];
    let redone = rigd(&data, &redo, &[]);
    assert!(redone.status.success(), "{}", String::from_utf8_lossy(&redone.stderr));
    let database = rusqlite::Connection::open(data.join("rigd.db")).unwrap();
    let kill = "
        CREATE TEMP TABLE last AS SELECT records.id FROM records JOIN runs ON runs.key = run
            WHERE runs.kind = 'amendment' AND seq = 3;
        CREATE TEMP TABLE cut AS SELECT DISTINCT run FROM records WHERE id > (SELECT id FROM last);
        DELETE FROM seals WHERE run IN (SELECT run FROM cut);
        DELETE FROM records WHERE id > (SELECT id FROM last);
        UPDATE runs SET status = 'running' WHERE key IN (SELECT run FROM cut);";
    database.execute_batch(kill).unwrap();
    data
}

#[test]
fn an_amendment_that_was_killed_keeps_no_run_from_the_archive() {
    let folder = with_runs(2);
    let data = with_killed_redo(folder.path());
    let outcomes = |to: &Path| -> (Option<i32>, Vec<(String, String)>) {
        let args = ["archive", to.to_str().unwrap(), "--older-than", "0d", "--json"];
        let done = rigd(&data, &args, &[]);
        let said = String::from_utf8_lossy(&done.stderr);
        let view: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|_| panic!("{said}"));
        let text = |run: &Value, of: &str| run[of].as_str().unwrap().to_owned();
        let runs = view.as_array().unwrap().iter();
        let runs = runs.map(|run| (text(run, "name"), text(run, "outcome")));
        (done.status.code(), runs.collect())
    };
    let named = |outcomes: [(&str, &str); 2]| {
        outcomes.map(|(run, outcome)| (run.to_owned(), outcome.to_owned())).to_vec()
    };
    // Another program has the journal, and may still be measuring that touch: the other run goes on.
    let lock = fs::File::options().write(true).open(data.join("rigd.lock")).unwrap();
    lock.try_lock().unwrap();
    let expected = named([("smoke-1", "kept"), ("smoke-2", "copied")]);
    assert_eq!(outcomes(&folder.path().join("first")), (Some(1), expected));
    drop(lock);
    let (code, mut done) = outcomes(&folder.path().join("second"));
    done.sort();
    assert_eq!((code, done), (Some(0), named([("smoke-1", "archived"), ("smoke-2", "archived")])));
    for run in runs(&Reader::open(&data).unwrap()) {
        assert_sound(&data, run, "archived");
    }
}

#[test]
fn a_note_of_an_archive_excuses_no_run_whose_readings_are_still_there() {
    let folder = with_runs(1);
    let (data, archive) = (folder.path().join("data"), folder.path().join("archive"));
    let database = rusqlite::Connection::open(data.join("rigd.db")).unwrap();
    let keep = "CREATE TABLE kept AS SELECT id, payload FROM records WHERE kind = 'sweep'";
    database.execute(keep, []).unwrap();
    json(&data, &["archive", archive.to_str().unwrap(), "smoke-1"]);
    let run = runs(&Reader::open(&data).unwrap())[0];
    assert_sound(&data, run, "archived");
    let put_back =
        "UPDATE records SET payload = (SELECT payload FROM kept WHERE kept.id = records.id)
                    WHERE kind = 'sweep'";
    assert!(database.execute(put_back, []).unwrap() > 0);
    let verdict = rig_verify::verify(&data, &run.to_string()).unwrap();
    let of_seal = |finding: &rig_verify::Finding| finding.check == rig_verify::Check::Seal;
    assert!(verdict.findings.iter().any(of_seal), "{:?}", verdict.findings);
}

#[test]
fn an_archived_run_is_read_from_the_archive_alone() {
    let folder = with_runs(3);
    let (data, archive) = (folder.path().join("data"), folder.path().join("archive"));
    let to = archive.to_str().unwrap();
    let before = json(&data, &["show", "smoke-2"]);
    let foretold = json(&data, &["archive", to, "--keep", "1", "--dry-run"]);
    let outcomes = |view: &Value| -> Vec<String> {
        let of = |run: &Value| format!("{} {}", run["name"].as_str().unwrap(), run["outcome"]);
        view.as_array().unwrap().iter().map(of).collect()
    };
    let expected = ["smoke-2 \"would_be_archived\"", "smoke-1 \"would_be_archived\""];
    assert_eq!(outcomes(&foretold), expected);
    assert!(!archive.exists());
    let done = json(&data, &["archive", to, "--keep", "1", "--operator", "somebody"]);
    assert_eq!(outcomes(&done), ["smoke-2 \"archived\"", "smoke-1 \"archived\""]);
    assert_eq!(done[0]["place"], foretold[0]["place"]);

    let listed = json(&data, &["runs"]);
    assert_eq!(listed[0]["archived_to"], Value::Null);
    assert_eq!(
        (&listed[1]["archived_to"], &listed[1]["name"]),
        (&done[0]["place"], &"smoke-2".into())
    );
    assert_eq!(names(&data.join("runs")).len(), 1, "the folders went along");
    let refused = rigd(&data, &["show", "smoke-2"], &[]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        !refused.status.success() && said.contains("is archived; its readings are in"),
        "{said}"
    );
    for run in ["smoke-1", "smoke-2", "smoke-3"] {
        assert!(json(&data, &["verify", run])["is_sound"].as_bool().unwrap());
    }
    let part = &json(&data, &["verify", "smoke-2"])["archived"];
    assert_eq!(part["place"], done[0]["place"]);

    // The data directory is lost.
    fs::rename(&data, folder.path().join("elsewhere")).unwrap();
    let place = PathBuf::from(done[0]["place"].as_str().unwrap());
    let bytes = fs::read(place.join("rigd.db")).unwrap();
    for from in [&archive, &place] {
        let verified = json(from, &["verify", "smoke-2"]);
        assert_eq!((&verified["is_sound"], &verified["has_folder"]), (&true.into(), &true.into()));
        let shown = json(from, &["show", "smoke-2"]);
        assert_eq!(shown["touches"], before["touches"]);
        assert_eq!(shown["name"], before["name"]);
        let csv = rigd(from, &["export", "smoke-2", "--format", "csv"], &[]);
        assert!(csv.status.success() && csv.stdout.len() > 500, "{csv:?}");
        let report = rigd(from, &["report", "smoke-2"], &[]);
        assert!(report.status.success(), "{}", String::from_utf8_lossy(&report.stderr));
    }
    assert_eq!(json(&archive, &["runs"]).as_array().unwrap().len(), 2);
    assert_eq!(rigd(&archive, &["show", "smoke-3"], &[]).status.code(), Some(3));
    // A damaged object hides no other.
    let damaged = PathBuf::from(done[1]["place"].as_str().unwrap());
    let list = fs::read(damaged.join("object.json")).unwrap();
    fs::write(damaged.join("object.json"), "{").unwrap();
    assert_eq!(json(&archive, &["show", "smoke-2"])["touches"], before["touches"]);
    let said = rigd(&archive, &["show", "smoke-1"], &[]);
    assert!(String::from_utf8_lossy(&said.stderr).contains("object.json"), "{said:?}");
    fs::write(damaged.join("object.json"), list).unwrap();
    fs::write(damaged.join("rigd.db"), "no journal").unwrap();
    let listed = rigd(&archive, &["runs"], &[]);
    let (out, told) =
        (String::from_utf8_lossy(&listed.stdout), String::from_utf8_lossy(&listed.stderr));
    assert!(listed.status.success() && out.contains("smoke-2"), "{listed:?}");
    assert!(told.contains("not listed") && told.contains("smoke-1"), "{told}");
    let written = rigd(&place, &["give-up", "smoke-2"], &[]);
    assert!(!written.status.success());
    assert_eq!(fs::read(place.join("rigd.db")).unwrap(), bytes);
    assert_eq!(names(&place), ["object.json", "rigd.db", "runs"]);
}

#[test]
fn a_directory_with_a_journal_or_its_folders_of_runs_is_no_archive() {
    let folder = with_runs(1);
    let data = folder.path().join("data");
    let before = names(&data);
    for to in [data.clone(), data.join("runs"), data.join("runs/..")] {
        for dry_run in [&[][..], &["--dry-run"]] {
            let to = to.to_str().unwrap();
            let args = [&["archive", to, "--older-than", "0d"], dry_run].concat();
            let output = rigd(&data, &args, &[]);
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{to}: {said}");
            assert!(said.contains("an archive needs one of its own"), "{to}: {said}");
        }
    }
    assert_eq!(names(&data), before);
    assert!(rigd(&data, &["show", "smoke-1"], &[]).status.success());
}

#[test]
fn only_sealed_and_sound_runs_leave_the_journal() {
    let folder = with_runs(2);
    let (data, archive) = (folder.path().join("data"), folder.path().join("archive"));
    let to = archive.to_str().unwrap();
    let store = Store::open(&data).unwrap();
    let mut open = store.begin(RunKind::Run, "open").unwrap();
    open.append(0, &Record::ClockJumped(rig_store::ClockJumped { jump_s: 1.0 })).unwrap();
    open.commit().unwrap();
    drop((open, store));
    // A reading of the latest sound one is changed.
    let database = rusqlite::Connection::open(data.join("rigd.db")).unwrap();
    let change = "UPDATE records SET payload = replace(payload, '0', '1') WHERE kind = 'sweep'
                  AND run = (SELECT key FROM runs WHERE kind = 'run' ORDER BY key LIMIT 1 OFFSET 1)";
    assert!(database.execute(change, []).unwrap() > 0);
    drop(database);
    let output = rigd(&data, &["archive", to, "--older-than", "0d", "--json"], &[]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(7), "{said}");
    let view: Value = serde_json::from_slice(&output.stdout).unwrap();
    let outcome = |index: usize| [&view[index]["name"], &view[index]["outcome"]];
    let all = [outcome(0), outcome(1), outcome(2)];
    let expected = [["open-1", "kept"], ["smoke-2", "refused"], ["smoke-1", "archived"]];
    for (found, expected) in all.iter().zip(expected) {
        assert_eq!(found, &expected, "{view}");
    }
    assert_eq!(names(&archive).iter().filter(|name| name.contains("smoke")).count(), 1);
    // None of them is old.
    let later = json(&data, &["archive", to, "--older-than", "1d"]);
    assert!(later.as_array().unwrap().iter().all(|run| run["outcome"] == "kept"), "{later}");
    assert_eq!(rigd(&data, &["archive", to], &[]).status.code(), Some(2), "a rule is needed");
}

#[test]
fn a_run_is_copied_while_a_daemon_writes_and_taken_out_after_it() {
    let folder = with_runs(1);
    let (data, archive) = (folder.path().join("data"), folder.path().join("archive"));
    let command = ["archive", archive.to_str().unwrap(), "smoke-1"];
    let store = Store::open(&data).unwrap();
    let output = rigd(&data, &[&command[..], &["--json"]].concat(), &[]);
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("in use by another rigd"), "{said}");
    let view: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(view[0]["outcome"], "copied");
    assert!(
        store.reader().unwrap().archive_of(runs(&store.reader().unwrap())[0]).unwrap().is_none()
    );
    drop(store);
    // The copy has been damaged since: nothing is taken out.
    let place = PathBuf::from(view[0]["place"].as_str().unwrap());
    let list = place.join("object.json");
    let whole = fs::read_to_string(&list).unwrap();
    fs::remove_file(&list).unwrap();
    fs::write(&list, whole.replace("\"bytes\": ", "\"bytes\": 1")).unwrap();
    assert_eq!(rigd(&data, &command, &[]).status.code(), Some(7));
    assert_sound(&data, runs(&Reader::open(&data).unwrap())[0], "after a damaged copy");
    fs::write(&list, whole).unwrap();
    // A file that a person has added is not lost.
    let own = data.join("runs").join(&names(&data.join("runs"))[0]);
    fs::write(own.join("by-hand.txt"), "note").unwrap();
    assert_eq!(json(&data, &command)[0]["outcome"], "archived");
    assert!(own.join("by-hand.txt").exists());
    fs::remove_file(own.join("by-hand.txt")).unwrap();
    assert_eq!(json(&data, &command)[0]["outcome"], "archived");
    assert!(!own.exists());
    assert_eq!(json(&data, &command), Value::Array(Vec::new()));
}

#[test]
fn doctor_tells_the_growth_of_a_year_from_the_runs_so_far() {
    let folder = with_runs(2);
    let data = folder.path().join("data");
    let growth = || {
        let findings = json(&data, &["doctor"]);
        let findings = findings["findings"].as_array().unwrap_or_else(|| panic!("{findings}"));
        let found = findings.iter().find(|finding| finding["check"] == "growth");
        found.map(|finding| finding["text"].as_str().unwrap().to_owned())
    };
    assert_eq!(growth(), None, "both runs are of today");
    let database = rusqlite::Connection::open(data.join("rigd.db")).unwrap();
    let earlier =
        "UPDATE runs SET started_at = strftime('%Y-%m-%dT%H:%M:%fZ', started_at, '-10 days')
                   WHERE key = 2";
    assert_eq!(database.execute(earlier, []).unwrap(), 1);
    let text = growth().unwrap();
    assert!(text.ends_with("from 8 touches in 2 runs within 10 days"), "{text}");
}

/// Copies a directory.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), &target).unwrap();
        }
    }
}

#[test]
fn a_kill_at_any_call_leaves_the_run_in_the_journal_or_in_the_archive() {
    /// The copy is placed, the readings are taken out, and the folder is removed within these calls.
    const LAST: u32 = 36;
    let folder = with_runs(2);
    let shim = preload::library("disk/kill.c", folder.path());
    let whole = folder.path().join("data");
    let archive_killed = |data: &Path, at: Option<u32>| {
        let count = folder.path().join("count");
        let mut environment = vec![
            ("LD_PRELOAD", shim.to_str().unwrap().to_owned()),
            ("RIGD_KILL_COUNT", count.to_str().unwrap().to_owned()),
        ];
        environment.extend(at.map(|at| ("RIGD_KILL_AT", at.to_string())));
        let to = data.with_extension("archive");
        let output = rigd(data, &["archive", to.to_str().unwrap(), "smoke-1"], &environment);
        (output, fs::read_to_string(count).unwrap().parse::<u32>().unwrap())
    };
    let data = folder.path().join("first");
    copy(&whole, &data);
    let (output, calls) = archive_killed(&data, None);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(calls > 60, "{calls} calls");
    let (mut only_in_journal, mut in_both, mut archived) = (0, 0, 0);
    // Before the copy is placed, one call is like another; after it, each one counts.
    for at in (1..calls - LAST).step_by(12).chain(calls - LAST..=calls) {
        let here = format!("call {at} of {calls}");
        let data = folder.path().join(format!("at-{at}"));
        let archive = data.with_extension("archive");
        copy(&whole, &data);
        let (output, _) = archive_killed(&data, Some(at));
        assert_eq!(output.status.signal(), Some(9), "{here}");
        let reader = Reader::open(&data).unwrap();
        let [other, run] = runs(&reader)[..] else { panic!("{here}") };
        for run in reader.runs().unwrap() {
            let check = reader.verify(run.id).unwrap();
            assert!(matches!(check, ChainCheck::Intact { .. }), "{here}: {check:?}");
        }
        assert_eq!(reader.broken_link().unwrap(), None, "{here}");
        assert_sound(&data, run, &here);
        let copies: Vec<_> =
            names(&archive).into_iter().filter(|name| name.contains("_smoke-1_")).collect();
        let is_placed = copies.iter().any(|name| !name.starts_with('.'));
        match (reader.records(run), is_placed) {
            (Ok(_), false) => only_in_journal += 1,
            (Ok(_), true) => in_both += 1,
            (Err(StoreError::Archived { place, .. }), true) => {
                assert_sound(Path::new(&place), run, &here);
                archived += 1;
            }
            (found, _) => panic!("{here}: {found:?}"),
        }
        drop(reader);
        let again = archive_killed(&data, None).0;
        let said = String::from_utf8_lossy(&again.stderr).into_owned();
        assert!(again.status.success(), "{here}: {said}");
        let reader = Reader::open(&data).unwrap();
        let place = reader.archive_of(run).unwrap().unwrap().place;
        assert_sound(Path::new(&place), run, &here);
        assert_sound(&data, run, &here);
        assert_sound(&data, other, &here);
        assert_eq!(names(&archive).len(), 2, "{here}: the lock and the run");
        assert_eq!(names(&data.join("runs")).len(), 1, "{here}: the folder of the other run");
        for directory in [&data, &archive] {
            fs::remove_dir_all(directory).unwrap();
        }
    }
    let counts = [only_in_journal, in_both, archived];
    assert!(counts.iter().all(|count| *count > 3), "{counts:?} of {calls}");
}
