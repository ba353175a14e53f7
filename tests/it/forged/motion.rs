//! Forged moves.

use rig_tests::forge::{Forged, Forgery};
use rig_verify::Check;
use serde_json::{Value, json};

use super::{Case, any, change, get, number};

fn is_linear(payload: &Value) -> bool {
    payload["axis"] == "linear_mm"
}

fn is_retract(payload: &Value) -> bool {
    payload["is_clear"] == true
}

fn is_rotary(payload: &Value) -> bool {
    payload["axis"] == "rotary_deg"
}

/// A move to an angle other than 0.
fn is_turn(payload: &Value) -> bool {
    is_rotary(payload) && get(payload, "/target") != 0.0
}

fn is_of(what: &'static str) -> impl Fn(&Value) -> bool {
    move |payload| payload["what"] == what
}

fn insert(forged: &mut Forgery, place: usize, kind: &str, payload: Value) {
    let rig_us = forged.records[place - 1].rig_us;
    forged.records.insert(place, Forged { rig_us, kind: kind.to_owned(), payload });
}

fn fault(probe: &str) -> Value {
    json!({"kind": "fault", "cause": "forged", "probe": probe, "hint": "none"})
}

/// The first move of a search that is not the first one of its touch.
fn step_of_search(forged: &Forgery) -> usize {
    // The first way down of a run is made in steps too.
    forged.nth("intent", 1, is_of("approach")) + 3
}

