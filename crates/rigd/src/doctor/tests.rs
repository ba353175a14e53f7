//! Findings about conditions that the simulated rig does not have.

use std::{sync::Arc, time::Duration};

use rig_analyzer::{AnalyzerError, Identity, UnexpectedTerminator};
use rig_link::{Holder, LineError, OpenError as LinkError, PartialAnswer};
use rig_model::{Deg, PortKind};
use rig_scpi::FrameError;
use rig_stage::{
    Alarm, BusError, DeviceRefusal, Exception, LineFault, Request, StageError, Symptom,
};

use super::{
    Level::{Ok as Well, Problem, Warning},
    *,
};
use crate::rig::{
    AxisFacts, AxisPosition, AxisState, DeviceError, DeviceFacts, DeviceSeen, PortFacts, PortSeen,
    RoundTrips,
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
        (
            LinkError::Permission { port: name.clone() },
            advice::on_permission(cfg!(target_os = "linux")),
        ),
        (LinkError::NoStatusByte { port: name.clone() }, "another release of Linux"),
        (
            LinkError::NotAPort { port: name, what: "a file", wanted: "a serial port" },
            "name a port",
        ),
    ];
    for (source, expected) in rows {
        check(&port(Err(source)), &[("open", Problem, expected)]);
    }
}

#[test]
fn only_linux_has_the_group_dialout_and_udev() {
    for word in ["dialout", "udev"] {
        assert!(advice::on_permission(true).contains(word), "{word}");
        assert!(!advice::on_permission(false).contains(word), "{word}");
    }
}

fn device_on(kind: PortKind, outcome: Option<Result<DeviceFacts, DeviceError>>) -> Vec<Finding> {
    let port = "/dev/ttyUSB0".to_owned();
    device::findings(&DeviceSeen { role: "rotary stage", port, kind, outcome })
}

fn device(outcome: Option<Result<DeviceFacts, DeviceError>>) -> Vec<Finding> {
    device_on(PortKind::Serial, outcome)
}

fn axis(place: AxisPosition, state: AxisState) -> DeviceFacts {
    DeviceFacts {
        identity: "oriental-az at unit 2".to_owned(),
        firmware: None,
        settings: Ok(()),
        axis: Some(AxisFacts { at: "0.000 °".to_owned(), place, state, has_settings: true }),
    }
}

