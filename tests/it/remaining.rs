//! The expected duration of a run, learned from the earlier runs of the rig.

use rig_engine::RunStatus;
use rig_store::{Expected, Record};
use rig_tests::{TestRig, changed, text};

/// The expected duration of a run and the real one, s.
fn durations(rig: &TestRig, run: rig_store::RunId) -> (Expected, f64) {
    let records = rig.records(run);
    let Ok(Record::RunStarted(started)) = records[0].record() else { panic!() };
    let end_us = records.last().unwrap().rig_us;
    (started.expected.unwrap(), (end_us - records[0].rig_us) as f64 / 1e6)
}

#[tokio::test]
async fn the_expected_duration_of_a_run_is_learned_from_the_runs_before() {
    const RUNS: usize = 8;
    let rig = TestRig::open().await;
    let smoke = text("config/protocols/smoke.toml");
    let (mut widths, mut within) = (Vec::new(), 0);
    for index in 0..RUNS {
        // Other numbers of touches in turn, so that the durations differ.
        let angles = if index % 2 == 0 { "[0, 45]" } else { "[0, 15, 30, 45]" };
        let protocol = changed(&smoke, &[("[0, 45]", angles)]);
        let (run, status) = rig.run(rig.protocol(&protocol)).await;
        assert_eq!(status, RunStatus::Completed);
        let (expected, took_s) = durations(&rig, run);
        assert_eq!(expected.from_touches == 0, index == 0, "{expected:?}");
        assert!(expected.least_s < expected.most_s, "{expected:?}");
        if index > 0 {
            within += u32::from(expected.least_s <= took_s && took_s <= expected.most_s);
        }
        widths.push((expected.most_s - expected.least_s) / took_s);
    }
    // Of a range of four fifths, one in seven may be missed.
    assert!(within >= 6, "{within} of 7: {widths:?}");
    // The plan alone knows neither this bench nor its people.
    assert!(widths[0] > 1.0 && widths[1..].iter().all(|width| *width < 0.6), "{widths:?}");
    rig.close().await;
}

/// The sum over the plan, without any history, of both shipped protocols, and with more touches of each
/// mounting.
#[tokio::test]
async fn the_plan_alone_foretells_the_duration_of_a_run_within_five_percent() {
    let (smoke, paper) =
        (text("config/protocols/smoke.toml"), text("config/protocols/three-direction.toml"));
    let repeated = changed(&paper, &[("repeats = 1", "repeats = 3")]);
    for protocol in [smoke, paper, repeated] {
        let rig = TestRig::open().await;
        let checked = rig.protocol(&protocol);
        let foretold_s = checked.plan.summary(&rig.facts.limits).duration_s;
        let (run, status) = rig.run(checked).await;
        assert_eq!(status, RunStatus::Completed);
        let (_, took_s) = durations(&rig, run);
        let ratio = foretold_s / took_s;
        assert!((0.95..1.05).contains(&ratio), "{foretold_s} s foretold, {took_s} s taken");
        rig.close().await;
    }
}
