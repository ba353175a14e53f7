//! The drift of a run: references that it does not need, a sensor that is knocked, and forgeries of both.

use rig_engine::RunStatus;
use rig_store::{Record, StoredRecord};
use rig_tests::{TestRig, changed, forge::Forgery, text};
use rig_verify::{Check, Verdict};
use serde_json::json;

/// How far the sensor is knocked, Hz.
const KNOCK_HZ: f64 = 0.8;

/// Smoke with references by drift, on a bench that walks so much that some are needed.
async fn run_by_drift(walk_hz: f64, knock: Option<&str>) -> (TestRig, String) {
    let walk = format!("walk_hz_per_sqrt_hour = {walk_hz}");
    let rig = TestRig::open_bench(&[], &[("walk_hz_per_sqrt_hour = 0.1", &walk)]).await;
    let smoke = text("config/protocols/smoke.toml");
    let by_drift = changed(&smoke, &[("seed = 1\n", "seed = 1\nno_load = \"by-drift\"\n")]);
    if let Some(knock) = knock {
        rig.fault(knock);
    }
    let (run, ending) = rig.run(rig.protocol(&by_drift)).await;
    // On a bench that walks far, the check after a sweep may refuse a touch.
    let is_ended = matches!(ending, RunStatus::Completed | RunStatus::CompletedWithRefusals);
    assert!(knock.is_some() || is_ended, "{walk_hz}: {ending:?}");
    (rig, run.to_string())
}

fn said(verdict: &Verdict) -> Vec<(Check, &str)> {
    verdict.findings.iter().map(|finding| (finding.check, &*finding.what)).collect()
}

#[tokio::test]
async fn the_drift_that_touches_state_is_learnt_anew() {
    for walk_hz in [0.1, 1.0, 3.0] {
        let (rig, run) = run_by_drift(walk_hz, None).await;
        let verdict = Forgery::of(rig.data(), &run).verdict();
        assert!(verdict.is_sound, "{walk_hz}: {:#?}", verdict.findings);
        let mut forged = Forgery::of(rig.data(), &run);
        let place = forged.nth("touch_result", 7, |_| true);
        let touch = &mut forged.records[place].payload;
        let of = |key: &str| touch[key].as_f64().expect("a number");
        let drift_hz = 0.5 * of("drift_sigma_hz");
        let sigma_hz = of("sigma_hz").hypot(of("no_load_sigma_hz")).hypot(drift_hz);
        touch["drift_sigma_hz"] = json!(drift_hz);
        touch["shift_sigma_hz"] = json!(sigma_hz);
        forged.write(true);
        let verdict = forged.verdict();
        let found = said(&verdict);
        assert!(
            found.contains(&(
                Check::Reference,
                "the standard deviation of the drift since the reference, Hz"
            )),
            "{walk_hz}: {found:?}"
        );
        rig.close().await;
    }
}

#[tokio::test]
async fn a_knock_is_a_jump_and_its_record_can_be_neither_left_out_nor_made_up() {
    // A knock while the sensor is turned, or that ruins a touch, is no jump: one of these is neither.
    let mut run_and_jump = None;
    for nth in (300..3000).step_by(200) {
        let knock = format!("fault analyzer knock by={KNOCK_HZ} nth={nth}");
        let (rig, run) = run_by_drift(0.1, Some(&knock)).await;
        let jumped = |stored: StoredRecord| match stored.record() {
            Ok(Record::ReferenceJumped(jumped)) => Some(jumped),
            _ => None,
        };
        let jump = rig.records(run.parse().expect("a run")).into_iter().find_map(jumped);
        if let Some(jump) = jump {
            run_and_jump = Some((rig, run, jump));
            break;
        }
        rig.close().await;
    }
    let (rig, run, jump) = run_and_jump.expect("a jump");
    assert!((jump.off_hz - KNOCK_HZ).abs() < 0.2 && !jump.touches.is_empty(), "{jump:?}");
    let verdict = Forgery::of(rig.data(), &run).verdict();
    assert!(verdict.is_sound, "{:#?}", verdict.findings);

    let mut left_out = Forgery::of(rig.data(), &run);
    let place = left_out.nth("reference_jumped", 0, |_| true);
    left_out.records.remove(place);
    left_out.write(true);
    let verdict = left_out.verdict();
    let what = "a reference that no drift explains, and the record of a jump";
    assert!(said(&verdict).contains(&(Check::Reference, what)), "{:?}", said(&verdict));

    let mut smaller = Forgery::of(rig.data(), &run);
    smaller.records[place].payload["off_hz"] = json!(0.5 * KNOCK_HZ);
    smaller.write(true);
    let what = "how far a jump of the resonance is off, Hz";
    assert!(said(&smaller.verdict()).contains(&(Check::Reference, what)));

    let mut made_up = Forgery::of(rig.data(), &run);
    let sweep = made_up.nth("sweep", 2, |payload| payload["purpose"] == "no_load");
    let mut another = made_up.records[place].clone();
    another.rig_us = made_up.records[sweep].rig_us;
    made_up.records.insert(sweep + 1, another);
    made_up.write(true);
    let found = made_up.verdict();
    assert!(
        said(&found)
            .iter()
            .any(|(check, what)| *check == Check::Reference && what.starts_with("a jump of")),
        "{:?}",
        said(&found)
    );
    rig.close().await;
}
