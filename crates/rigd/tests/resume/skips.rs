//! Touches that a person leaves out while their run is under way.

use std::{collections::BTreeMap, fs};

use rig_engine::{Command, RigState, RunStatus};
use rig_store::{Reader, Record, RunId};
use rigd::rig::{self, RequestRefusal, TouchOrder};
use tempfile::TempDir;

use crate::support::{Bench, rigd, write_protocol, write_rig};

#[tokio::test]
async fn touches_ahead_are_left_out_of_a_paused_run_and_the_rest_is_measured() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let data = folder.path().join("data");
    let bench = Bench::open(&rig, &data);
    let run = bench.start(&rig, &protocol).await;
    let mut status = bench.handle.status();
    status
        .wait_for(|status| status.run.as_ref().is_some_and(|run| run.touches_done > 0))
        .await
        .unwrap();
    bench.handle.command(Command::Pause, None, "Ada").await.unwrap();
    bench.wait_for(RigState::Paused).await;

    let planned = planned(&data, run);
    let done = outcomes(&data, run).len();
    assert!((1..=3).contains(&done), "paused after {done} touches");
    let skip = |step: &str| {
        let order = TouchOrder { run, step: step.to_owned(), why: "cracked".to_owned() };
        bench.handle.skip(order, "Ada")
    };
    // The next one, and the last one.
    let left_out = [planned[done].clone(), planned[5].clone()];
    for step in &left_out {
        skip(step).await.unwrap();
    }
    for (step, said) in [
        (&*planned[0], "has begun"),
        (&*left_out[0], "is left out already"),
        ("main/9/left/0/1", "the run under way has no touch main/9/left/0/1"),
    ] {
        let refusal = skip(step).await.unwrap_err();
        assert!(refusal.to_string().ends_with(said), "{step}: {refusal}");
    }
    bench.handle.command(Command::Resume, None, "Ada").await.unwrap();
    assert_eq!(bench.ended(run).await, RunStatus::Completed);
    bench.close().await;

    let outcomes = outcomes(&data, run);
    let expected: Vec<_> = planned.iter().filter(|step| !left_out.contains(step)).collect();
    let mut made: Vec<_> = outcomes.keys().collect();
    made.sort_by_key(|step| planned.iter().position(|one| one == *step));
    assert_eq!(made, expected);
    let verdict = rig_verify::verify(&data, &run.to_string()).unwrap();
    assert!(verdict.is_sound, "{:#?}", verdict.findings);
    let shown = rigd(folder.path(), &["show", "latest", "--json"]);
    let shown: serde_json::Value = serde_json::from_slice(&shown.stdout).unwrap();
    assert_eq!((&shown["touches_measured"], &shown["touches_skipped"]), (&4.into(), &2.into()));
    assert_eq!(shown["touch_results"][done]["amended"], "skip by Ada: cracked");
}

/// Answers the prompts of a run, or of a touch that is measured again, until it has ended.
async fn answer_to_the_end(bench: &Bench, run: RunId) -> RunStatus {
    let mut status = bench.handle.status();
    for _ in 0..20 {
        let waits = |status: &rig::Status| {
            let of_run = status.run.as_ref().filter(|view| view.id == run);
            of_run.is_some_and(|view| view.ending.is_some())
                || status.snapshot.state == RigState::WaitingForPerson
        };
        let now = status.wait_for(waits).await.unwrap().clone();
        if let Some(ending) = now.run.filter(|view| view.id == run).and_then(|view| view.ending) {
            return ending;
        }
        bench.handle.command(Command::Answer, Some(run), "Ada").await.unwrap();
    }
    panic!("asked without end");
}

