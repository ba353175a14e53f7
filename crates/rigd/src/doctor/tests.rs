//! Findings on what the simulated rig does not have by itself.

use std::sync::Arc;

use rig_analyzer::{AnalyzerError, Identity};
use rig_link::{Holder, OpenError as LinkError};
use rig_model::Deg;
use rig_stage::{Alarm, BusError, Exception, LineFault, Refusal, Request, StageError, Symptom};

use super::{
    Level::{Ok as Well, Problem, Warning},
    *,
};
use crate::rig::{
    AxisFacts, AxisPlace, AxisState, DeviceFacts, DeviceSeen, PortFacts, PortSeen, RoundTrips,
};

/// One finding: check, level, and some of its advice.
type Row = (&'static str, Level, &'static str);

#[track_caller]
fn check(found: &[Finding], expected: &[Row]) {
    let matches = |(finding, row): (&Finding, &Row)| {
        let advice = finding.advice.unwrap_or_default();
        (finding.check, finding.level) == (row.0, row.1)
            && advice.contains(row.2)
            && advice.is_empty() == (row.1 == Well)
    };
    let is_same = found.len() == expected.len() && found.iter().zip(expected).all(matches);
    assert!(is_same, "{found:#?}\n{expected:#?}");
}

fn facts() -> PortFacts {
    let round_trips = Some(RoundTrips { count: 20, median_ms: 3.0, longest_ms: 9.0 });
    PortFacts { intruders: Vec::new(), adapter_delay_ms: Some(1), round_trips }
}

fn port(outcome: Result<PortFacts, LinkError>) -> Vec<Finding> {
    port::findings(&PortSeen { role: "bus", name: "/dev/ttyUSB0".to_owned(), outcome })
}

#[test]
fn a_port_that_opens_is_asked_how_fast_it_is_and_who_else_has_it() {
    let well: [Row; 3] = [("open", Well, ""), ("adapter", Well, ""), ("latency", Well, "")];
    check(&port(Ok(facts())), &well);
    let slow = PortFacts {
        adapter_delay_ms: Some(16),
        intruders: vec![Holder { pid: 11, name: "minicom".to_owned() }],
        round_trips: Some(RoundTrips { count: 20, median_ms: 51.0, longest_ms: 60.0 }),
    };
    let found = port(Ok(slow));
    assert_eq!(found[1].text, "also open in minicom (process 11)");
    check(
        &found,
        &[
            ("open", Well, ""),
            ("other programs", Warning, "end that program"),
            ("adapter", Warning, "latency_timer"),
            ("latency", Warning, "network"),
        ],
    );
    // On a network, nothing is known of an adapter; a device that never answers has no latency.
    let network = PortFacts { adapter_delay_ms: None, round_trips: None, ..facts() };
    check(&port(Ok(network)), &[("open", Well, "")]);
}

#[test]
fn a_port_that_does_not_open_is_explained() {
    let name: Arc<str> = "/dev/ttyUSB0".into();
    let rows = [
        (LinkError::Absent { port: name.clone() }, "rigd ports"),
        (LinkError::Busy { port: name.clone(), holders: Vec::new() }, "end that program"),
        (LinkError::Permission { port: name }, "dialout"),
    ];
    for (source, expected) in rows {
        check(&port(Err(source)), &[("open", Problem, expected)]);
    }
}

fn device(outcome: Option<Result<DeviceFacts, DeviceError>>) -> Vec<Finding> {
    let port = "/dev/ttyUSB0".to_owned();
    device::findings(&DeviceSeen { role: "rotary stage", port, outcome })
}

fn axis(place: AxisPlace, state: AxisState) -> DeviceFacts {
    DeviceFacts {
        identity: "oriental-az at unit 2".to_owned(),
        firmware: None,
        settings: Ok(()),
        axis: Some(AxisFacts { at: "0.000 °".to_owned(), place, state }),
    }
}

#[test]
fn an_axis_is_judged_by_how_it_stands() {
    let place = |place| axis(place, AxisState::Ready);
    let state = |state| axis(AxisPlace::InLimits, state);
    let span = || "[-50.000 °, 50.000 °]".to_owned();
    let alarm = Alarm { code: 0x30, name: "overload" };
    let rows: [(DeviceFacts, Row, Row); 7] = [
        (state(AxisState::Ready), ("position", Well, ""), ("state", Well, "")),
        (state(AxisState::NotReady), ("position", Well, ""), ("state", Problem, "stop input")),
        (
            state(AxisState::Moving),
            ("position", Well, ""),
            ("state", Problem, "what else drives it"),
        ),
        (
            state(AxisState::Alarmed(alarm)),
            ("position", Well, ""),
            ("state", Problem, "resets the alarm"),
        ),
        (
            place(AxisPlace::NotHomed),
            ("position", Warning, "clear the whole travel"),
            ("state", Well, ""),
        ),
        (
            place(AxisPlace::BeyondLimits(span())),
            ("position", Warning, "look whether it stands there"),
            ("state", Well, ""),
        ),
        (
            place(AxisPlace::BeyondTravel(span())),
            ("position", Problem, "move nothing"),
            ("state", Well, ""),
        ),
    ];
    for (facts, position, state) in rows {
        let before = [("identity", Well, ""), ("firmware", Well, ""), ("settings", Well, "")];
        let found = device(Some(Ok(facts)));
        check(&found, &[before.as_slice(), &[position, state]].concat());
    }
}

#[test]
fn a_device_that_does_not_answer_as_it_should_is_explained() {
    let port: Arc<str> = "/dev/ttyUSB0".into();
    let stage = |source| DeviceError::Rotary(StageError::<Deg>::Bus(source));
    let request = Request::ReadHolding { address: 1, count: 2 };
    let silent = LineFault::NoAnswer {
        port: port.clone(),
        unit: 2,
        request: request.clone(),
        symptom: Symptom::Silence,
        attempts: 3,
        intruders: Vec::new(),
    };
    let changed = LineFault::Changed { port: port.clone(), unit: 2, request: request.clone() };
    let exception = Exception::IllegalAddress;
    let refused = Refusal { port: port.clone(), unit: 2, request, exception };
    let found = Box::new(Identity {
        manufacturer: "ACME".to_owned(),
        model: "1".to_owned(),
        serial: None,
        firmware: None,
    });
    let wrong = AnalyzerError::WrongInstrument { port, expected: "IM3536", found };
    let rows = [
        (stage(BusError::Failed(silent)), "unit id"),
        (stage(BusError::Failed(changed)), "register map"),
        (stage(BusError::Refused(refused)), "manual"),
        (DeviceError::Analyzer(wrong), "dialect"),
    ];
    for (error, advice) in rows {
        check(&device(Some(Err(error))), &[("identity", Problem, advice)]);
    }
    check(&device(None), &[("identity", Problem, "port first")]);
}
