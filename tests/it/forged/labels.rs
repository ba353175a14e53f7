//! Forged labels: samples, poses, steps, sweeps.

use rig_tests::forge::{Forged, Forgery};
use rig_verify::Check;
use serde_json::{Value, json};

use super::{Case, any, change, get};

fn is_touch_sweep(payload: &Value) -> bool {
    payload["purpose"] == "touch"
}

fn is_reference(payload: &Value) -> bool {
    payload["purpose"] == "no_load"
}

fn result(forged: &mut Forgery, n: usize) -> &mut Value {
    let place = forged.nth("touch_result", n, any);
    &mut forged.records[place].payload
}

fn rows(forged: &mut Forgery) -> &mut Vec<Value> {
    let touches = forged.records[0].payload["touches"].as_array_mut();
    touches.expect("a plan")
}

fn protocol(forged: &mut Forgery, from: &str, to: &str) {
    source(forged, "/protocol/toml", from, to);
}

fn source(forged: &mut Forgery, path: &str, from: &str, to: &str) {
    let text = forged.records[0].payload.pointer_mut(path).expect("a file");
    let changed = text.as_str().expect("a text").replace(from, to);
    assert_ne!(*text, changed, "there is no {from}");
    *text = changed.into();
}

fn without_slip_check(forged: &mut Forgery) {
    protocol(forged, "\ncontact_threshold", "\nslip_mm = 0\ncontact_threshold");
}

/// Numbers the steps anew, as if there had never been others.
fn renumber(forged: &mut Forgery) {
    let is_step = |record: &&mut Forged| record.kind == "step_started";
    let count = forged.records.iter_mut().filter(is_step).count();
    for (index, step) in (1..=count).zip(forged.records.iter_mut().filter(is_step)) {
        step.payload["index"] = index.into();
        step.payload["count"] = count.into();
    }
    forged.records[0].payload["plan"]["steps"] = count.into();
}

