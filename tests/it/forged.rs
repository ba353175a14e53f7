//! Forged journals: the checker finds each forgery by its name, and nothing in sound runs.

mod amended;
mod cut;
mod labels;
mod list;
mod motion;
mod numbers;
mod outside;

use std::collections::BTreeSet;

use rig_engine::RunStatus;
use rig_tests::{TestRig, changed, forge::Forgery, text};
use rig_verify::{Check, Verdict};
use serde_json::{Value, json};

/// A forgery: its name, what must find it, and what it changes.
type Case = (&'static str, Check, fn(&mut Forgery));

/// A short sound run, forged by every case.
async fn sound() -> (TestRig, String) {
    let rig = TestRig::open().await;
    let protocol = rig.protocol(&text("config/protocols/smoke.toml"));
    let (run, _) = rig.run(protocol).await;
    (rig, run.to_string())
}

fn names(verdict: &Verdict) -> Vec<Check> {
    verdict.findings.iter().map(|finding| finding.check).collect()
}

/// Every forgery by records, with the digests made again.
const BY_RECORDS: [&[Case]; 4] = [motion::CASES, labels::CASES, numbers::CASES, outside::CASES];

#[tokio::test]
async fn every_forgery_is_found_by_its_name() {
    let (rig, run) = sound().await;
    let forgery = || Forgery::of(rig.data(), &run);
    let verdict = forgery().verdict();
    assert!(verdict.is_sound, "{:#?}", verdict.findings);
    assert_eq!(verdict.sweeps, 36);

    let mut again = forgery();
    again.write(true);
    assert!(again.verdict().is_sound, "a run with new digests: {:#?}", again.verdict().findings);

    let mut found = BTreeSet::new();
    let mut missed = Vec::new();
    for (name, expected, change) in BY_RECORDS.into_iter().flatten() {
        let mut forged = forgery();
        change(&mut forged);
        forged.write(true);
        let names = names(&forged.verdict());
        if !names.contains(expected) {
            missed.push(format!("{name}: expected {}, found {names:?}", expected.name()));
        }
        for unwanted in [Check::Digest, Check::Seal, Check::List, Check::Complete] {
            assert!(!names.contains(&unwanted), "{name}: {names:?}");
        }
        found.insert(*expected);
    }
    for (name, expected, change) in list::CASES {
        let mut forged = forgery();
        change(&mut forged);
        let names = names(&forged.verdict());
        if !names.contains(expected) {
            missed.push(format!("{name}: expected {}, found {names:?}", expected.name()));
        }
        found.insert(*expected);
    }
    assert!(missed.is_empty(), "{missed:#?}");
    let forgotten: Vec<_> = Check::ALL.into_iter().filter(|check| !found.contains(check)).collect();
    assert!(forgotten.is_empty(), "no forgery for {forgotten:?}");
    rig.close().await;
}

#[tokio::test]
async fn a_forgery_without_new_digests_is_found_by_them() {
    let (rig, run) = sound().await;
    let mut tried = 0;
    for (name, _, change) in BY_RECORDS.into_iter().flatten() {
        let mut forged = Forgery::of(rig.data(), &run);
        let before = forged.records.len();
        change(&mut forged);
        if forged.records.len() != before {
            continue;
        }
        forged.write(false);
        let names = names(&forged.verdict());
        assert!(names.contains(&Check::Digest), "{name}: {names:?}");
        tried += 1;
    }
    assert!(tried > 30, "{tried}");
    rig.close().await;
}

#[tokio::test]
async fn a_relaxation_that_readings_cannot_tell_from_the_free_decay_is_found() {
    let (rig, run) = sound().await;
    // Nothing of 0 changes what is fitted. A free decay takes 0.07 s, which is the limit.
    for (time_s, is_told) in [(-3.0, false), (0.0, false), (0.03, false), (3.0, true)] {
        let mut forged = Forgery::of(rig.data(), &run);
        let place = forged.nth("sweep", 3, |payload| payload["purpose"] == "touch");
        let extra = json!({ "kind": "relaxation", "change": 0.0, "time_s": time_s });
        forged.records[place].payload["outcome"]["extra"] = extra;
        forged.write(true);
        let findings = forged.verdict().findings;
        let found = findings.iter().any(|finding| finding.to_string().contains("relaxation"));
        assert_eq!(found, !is_told, "{time_s} s: {findings:#?}");
    }
    rig.close().await;
}

/// The number under a path of keys and places, such as `/outcome/sigma_hz`.
fn number<'a>(payload: &'a mut Value, path: &str) -> &'a mut Value {
    payload.pointer_mut(path).unwrap_or_else(|| panic!("there is no {path}"))
}

