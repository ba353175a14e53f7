//! Forgeries by somebody who knows the format but not the checks: results that are hidden, readings that
//! show something else, files that say something else.

use rig_tests::forge::{Forged, Forgery};
use rig_verify::Check;
use serde_json::{Value, json};

use super::{Case, any, change, get};

fn is_touch_sweep(payload: &Value) -> bool {
    payload["purpose"] == "touch"
}

fn sweep(forged: &mut Forgery, n: usize) -> &mut Value {
    let place = forged.nth("sweep", n, is_touch_sweep);
    &mut forged.records[place].payload
}

/// The search with this number.
fn search(forged: &mut Forgery, n: usize) -> &mut Vec<Value> {
    let place = forged.nth("surface_found", n, any);
    forged.records[place].payload["trail"].as_array_mut().expect("a trail")
}

/// Copies the impedance of one reading of a search to another one.
fn copy_impedance(trail: &mut [Value], from: usize, to: usize) {
    for key in ["resistance_ohm", "reactance_ohm"] {
        trail[to]["reading"][key] = trail[from]["reading"][key].clone();
    }
}

/// Changes a file that the first record keeps.
fn source(forged: &mut Forgery, path: &str, from: &str, to: &str) {
    let text = forged.records[0].payload.pointer_mut(path).expect("a file");
    let changed = text.as_str().expect("a text").replace(from, to);
    assert_ne!(*text, changed, "there is no {from}");
    *text = changed.into();
}

/// Turns a measured touch into a refused one.
fn refuse(forged: &mut Forgery, n: usize, reason: &str) {
    let place = forged.nth("touch_result", n, any);
    let of = forged.records[place].payload.clone();
    let payload = json!({
        "kind": "touch_refused", "touch": of["touch"], "reason": reason,
        "no_load_sweep": of["no_load_sweep"], "no_load_hz": of["no_load_hz"],
        "no_load_sigma_hz": of["no_load_sigma_hz"], "rotary_deg": of["rotary_deg"],
        "indented": {
            "sweep": of["sweep"], "surface_mm": of["surface_mm"],
            "surface_sigma_mm": of["surface_sigma_mm"],
            "indentation_mm": of["indentation_mm"], "linear_mm": of["linear_mm"],
        },
    });
    let rig_us = forged.records[place].rig_us;
    forged.records[place] = Forged { rig_us, kind: "touch_refused".to_owned(), payload };
    let last = forged.records.len() - 1;
    forged.records[last].payload["status"] = "completed_with_refusals".into();
    forged.execute("UPDATE runs SET status = 'completed_with_refusals' WHERE key = ?1");
}

const NO_RESONANCE: &str = "no resonance: a capacitor with loss explains the readings as well (a resonance \
                            adds 3.1 to twice the log-likelihood, a real one at least 25)";

fn refuse_sweep(payload: &mut Value) {
    payload["outcome"] = json!({"status": "refused", "reason": NO_RESONANCE});
}

/// Moves the times of readings by a time, s.
fn move_readings(payload: &mut Value, by_s: f64) {
    for list in ["/readings", "/trail"] {
        let Some(list) = payload.pointer_mut(list).and_then(Value::as_array_mut) else { continue };
        for one in list {
            let path =
                if one.get("reading").is_some() { "/reading/started_s" } else { "/started_s" };
            change(one, path, |at| at + by_s);
        }
    }
}

