//! Runs whose surfaces are found by continuous descents.

use rig_engine::RunStatus;
use rig_store::Record;
use rig_tests::{TestRig, changed, forge::Forgery, text};
use rig_verify::Check;
use serde_json::Value;

/// The short protocol with descents of two cycles a reading, at this speed, mm/s.
fn descending(speed: &str) -> String {
    let method = format!("cycles = 2\nmethod = \"descent\"\nspeed_mm_per_s = {speed}\n\n[no_load");
    changed(&text("config/protocols/smoke.toml"), &[("cycles = 10\n\n[no_load", &method)])
}

/// What a run has recorded of its surfaces.
#[derive(Debug, Default)]
struct Surfaces {
    descents: usize,
    given_up: Vec<String>,
    touches: usize,
}

async fn run(rig: &TestRig, protocol: &str) -> (String, Surfaces) {
    let (run, ending) = rig.run(rig.protocol(protocol)).await;
    assert_eq!(ending, RunStatus::Completed);
    let mut surfaces = Surfaces::default();
    for stored in rig.records(run) {
        match stored.record().unwrap() {
            Record::Descended(descent) => {
                surfaces.descents += usize::from(descent.end == "contact");
                assert!(descent.readings.len() > 8, "{descent:?}");
            }
            Record::SurfaceNotFound(lost) => surfaces.given_up.extend(lost.reason),
            Record::SurfaceFound(found) => assert!(found.sigma_mm < 0.01, "{found:?}"),
            Record::TouchResult(touch) => {
                surfaces.touches += 1;
                assert!((touch.indentation_mm - 0.5).abs() < 0.02, "{touch:?}");
            }
            _ => {}
        }
    }
    (run.to_string(), surfaces)
}

fn is_any(_: &Value) -> bool {
    true
}

/// A forgery of a descent, what must find it, and what it changes.
type Case = (&'static str, Check, fn(&mut Forgery));

const FORGERIES: [Case; 7] = [
    ("another surface", Check::Surface, |forged| {
        let place = forged.nth("surface_found", 2, is_any);
        let found = &mut forged.records[place].payload;
        found["position_mm"] = (found["position_mm"].as_f64().unwrap() - 0.06).into();
    }),
    ("a target below the declared depth", Check::Depth, |forged| {
        let place = forged.nth("descended", 1, is_any);
        let descent = &mut forged.records[place].payload;
        descent["target_mm"] = (descent["target_mm"].as_f64().unwrap() - 0.1).into();
    }),
    ("a faster descent", Check::Speed, |forged| {
        let place = forged.nth("descended", 1, is_any);
        forged.records[place].payload["speed_mm_per_s"] = 1.5.into();
    }),
    ("a jump on the way", Check::Speed, |forged| {
        let place = forged.nth("descended", 1, is_any);
        let point = &mut forged.records[place].payload["way"][2]["position_mm"];
        *point = (point.as_f64().unwrap() + 0.2).into();
    }),
    ("a stop that came late", Check::SearchStep, |forged| {
        let place = forged.nth("descended", 1, is_any);
        let readings = forged.records[place].payload["readings"].as_array_mut().unwrap();
        let from = readings.len() - 5;
        for reading in &mut readings[from..] {
            reading["resistance_ohm"] = (3.0 * reading["resistance_ohm"].as_f64().unwrap()).into();
        }
    }),
    ("a contact that no reading shows", Check::Surface, |forged| {
        let place = forged.nth("descended", 1, is_any);
        let readings = forged.records[place].payload["readings"].as_array_mut().unwrap();
        for part in ["resistance_ohm", "reactance_ohm"] {
            let clear = readings[..8].iter().map(|one| one[part].as_f64().unwrap()).sum::<f64>();
            for reading in &mut readings[8..] {
                reading[part] = (clear / 8.0).into();
            }
        }
    }),
    ("a descent in another order of time", Check::ReadingTime, |forged| {
        let place = forged.nth("descended", 1, is_any);
        let reading = &mut forged.records[place].payload["readings"][4]["settle_s"];
        *reading = (reading.as_f64().unwrap() - 1.0).into();
    }),
];

#[tokio::test]
async fn a_run_by_descents_is_sound_and_every_forgery_of_one_is_found() {
    let rig = TestRig::open().await;
    let (run, surfaces) = run(&rig, &descending("1")).await;
    assert_eq!(surfaces.touches, 18, "{surfaces:?}");
    assert!(surfaces.descents >= 16 && surfaces.given_up.len() <= 6, "{surfaces:?}");
    let verdict = Forgery::of(rig.data(), &run).verdict();
    assert!(verdict.is_sound, "{:#?}", verdict.findings);
    let mut missed = Vec::new();
    for (name, expected, change) in FORGERIES {
        let mut forged = Forgery::of(rig.data(), &run);
        change(&mut forged);
        forged.write(true);
        let verdict = forged.verdict();
        let names: Vec<Check> = verdict.findings.iter().map(|finding| finding.check).collect();
        if !names.contains(&expected) {
            missed.push(format!("{name}: expected {}, found {names:?}", expected.name()));
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
    rig.close().await;
}
