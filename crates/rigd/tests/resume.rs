//! Resumed runs: after a crash at any record, a fault, an abort, and a kill of the program.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    time::Duration,
};

use rig_engine::{Command as RigCommand, Fault, RigState, RunStatus};
use rig_store::{Clearance, Reader, Record, RunId, StoredRecord, Touch};
use rigd::{
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, RequestRefusal, ResumeRefusal, RigHandle, RigThread},
};
use tempfile::TempDir;

fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config")
}

/// A simulated rig on which a sample has the same stiffness each time it is placed.
fn write_rig(folder: &Path) -> PathBuf {
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
fn write_protocol(folder: &Path) -> PathBuf {
    write_short(folder, "[\"front\", \"left\"]")
}

fn write_short(folder: &Path, directions: &str) -> PathBuf {
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
struct Bench {
    handle: RigHandle,
    thread: RigThread,
}

impl Bench {
    fn open(rig: &Path, data: &Path) -> Self {
        let (handle, thread) = rig::open(LoadedRig::load(rig).unwrap(), data.to_owned()).unwrap();
        Self { handle, thread }
    }

    async fn wait_for(&self, state: RigState) {
        let mut status = self.handle.status();
        let reached = status.wait_for(|status| status.snapshot.state == state);
        tokio::time::timeout(Duration::from_secs(60), reached).await.unwrap().unwrap();
    }

    async fn ended(&self, run: RunId) -> RunStatus {
        let mut status = self.handle.status();
        let is_ended = |status: &rig::Status| {
            status.run.as_ref().is_some_and(|view| view.id == run && view.ending.is_some())
                && status.snapshot.state != RigState::Running
        };
        let ended = tokio::time::timeout(Duration::from_secs(60), status.wait_for(is_ended));
        ended.await.unwrap().unwrap().run.as_ref().unwrap().ending.unwrap()
    }

    async fn close(self) {
        self.handle.close().await;
        self.thread.join();
    }
}

/// Replays a protocol to its end.
async fn replay(rig: &Path, protocol: &Path, data: &Path) -> RunId {
    let bench = Bench::open(rig, data);
    bench.wait_for(RigState::Idle).await;
    let facts = LoadedRig::load(rig).unwrap().facts();
    let protocol = LoadedProtocol::load(protocol, &facts).unwrap();
    let run = bench.handle.run(protocol, "Ada").await.unwrap();
    assert_eq!(bench.ended(run).await, RunStatus::Completed);
    bench.close().await;
    run
}

/// A copy of a journal as a crash behind the event `last` would have left it.
fn crashed(whole: &Path, last: u64) -> TempDir {
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

fn touches(reader: &Reader, run: RunId) -> BTreeMap<String, Vec<Touch>> {
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
fn check_same(data: &Path, run: RunId, whole: &BTreeMap<String, Vec<Touch>>, here: &str) {
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

/// Outcomes of the crashes after each kind of record.
#[derive(Default)]
struct Seen {
    in_contact: u32,
    clear: u32,
    phases: BTreeSet<String>,
}

/// A crash behind each of these records of a run, and once more behind every seventh second part.
async fn crash_and_resume(
    rig: &Path,
    data: &Path,
    run: RunId,
    whole: &BTreeMap<String, Vec<Touch>>,
    records: impl Iterator<Item = &StoredRecord>,
) -> Seen {
    let mut seen = Seen::default();
    for record in records {
        let crash = crashed(data, record.event);
        if resume(rig, crash.path(), run).await.was_latched_in_contact {
            seen.in_contact += 1;
        } else {
            seen.clear += 1;
        }
        seen.phases.insert(record.kind.clone());
        let here = format!("crash behind record {} ({})", record.seq, record.kind);
        check_same(crash.path(), run, whole, &here);
        if record.seq % 7 == 0 {
            let second = Reader::open(crash.path()).unwrap().records(run).unwrap();
            let seam = second.iter().position(|stored| stored.kind == "resumed").unwrap();
            let index = usize::try_from(record.seq).unwrap();
            let at = &second[seam + (index * 5) % (second.len() - seam - 1)];
            let again = crashed(crash.path(), at.event);
            resume(rig, again.path(), run).await;
            check_same(again.path(), run, whole, &format!("{here}, then behind {}", at.seq));
        }
    }
    seen
}

#[test]
fn a_run_that_crashed_at_any_record_has_the_touches_of_one_that_did_not() {
    const WORKERS: usize = 2;
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_short(folder.path(), "[\"left\"]"));
    let data = folder.path().join("whole");
    let runtime = || tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let run = runtime().block_on(replay(&rig, &protocol, &data));
    let reader = Reader::open(&data).unwrap();
    let records = reader.records(run).unwrap();
    let whole = touches(&reader, run);
    assert_eq!(whole.len(), 4);
    // The last record is on disk together with the end of the run.
    let before_end = &records[..records.len() - 1];
    let seen: Vec<Seen> = std::thread::scope(|scope| {
        let begin = |worker| {
            let (rig, data, whole, runtime) = (&rig, &data, &whole, &runtime);
            scope.spawn(move || {
                let some = before_end.iter().skip(worker).step_by(WORKERS);
                runtime().block_on(crash_and_resume(rig, data, run, whole, some))
            })
        };
        let workers: Vec<_> = (0..WORKERS).map(begin).collect();
        workers.into_iter().map(|worker| worker.join().unwrap()).collect()
    });
    let sum = |count: fn(&Seen) -> u32| seen.iter().map(count).sum::<u32>();
    let (in_contact, clear) = (sum(|seen| seen.in_contact), sum(|seen| seen.clear));
    assert!(in_contact > 20 && clear > 20, "{in_contact} in contact, {clear} clear");
    for kind in ["intent", "moved", "surface_found", "sweep", "touch_result", "prompt_asked"] {
        assert!(seen.iter().any(|seen| seen.phases.contains(kind)), "no crash behind {kind}");
    }
}

struct ResumedRun {
    was_latched_in_contact: bool,
}

/// Opens the rig, which must be latched, acknowledges, and resumes the run to its end.
async fn resume(rig: &Path, data: &Path, run: RunId) -> ResumedRun {
    let bench = Bench::open(rig, data);
    let snapshot = bench.handle.status().borrow().snapshot.clone();
    assert_eq!(snapshot.state, RigState::Latched);
    let Some(Fault::Interrupted { left, may_touch, .. }) = snapshot.fault else {
        panic!("{:?}", snapshot.fault)
    };
    assert!(left.contains("-1 was interrupted at ") && left.contains(" UTC"), "{left}");
    let is_in_contact = snapshot.clearance == rig_model::Clearance::InContact;
    assert_eq!(is_in_contact, may_touch);
    // Only an acknowledgement leads out.
    let refusal = bench.handle.resume(run, false, "Ada").await.unwrap_err();
    assert!(matches!(refusal, RequestRefusal::Command(_)), "{refusal}");
    bench.handle.command(RigCommand::Acknowledge, None, "Ada").await.unwrap();
    bench.wait_for(RigState::Idle).await;
    bench.handle.resume(run, false, "Ada").await.unwrap();
    assert_eq!(bench.ended(run).await, RunStatus::Completed);
    bench.close().await;
    ResumedRun { was_latched_in_contact: may_touch }
}

#[tokio::test]
async fn a_run_goes_on_after_an_abort_and_after_a_stop_in_the_same_daemon() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let whole_data = folder.path().join("whole");
    let whole = replay(&rig, &protocol, &whole_data).await;
    let whole = touches(&Reader::open(&whole_data).unwrap(), whole);
    let data = folder.path().join("data");
    let bench = Bench::open(&rig, &data);
    bench.wait_for(RigState::Idle).await;
    let facts = LoadedRig::load(&rig).unwrap().facts();
    let protocol = LoadedProtocol::load(&protocol, &facts).unwrap();
    let run = bench.handle.run(protocol, "Ada").await.unwrap();
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
    bench.wait_for(RigState::Idle).await;
    let first = bench.handle.status().borrow().session;
    let facts = LoadedRig::load(&rig).unwrap().facts();
    let protocol = LoadedProtocol::load(&protocol, &facts).unwrap();
    let run = bench.handle.run(protocol, "Ada").await.unwrap();
    assert_eq!(bench.ended(run).await, RunStatus::Completed);
    let mut status = bench.handle.status();
    let renewed = status.wait_for(|status| status.session != first);
    tokio::time::timeout(Duration::from_secs(60), renewed).await.unwrap().unwrap();
    let reader = Reader::open(&data).unwrap();
    assert!(reader.run(first).unwrap().is_sealed);
    bench.close().await;
    let sessions = reader.runs().unwrap().into_iter().filter(|run| run.id != first);
    assert!(sessions.into_iter().all(|run| run.is_sealed));
    assert_eq!(reader.broken_link().unwrap(), None);
}

/// Runs the program to its end.
fn rigd(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(args)
        .args(["--data", folder.join("data").to_str().unwrap()])
        .current_dir(config().parent().unwrap())
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[test]
fn what_has_changed_is_refused_until_it_is_confirmed() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let (rig_text, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    assert!(rigd(folder.path(), &["run", protocol, "--rig", rig_text]).status.success());
    // A crash in the middle: the journal is cut there.
    let data = folder.path().join("data");
    let whole = fs::canonicalize(&data).unwrap();
    let last = Reader::open(&data).unwrap().events_after(0, 10_000).unwrap().len() as u64 / 2;
    let crash = crashed(&whole, last);
    fs::remove_dir_all(&data).unwrap();
    fs::create_dir(&data).unwrap();
    fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();

    let changed = fs::read_to_string(&rig).unwrap() + "\n# another hand was here\n";
    fs::write(&rig, changed).unwrap();
    let resume = ["run", "--resume", "latest", "--rig", rig_text, "--json"];
    let refused = rigd(folder.path(), &resume);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("have changed: rig file") && said.contains("--accept-changes"), "{said}");
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
    assert_eq!((seam.changes.len(), &*seam.changes[0].what), (1, "rig file"));
    assert!(seam.rig.unwrap().toml.contains("another hand"));

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
            Record::Operator(operator) => operator.action == "prepare",
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
        "payload = replace(payload, '30.0', '31.0')",
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

#[test]
fn a_run_that_is_given_up_does_not_go_on() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let (rig, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    assert!(rigd(folder.path(), &["run", protocol, "--rig", rig]).status.success());
    let refused = rigd(folder.path(), &["give-up", "latest"]);
    assert_eq!(refused.status.code(), Some(1), "it is complete");
    let data = folder.path().join("data");
    let crash = crashed(&data, 60);
    fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();
    let given_up = rigd(folder.path(), &["give-up", "latest"]);
    assert!(given_up.status.success(), "{}", String::from_utf8_lossy(&given_up.stderr));
    let refused = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig]);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(1) && said.contains("sealed"), "{said}");
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
}

#[test]
fn a_skipped_touch_is_not_measured_when_the_run_is_resumed() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let (rig, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    assert!(rigd(folder.path(), &["run", protocol, "--rig", rig]).status.success());
    let data = folder.path().join("data");
    let crash = crashed(&data, 60);
    fs::copy(crash.path().join("rigd.db"), data.join("rigd.db")).unwrap();
    let skipped = rigd(folder.path(), &["skip", "latest", "blind/2", "--why", "not needed"]);
    assert!(skipped.status.success(), "{}", String::from_utf8_lossy(&skipped.stderr));
    let done = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig, "--json"]);
    let results: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let counts = ["touches_measured", "touches_skipped", "touches_not_reached"];
    assert_eq!(counts.map(|count| results[count].as_u64().unwrap()), [5, 1, 0]);
    let reader = Reader::open(&data).unwrap();
    let run = reader.find("latest").unwrap();
    assert!(run.is_sealed && !touches(&reader, run.id).contains_key("blind/2"));
}

