//! Whole runs.

use rig_engine::RunStatus;
use rig_report::{
    RunResults,
    export::{self, TableFormat, TableName},
};
use rig_store::{ChainCheck, Record, SweepOutcome};
use rig_tests::{TestRig, changed, text};

#[tokio::test]
async fn the_papers_protocol_gives_a_shift_for_every_touch() {
    let rig = TestRig::open().await;
    let protocol = rig.protocol(&text("config/protocols/three-direction.toml"));
    let (run, ending) = rig.run(protocol).await;
    assert_eq!(ending, RunStatus::Completed);
    let records = rig.records(run);
    let mut touches = 0;
    for stored in &records {
        if let Record::TouchResult(touch) = stored.record().unwrap() {
            touches += 1;
            assert!((touch.indentation_mm - 0.5).abs() < 0.005, "{touch:?}");
            assert!(touch.shift_hz > 3.0 && touch.shift_hz < 110.0, "{touch:?}");
            // Of the first touches the drift since the reference is the largest part.
            assert!(touch.shift_sigma_hz < 0.15, "{touch:?}");
        }
    }
    assert_eq!(touches, 5 * 3 * 4 + 50);
    // Every motion below the clear position was allowed by an intent before it.
    let mut floor_mm = f64::MAX;
    for stored in &records {
        match stored.record().unwrap() {
            Record::Intent(intent) => floor_mm = intent.to,
            Record::Moved(moved) if moved.axis == rig_store::Axis::LinearMm => {
                let is_rest =
                    moved.target >= rig.facts.limits.linear.rest_target().position().value();
                assert!(is_rest || moved.target >= floor_mm, "seq {}: {moved:?}", stored.seq);
            }
            _ => {}
        }
    }
    assert!(matches!(rig.reader().verify(run).unwrap(), ChainCheck::Intact { .. }));
    rig.close().await;
}

#[tokio::test]
async fn the_same_seed_gives_the_same_bytes() {
    let mut exports = Vec::new();
    for _ in 0..2 {
        let rig = TestRig::open().await;
        let (run, _) = rig.run(rig.protocol(&text("config/protocols/smoke.toml"))).await;
        let (records, mut bytes) = (rig.records(run), Vec::new());
        export::jsonl(&records, &mut bytes).unwrap();
        let results = RunResults::new(&rig.reader().run(run).unwrap(), &records).unwrap();
        for name in TableName::ALL.into_iter().filter(|name| *name != TableName::Touches) {
            for format in TableFormat::ALL {
                export::table(name, format, &results, &records, &mut bytes).unwrap();
            }
        }
        exports.push(bytes);
        rig.close().await;
    }
    assert!(exports[0].len() > 10_000);
    assert!(exports[0] == exports[1], "two runs with one seed differ");
}

#[tokio::test]
async fn a_second_run_goes_on_where_the_first_left_the_bench() {
    let rig = TestRig::open().await;
    for _ in 0..2 {
        let (_, ending) = rig.run(rig.protocol(&text("config/protocols/smoke.toml"))).await;
        assert_eq!(ending, RunStatus::Completed);
    }
    rig.close().await;
}

/// A scene in which the planner read one place again and again for minutes, the probe in contact.
#[tokio::test]
async fn a_scene_in_which_a_sweep_did_not_end_is_measured() {
    let rig = TestRig::open_bench(&[], &[("seed = 2020", "seed = 98")]).await;
    let (run, ending) = rig.run(rig.protocol(&text("config/protocols/smoke.toml"))).await;
    assert_eq!(ending, RunStatus::Completed);
    let (mut sweeps, mut refused) = (0, 0);
    for stored in rig.records(run) {
        if let Record::Sweep(sweep) = stored.record().unwrap() {
            sweeps += 1;
            refused += u32::from(!matches!(sweep.outcome, SweepOutcome::Accepted { .. }));
            assert!(sweep.readings.len() < 100, "{sweep:?}");
        }
    }
    // A refused sweep is repeated: every touch of a completed run is measured.
    assert!(sweeps > 30 && refused <= 1, "{sweeps} sweeps, {refused} of them refused");
    rig.close().await;
}

/// A window that ends below the resonance in contact: each touch is refused within its time limit,
/// and the message says why.
#[tokio::test]
async fn a_resonance_beyond_the_window_is_refused_in_time() {
    let rig = TestRig::open().await;
    let smoke = text("config/protocols/smoke.toml");
    for max_hz in ["max_hz = 200", "max_hz = 155"] {
        let protocol = changed(&smoke, &[("max_hz = 260", max_hz)]);
        let (run, ending) = rig.run(rig.protocol(&protocol)).await;
        assert_eq!(ending, RunStatus::CompletedWithRefusals);
        let (mut measured, mut refused) = (0, 0);
        for stored in rig.records(run) {
            let Record::Sweep(sweep) = stored.record().unwrap() else { continue };
            match sweep.outcome {
                SweepOutcome::Accepted { .. } => measured += 1,
                SweepOutcome::Refused { ref reason } => {
                    refused += 1;
                    let last = sweep.readings.last().unwrap();
                    let end_s = last.started_s + last.settle_s + last.integration_s;
                    let seconds = end_s - sweep.readings[0].started_s;
                    assert!(seconds <= 30.0, "{seconds} s");
                    assert!(!reason.is_empty());
                }
            }
        }
        assert!(refused > 0 && measured > 0, "{max_hz}: {refused} refused, {measured} measured");
    }
    rig.close().await;
}
