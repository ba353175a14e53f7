//! Refused touches through the whole daemon: the policy of the protocol, and its records.

use std::collections::BTreeSet;

use rig_engine::{Command, RefusalAnswer, RigState, RunStatus};
use rig_store::{Action, Record, RunId, SweepPurpose};
use rig_tests::{TestRig, changed, touches_of_smoke};

/// Sample 5 has its resonance in contact beyond the window.
fn narrow(on_refusal: &str) -> String {
    let policy = format!("indentation_mm = 0.5\non_refusal = \"{on_refusal}\"");
    let changes = [("max_hz = 260", "max_hz = 205"), ("indentation_mm = 0.5", &*policy)];
    changed(&touches_of_smoke("[0, 45]"), &changes)
}

#[tokio::test]
async fn the_policy_of_the_protocol_is_carried_out_and_recorded_and_the_run_is_sound() {
    for (policy, word, expected) in [
        ("record", None, RunStatus::CompletedWithRefusals),
        ("widen", Some("widen"), RunStatus::Completed),
        ("repeat", Some("repeat"), RunStatus::CompletedWithRefusals),
        ("abort", Some("abort"), RunStatus::Aborted),
        // The simulated person keeps the refusal.
        ("ask", Some("skip"), RunStatus::CompletedWithRefusals),
    ] {
        let rig = TestRig::open().await;
        let (run, status) = rig.run(rig.protocol(&narrow(policy))).await;
        assert_eq!(status, expected, "{policy}");
        let answers: Vec<_> = rig
            .records(run)
            .iter()
            .filter_map(|stored| match stored.record() {
                Ok(Record::RefusalAnswered(answered)) => Some(answered),
                _ => None,
            })
            .collect();
        assert_eq!(answers.is_empty(), word.is_none(), "{policy}: {answers:?}");
        for answered in &answers {
            assert_eq!(Some(answered.answer.as_str()), word, "{policy}");
            assert!(!answered.reason.is_empty());
            let window = (policy == "widen").then_some([92.5, 242.5]);
            assert_eq!(answered.window_hz, window, "{policy}");
        }
        let verdict = rig_verify::verify(rig.data(), &run.to_string()).unwrap();
        assert!(verdict.is_sound, "{policy}: {:#?}", verdict.findings);
        rig.close().await;
    }
}

/// Plays a run whose refused touches a person has made again with a wider window. Returns its id and how many there were.
async fn widened(rig: &TestRig, toml: &str) -> (RunId, usize) {
    let run = rig.handle.run(rig.protocol(toml), "Ada").await.unwrap();
    let mut status = rig.handle.status();
    let mut asked = 0;
    for _ in 0..20 {
        let waits = |status: &rigd::rig::Status| {
            let is_over = status.run.as_ref().is_some_and(|run| run.ending.is_some());
            is_over || status.snapshot.state == RigState::WaitingForPerson
        };
        let now = status.wait_for(waits).await.unwrap().clone();
        if let Some(ending) = now.run.as_ref().and_then(|run| run.ending) {
            assert_eq!(ending, RunStatus::Completed);
            return (run, asked);
        }
        let command = now.snapshot.refused.map_or(Command::Answer, |touch| {
            asked += 1;
            Command::Decide { step: touch.step, answer: RefusalAnswer::Widen }
        });
        rig.handle.command(command, Some(run), "Ada").await.unwrap();
    }
    panic!("asked without end");
}

/// The reference before a touch that is made again is of the step of the touch.
#[tokio::test]
async fn a_person_is_asked_and_widens_the_window_after_a_reference_as_a_planned_touch_has_it() {
    for (no_load, has_reference) in [("every-touch", true), ("by-drift", true), ("once", false)] {
        let person = ("person = \"answers\"", "person = \"waits\"");
        let rig = TestRig::open_changed(&[person]).await;
        let change = ("seed = 1", &*format!("seed = 1\nno_load = \"{no_load}\""));
        let (run, asked) = widened(&rig, &changed(&narrow("ask"), &[change])).await;
        assert!(asked >= 1, "{no_load}: nobody was asked");
        let (mut touches, mut references, mut last) = (BTreeSet::new(), 0, 0);
        for stored in rig.records(run) {
            match stored.record().unwrap() {
                Record::StepStarted(begun) => {
                    if matches!(begun.action, Action::Touch { .. }) {
                        touches.insert(begun.step);
                    }
                }
                Record::Sweep(sweep) if sweep.purpose == SweepPurpose::NoLoad => {
                    last = sweep.number;
                    references +=
                        usize::from(sweep.step.is_some_and(|step| touches.contains(&step)));
                }
                Record::TouchResult(result) => assert_eq!(result.no_load_sweep, last, "{no_load}"),
                _ => {}
            }
        }
        assert_eq!(references, if has_reference { asked } else { 0 }, "{no_load}");
        let verdict = rig_verify::verify(rig.data(), &run.to_string()).unwrap();
        assert!(verdict.is_sound, "{no_load}: {:#?}", verdict.findings);
        rig.close().await;
    }
}
