//! Single sweeps of the free sensor.

use rig_engine::Command;
use rig_model::{DriveLevel, SweepMethod, SweepRequest, Window};
use rig_store::{Record, Sweep, SweepOutcome};
use rig_tests::TestRig;

fn request(min_hz: f64, max_hz: f64, method: SweepMethod) -> SweepRequest {
    SweepRequest {
        window: Window { min_hz, max_hz },
        method,
        target_sigma_hz: 0.02,
        time_limit_s: 200.0,
        cycles: 10,
        settle_s: 1.0,
        level: DriveLevel { volt: 1.0 },
    }
}

/// Measures, and returns the sweep from the journal.
async fn sweep(rig: &TestRig, request: SweepRequest) -> Sweep {
    let number = rig.handle.sweep(request, "test").await.unwrap();
    let status = rig.wait_for("the sweep", |status| status.sweep.is_none()).await;
    let records = rig.records(status.session);
    let mut sweeps = records.iter().rev().filter_map(|stored| match stored.record().unwrap() {
        Record::Sweep(sweep) => Some(sweep),
        _ => None,
    });
    sweeps.next().filter(|sweep| sweep.number == number).expect("the sweep is in the journal")
}

/// From the first change of frequency to the end of the last integration.
fn duration_s(sweep: &Sweep) -> f64 {
    let last = sweep.readings.last().unwrap();
    last.started_s + last.settle_s + last.integration_s - sweep.readings[0].started_s
}

#[tokio::test]
async fn the_planner_finds_the_free_resonance_wherever_it_lies_in_the_window() {
    let rig = TestRig::open().await;
    let mut worst_hz = 0.0_f64;
    for (min_hz, max_hz) in [
        (120.0, 165.0),
        (100.0, 250.0),
        (136.0, 145.0),
        (138.0, 260.0),
        (90.0, 146.0),
        (125.0, 160.0),
        (110.0, 300.0),
        (130.0, 150.0),
    ] {
        let sweep = sweep(&rig, request(min_hz, max_hz, SweepMethod::Adaptive)).await;
        let SweepOutcome::Accepted { resonance_hz, sigma_hz, .. } = sweep.outcome else {
            panic!("[{min_hz}, {max_hz}]: {:?}", sweep.outcome)
        };
        assert!(sigma_hz <= 0.02, "[{min_hz}, {max_hz}]: ± {sigma_hz}");
        // The scene lets it drift by tenths of a hertz.
        worst_hz = worst_hz.max((resonance_hz - 140.4).abs());
        assert!(duration_s(&sweep) < 12.0, "{} s", duration_s(&sweep));
    }
    assert!(worst_hz < 0.5, "{worst_hz}");
    rig.close().await;
}

#[tokio::test]
async fn a_uniform_sweep_agrees_with_the_planner() {
    let rig = TestRig::open().await;
    let uniform = SweepMethod::Uniform { points: 61 };
    let uniform = sweep(&rig, request(130.0, 150.0, uniform)).await;
    let planned = sweep(&rig, request(130.0, 150.0, SweepMethod::Adaptive)).await;
    let resonance = |sweep: &Sweep| match sweep.outcome {
        SweepOutcome::Accepted { resonance_hz, sigma_hz, .. } => (resonance_hz, sigma_hz),
        SweepOutcome::Refused { ref reason } => panic!("{reason}"),
    };
    let ((one, sigma_one), (two, sigma_two)) = (resonance(&uniform), resonance(&planned));
    // The resonance drifts meanwhile by far less than the planner is asked for.
    assert!((one - two).abs() < 5.0 * sigma_one.hypot(sigma_two) + 0.02, "{one} {two}");
    assert_eq!(uniform.readings.len(), 61);
    let (uniform_s, planned_s) = (duration_s(&uniform), duration_s(&planned));
    assert!(planned_s < uniform_s / 10.0, "{planned_s} s and {uniform_s} s");
    rig.close().await;
}

#[tokio::test]
async fn a_window_without_a_resonance_is_refused() {
    let rig = TestRig::open().await;
    let sweep = sweep(&rig, request(170.0, 230.0, SweepMethod::Adaptive)).await;
    assert!(matches!(sweep.outcome, SweepOutcome::Refused { .. }), "{:?}", sweep.outcome);
    // And the rig is ready for the next command.
    rig.command(Command::Stop).await.unwrap();
    rig.close().await;
}