pub(super) const CASES: &[Case] = &[
    ("a reference left out, and the steps numbered anew", Check::Plan, |forged| {
        let is_no_load = |payload: &Value| payload["action"]["action"] == "no_load";
        let begin = forged.nth("step_started", 1, is_no_load);
        let is_step = |&place: &usize| forged.records[place].kind == "step_started";
        let next = (begin + 1..forged.records.len()).find(is_step).expect("a step");
        forged.records.drain(begin..next);
        renumber(forged);
    }),
    ("another policy for the reference", Check::Plan, |forged| {
        protocol(forged, "\nseed", "\nno_load = \"every-sample\"\nseed");
    }),
    ("another order of the touches", Check::Plan, |forged| {
        protocol(forged, "\nseed", "\norder = \"by-travel\"\nseed");
    }),
    ("another seed", Check::Plan, |forged| {
        forged.records[0].payload["seed"] = 77.into();
    }),
    ("swapped samples", Check::Sample, |forged| {
        result(forged, 0)["touch"]["sample"] = "5".into();
        result(forged, 6)["touch"]["sample"] = "1".into();
    }),
    ("another sample than was placed", Check::Sample, |forged| {
        let is_placed = |payload: &Value| payload["prompt"]["what"] == "place_sample";
        let asked = forged.nth("prompt_asked", 0, is_placed);
        forged.records[asked].payload["prompt"]["sample"] = "5".into();
        let step = forged.nth("step_started", 0, any);
        forged.records[step].payload["action"]["prompt"]["sample"] = "5".into();
    }),
    ("a sensor that was not turned", Check::Orientation, |forged| {
        let is_left = |payload: &Value| payload["action"]["prompt"]["orientation"] == "left";
        let step = forged.nth("step_started", 0, is_left);
        let answered =
            (step..forged.records.len()).find(|&n| forged.records[n].kind == "prompt_answered");
        forged.records.drain(step..=answered.expect("an answer"));
    }),
    ("another direction in a result", Check::Pose, |forged| {
        result(forged, 1)["touch"]["pose"]["direction"] = "back".into();
    }),
    ("another angle in a result", Check::Pose, |forged| {
        result(forged, 1)["touch"]["pose"]["angle_deg"] = 30.0.into();
    }),
    ("another pose of a sweep", Check::Pose, |forged| {
        let place = forged.nth("sweep", 1, is_touch_sweep);
        forged.records[place].payload["pose"]["direction"] = "back".into();
    }),
    ("another pose of a search", Check::Pose, |forged| {
        let place = forged.nth("surface_found", 1, any);
        forged.records[place].payload["pose"]["angle_deg"] = 0.0.into();
    }),
    ("another tilt than that of the step", Check::Pose, |forged| {
        let is_turn =
            |payload: &Value| payload["axis"] == "rotary_deg" && get(payload, "/target") > 40.0;
        let place = forged.nth("moved", 0, is_turn);
        for path in ["/target", "/read_back"] {
            change(&mut forged.records[place].payload, path, |_| 30.0);
        }
    }),
    ("a sweep in contact before the indentation", Check::Pose, |forged| {
        let sweep = forged.nth("sweep", 0, is_touch_sweep);
        forged.records.swap(sweep - 1, sweep);
    }),
    ("another touch in a result", Check::Row, |forged| {
        result(forged, 2)["touch"]["step"] = "main/1/back/45/1".into();
    }),
    ("swapped results", Check::Copy, |forged| {
        let places = [0, 1].map(|n| forged.nth("touch_result", n, any));
        let touches = places.map(|place| forged.records[place].payload["touch"].clone());
        forged.records.swap(places[0], places[1]);
        for (place, touch) in places.into_iter().zip(touches) {
            forged.records[place].payload["touch"] = touch;
        }
    }),
    ("a missing result", Check::Row, |forged| {
        let place = forged.nth("touch_result", 3, any);
        forged.records.remove(place);
    }),
    ("a result twice", Check::Row, |forged| {
        let place = forged.nth("touch_result", 3, any);
        let twin = forged.records[place].clone();
        forged.records.insert(place, twin);
    }),
    ("a check of slip that is said to be left out", Check::Row, |forged| {
        result(forged, 3)["is_slip_checked"] = false.into();
    }),
    ("a check of slip that the protocol leaves out", Check::Row, without_slip_check),
    ("a check of slip that nobody asked for, and no mark", Check::Surface, |forged| {
        without_slip_check(forged);
        let results = forged.records.iter_mut().filter(|record| record.kind == "touch_result");
        for touch in results {
            touch.payload.as_object_mut().expect("an object").remove("is_slip_checked");
        }
    }),
    ("a step twice", Check::StepOrder, |forged| {
        let place = forged.nth("step_started", 5, any);
        let twin = forged.records[place].clone();
        forged.records.insert(place, twin);
    }),
    ("another step than planned", Check::StepOrder, |forged| {
        let place = forged.nth("step_started", 7, any);
        forged.records[place].payload["step"] = "main/5/back/0/1".into();
    }),
    ("a prompt without an answer", Check::StepOrder, |forged| {
        let place = forged.nth("prompt_answered", 2, any);
        forged.records.remove(place);
    }),
    ("a touch that was not planned", Check::Plan, |forged| {
        rows(forged)[4]["pose"]["angle_deg"] = 44.0.into();
    }),
    ("a planned touch less", Check::Plan, |forged| {
        rows(forged).pop();
        forged.records[0].payload["plan"]["touches"] = json!(17);
    }),
    ("another number of trials", Check::Plan, |forged| {
        protocol(forged, "trials = 6", "trials = 7");
    }),
    ("another number of a sweep", Check::Sweep, |forged| {
        let place = forged.nth("sweep", 4, any);
        forged.records[place].payload["number"] = json!(9);
    }),
    ("another purpose of a sweep", Check::Sweep, |forged| {
        let place = forged.nth("sweep", 1, is_reference);
        forged.records[place].payload["purpose"] = "touch".into();
    }),
    ("another step of a sweep", Check::Sweep, |forged| {
        let place = forged.nth("sweep", 3, is_touch_sweep);
        forged.records[place].payload["step"] = "blind/1".into();
    }),
    ("a missing reference", Check::Reference, |forged| {
        let place = forged.nth("sweep", 2, is_reference);
        forged.records.remove(place);
    }),
    ("an older reference", Check::Reference, |forged| {
        let old = result(forged, 2).clone();
        let new = result(forged, 3);
        for key in ["no_load_sweep", "no_load_hz", "no_load_sigma_hz"] {
            new[key] = old[key].clone();
        }
        let shift = get(new, "/resonance_hz") - get(new, "/no_load_hz");
        new["shift_hz"] = shift.into();
        let sigma = get(new, "/sigma_hz").hypot(get(new, "/no_load_sigma_hz"));
        let sigma = sigma.hypot(get(new, "/drift_sigma_hz"));
        new["shift_sigma_hz"] = sigma.into();
    }),
    ("readings from before the move", Check::ReadingTime, |forged| {
        let place = forged.nth("sweep", 3, is_touch_sweep);
        let readings = forged.records[place].payload["readings"].as_array_mut().expect("readings");
        for reading in readings {
            change(reading, "/started_s", |at| at - 1.0);
        }
    }),
    ("readings from after the sweep", Check::ReadingTime, |forged| {
        let place = forged.nth("sweep", 3, is_touch_sweep);
        let readings = forged.records[place].payload["readings"].as_array_mut().expect("readings");
        for reading in readings {
            change(reading, "/started_s", |at| at + 1.0);
        }
    }),
    ("readings out of order", Check::ReadingTime, |forged| {
        let place = forged.nth("sweep", 3, is_touch_sweep);
        let readings = forged.records[place].payload["readings"].as_array_mut().expect("readings");
        readings.swap(2, 9);
    }),
    ("a resonance of another time", Check::ReadingTime, |forged| {
        let place = forged.nth("sweep", 3, is_touch_sweep);
        change(&mut forged.records[place].payload, "/outcome/effective_time_s", |at| at - 5.0);
    }),
    ("a resonance of the end of its sweep", Check::ReadingTime, |forged| {
        let place = forged.nth("sweep", 3, is_touch_sweep);
        let readings = forged.records[place].payload["readings"].as_array().expect("readings");
        let last = readings.last().expect("a reading");
        let end_s = get(last, "/started_s") + get(last, "/settle_s");
        forged.records[place].payload["outcome"]["effective_time_s"] = (end_s + 1.0).into();
    }),
    ("readings of the search from another time", Check::Surface, |forged| {
        let place = forged.nth("surface_found", 0, any);
        let trail = forged.records[place].payload["trail"].as_array_mut().expect("a trail");
        let first = trail[0]["reading"]["settle_s"].clone();
        trail[3]["reading"]["settle_s"] = first;
    }),
    ("a refusal that was not counted", Check::Ends, |forged| {
        let last = forged.records.len() - 1;
        forged.records[last].payload["status"] = "completed_with_refusals".into();
        forged.execute("UPDATE runs SET status = 'completed_with_refusals' WHERE key = ?1");
    }),
    ("a fault as the end without its record", Check::Ends, |forged| {
        let last = forged.records.len() - 1;
        forged.records[last].payload["status"] = "faulted".into();
        forged.execute("UPDATE runs SET status = 'faulted' WHERE key = ?1");
        forged.execute("DELETE FROM seals WHERE run = ?1");
    }),
    ("a record after the end", Check::Ends, |forged| {
        let last = forged.records.last().expect("records").clone();
        forged.records.push(last);
    }),
    ("a run without its settings", Check::Ends, |forged| {
        forged.records.remove(0);
    }),
    ("an unknown kind of record", Check::Readable, |forged| {
        forged.records[50].payload["kind"] = "teleported".into();
        forged.records[50].kind = "teleported".into();
    }),
    ("another kind in the table", Check::Readable, |forged| {
        forged.records[50].kind = "operator".into();
    }),
    ("a record without a value", Check::Readable, |forged| {
        let place = forged.nth("touch_result", 0, any);
        let fields = forged.records[place].payload.as_object_mut().expect("an object");
        fields.remove("sigma_hz");
    }),
];
