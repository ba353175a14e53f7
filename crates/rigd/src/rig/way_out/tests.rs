//! A panic of the rig thread at each stage of a run: the probe is retracted, and the rig latches.

use std::{path::Path, time::Duration};

use rig_engine::{Fault, RigState, RunStatus};
use rig_model::{Clearance, RigTime};
use rig_store::{ProbeWord, Reader, Record, RunKind};
use tempfile::TempDir;
use tokio::sync::oneshot;

use crate::{
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, Request, RequestRefusal, Status},
};

/// The run of the test has more events than this, and two touches among them.
const EVENTS: u64 = 170;

/// Later than any run of the test.
const LATER: RigTime = RigTime::from_micros(1_000_000_000_000);

fn injected() -> Fault {
    Fault::Panicked { what: "injected".to_owned() }
}

pub(in crate::rig) fn load() -> LoadedRig {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    LoadedRig::load(&config.join("rigs/simulated.toml")).unwrap()
}

pub(in crate::rig) fn protocol() -> LoadedProtocol {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    LoadedProtocol::load(&config.join("protocols/smoke.toml"), &load().facts()).unwrap()
}

async fn reached(status: &mut tokio::sync::watch::Receiver<Status>, state: RigState) -> Status {
    status.wait_for(|status| status.snapshot.state == state).await.unwrap().clone()
}

/// Panics at an event of a run, and gives what the run had recorded last of the probe.
async fn panic_at(event: u64, is_resumed: bool) -> ProbeWord {
    let data = TempDir::new().unwrap();
    let (handle, thread) = rig::open(load(), data.path().to_owned()).unwrap();
    let mut status = handle.status();
    reached(&mut status, RigState::Idle).await;
    handle.requests.send(Request::PanicAt(event)).await.unwrap();
    let run = handle.run(protocol(), "Ada").await;
    let end = reached(&mut status, RigState::Latched).await;
    let snapshot = &end.snapshot;
    assert_eq!(snapshot.clearance, Clearance::Clear, "event {event}");
    assert_eq!(snapshot.fault, Some(injected()));
    // The clock of the rig is not the one of this thread; its motion is over.
    let truth = handle.simulation().unwrap().with(|_, rig| rig.world().truth(LATER));
    assert!((truth.tip_mm - 24.5).abs() < 0.1, "event {event}: the tip is at {}", truth.tip_mm);
    // Nothing begins any more, and the rig can be closed.
    let (reply, answer) = oneshot::channel();
    let request = Request::GiveUp { run: end.session, by: "Ada".to_owned(), reply };
    let refused = handle.ask(request, answer).await.unwrap_err();
    assert!(matches!(refused, RequestRefusal::Closed), "{refused}");
    handle.close().await;
    thread.join();

    let reader = Reader::open(data.path()).unwrap();
    let session = reader.latest_session(&load().file.name).unwrap().unwrap();
    let records = reader.records(session.id).unwrap();
    let said = records.iter().any(|stored| match stored.record().unwrap() {
        Record::Fault(fault) => fault.cause == injected().to_string(),
        _ => false,
    });
    assert!(said, "event {event}: the session has no record of the panic");
    assert_eq!(reader.probe_word(&session).unwrap(), ProbeWord::Clear);
    let is_run = |run: &rig_store::Run| run.kind == RunKind::Run;
    let Some(listed) = reader.runs().unwrap().into_iter().find(is_run) else {
        return ProbeWord::Silent;
    };
    let left = reader.interruption(&listed).unwrap().unwrap();
    assert!(left.is_cleared_since || left.probe == ProbeWord::Clear, "{left:?}");
    if is_resumed && run.is_ok() {
        let (handle, thread) = rig::open(load(), data.path().to_owned()).unwrap();
        let mut status = handle.status();
        reached(&mut status, RigState::Idle).await;
        handle.resume(listed.id, false, "Ada").await.unwrap();
        let ended = |status: &Status| status.run.as_ref().is_some_and(|run| run.ending.is_some());
        let ending = status.wait_for(ended).await.unwrap().run.as_ref().unwrap().ending;
        assert_eq!(ending, Some(RunStatus::Completed));
        handle.close().await;
        thread.join();
    }
    left.probe
}

#[tokio::test]
async fn a_panic_at_any_stage_of_a_run_ends_latched_with_a_clear_probe() {
    let mut in_contact = 0;
    for event in (1..EVENTS).step_by(10) {
        let left = panic_at(event, event % 5 == 0).await;
        in_contact += u32::from(matches!(left, ProbeWord::MayTouch { .. }));
    }
    assert!(in_contact > 5, "{in_contact} panics in contact");
}

/// Nobody has shown which way is up.
#[tokio::test]
async fn a_panic_at_a_bench_that_is_not_commissioned_moves_nothing() {
    let data = TempDir::new().unwrap();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").canonicalize().unwrap();
    let rig = std::fs::read_to_string(config.join("rigs/simulated.toml")).unwrap();
    let scene = config.join("scenes/new-bench.toml");
    let rig = rig.replace("../scenes/paper.toml", scene.to_str().unwrap());
    let path = data.path().join("rig.toml");
    std::fs::write(&path, rig).unwrap();
    let (handle, thread) =
        rig::open(LoadedRig::load(&path).unwrap(), data.path().to_owned()).unwrap();
    let mut status = handle.status();
    let is_new =
        |status: &Status| matches!(status.snapshot.fault, Some(Fault::NotCommissioned { .. }));
    status.wait_for(is_new).await.unwrap();
    let simulation = handle.simulation().unwrap().clone();
    let tip_mm = || simulation.with(|_, rig| rig.world().truth(LATER)).tip_mm;
    let before_mm = tip_mm();
    // At once: such a bench has no events.
    handle.requests.send(Request::PanicAt(0)).await.unwrap();
    let has_left = |status: &Status| {
        status.snapshot.fault == Some(injected()) && status.snapshot.state == RigState::Latched
    };
    let left = tokio::time::timeout(Duration::from_secs(60), status.wait_for(has_left)).await;
    assert_eq!(left.unwrap().unwrap().snapshot.clearance, Clearance::Unknown);
    assert!((tip_mm() - before_mm).abs() < 1e-9, "{before_mm} {}", tip_mm());
    handle.close().await;
    thread.join();
    let reader = Reader::open(data.path()).unwrap();
    let session = reader.latest_session(&load().file.name).unwrap().unwrap();
    let records = reader.records(session.id).unwrap();
    assert!(!records.iter().any(|stored| stored.kind == "moved"));
}