/// The touch that is measured again waits at its first prompt, so that it is under way for sure.
#[tokio::test]
async fn no_touch_of_a_run_is_left_out_while_one_of_it_is_measured_again() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let text = fs::read_to_string(&rig).unwrap();
    let waits = text.replace("person = \"answers\"", "person = \"waits\"");
    assert_ne!(text, waits);
    fs::write(&rig, waits).unwrap();
    let data = folder.path().join("data");
    let bench = Bench::open(&rig, &data);
    let run = bench.start(&rig, &protocol).await;
    assert_eq!(answer_to_the_end(&bench, run).await, RunStatus::Completed);
    let planned = planned(&data, run);
    let order =
        |step: &str| TouchOrder { run, step: step.to_owned(), why: "it slipped".to_owned() };
    let amendment = bench.handle.redo(order(&planned[1]), false, "Ada").await.unwrap();
    bench.wait_for(RigState::WaitingForPerson).await;
    for step in [&planned[1], &planned[4]] {
        let refusal = bench.handle.skip(order(step), "Ada").await.unwrap_err();
        assert!(matches!(refusal, RequestRefusal::Resume(_)), "{refusal:?}");
        assert!(refusal.to_string().ends_with("is under way"), "{step}: {refusal}");
    }
    let shown = || -> serde_json::Value {
        let shown = rigd(folder.path(), &["show", "latest", "--json"]);
        serde_json::from_slice(&shown.stdout).unwrap()
    };
    assert_eq!(shown()["touches_skipped"], 0);
    assert_eq!(answer_to_the_end(&bench, amendment).await, RunStatus::Completed);
    bench.wait_for(RigState::Idle).await;
    let row = shown()["touch_results"][1].clone();
    assert_eq!(row["amended"], "redo by Ada: it slipped", "{row}");
    bench.handle.skip(order(&planned[4]), "Ada").await.unwrap();
    bench.close().await;
    assert_eq!(shown()["touches_skipped"], 1);
    for id in [run, amendment] {
        let verdict = rig_verify::verify(&data, &id.to_string()).unwrap();
        assert!(verdict.is_sound, "{id}: {:#?}", verdict.findings);
    }
}

/// What they read, a stop would have to wait for.
#[tokio::test]
async fn nothing_of_another_run_is_decided_while_a_run_is_under_way() {
    let folder = TempDir::new().unwrap();
    let (rig, protocol) = (write_rig(folder.path()), write_protocol(folder.path()));
    let text = fs::read_to_string(&rig).unwrap();
    fs::write(&rig, text.replace("person = \"answers\"", "person = \"waits\"")).unwrap();
    let data = folder.path().join("data");
    let bench = Bench::open(&rig, &data);
    let earlier = bench.start(&rig, &protocol).await;
    bench.wait_for(RigState::WaitingForPerson).await;
    bench.handle.command(Command::Abort, Some(earlier), "Ada").await.unwrap();
    bench.wait_for(RigState::Idle).await;
    let run = bench.start(&rig, &protocol).await;
    bench.wait_for(RigState::WaitingForPerson).await;
    let step = planned(&data, earlier)[0].clone();
    let order = TouchOrder { run: earlier, step, why: "cracked".to_owned() };
    let skipped = bench.handle.skip(order.clone(), "Ada").await.unwrap_err();
    let given_up = bench.handle.give_up(earlier, "Ada").await.unwrap_err();
    for refusal in [skipped, given_up] {
        assert!(matches!(refusal, RequestRefusal::Command(_)), "{refusal:?}");
    }
    assert_eq!(answer_to_the_end(&bench, run).await, RunStatus::Completed);
    bench.wait_for(RigState::Idle).await;
    bench.handle.skip(order, "Ada").await.unwrap();
    bench.handle.give_up(earlier, "Ada").await.unwrap();
    bench.close().await;
}

fn planned(data: &std::path::Path, run: RunId) -> Vec<String> {
    let records = Reader::open(data).unwrap().records(run).unwrap();
    let Ok(Record::RunStarted(started)) = records[0].record() else { panic!("no plan") };
    started.touches.into_iter().map(|touch| touch.step).collect()
}

/// The number of outcomes of each touch.
fn outcomes(data: &std::path::Path, run: RunId) -> BTreeMap<String, u32> {
    let mut outcomes = BTreeMap::new();
    for stored in Reader::open(data).unwrap().records(run).unwrap() {
        if let Ok(Record::TouchResult(touch)) = stored.record() {
            *outcomes.entry(touch.touch.step).or_default() += 1;
        }
    }
    assert!(outcomes.values().all(|count| *count == 1), "{outcomes:?}");
    outcomes
}