/// Refuses the last sweep, and repeats it as a refused sweep is repeated.
fn refuse_and_repeat(forged: &mut Forgery) {
    let place = forged.records.iter().rposition(|record| record.kind == "sweep").expect("a sweep");
    refuse_sweep(&mut forged.records[place].payload);
    let mut again = forged.records[place].clone();
    let span_us = again.rig_us - forged.records[place - 1].rig_us;
    again.rig_us += span_us;
    again.payload["number"] = json!(again.payload["number"].as_u64().expect("a number") + 1);
    move_readings(&mut again.payload, span_us as f64 / 1e6);
    for later in &mut forged.records[place + 1..] {
        later.rig_us += span_us;
        move_readings(&mut later.payload, span_us as f64 / 1e6);
    }
    let touches = forged.records.iter().filter(|record| record.kind == "touch_result").count();
    let last = forged.nth("touch_result", touches - 1, any);
    forged.records[last].payload["sweep"] = again.payload["number"].clone();
    refuse(forged, touches - 1, NO_RESONANCE);
    forged.records.insert(place + 1, again);
}

fn insert(forged: &mut Forgery, place: usize, rig_us: i64, payload: Value) {
    let kind = payload["kind"].as_str().expect("a kind").to_owned();
    forged.records.insert(place, Forged { rig_us, kind, payload });
}

