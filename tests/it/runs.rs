//! Whole runs.

use std::fs;

use rig_engine::RunStatus;
use rig_store::{Record, Verdict, export};
use rig_tests::{TestRig, shipped};

fn text(path: &str) -> String {
    fs::read_to_string(shipped(path)).unwrap()
}

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
            assert!(touch.shift_sigma_hz < 0.1, "{touch:?}");
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
                    moved.target >= rig.facts.bench.linear.rest_target().position().value();
                assert!(is_rest || moved.target >= floor_mm, "seq {}: {moved:?}", stored.seq);
            }
            _ => {}
        }
    }
    assert!(matches!(rig.reader().verify(run).unwrap(), Verdict::Intact { .. }));
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
        export::readings_csv(&records, &mut bytes).unwrap();
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
