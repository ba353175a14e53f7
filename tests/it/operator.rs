//! Commands of a person during a run.

use std::fs;

use rig_engine::{Command, RigState, RunStatus};
use rig_model::Clearance;
use rig_store::Record;
use rig_tests::{TestRig, shipped};

fn smoke() -> String {
    fs::read_to_string(shipped("config/protocols/smoke.toml")).unwrap()
}

/// Begins a run and ends it early with a command, given while it is under way.
async fn interrupted(command: Command) -> (TestRig, rig_store::RunId) {
    let rig = TestRig::open().await;
    let run = rig.handle.run(rig.protocol(&smoke()), "test").await.unwrap();
    rig.command(command).await.unwrap();
    rig.wait_for("the end", |status| {
        let is_ended = status.run.as_ref().is_some_and(|view| view.ending.is_some());
        let state = status.snapshot.state;
        is_ended && matches!(state, RigState::Idle | RigState::Latched)
    })
    .await;
    (rig, run)
}

fn ending(rig: &TestRig, run: rig_store::RunId) -> rig_store::Ending {
    match rig.records(run).last().unwrap().record().unwrap() {
        Record::RunFinished(finished) => finished.status,
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn an_aborted_run_leaves_the_probe_clear_and_the_rig_ready() {
    let (rig, run) = interrupted(Command::Abort).await;
    assert_eq!(ending(&rig, run), rig_store::Ending::Aborted);
    let status = rig.handle.status().borrow().clone();
    assert_eq!(status.snapshot.state, RigState::Idle);
    assert_eq!(status.snapshot.clearance, Clearance::Clear);
    let (_, ending) = rig.run(rig.protocol(&smoke())).await;
    assert_eq!(ending, RunStatus::Completed);
    rig.close().await;
}

#[tokio::test]
async fn after_a_stop_nothing_is_taken_until_it_is_acknowledged() {
    let (rig, run) = interrupted(Command::Stop).await;
    assert_eq!(ending(&rig, run), rig_store::Ending::Faulted);
    let status = rig.handle.status().borrow().clone();
    assert_eq!(status.snapshot.state, RigState::Latched);
    assert_eq!(status.snapshot.clearance, Clearance::Clear);
    let refusal = rig.handle.run(rig.protocol(&smoke()), "test").await.unwrap_err();
    assert_eq!(refusal.to_string(), "cannot run while the rig is latched");
    rig.command(Command::Acknowledge).await.unwrap();
    rig.wait_for("service", |status| status.snapshot.state == RigState::Idle).await;
    let (_, ending) = rig.run(rig.protocol(&smoke())).await;
    assert_eq!(ending, RunStatus::Completed);
    rig.close().await;
}

#[tokio::test]
async fn a_paused_run_waits_with_the_probe_clear_and_goes_on() {
    let rig = TestRig::open().await;
    let run = rig.handle.run(rig.protocol(&smoke()), "test").await.unwrap();
    rig.command(Command::Pause).await.unwrap();
    let status = rig.wait_for("the pause", |s| s.snapshot.state == RigState::Paused).await;
    assert_eq!(status.snapshot.clearance, Clearance::Clear);
    let refusal = rig.handle.run(rig.protocol(&smoke()), "test").await.unwrap_err();
    assert_eq!(refusal.to_string(), "cannot run while the rig is paused");
    rig.handle.command(Command::Resume, Some(run), "test").await.unwrap();
    rig.wait_for("the end", |s| s.run.as_ref().is_some_and(|view| view.ending.is_some())).await;
    assert_eq!(ending(&rig, run), rig_store::Ending::Completed);
    let refusal = rig.handle.command(Command::Abort, Some(run), "test").await.unwrap_err();
    assert_eq!(refusal.to_string(), format!("run {run} is not under way"));
    rig.close().await;
}