#[test]
fn a_refused_touch_is_finished_and_is_not_repeated_unasked() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    // The resonances of the stiffer sample lie above the window.
    let text = fs::read_to_string(&protocol).unwrap();
    fs::write(&protocol, text.replace("max_hz = 260", "max_hz = 190")).unwrap();
    let (rig, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    let whole = rigd(folder.path(), &["run", protocol, "--rig", rig]);
    assert_eq!(whole.status.code(), Some(6), "{}", String::from_utf8_lossy(&whole.stderr));
    let data = folder.path().join("data");
    let events = Reader::open(&data).unwrap().events_after(0, 10_000).unwrap();
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
}

/// Kills the program itself, at numbers of records spread over a run, and resumes it until it is done.
#[test]
fn a_program_that_is_killed_again_and_again_finishes_its_run() {
    const KILLS: usize = 24;
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let (rig, protocol) = (rig.to_str().unwrap(), protocol.to_str().unwrap());
    assert!(rigd(folder.path(), &["run", protocol, "--rig", rig]).status.success());
    let data = folder.path().join("data");
    let count = || {
        Reader::open(&data)
            .and_then(|reader| reader.events_after(0, 100_000))
            .map_or(0, |all| all.len())
    };
    let events = count();
    let whole = {
        let reader = Reader::open(&data).unwrap();
        touches(&reader, reader.find("latest").unwrap().id)
    };
    fs::remove_dir_all(&data).unwrap();
    let (mut kills, mut runs) = (0, 0);
    while kills < KILLS {
        let is_new = Reader::open(&data)
            .and_then(|reader| Ok(reader.find("latest")?.is_sealed))
            .unwrap_or(true);
        let what: &[&str] =
            if is_new { &["run", protocol] } else { &["run", "--resume", "latest"] };
        let mut child = Command::new(env!("CARGO_BIN_EXE_rigd"))
            .args(what)
            .args(["--rig", rig, "--data", data.to_str().unwrap()])
            .current_dir(config().parent().unwrap())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        kills += 1;
        // Between the opening of the rig and three quarters of a run, in steps that visit all of it.
        let wanted = count() + events * (kills * 7 % KILLS) * 3 / (KILLS * 4);
        while child.try_wait().unwrap().is_none() && count() < wanted {
            // Records come from another program.
            std::thread::yield_now();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let reader = Reader::open(&data);
        let latest = reader.as_ref().ok().and_then(|reader| reader.find("latest").ok());
        if let (Ok(reader), Some(latest)) = (reader, latest) {
            for (step, made) in touches(&reader, latest.id) {
                assert_eq!(made.len(), 1, "{step} was made twice");
            }
        }
    }
    let done = rigd(folder.path(), &["run", "--resume", "latest", "--rig", rig]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let reader = Reader::open(&data).unwrap();
    for run in reader.runs().unwrap() {
        if run.kind == rig_store::RunKind::Run {
            check_same(&data, run.id, &whole, &run.short_name());
            runs += 1;
        }
    }
    assert!(runs > 0);
}
