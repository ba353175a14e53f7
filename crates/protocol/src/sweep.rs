//! The sections that say how a resonance is measured.

use rig_files::{
    Location,
    settings::{Setting, Table},
};
use rig_model::{DriveLevel, SweepMethod, SweepRequest, SweepRequestError, Window};

use crate::fault::ProtocolFault;

/// The keys of a sweep.
#[derive(Debug, Clone)]
pub(crate) struct SweepKeys {
    pub(crate) request: SweepRequest,
    pub(crate) target_sigma_hz: Setting<f64>,
    pub(crate) time_limit_s: Setting<f64>,
    pub(crate) min_hz: Setting<f64>,
    pub(crate) max_hz: Setting<f64>,
    pub(crate) level_v: Setting<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Method {
    Adaptive,
    Uniform,
}

/// The keys of the sweep of the free sensor.
#[derive(Debug, Clone)]
pub(crate) struct NoLoadKeys {
    pub(crate) sweep: SweepKeys,
    /// Duration of the survey at the beginning of a run, s.
    pub(crate) survey_s: Option<u32>,
    /// Whether the resonance is then compared with that at half the level.
    pub(crate) level_check: bool,
}

/// Reads the sweep of the free sensor.
pub(crate) fn read_no_load(table: &mut Table<'_>, has_aim: bool) -> NoLoadKeys {
    let survey_s = table.count("survey_s").optional();
    let level_check = table.flag("level_check").optional();
    let sweep = read(table, has_aim);
    if let Some(seconds) = &survey_s {
        let allowed = SweepMethod::SURVEY_S;
        let (found, min, max) = (seconds.value, *allowed.start(), *allowed.end());
        if seconds.sound().is_some() && !allowed.contains(&found) {
            table.refuse(seconds, &ProtocolFault::SurveyTime { found, min, max });
        }
        if sweep.request.method != SweepMethod::Adaptive {
            table.refuse(seconds, &ProtocolFault::OnlyAdaptive { key: "survey_s" });
        }
    }
    if let (Some(check), None) = (&level_check, &survey_s) {
        table.refuse(check, &ProtocolFault::CheckNeedsSurvey);
    }
    NoLoadKeys {
        sweep,
        survey_s: survey_s.map(|seconds| seconds.value),
        level_check: level_check.is_some_and(|check| check.value),
    }
}

/// Reads a sweep and checks it without a rig. A protocol with an aim may leave the target out.
pub(crate) fn read(table: &mut Table<'_>, has_aim: bool) -> SweepKeys {
    let words = [("adaptive", Method::Adaptive), ("uniform", Method::Uniform)];
    let method = table.choice("method", words).or(Method::Adaptive);
    let min_hz = table.number("min_hz").required();
    let max_hz = table.number("max_hz").required();
    let target_sigma_hz = table.number("target_sigma_hz").required_unless(has_aim);
    let time_limit_s = table.number("time_limit_s").required();
    let cycles = table.count("cycles").required();
    let level_v = table.number("level_v").required();
    let points = table.count("points").optional();
    let settle_s = table.number("settle_s").optional();
    for (key, location) in [
        ("points", points.as_ref().map(Location::from)),
        ("settle_s", settle_s.as_ref().map(Location::from)),
    ] {
        match (method.sound(), location) {
            (Some(Method::Adaptive), Some(location)) => {
                table.refuse(location, &ProtocolFault::OnlyUniform { key });
            }
            (Some(Method::Uniform), None) => {
                table.refuse(&method, &ProtocolFault::UniformNeeds { key });
            }
            _ => {}
        }
    }

    let request = SweepRequest {
        window: Window { min_hz: min_hz.value, max_hz: max_hz.value },
        method: match (method.value, &points) {
            (Method::Uniform, Some(points)) => SweepMethod::Uniform { points: points.value },
            _ => SweepMethod::Adaptive,
        },
        target_sigma_hz: target_sigma_hz.value,
        time_limit_s: time_limit_s.value,
        cycles: cycles.value,
        settle_s: settle_s.as_ref().map_or(0.0, |settle_s| settle_s.value),
        level: DriveLevel { volt: level_v.value },
    };
    let written = [
        points.as_ref().and_then(written),
        settle_s.as_ref().and_then(written),
        written(&target_sigma_hz),
        written(&time_limit_s),
        written(&cycles),
        written(&level_v),
    ];
    let window = min_hz.sound().and(max_hz.sound()).map(|_| max_hz.location);
    for error in request.faults() {
        let location = match error {
            SweepRequestError::Window { .. } => window,
            SweepRequestError::OutOfRange { what, .. } => {
                let at_fault = written.iter().flatten().find(|(key, _)| *key == what);
                at_fault.map(|(_, location)| *location)
            }
            SweepRequestError::TooLong { .. } => Some(time_limit_s.location),
        };
        if let Some(location) = location {
            table.refuse(location, &ProtocolFault::Sweep(error));
        }
    }
    SweepKeys { request, target_sigma_hz, time_limit_s, min_hz, max_hz, level_v }
}

/// The key and its location, if its value could be read.
fn written<T>(setting: &Setting<T>) -> Option<(&'static str, Location)> {
    setting.sound().map(|_| (setting.key, setting.location))
}