#[test]
fn an_axis_is_judged_by_how_it_stands() {
    let place = |place| axis(place, AxisState::Ready);
    let state = |state| axis(AxisPosition::InLimits, state);
    let span = || "[-50.000 °, 50.000 °]".to_owned();
    let alarm = Alarm { code: 0x30, name: "overload" };
    let rows: [(DeviceFacts, Row, Row); 8] = [
        (state(AxisState::Ready), ("position", Well, ""), ("state", Well, "")),
        (state(AxisState::NotReady), ("position", Well, ""), ("state", Problem, "stop input")),
        (
            state(AxisState::NotInService),
            ("position", Well, ""),
            ("state", Warning, "opened for work"),
        ),
        (
            state(AxisState::Moving),
            ("position", Well, ""),
            ("state", Problem, "other program or signal"),
        ),
        (
            state(AxisState::Alarmed(alarm)),
            ("position", Well, ""),
            ("state", Problem, "resets the alarm"),
        ),
        (
            place(AxisPosition::NotHomed),
            ("position", Warning, "clear the whole travel"),
            ("state", Well, ""),
        ),
        (
            place(AxisPosition::BeyondLimits(span())),
            ("position", Warning, "check by eye that it is there"),
            ("state", Well, ""),
        ),
        (
            place(AxisPosition::BeyondTravel(span())),
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
fn the_settings_of_a_drive_are_compared_and_not_taken_for_given() {
    for (has_settings, text) in
        [(true, "those of the rig file"), (false, "replaced by those of the rig file")]
    {
        let mut facts = axis(AxisPosition::InLimits, AxisState::Ready);
        facts.axis.as_mut().unwrap().has_settings = has_settings;
        let found = device(Some(Ok(facts)));
        assert_eq!((found[2].check, found[2].level), ("settings", Well));
        assert!(found[2].text.starts_with(text), "{found:#?}");
    }
}

/// A question to an analyzer of which these bytes came back.
fn unanswered(bytes: &[u8], unexpected_terminator: Option<UnexpectedTerminator>) -> DeviceError {
    let arrived = Box::new(PartialAnswer { bytes: bytes.to_vec(), last_after: Duration::ZERO });
    let waited = Duration::from_secs(1);
    let source = LineError::TimedOut { port: "port".into(), waited, arrived };
    AnalyzerError::Line {
        asked: "*IDN?".into(),
        unexpected_terminator,
        intruders: Vec::new(),
        source,
    }
    .into()
}

/// A request to a drive with this in place of an answer.
fn no_answer(symptom: Symptom) -> DeviceError {
    let fault = LineFault::NoAnswer {
        port: "port".into(),
        unit: 2,
        request: Request::ReadHolding { address: 1, count: 2 },
        symptom,
        received: Box::default(),
        attempts: 3,
        intruders: Vec::new(),
    };
    on_bus(BusError::from(fault))
}

fn on_bus(error: impl Into<BusError>) -> DeviceError {
    DeviceError::Rotary(StageError::<Deg>::Bus(error.into()))
}

/// Errors with their advice on a serial line and on a network.
fn errors() -> Vec<(DeviceError, &'static str, &'static str)> {
    let port: Arc<str> = "port".into();
    let request = Request::ReadHolding { address: 1, count: 2 };
    let changed = LineFault::Changed { port: port.clone(), unit: 2, request: request.clone() };
    let exception = Exception::IllegalAddress;
    let refused = DeviceRefusal { port: port.clone(), unit: 2, request, exception };
    let found = Box::new(Identity {
        manufacturer: "ACME".to_owned(),
        model: "1".to_owned(),
        serial: None,
        firmware: None,
    });
    let wrong = AnalyzerError::WrongInstrument { port: port.clone(), expected: "IM3536", found };
    let strays = AnalyzerError::Strays { port: port.clone(), bytes: 7 };
    let garbled = AnalyzerError::Frame {
        port: port.clone(),
        asked: "*IDN?".into(),
        found: "\\xc3".into(),
        source: FrameError::NotAscii { byte: 0xC3, offset: 0 },
    };
    let lost = |kind| LineError::Lost { port: port.clone(), kind };
    let gone = |kind| AnalyzerError::Line {
        asked: "*IDN?".into(),
        unexpected_terminator: None,
        intruders: Vec::new(),
        source: lost(kind),
    };
    vec![
        (unanswered(b"", None), "parity", "port for commands"),
        (unanswered(b"HIO", None), "reply_timeout_s", "reply_timeout_s"),
        (
            unanswered(b"a\r", Some(UnexpectedTerminator::CrForLf)),
            "terminator = \"cr\"",
            "terminator = \"cr\"",
        ),
        (unanswered(b"a\n", Some(UnexpectedTerminator::LfForCr)), "terminator", "terminator"),
        (garbled.into(), "parity", "address and port"),
        (strays.into(), "cable", "network"),
        (gone(PortKind::Serial).into(), "cable", "network"),
        (wrong.into(), "dialect", "dialect"),
        (no_answer(Symptom::Silence), "unit id", "unit id"),
        (no_answer(Symptom::OnlyEcho), "parity", "power"),
        (no_answer(Symptom::Garbage), "parity", "Modbus TCP"),
        (no_answer(Symptom::Truncated), "termination", "gateway"),
        (no_answer(Symptom::Corrupted), "termination", "gateway"),
        (no_answer(Symptom::ForeignUnit(3)), "second master", "unit id"),
        (no_answer(Symptom::Surplus), "second master", "unit id"),
        (no_answer(Symptom::OtherAnswer), "second master", "unit id"),
        (no_answer(Symptom::WrongCount { found: 6, expected: 4 }), "register map", "register map"),
        (on_bus(LineFault::Port(lost(PortKind::Network))), "cable", "network"),
        (on_bus(changed), "register map", "register map"),
        (on_bus(refused), "register map", "register map"),
    ]
}

#[test]
fn a_device_that_does_not_answer_as_it_should_is_explained() {
    for (error, advice, _) in errors() {
        check(&device(Some(Err(error))), &[("identity", Problem, advice)]);
    }
    check(&device(None), &[("identity", Problem, "port first")]);
}

#[test]
fn nothing_that_belongs_to_a_serial_line_is_said_of_a_network() {
    for (error, _, advice) in errors() {
        let found = device_on(PortKind::Network, Some(Err(error)));
        check(&found, &[("identity", Problem, advice)]);
        let said = format!("{} {}", found[0].text, found[0].advice.unwrap_or_default());
        for word in ["speed", "parity", "baud", "cable", "adapter", "plug"] {
            assert!(!said.contains(word), "{said}");
        }
    }
}

#[test]
fn advice_for_usb_names_neither_a_line_nor_a_network() {
    for (error, ..) in errors() {
        if let DeviceError::Analyzer(error) = error {
            let advice = advice::on_device(&error.into(), PortKind::Usb);
            for word in ["speed", "parity", "baud", "adapter", "network", "address"] {
                assert!(!advice.contains(word), "{advice}");
            }
        }
    }
}

#[test]
fn no_advice_moves_anything() {
    for (error, ..) in errors() {
        for kind in [PortKind::Network, PortKind::Serial, PortKind::Usb] {
            let advice = advice::on_device(&error, kind);
            for word in ["home", "rigd move", "retract", "acknowledge"] {
                assert!(!advice.contains(word), "{advice}");
            }
        }
    }
}