fn get(payload: &Value, path: &str) -> f64 {
    payload.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("there is no {path}"))
}

/// Replaces a number by a function of it.
fn change(payload: &mut Value, path: &str, to: impl Fn(f64) -> f64) {
    let found = get(payload, path);
    *number(payload, path) = to(found).into();
}

/// Any record of its kind.
fn any(_: &Value) -> bool {
    true
}

/// A false statement about the bench: its name, what must find it, and from which sweep on it changes what.
type Lie = (&'static str, Check, usize, fn(&mut Value));

/// Changes what every sweep, or every later one, states of the bench.
fn state_bench(forged: &mut Forgery, first: usize, change: impl Fn(&mut Value)) {
    let sweeps = forged.records.iter_mut().filter(|record| record.kind == "sweep").skip(first);
    for sweep in sweeps {
        change(&mut sweep.payload["fit"]["bench"]);
    }
}

#[tokio::test]
async fn what_a_survey_says_of_the_bench_is_checked() {
    let phase = [("analyzer_phase_deg = 0", "analyzer_phase_deg = 1\ncapacitance_slope = -0.05")];
    let rig = TestRig::open_bench(&[], &phase).await;
    let survey = [("[no_load_sweep]", "[no_load_sweep]\nsurvey_s = 20")];
    let protocol = rig.protocol(&changed(&text("config/protocols/smoke.toml"), &survey));
    let (run, status) = rig.run(protocol).await;
    assert_eq!(status, RunStatus::Completed);
    let run = run.to_string();
    let forgery = || Forgery::of(rig.data(), &run);
    let verdict = forgery().verdict();
    assert!(verdict.is_sound, "{:#?}", verdict.findings);
    let sweep =
        forgery().records.into_iter().find(|record| record.kind == "sweep").unwrap().payload;
    let stated = |name: &str| sweep["fit"]["bench"][name].as_f64().unwrap();
    let phase_rad = stated("phase_rad");
    assert!((phase_rad - 1_f64.to_radians()).abs() < 5e-3, "{phase_rad}");
    let capacitance_f = sweep["outcome"]["circuit"]["static_capacitance_f"].as_f64().unwrap();
    let slope = stated("dispersion_f") / capacitance_f;
    assert!((slope + 0.05).abs() < 0.02, "{slope}");

    let cases: [Lie; 9] = [
        ("another phase", Check::Resonance, 0, |bench| bench["phase_rad"] = 0.0.into()),
        ("a surer phase", Check::Resonance, 0, |bench| bench["phase_sigma_rad"] = 1e-5.into()),
        ("no dispersion", Check::Resonance, 0, |bench| bench["dispersion_f"] = 1e-12.into()),
        ("none and sure of it", Check::Resonance, 0, |bench| {
            bench["dispersion_f"] = 0.0.into();
            bench["dispersion_sigma_f"] = 0.0.into();
        }),
        ("a surer one", Check::Resonance, 0, |bench| bench["dispersion_sigma_f"] = 1e-12.into()),
        ("another first gap", Check::Resonance, 0, |bench| bench["first_gap_s"] = 5e-3.into()),
        ("no second mode", Check::Sigma, 0, |bench| bench["mode_sigma"] = 1e-6.into()),
        ("another phase later", Check::Request, 7, |bench| bench["phase_rad"] = 0.02.into()),
        ("nothing known later", Check::Request, 7, |bench| *bench = Value::Null),
    ];
    for (name, expected, first, change) in cases {
        let mut forged = forgery();
        state_bench(&mut forged, first, change);
        forged.write(true);
        let names = names(&forged.verdict());
        assert!(names.contains(&expected), "{name}: {names:?}");
    }
    rig.close().await;
}
