//! Crashes at every record, in one process, and kills of the program itself.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    process::{Command, Stdio},
};

use rig_engine::{Command as RigCommand, Fault, LeftRig, RigState, RunStatus};
use rig_store::{Reader, RunId, StoredRecord, Touch};
use rigd::rig::RequestRefusal;
use tempfile::TempDir;

use crate::support::{
    Bench, check_same, config, crashed, replay, rigd, touches, write_protocol, write_rig,
    write_short,
};

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
    let Some(Fault::Interrupted(left)) = snapshot.fault else { panic!("{:?}", snapshot.fault) };
    let LeftRig { message: left, may_touch, .. } = left;
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
