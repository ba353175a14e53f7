//! Readings that are wrong without a flag: left out of their sweeps, or the touch is refused, and never a wrong shift.

use rig_engine::RunStatus;
use rig_store::{Record, RunId, SweepOutcome, SweepPurpose};
use rig_tests::{TestRig, forge::Forgery, text};

/// A shift may differ from that of the undisturbed bench by this many standard deviations of both.
const SIGMAS: f64 = 5.0;

/// The touches of a run: shift and standard deviation, Hz, or `None` if it was refused.
fn shifts(rig: &TestRig, run: RunId) -> Vec<Option<(f64, f64)>> {
    let of = |record: Record| match record {
        Record::TouchResult(touch) => Some(Some((touch.shift_hz, touch.shift_sigma_hz))),
        Record::TouchRefused(_) => Some(None),
        _ => None,
    };
    rig.records(run).iter().filter_map(|stored| of(stored.record().unwrap())).collect()
}

/// Of the accepted sweeps in contact: how many left readings out, and how many there are.
fn left_out(rig: &TestRig, run: RunId) -> (usize, usize) {
    let of = |record: Record| match record {
        Record::Sweep(sweep) if sweep.purpose == SweepPurpose::Touch => match sweep.outcome {
            SweepOutcome::Accepted { left_out, .. } => Some(left_out > 0),
            SweepOutcome::Refused { .. } => None,
        },
        _ => None,
    };
    let all: Vec<bool> =
        rig.records(run).iter().filter_map(|stored| of(stored.record().unwrap())).collect();
    (all.iter().filter(|has| **has).count(), all.len())
}

#[tokio::test]
async fn a_run_with_wrong_readings_is_sound_and_has_no_wrong_shift() {
    let smoke = text("config/protocols/smoke.toml");
    let rig = TestRig::open().await;
    let (run, ending) = rig.run(rig.protocol(&smoke)).await;
    assert_eq!(ending, RunStatus::Completed);
    let undisturbed = shifts(&rig, run);
    rig.close().await;
    let mut with_left_out = 0;
    for (factor, rate) in [(1.06, 0.05), (0.7, 0.02), (-1.0, 0.01), (10.0, 0.01), (0.01, 0.03)] {
        let rig = TestRig::open().await;
        rig.fault(&format!("fault analyzer wrong-reading by={factor} rate={rate}"));
        let (run, ending) = rig.run(rig.protocol(&smoke)).await;
        let case = format!("{factor} at {rate}: {ending:?}");
        let found = shifts(&rig, run);
        for (expected, found) in undisturbed.iter().zip(&found) {
            let (Some((expected_hz, expected_sigma_hz)), Some((hz, sigma_hz))) = (expected, found)
            else {
                continue;
            };
            let off = (hz - expected_hz).abs() / sigma_hz.hypot(*expected_sigma_hz);
            assert!(off < SIGMAS, "{case}: {hz} ± {sigma_hz} Hz, undisturbed {expected_hz} Hz");
        }
        let (some, all) = left_out(&rig, run);
        with_left_out += some;
        assert!(0 < all, "{case}");
        let verdict = Forgery::of(rig.data(), &run.to_string()).verdict();
        assert!(verdict.is_sound, "{case}: {:#?}", verdict.findings);
        rig.close().await;
    }
    assert!(with_left_out > 10, "{with_left_out}");
}