pub(super) const CASES: &[Case] = &[
    ("another static capacitance", Check::Resonance, |forged| {
        change(sweep(forged, 2), "/outcome/circuit/static_capacitance_f", |c| 1.3 * c);
    }),
    ("another capacitance ratio", Check::Resonance, |forged| {
        change(sweep(forged, 2), "/outcome/circuit/capacitance_ratio", |ratio| 2.5 * ratio);
    }),
    ("another loss", Check::Resonance, |forged| {
        change(sweep(forged, 2), "/outcome/circuit/loss_tangent", |loss| loss + 0.4);
    }),
    ("readings that are said not to count", Check::Sweep, |forged| {
        sweep(forged, 2)["probe_readings"] = json!(3);
    }),
    ("more readings left out than may be", Check::Sweep, |forged| {
        sweep(forged, 2)["outcome"]["left_out"] = json!(9);
    }),
    ("a reading that is said to be flagged", Check::Sweep, |forged| {
        let readings = sweep(forged, 2)["readings"].as_array_mut().expect("readings");
        let last = readings.last_mut().and_then(Value::as_object_mut).expect("a reading");
        last.remove("resistance_ohm");
        last.remove("reactance_ohm");
        last.insert("flag".to_owned(), "overload".into());
    }),
    ("an accepted sweep that is said to be refused", Check::Sweep, |forged| {
        refuse_sweep(sweep(forged, 3));
        refuse(forged, 3, NO_RESONANCE);
    }),
    ("an accepted sweep that is said to be refused twice", Check::Resonance, refuse_and_repeat),
    ("a refused touch that says nothing of its indentation", Check::Copy, |forged| {
        refuse(forged, 3, "the analyzer flagged overload at 140.25 Hz in 3 of 3 tries");
        let place = forged.nth("touch_refused", 0, any);
        forged.records[place].payload.as_object_mut().expect("a record").remove("indented");
    }),
    ("a search that is declared again in its touch", Check::Row, |forged| {
        let place = forged.nth("intent", 3, |payload| payload["what"] == "approach");
        let twin = forged.records[place].clone();
        forged.records.insert(place, twin);
    }),
    ("a run that goes on after the answer abort", Check::Stopped, |forged| {
        let place = forged.nth("touch_result", 3, any);
        let (rig_us, touch) =
            (forged.records[place].rig_us, forged.records[place].payload["touch"].clone());
        let payload = json!({
            "kind": "refusal_answered", "step": touch["step"], "reason": NO_RESONANCE,
            "answer": "abort", "by": "somebody",
        });
        insert(forged, place, rig_us, payload);
    }),
    ("a sweep with readings of another one", Check::Distinct, |forged| {
        let of = sweep(forged, 2)["readings"].as_array().expect("readings").clone();
        let copies = sweep(forged, 5)["readings"].as_array_mut().expect("readings");
        for (copy, of) in copies.iter_mut().zip(of).take(5) {
            for key in ["frequency_hz", "resistance_ohm", "reactance_ohm"] {
                copy[key] = of[key].clone();
            }
        }
    }),
    ("a touch that is said to be contradicted", Check::Row, |forged| {
        let reason = "it is contradicted by what was measured next: contact sense: at 141.200 Hz \
                      the impedance of the clear probe is 64 % from that of the last no-load \
                      resonance, where at most 20 % are allowed";
        refuse(forged, 3, reason);
    }),
    ("a touch that is said to have slipped upwards", Check::Surface, |forged| {
        refuse(
            forged,
            3,
            "after the sweep the probe touches at 10.025 mm, 0.025 mm above the \
                           surface that the search found",
        );
    }),
    ("a touch that is said to have slipped downwards", Check::Surface, |forged| {
        refuse(
            forged,
            3,
            "after the sweep the probe is free at 9.975 mm, 0.025 mm below the \
                           surface that the search found",
        );
    }),
    ("a contact that no reading shows", Check::Surface, |forged| {
        let trail = search(forged, 1);
        let last = trail.len() - 1;
        copy_impedance(trail, 0, last);
    }),
    ("a clear position whose reading shows the contact", Check::Surface, |forged| {
        let trail = search(forged, 1);
        let last = trail.len() - 1;
        copy_impedance(trail, last, 1);
    }),
    ("a surface one step higher", Check::Surface, |forged| {
        let found = forged.nth("surface_found", 1, any);
        // Not the last step, but the move to it and its reading.
        forged.records.remove(found - 1);
        let trail = search(forged, 1);
        trail.pop();
        let [.., clear, contact] = &trail[..] else { panic!("two positions") };
        let (clear, contact) = (get(clear, "/position_mm"), get(contact, "/position_mm"));
        let payload = &mut forged.records[found - 1].payload;
        payload["position_mm"] = (0.5 * (clear + contact)).into();
        payload["sigma_mm"] = ((clear - contact) / 12.0_f64.sqrt()).into();
    }),
    ("blind touches that are not made by mounting", Check::Plan, |forged| {
        let (from, to) = ("trials = 6\n", "trials = 6\norder = \"by-mounting\"\n");
        source(forged, "/protocol/toml", from, to);
    }),
    ("a longer settling in the protocol", Check::Request, |forged| {
        source(forged, "/protocol/toml", "settle_s = 0.1\n", "settle_s = 4.0\n");
    }),
    ("more cycles in the protocol", Check::Request, |forged| {
        source(forged, "/protocol/toml", "cycles = 10\n", "cycles = 100\n");
    }),
    ("a standstill during a sweep", Check::ReadingTime, |forged| {
        let place = forged.nth("sweep", 3, is_touch_sweep);
        let rig_us = forged.records[place].rig_us - 1000;
        let payload = json!({"kind": "stalled", "stalled_s": 1.5, "is_measured_again": false});
        insert(forged, place, rig_us, payload);
    }),
    ("another stiffness of a sample", Check::Sample, |forged| {
        change(&mut forged.records[0].payload, "/samples/0/stiffness_mpa", |mpa| 2.0 * mpa);
    }),
    ("a map of the screw that is none", Check::Calibration, |forged| {
        let screw =
            json!({"heights_mm": [9.0, 8.0], "errors_mm": [0, 0], "covariance_um2": [[1], [0, 1]]});
        let cited = json!({
            "kind": "blocks", "made": "", "person": "ada", "file": "blocks-1.toml", "sha256": "", "screw": screw,
        });
        forged.records[0].payload["calibrations"] = json!([cited]);
    }),
    ("a simulated run that is said to be real", Check::Plan, |forged| {
        forged.records[0].payload["is_simulated"] = false.into();
    }),
    ("a run before its session was prepared", Check::Time, |forged| {
        for record in &mut forged.records {
            record.rig_us -= 500_000;
            let payload = &mut record.payload;
            move_readings(payload, -0.5);
            if payload.pointer("/outcome/effective_time_s").is_some_and(Value::is_number) {
                change(payload, "/outcome/effective_time_s", |at| at - 0.5);
            }
        }
    }),
];