pub(super) const CASES: &[Case] = &[
    ("a turn in contact", Check::TurnedClear, |forged| {
        let place = forged.nth("moved", 2, is_retract);
        let payload =
            json!({"kind": "moved", "axis": "rotary_deg", "target": 0.0, "read_back": 0.0});
        insert(forged, place, "moved", payload);
    }),
    ("a turn before clear", Check::TurnedClear, |forged| {
        let place = forged.nth("moved", 0, is_retract);
        forged.records.remove(place);
    }),
    ("a retract that shows nothing", Check::TurnedClear, |forged| {
        let place = forged.nth("moved", 1, is_retract);
        forged.records[place].payload["is_clear"] = false.into();
    }),
    ("clear at another height", Check::FalseClear, |forged| {
        let place = forged.nth("moved", 1, is_retract);
        change(&mut forged.records[place].payload, "/read_back", |_| 29.0);
    }),
    ("clear at a lower target", Check::FalseClear, |forged| {
        let place = forged.nth("moved", 1, is_retract);
        change(&mut forged.records[place].payload, "/read_back", |_| 12.0);
        change(&mut forged.records[place].payload, "/target", |_| 12.0);
    }),
    ("a turn under a probe that its edge may reach", Check::TurnedClear, |forged| {
        // 11 mm are clear of a level sample, and of no turn.
        let low = |payload: &Value| is_retract(payload) && get(payload, "/target") < 24.0;
        let place = forged.nth("moved", 0, low);
        for path in ["/target", "/read_back"] {
            change(&mut forged.records[place].payload, path, |_| 11.1);
        }
    }),
    ("a fault that says clear in contact", Check::FalseClear, |forged| {
        let place = forged.nth("moved", 1, is_retract);
        insert(forged, place, "fault", fault("clear"));
    }),
    ("a read-back off its target", Check::AtTarget, |forged| {
        let place = step_of_search(forged);
        change(&mut forged.records[place].payload, "/read_back", |at| at + 0.01);
    }),
    ("a tilt off its target", Check::AtTarget, |forged| {
        let place = forged.nth("moved", 0, is_turn);
        change(&mut forged.records[place].payload, "/read_back", |at| at + 0.5);
    }),
    ("a height beyond the soft limits", Check::Limits, |forged| {
        let place = forged.nth("moved", 0, is_linear);
        for path in ["/target", "/read_back"] {
            change(&mut forged.records[place].payload, path, |_| 46.0);
        }
    }),
    ("a tilt beyond the soft limits", Check::Limits, |forged| {
        let place = forged.nth("moved", 0, is_turn);
        for path in ["/target", "/read_back"] {
            change(&mut forged.records[place].payload, path, |_| 50.5);
        }
    }),
    ("a read-back beyond the soft limits", Check::Limits, |forged| {
        let place = forged.nth("moved", 0, is_linear);
        change(&mut forged.records[place].payload, "/read_back", |_| 7.0);
    }),
    ("a descent without an intent", Check::Intent, |forged| {
        let place = forged.nth("intent", 0, is_of("approach"));
        forged.records.remove(place);
    }),
    ("an indentation without an intent", Check::Depth, |forged| {
        let place = forged.nth("intent", 0, is_of("indent"));
        forged.records.remove(place);
        change(&mut forged.records[place].payload, "/target", |at| at - 0.5);
        change(&mut forged.records[place].payload, "/read_back", |at| at - 0.5);
    }),
    ("an intent from elsewhere", Check::Intent, |forged| {
        let place = forged.nth("intent", 0, is_of("indent"));
        change(&mut forged.records[place].payload, "/from", |at| at + 1.0);
    }),
    ("a second descent without a retract", Check::Intent, |forged| {
        let place = forged.nth("intent", 0, is_of("indent"));
        forged.records[place].payload["what"] = "approach".into();
    }),
    ("deeper than declared", Check::Depth, |forged| {
        let place = forged.nth("moved", 2, is_linear);
        for path in ["/target", "/read_back"] {
            change(&mut forged.records[place].payload, path, |_| 9.1);
        }
    }),
    ("a declared search deeper than permitted", Check::Depth, |forged| {
        let place = forged.nth("intent", 0, is_of("approach"));
        for path in ["/to", "/limit"] {
            change(&mut forged.records[place].payload, path, |_| 8.6);
        }
    }),
    ("a declared indentation deeper than permitted", Check::Depth, |forged| {
        let place = forged.nth("intent", 0, is_of("indent"));
        for path in ["/to", "/limit"] {
            change(&mut forged.records[place].payload, path, |at| at - 0.4);
        }
    }),
    ("a large step of the search", Check::SearchStep, |forged| {
        let place = step_of_search(forged);
        for _ in 0..2 {
            forged.records.remove(place);
        }
    }),
    ("a search that begins below every surface found before", Check::SearchStep, |forged| {
        let place = forged.nth("intent", 1, is_of("approach")) + 2;
        for path in ["/target", "/read_back"] {
            change(&mut forged.records[place].payload, path, |at| at - 0.6);
        }
    }),
    ("a long way down after the first reading of a search", Check::SearchStep, |forged| {
        let place = forged.nth("surface_found", 7, any);
        // As soon as the frequency was set.
        *number(&mut forged.records[place].payload, "/trail/0/reading/settle_s") = 0.0.into();
    }),
    ("a move that is too fast", Check::Speed, |forged| {
        let place = step_of_search(forged);
        forged.records[place].rig_us = forged.records[place - 1].rig_us + 10_000;
    }),
    ("a turn that is too fast", Check::Speed, |forged| {
        let place = forged.nth("moved", 0, is_turn);
        forged.records[place].rig_us = forged.records[place - 1].rig_us + 100_000;
    }),
    ("a turn while a person works", Check::Stopped, |forged| {
        let place = forged.nth("prompt_answered", 3, any);
        let payload =
            json!({"kind": "moved", "axis": "rotary_deg", "target": 0.0, "read_back": 0.0});
        insert(forged, place, "moved", payload);
    }),
    ("a run that goes on after a fault", Check::Stopped, |forged| {
        let place = forged.nth("step_started", 20, any);
        insert(forged, place, "fault", fault("clear"));
    }),
    ("a touch that ends in contact", Check::EndsClear, |forged| {
        let place = forged.nth("moved", 13, is_retract);
        forged.records.remove(place);
    }),
    ("a time that goes back", Check::Time, |forged| {
        forged.records[100].rig_us -= 60_000_000;
    }),
];
