//! Resumed runs: after a fault, an abort and a kill of the program, with changes, and touches amended.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

mod kills;
mod skips;
mod support;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use rig_engine::{Command as RigCommand, RigState, RunStatus};
use rig_store::{Clearance, Reader, Record, Resumed, StoredRecord};
use rigd::rig::{self, RequestRefusal, ResumeRefusal};
use tempfile::TempDir;

use support::{
    Bench, Interrupted, check_same, config, crashed, replay, rigd, touches, write_protocol,
    write_rig,
};

#[tokio::test]
async fn a_run_goes_on_after_an_abort_and_after_a_stop_in_the_same_daemon() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let whole_data = folder.path().join("whole");
    let whole = replay(&rig, &protocol, &whole_data).await;
    let whole = touches(&Reader::open(&whole_data).unwrap(), whole);
    let data = folder.path().join("data");
    let bench = Bench::open(&rig, &data);
    let run = bench.start(&rig, &protocol).await;
    let mut status = bench.handle.status();
    for (touches, command, ending) in
        [(1, RigCommand::Abort, RunStatus::Aborted), (3, RigCommand::Stop, RunStatus::Faulted)]
    {
        let far = |status: &rig::Status| {
            status.run.as_ref().is_some_and(|view| view.touches_done >= touches)
        };
        status.wait_for(far).await.unwrap();
        bench.handle.command(command, None, "Ada").await.unwrap();
        assert_eq!(bench.ended(run).await, ending);
        if ending == RunStatus::Faulted {
            bench.wait_for(RigState::Latched).await;
            bench.handle.command(RigCommand::Acknowledge, None, "Ada").await.unwrap();
        }
        bench.wait_for(RigState::Idle).await;
        bench.handle.resume(run, false, "Ada").await.unwrap();
        let refusal = bench.handle.resume(run, false, "Ada").await.unwrap_err();
        let RequestRefusal::Resume(refusal) = refusal else { panic!("{refusal}") };
        assert!(matches!(*refusal, ResumeRefusal::UnderWay { .. }), "{refusal}");
        let view = bench.handle.status().borrow().run.clone().unwrap();
        assert!(view.touches_before >= touches && view.touches_planned() == 6, "{view:?}");
    }
    assert_eq!(bench.ended(run).await, RunStatus::Completed);
    bench.close().await;
    check_same(&data, run, &whole, "resumed twice");
}

#[tokio::test]
async fn a_session_is_sealed_after_a_day() {
    let folder = TempDir::new().unwrap();
    let rig = write_rig(folder.path());
    let text = fs::read_to_string(config().join("protocols/smoke.toml")).unwrap();
    // Thirty touches of an hour.
    let slow = text
        .replace("angles_deg = [0, 45]", "angles_deg = [0, 15, 30, 45]")
        .replace("\n[approach]", "\ndwell_s = 3600\n\n[approach]");
    let protocol = folder.path().join("slow.toml");
    fs::write(&protocol, slow).unwrap();
    let data = folder.path().join("data");
    let bench = Bench::open(&rig, &data);
    let first = bench.handle.status().borrow().session;
    let run = bench.start(&rig, &protocol).await;
    assert_eq!(bench.ended(run).await, RunStatus::Completed);
    let mut status = bench.handle.status();
    let renewed = status.wait_for(|status| status.session != first);
    tokio::time::timeout(Duration::from_secs(60), renewed).await.unwrap().unwrap();
    let reader = Reader::open(&data).unwrap();
    assert!(reader.run(first).unwrap().is_sealed);
    // What the end of the session before it says of the rig does not stand.
    let session = bench.handle.status().borrow().session;
    let states = reader.records(session).unwrap();
    let states = states.iter().filter_map(|stored| match stored.record().unwrap() {
        Record::StateChanged(changed) => Some(changed.state),
        _ => None,
    });
    assert_eq!(states.collect::<Vec<_>>(), ["idle"]);
    // The clock and the axes go on, so that a run of the next session begins as any other.
    let next = bench.start(&rig, &write_protocol(folder.path())).await;
    assert_eq!(bench.ended(next).await, RunStatus::Completed);
    bench.close().await;
    let runs = reader.runs().unwrap();
    assert!(runs.iter().all(|run| run.is_sealed));
    assert_eq!(reader.broken_link().unwrap(), None);
    let archive = TempDir::new().unwrap();
    rig_store::excerpt(&data, next, archive.path()).unwrap();
    for (data, run) in runs.iter().map(|run| (&*data, run.id)).chain([(archive.path(), next)]) {
        let verdict = rig_verify::verify(data, &run.to_string()).unwrap();
        assert!(verdict.is_sound, "{run} in {}: {:#?}", data.display(), verdict.findings);
    }
}

