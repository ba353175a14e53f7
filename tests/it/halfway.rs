//! Touches that are measured at two depths, and forgeries of the measurement halfway.

use rig_engine::RunStatus;
use rig_store::Record;
use rig_tests::{TestRig, changed, forge::Forgery, text};
use rig_verify::Check;
use serde_json::{Value, json};

/// A forgery of the measurement halfway of a touch, and the check that must find it.
type Case = (Check, fn(&mut Value));

const FORGERIES: [Case; 5] = [
    (Check::Row, |touch| touch["halfway"] = Value::Null),
    (Check::Indentation, |touch| touch["halfway"]["indentation_mm"] = json!(0.3)),
    (Check::Copy, |touch| {
        let resonance_hz = touch["halfway"]["resonance_hz"].as_f64().expect("a number");
        touch["halfway"]["resonance_hz"] = json!(resonance_hz + 1.0);
    }),
    (Check::Copy, |touch| touch["halfway"]["sigma_hz"] = json!(0.001)),
    (Check::Copy, |touch| touch["halfway"]["sweep"] = touch["sweep"].clone()),
];

#[tokio::test]
async fn a_run_with_two_depths_is_sound_and_forged_depths_are_found() {
    let rig = TestRig::open().await;
    let smoke = text("config/protocols/smoke.toml");
    let depths = [("\nindentation_mm = 0.5", "\nindentation_mm = 0.5\nhalfway_mm = 0.25")];
    let (run, ending) = rig.run(rig.protocol(&changed(&smoke, &depths))).await;
    assert_eq!(ending, RunStatus::Completed);
    let mut touches = 0;
    for stored in rig.records(run) {
        let Record::TouchResult(touch) = stored.record().expect("a record") else { continue };
        let halfway = touch.halfway.expect("a measurement halfway");
        assert!((halfway.indentation_mm - 0.25).abs() < 0.003, "{halfway:?}");
        assert!(halfway.sweep < touch.sweep && halfway.resonance_hz < touch.resonance_hz);
        touches += 1;
    }
    assert_eq!(touches, 18);
    let run = run.to_string();
    let verdict = Forgery::of(rig.data(), &run).verdict();
    assert!(verdict.is_sound, "{:#?}", verdict.findings);
    assert_eq!(verdict.sweeps, 54);
    for (check, change) in FORGERIES {
        let mut forged = Forgery::of(rig.data(), &run);
        let place = forged.nth("touch_result", 2, |_| true);
        change(&mut forged.records[place].payload);
        forged.write(true);
        let found = forged.verdict().findings;
        assert!(found.iter().any(|finding| finding.check == check), "{check:?}: {found:#?}");
    }
    rig.close().await;
}
