//! Touches that are measured again, and runs that are given up, forged.

use rig_engine::{Command, RigState, RunStatus};
use rig_store::RunId;
use rig_tests::{
    TestRig,
    forge::{Forged, Forgery},
    text,
};
use rig_verify::Check;
use rigd::rig::TouchOrder;
use serde_json::json;

use super::{any, names, sound};

const STEP: &str = "main/1/front/0/1";

/// Measures the first touch of a run again, after a run that a person has aborted in the same session.
async fn redone(rig: &TestRig, run: &str) -> RunId {
    let other =
        rig.handle.run(rig.protocol(&text("config/protocols/smoke.toml")), "Ada").await.unwrap();
    rig.command(Command::Abort).await.unwrap();
    assert_eq!(rig.ended(other).await, RunStatus::Aborted);
    rig.wait_for("an idle rig", |status| status.snapshot.state == RigState::Idle).await;
    let why = "a hair".to_owned();
    let order = TouchOrder { run: run.parse().unwrap(), step: STEP.to_owned(), why };
    let id = rig.handle.redo(order, false, "Ada").await.unwrap();
    assert_eq!(rig.ended(id).await, RunStatus::Completed);
    id
}

#[tokio::test]
async fn a_touch_that_is_measured_again_is_of_the_run_in_whose_name_it_is_listed() {
    let (rig, run) = sound().await;
    let id = redone(&rig, &run).await.to_string();
    let forgery = || Forgery::of(rig.data(), &id);
    assert!(forgery().verdict().is_sound, "{:#?}", forgery().verdict().findings);

    let mut forged = forgery();
    forged.records[0].payload["run"] = "0123456789abcdef0123456789abcdef".into();
    forged.write(true);
    assert!(names(&forged.verdict()).contains(&Check::Ends), "{:?}", forged.verdict().findings);

    let mut forged = forgery();
    let screw =
        json!({"heights_mm": [9.0, 8.0], "errors_mm": [0, 0], "covariance_um2": [[1], [0, 1]]});
    let cited = json!({
        "kind": "blocks", "made": "", "person": "ada", "file": "blocks-1.toml", "sha256": "", "screw": screw,
    });
    forged.records[0].payload["calibrations"] = json!([cited]);
    forged.write(true);
    // Nothing is said to have changed.
    assert_eq!(names(&forged.verdict()), [Check::Calibration, Check::Plan]);
    rig.close().await;
}

/// A redo that was made after the end of a run, or was cut short, is no outcome in the run; a redo of another rig says so.
#[tokio::test]
async fn a_touch_that_is_missing_is_not_excused_by_a_later_amendment() {
    let (rig, run) = sound().await;
    let id = redone(&rig, &run).await.to_string();
    let mut forged = Forgery::of(rig.data(), &run);
    let is_of = |payload: &serde_json::Value| payload["touch"]["step"] == STEP;
    let result = forged.nth("touch_result", 0, is_of);
    let begun = forged.nth("step_started", 0, |payload| payload["step"] == STEP);
    forged.records.drain(begun..=result);
    forged.write(true);
    assert!(names(&forged.verdict()).contains(&Check::Row), "{:?}", forged.verdict().findings);

    let mut forged = Forgery::of(rig.data(), &id);
    let rig_file = Forgery::of(rig.data(), &run).records[0].payload["rig"].clone();
    let toml = format!("{}\n# another", rig_file["toml"].as_str().unwrap());
    forged.records[0].payload["rig"] = json!({ "name": rig_file["name"], "toml": toml });
    forged.write(true);
    assert!(names(&forged.verdict()).contains(&Check::Plan), "{:?}", forged.verdict().findings);
    rig.close().await;
}

#[tokio::test]
async fn a_run_that_was_given_up_has_no_other_ending_than_before() {
    let (rig, run) = sound().await;
    let given_up = |forged: &mut Forgery, ending: &str| {
        let begun = forged.nth("step_started", 20, any);
        let rig_us = forged.records.last().unwrap().rig_us;
        forged.records.truncate(begun);
        for payload in [
            json!({ "kind": "given_up", "epoch": 1, "who": "Ada" }),
            json!({ "kind": "run_finished", "status": ending }),
        ] {
            let kind = payload["kind"].as_str().unwrap().to_owned();
            forged.records.push(Forged { rig_us, kind, payload });
        }
    };
    for (ending, is_told) in [("interrupted", false), ("completed", true), ("aborted", true)] {
        let mut forged = Forgery::of(rig.data(), &run);
        given_up(&mut forged, ending);
        forged.execute(&format!("UPDATE runs SET status = '{ending}' WHERE key = ?1"));
        forged.write(true);
        let findings = forged.verdict().findings;
        let found = findings.iter().any(|finding| finding.to_string().contains("given up"));
        assert_eq!(found, is_told, "{ending}: {findings:#?}");
    }
    // Nothing follows.
    let mut forged = Forgery::of(rig.data(), &run);
    let end = forged.records.last().unwrap().clone();
    given_up(&mut forged, "interrupted");
    forged.records.push(end);
    forged.write(true);
    assert!(names(&forged.verdict()).contains(&Check::Ends), "{:?}", forged.verdict().findings);
    rig.close().await;
}