#[test]
fn what_has_changed_is_refused_until_it_is_confirmed() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let (rig_text, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    let analyzer = folder.path().join("analyzer.toml");
    let shipped = fs::read_to_string(config().join("instruments/hioki-im3536.toml")).unwrap();
    let named = shipped.replacen("name = \"hioki-im3536\"", "name = \"our-im3536\"", 1);
    fs::write(&analyzer, named).unwrap();
    let own = fs::read_to_string(&rig).unwrap();
    fs::write(&rig, own.replace("dialect = \"hioki-im3536\"", "dialect = \"analyzer.toml\""))
        .unwrap();
    let whole = rigd(folder.path(), &["run", protocol, "--rig", rig_text]);
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    // A crash in the middle: the journal is cut there.
    let data = folder.path().join("data");
    let whole = fs::canonicalize(&data).unwrap();
    let last = Reader::open(&data).unwrap().events_after(0, 10_000).unwrap().len() as u64 / 2;
    let crash = crashed(&whole, last);
    fs::remove_dir_all(&data).unwrap();
    fs::create_dir(&data).unwrap();
    fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();

    let changed = fs::read_to_string(&rig).unwrap();
    // The probe is clear at another height, from the first retract of the next start on.
    let changed = changed
        .replace("rotary_speed_deg_per_s = 40", "rotary_speed_deg_per_s = 39")
        .replace("clear_mm = 24.5", "clear_mm = 24.1");
    fs::write(&rig, changed).unwrap();
    let changed = fs::read_to_string(&analyzer).unwrap() + "# Edited.\n";
    fs::write(&analyzer, changed).unwrap();
    let resume = ["run", "--resume", "latest", "--rig", rig_text, "--json"];
    let refused = rigd(folder.path(), &resume);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("have changed: rig file") && said.contains("--accept-changes"), "{said}");
    let key = "limits.rotary_speed_deg_per_s";
    assert!(said.contains(&format!("{key} = 40 → ")), "{said}");
    assert!(said.contains(&format!("{key} = 39)")), "{said}");
    assert!(said.contains("instrument file of the analyzer"), "{said}");
    let refused = rigd(folder.path(), &["run", "--resume", "no-such-run", "--rig", rig_text]);
    assert_eq!(refused.status.code(), Some(3));

    let confirmed = [&resume[..], &["--accept-changes"]].concat();
    let done = rigd(folder.path(), &confirmed);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let results: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!((&results["status"], &results["touches"]), (&"completed".into(), &6.into()));
    let reader = Reader::open(&data).unwrap();
    let run = reader.find("latest").unwrap();
    let seam = reader.records(run.id).unwrap().into_iter().find(|one| one.kind == "resumed");
    let Record::Resumed(seam) = seam.unwrap().record().unwrap() else { panic!() };
    let what: Vec<_> = seam.changes.iter().map(|change| &*change.what).collect();
    assert_eq!(what, ["rig file", "instrument file of the analyzer"]);
    let instruments: Vec<_> =
        seam.devices.iter().filter_map(|device| device.instrument.as_ref()).collect();
    assert!(matches!(instruments[..], [of] if of.toml.ends_with("# Edited.\n")), "{instruments:?}");
    assert_sound(&data);
    assert!(seam.rig.unwrap().toml.contains("rotary_speed_deg_per_s = 39"));

    // Asked again, it says the same.
    let again = rigd(folder.path(), &resume);
    assert!(again.status.success() && again.stdout == done.stdout);
}

