//! Errors with example values.

use std::sync::Arc;

use rig_analyzer::{AnalyzerError, Identity};
use rig_engine::{Device, Fault};
use rig_link::LineError;
use rig_model::{Mm, PortKind, Position};
use rig_stage::{
    Alarm, BusError, DeviceRefusal, Exception, LineFault, Request, StageError, Symptom,
};

use super::Seen;
use crate::{
    doctor::advice,
    rig::{OpenError, analyzer_failure, stage_failure},
};

/// The port of the drives.
pub(super) fn bus() -> Arc<str> {
    "/dev/ttyUSB1".into()
}

/// The port of the analyzer.
pub(super) fn analyzer_port() -> Arc<str> {
    "/dev/ttyUSB0".into()
}

fn request() -> Request {
    Request::ReadHolding { address: 0x00CC, count: 2 }
}

pub(super) fn at(mm: f64) -> Position<Mm> {
    Position::new(mm)
}

/// A fault of the linear stage.
pub(super) fn linear(error: &StageError<Mm>) -> Seen {
    Seen::latched(&Fault::Device(stage_failure(Device::LinearStage, error)))
}

/// A fault of the analyzer.
pub(super) fn analyzer(error: AnalyzerError) -> Seen {
    Seen::latched(&Fault::Device(analyzer_failure(error)))
}

/// No answer of the linear drive could be used.
pub(super) fn no_answer(symptom: Symptom, received: &[u8]) -> StageError<Mm> {
    let fault = LineFault::NoAnswer {
        port: bus(),
        unit: 1,
        request: request(),
        symptom,
        received: received.into(),
        attempts: 3,
        intruders: Vec::new(),
    };
    BusError::from(fault).into()
}

/// The linear drive refused.
pub(super) fn refusal(exception: Exception) -> StageError<Mm> {
    let refusal = DeviceRefusal { port: bus(), unit: 1, request: request(), exception };
    BusError::from(refusal).into()
}

/// The adapter of the bus has disappeared.
pub(super) fn lost() -> StageError<Mm> {
    let lost = LineError::Lost { port: bus(), kind: PortKind::Serial };
    BusError::from(LineFault::from(lost)).into()
}

/// The linear drive has an alarm.
pub(super) fn alarmed(code: u16, name: &'static str) -> StageError<Mm> {
    StageError::Alarmed { alarm: Alarm { code, name }, at: at(9.812) }
}

/// Another analyzer answers than the one in the rig file.
pub(super) fn wrong_instrument() -> Seen {
    let found = Identity {
        manufacturer: "Keysight Technologies".to_owned(),
        model: "E4980A".to_owned(),
        serial: None,
        firmware: None,
    };
    let (port, expected, found) = (analyzer_port(), "HIOKI IM3536", Box::new(found));
    let source = Box::new(AnalyzerError::WrongInstrument { port, expected, found }.into());
    let error = OpenError::Device { role: "analyzer", kind: PortKind::Serial, source };
    Seen::refused(&error, advice::on_rig(&error))
}