#[test]
fn a_rig_left_in_contact_moves_only_for_home_and_resume() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let (rig, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    assert!(rigd(folder.path(), &["run", protocol, "--rig", rig]).status.success());
    let data = folder.path().join("data");
    let events = Reader::open(&data).unwrap().events_after(0, 10_000).unwrap();
    let intent = events.iter().find(|stored| stored.kind == "intent").unwrap();
    let crash = crashed(&data, intent.event);
    for name in ["rigd.db-wal", "rigd.db-shm"] {
        _ = fs::remove_file(data.join(name));
    }
    fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();
    let commands: [&[&str]; 3] =
        [&["run", protocol], &["move", "linear", "29"], &["move", "linear", "29"]];
    for args in commands {
        let refused = rigd(folder.path(), &[args, &["--rig", rig]].concat());
        let said = String::from_utf8(refused.stderr).unwrap();
        assert_eq!(refused.status.code(), Some(4), "{args:?}: {said}");
        assert!(said.contains("the probe may be in the sample"), "{said}");
        assert!(said.contains("rigd home"), "{said}");
    }
    let reader = Reader::open(&data).unwrap();
    let session = reader.latest_session("simulated bench").unwrap().unwrap();
    let records = reader.records(session.id).unwrap();
    let probe = records.iter().find_map(|stored| match stored.record().unwrap() {
        Record::Fault(fault) => Some(fault.probe),
        _ => None,
    });
    assert_eq!(probe, Some(Clearance::InContact));
    assert!(records.iter().all(|stored| stored.kind != "moved"), "nothing has moved");
    assert!(rigd(folder.path(), &["home", "--rig", rig]).status.success());
    assert!(rigd(folder.path(), &["move", "linear", "29", "--rig", rig]).status.success());

    let done = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

#[test]
fn a_kill_on_the_way_into_service_stops_nobody_unless_the_probe_was_low_before() {
    for is_low in [false, true] {
        let folder = TempDir::new().unwrap();
        let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
        let (rig, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
        if is_low {
            assert!(rigd(folder.path(), &["move", "linear", "12", "--rig", rig]).status.success());
        }
        assert!(rigd(folder.path(), &["home", "--rig", rig]).status.success());
        let data = folder.path().join("data");
        let events = Reader::open(&data).unwrap().events_after(0, 10_000).unwrap();
        let is_preparing = |stored: &&StoredRecord| match stored.record().unwrap() {
            Record::Operator(operator) => operator.action.starts_with("home"),
            _ => false,
        };
        let killed = events.iter().rfind(is_preparing).unwrap();
        let crash = crashed(&data, killed.event);
        for name in ["rigd.db-wal", "rigd.db-shm"] {
            _ = fs::remove_file(data.join(name));
        }
        fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();
        let begun = rigd(folder.path(), &["run", protocol, "--rig", rig]);
        let said = String::from_utf8(begun.stderr).unwrap();
        assert_eq!(begun.status.code(), Some(if is_low { 4 } else { 0 }), "{is_low}: {said}");
        assert!(said.contains("was interrupted at"), "{said}");
    }
}

#[test]
fn a_damaged_last_session_proves_nothing_of_the_probe() {
    let damages = [
        // Still JSON, but not the written text.
        "payload = replace(payload, '24.5', '25.5')",
        "payload = substr(payload, 1, 20)",
        "digest = x'00'",
        "digest = zeroblob(32)",
        "rig_us = rig_us + 1",
    ];
    for damage in damages {
        let folder = TempDir::new().unwrap();
        let rig = write_rig(folder.path());
        let rig = rig.to_str().unwrap();
        assert!(rigd(folder.path(), &["home", "--rig", rig]).status.success());
        let data = folder.path().join("data");
        let database = rusqlite::Connection::open(data.join("rigd.db")).unwrap();
        let change = format!(
            "UPDATE records SET {damage}
             WHERE id = (SELECT id FROM records WHERE kind = 'moved' AND payload LIKE '%linear_mm%')"
        );
        assert_eq!(database.execute(&change, []).unwrap(), 1);
        drop(database);
        let refused = rigd(folder.path(), &["move", "linear", "29", "--rig", rig]);
        let said = String::from_utf8(refused.stderr).unwrap();
        assert_eq!(refused.status.code(), Some(4), "{damage}: {said}");
        assert!(said.contains("is damaged") && said.contains("may be in the sample"), "{said}");
        let homed = rigd(folder.path(), &["home", "--rig", rig]);
        assert!(homed.status.success(), "{damage}: {}", String::from_utf8_lossy(&homed.stderr));
        // The session that followed is sound, and proves the probe clear.
        assert!(rigd(folder.path(), &["move", "linear", "29", "--rig", rig]).status.success());
    }
}

/// Nothing moves for a run that cannot go on.
#[test]
fn a_damaged_or_sealed_run_is_refused_before_the_rig_is_opened_with_what_helps() {
    let touch = ["main/1/front/30/1", "--why", "it slipped"];
    let salvage = "`rigd salvage NEW --data DIR`";
    let rig_is_asked = |bench: &Interrupted, refused: &[&str], says: &str| {
        let sessions = || {
            let all = Reader::open(&bench.data).unwrap().runs().unwrap().into_iter();
            all.filter(|run| run.kind == rig_store::RunKind::Session).count()
        };
        let before = sessions();
        let output = bench.rigd(refused);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{refused:?}: {said}");
        assert!(said.contains(says), "{refused:?}: {said}");
        assert_eq!(sessions(), before, "{refused:?}: {said}");
    };
    let bench = Interrupted::behind(88);
    let rig = ["--rig", bench.rig.as_str()];
    let database = rusqlite::Connection::open(bench.data.join("rigd.db")).unwrap();
    let damage = "UPDATE records SET payload = replace(payload, '0', '1') WHERE kind = 'sweep'
                  AND id = (SELECT min(id) FROM records WHERE kind = 'sweep')";
    assert_eq!(database.execute(damage, []).unwrap(), 1);
    drop(database);
    let resume = [&["run", "--resume", "latest"][..], &rig].concat();
    rig_is_asked(&bench, &resume, salvage);
    rig_is_asked(&bench, &[&["redo", "latest"][..], &touch, &rig].concat(), salvage);
    rig_is_asked(&bench, &[&["skip", "latest"][..], &touch].concat(), salvage);

    let bench = Interrupted::behind(88);
    let resume = ["run", "--resume", "latest", "--rig", &bench.rig];
    assert!(bench.rigd(&["give-up", "latest"]).status.success());
    rig_is_asked(&bench, &resume, "`rigd redo RUN STEP` measures one touch again");
}

#[test]
fn a_run_that_is_given_up_does_not_go_on() {
    let bench = Interrupted::behind(88);
    let given_up = bench.rigd(&["give-up", "latest"]);
    assert!(given_up.status.success(), "{}", String::from_utf8_lossy(&given_up.stderr));
    let refused = bench.rigd(&["run", "--resume", "latest", "--rig", &bench.rig]);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(1) && said.contains("sealed"), "{said}");
}

/// Every run, session and amendment is sound.
fn assert_sound(data: &Path) {
    for run in Reader::open(data).unwrap().runs().unwrap() {
        let verdict = rig_verify::verify(data, &run.id.to_string()).unwrap();
        assert!(verdict.is_sound, "{run}: {:#?}", verdict.findings);
    }
}

/// Each part of a run cites the calibrations and corrections that hold when it begins.
#[test]
fn a_correction_that_was_made_since_has_to_be_confirmed() {
    let bench = Interrupted::behind(88);
    let reader = Reader::open(&bench.data).unwrap();
    let run = reader.find("latest").unwrap();
    let Record::RunStarted(started) = reader.records(run.id).unwrap()[0].record().unwrap() else {
        panic!("no beginning");
    };
    drop(reader);
    let analyzer = started.devices.iter().find(|device| device.role == "analyzer").unwrap();
    let correction = serde_json::json!([{
        "what": "open", "at": "2026-11-26T08:00:00Z", "cable": "RG174", "operator": "ada",
        "analyzer": analyzer.identity,
    }]);
    fs::write(bench.data.join("corrections.json"), correction.to_string()).unwrap();
    let go_on = ["run", "--resume", "latest", "--rig", &bench.rig];
    let refused = bench.rigd(&go_on);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    let expected = "correction (open) (none → corrections.json of 2026-11-26T08:00:00Z)";
    assert!(said.contains(expected) && said.contains("--accept-changes"), "{said}");
    let done = bench.rigd(&[&go_on[..], &["--accept-changes"]].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_sound(&bench.data);
    let reader = Reader::open(&bench.data).unwrap();
    let records = reader.records(reader.find("latest").unwrap().id).unwrap();
    let seam = records.iter().find_map(|stored| match stored.record() {
        Ok(Record::Resumed(resumed)) => Some(resumed),
        _ => None,
    });
    let Resumed { changes, calibrations, .. } = seam.unwrap();
    assert_eq!(changes.len(), 1, "{changes:?}");
    assert_eq!((&*changes[0].what, &*changes[0].was), ("correction (open)", "none"));
    assert!(calibrations.unwrap().iter().any(|cited| cited.kind == "open"));
    // What was confirmed once is what the next part is held against.
    let redo = ["redo", "latest", "main/1/front/30/1", "--why", "a hair", "--rig", &bench.rig];
    let redone = bench.rigd(&redo);
    assert!(redone.status.success(), "{}", String::from_utf8_lossy(&redone.stderr));
    assert_sound(&bench.data);
}

#[test]
fn the_sweeps_of_a_run_and_of_its_amendments_are_numbered_together() {
    let bench = Interrupted::behind(88);
    let rig = bench.rig.as_str();
    for command in [
        &["redo", "latest", "main/1/front/30/1", "--why", "it slipped", "--rig", rig][..],
        &["run", "--resume", "latest", "--rig", rig],
        &["redo", "latest", "main/1/front/30/1", "--why", "once more", "--rig", rig],
    ] {
        let done = bench.rigd(command);
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
    assert_sound(&bench.data);
}

#[test]
fn a_touch_is_measured_again_or_left_out_and_the_old_outcome_is_kept() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let (rig, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    assert!(rigd(folder.path(), &["run", protocol, "--rig", rig]).status.success());
    let show = || -> serde_json::Value {
        let shown = rigd(folder.path(), &["show", "latest", "--json"]);
        serde_json::from_slice(&shown.stdout).unwrap()
    };
    let chain = || rigd(folder.path(), &["export", "latest", "--format", "jsonl"]).stdout;
    let (before, records) = (show(), chain());
    let step = before["touch_results"][1]["step"].as_str().unwrap().to_owned();
    let redo = ["redo", "latest", &step, "--why", "it slipped", "--operator", "Ada"];
    let redone = rigd(folder.path(), &[&redo[..], &["--rig", rig, "--json"]].concat());
    assert!(redone.status.success(), "{}", String::from_utf8_lossy(&redone.stderr));
    let redone: serde_json::Value = serde_json::from_slice(&redone.stdout).unwrap();
    let row = redone["touch_results"][1].clone();
    assert_eq!((&row["status"], &row["attempts"]), (&"measured".into(), &2.into()));
    assert_eq!(row["amended"], "redo by Ada: it slipped");
    assert!(row["earlier"].as_str().unwrap().starts_with("shift "), "{row}");
    assert!(row["sweep"].as_u64() > before["touch_results"][5]["sweep"].as_u64(), "{row}");
    assert_eq!(redone["touches_measured"], 6);
    // The run itself is unchanged.
    assert_eq!(chain(), records);
    let refused = rigd(folder.path(), &["give-up", "latest"]);
    assert_eq!(refused.status.code(), Some(1), "it is complete");

    let skip = |step: &str| {
        rigd(folder.path(), &["skip", "latest", step, "--why", "cracked", "--operator", "Ada"])
    };
    assert!(skip(&step).status.success());
    let skipped = show();
    let row = &skipped["touch_results"][1];
    assert_eq!((&row["status"], &row["shift_hz"]), (&"skipped".into(), &serde_json::Value::Null));
    assert!(row["earlier"].as_str().unwrap().matches("shift ").count() == 2, "{row}");
    assert_eq!((&skipped["touches_measured"], &skipped["touches_skipped"]), (&5.into(), &1.into()));
    assert_eq!(skip("main/9/left/0/1").status.code(), Some(3));
    assert_eq!(chain(), records);
    let report = fs::read_to_string(skipped["report"].as_str().unwrap()).unwrap();
    assert!(report.contains("skip by Ada: cracked"));
    assert_sound(&folder.path().join("data"));
}

#[test]
fn a_skipped_touch_is_not_measured_when_the_run_is_resumed() {
    let bench = Interrupted::behind(88);
    let skipped = bench.rigd(&["skip", "latest", "blind/2", "--why", "not needed"]);
    assert!(skipped.status.success(), "{}", String::from_utf8_lossy(&skipped.stderr));
    let done = bench.rigd(&["run", "--resume", "latest", "--rig", &bench.rig, "--json"]);
    let results: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let counts = ["touches_measured", "touches_skipped", "touches_not_reached"];
    assert_eq!(counts.map(|count| results[count].as_u64().unwrap()), [5, 1, 0]);
    let reader = Reader::open(&bench.data).unwrap();
    let run = reader.find("latest").unwrap();
    assert!(run.is_sealed && !touches(&reader, run.id).contains_key("blind/2"));
}

/// A run with refused touches, because the resonances of the stiffer sample lie above the window: its rig file and its records.
fn with_refused_touches(folder: &Path) -> (PathBuf, Vec<StoredRecord>) {
    let (rig, protocol) = (write_rig(folder), write_protocol(folder));
    let text = fs::read_to_string(&protocol).unwrap();
    fs::write(&protocol, text.replace("max_hz = 260", "max_hz = 190")).unwrap();
    let paths = (protocol.to_str().unwrap(), rig.to_str().unwrap());
    let whole = rigd(folder, &["run", paths.0, "--rig", paths.1]);
    assert_eq!(whole.status.code(), Some(6), "{}", String::from_utf8_lossy(&whole.stderr));
    let reader = Reader::open(&folder.join("data")).unwrap();
    (rig, reader.events_after(0, 10_000).unwrap())
}

#[test]
fn a_refused_touch_is_finished_and_is_not_repeated_unasked() {
    let folder = TempDir::new().unwrap();
    let (rig, events) = with_refused_touches(folder.path());
    let (rig, data) = (rig.to_str().unwrap(), folder.path().join("data"));
    let refused = events.iter().find(|stored| stored.kind == "touch_refused").unwrap();
    let crash = crashed(&data, refused.event);
    fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();
    let done = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig]);
    assert_eq!(done.status.code(), Some(6), "{}", String::from_utf8_lossy(&done.stderr));
    let reader = Reader::open(&data).unwrap();
    let run = reader.find("latest").unwrap();
    assert_eq!((run.status.name(), run.is_sealed), ("completed_with_refusals", true));
    let mut outcomes = BTreeMap::<String, u32>::new();
    for stored in reader.records(run.id).unwrap() {
        let step = match stored.record().unwrap() {
            Record::TouchResult(touch) => touch.touch.step,
            Record::TouchRefused(touch) => touch.touch.step,
            _ => continue,
        };
        *outcomes.entry(step).or_default() += 1;
    }
    assert!(outcomes.len() == 6 && outcomes.values().all(|count| *count == 1), "{outcomes:?}");
    // The exit code is that of the results, with what was left out since.
    for stored in events.iter().filter(|stored| stored.kind == "touch_refused") {
        let Record::TouchRefused(touch) = stored.record().unwrap() else { unreachable!() };
        let again = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig]);
        assert_eq!(again.status.code(), Some(6));
        let skip = ["skip", "latest", &touch.touch.step, "--why", "too stiff"];
        assert!(rigd(folder.path(), &skip).status.success());
    }
    let again = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig]);
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
}

/// What was left out before the run went on is no refusal of the run, for the engine and for the checker.
#[test]
fn refused_touches_that_a_person_leaves_out_before_a_run_goes_on_are_refused_no_more() {
    let folder = TempDir::new().unwrap();
    let (rig, events) = with_refused_touches(folder.path());
    let (rig, data) = (rig.to_str().unwrap(), folder.path().join("data"));
    let refused: Vec<_> = events.iter().filter(|stored| stored.kind == "touch_refused").collect();
    let crash = crashed(&data, refused.last().unwrap().event);
    fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();
    for stored in &refused {
        let Record::TouchRefused(touch) = stored.record().unwrap() else { unreachable!() };
        let skip = ["skip", "latest", &touch.touch.step, "--why", "too stiff"];
        let skipped = rigd(folder.path(), &skip);
        assert!(skipped.status.success(), "{}", String::from_utf8_lossy(&skipped.stderr));
    }
    let done = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(Reader::open(&data).unwrap().find("latest").unwrap().status.name(), "completed");
    let verified = rigd(folder.path(), &["verify", "latest"]);
    assert!(verified.status.success(), "{}", String::from_utf8_lossy(&verified.stdout));
}
