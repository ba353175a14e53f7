//! The faults of a rig file whose single values are right.

use rig_model::{AnalyzerMake, AxisError, Deg, DriveMake, Mm, Position};

use crate::{
    Complaint,
    sensor::LONGEST_MM,
    settings::{unit_hint, with_unit_hint},
};

/// A fault. Values and limits have the unit of their key.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum RigFileFault {
    // Ports.
    #[error("connection = \"simulated\" needs the section [simulation]")]
    NothingToSimulate,
    #[error("a line of {linear} and {rotary} needs its parity: their factory settings differ")]
    NoParity { linear: DriveMake, rotary: DriveMake },
    #[error("a line with a drive that has a file of its own needs its parity")]
    UnreadParity,
    #[error("the analyzer and the bus cannot share the port {port}")]
    SharedPort { port: String },
    #[error("unit_id = {unit_id} is that of the linear stage, on the same bus")]
    SharedUnit { unit_id: u32 },

    // The analyzer.
    #[error("frequency_hz is outside the range of {make}, {min} Hz to {max} Hz")]
    BeyondDialect { make: AnalyzerMake, min: f64, max: f64 },
    #[error("max_level_v = {found} is above the {limit} V that {make} can give")]
    LevelBeyondDialect { found: f64, limit: f64, make: AnalyzerMake },

    // The axes.
    #[error("{}", of_linear(.0))]
    Linear(#[from] AxisError<Mm>),
    #[error(transparent)]
    Rotary(#[from] AxisError<Deg>),
    #[error("{key} = 0 moves nothing")]
    NoStep { key: &'static str },
    #[error(
        "{key} = {found} is coarser than twice the tolerance {tolerance}: the axis may have no step within the tolerance of a target"
    )]
    CoarseStep { key: &'static str, found: f64, tolerance: f64 },
    #[error("{key} = {found} is finer than the step of any drive, {finest} {unit}")]
    FineStep { key: &'static str, found: f64, finest: f64, unit: &'static str },
    #[error("{key} = [{min}, {max}] is narrower than {narrowest} {unit}")]
    Narrow { key: &'static str, min: f64, max: f64, narrowest: f64, unit: &'static str },
    #[error("{key} = {found} is above {limit_key} = {limit}")]
    TooFast { key: &'static str, found: f64, limit_key: &'static str, limit: f64 },

    // The geometry.
    #[error(
        "clear_mm = {clear} is not above {highest}, to which the edge of a sample rises within the \
         soft limits of the rotary stage"
    )]
    NotClear { clear: f64, highest: Position<Mm>, reach_mm: Option<f64> },
    #[error(
        "surface_mm = {found} is less than {room} mm above the lower soft limit {limit} mm of the \
         linear stage: no room for surface_tolerance_mm and max_indentation_mm"
    )]
    NoRoomBelow { found: f64, room: f64, limit: f64 },
    #[error(
        "pin_radius_mm = {found}: at {tilt_deg}°, a soft limit of the rotary stage, the ball touches the side of the pin or passes \
         beside it"
    )]
    ThinPin { found: f64, tilt_deg: f64 },
}

impl Complaint for RigFileFault {
    fn suggestion(&self) -> Option<String> {
        let suggestion = match self {
            Self::NothingToSimulate => "add it, or write connection = \"ports\"".into(),
            Self::NoParity { .. } => {
                "set both drives to one parity, and write it here: parity = \"none\" or \"even\""
                    .into()
            }
            Self::UnreadParity => {
                "write the parity that is set in the drives: parity = \"none\", \"even\" or \"odd\""
                    .into()
            }
            Self::SharedPort { .. } => "give each its own port".into(),
            Self::SharedUnit { .. } => "set a different unit id on each drive, and write it \
                                        here"
                .into(),
            Self::BeyondDialect { min, max, .. } => format!("stay within [{min}, {max}]"),
            Self::LevelBeyondDialect { limit, .. } => format!("use at most {limit}"),
            Self::Linear(AxisError::SoftBeyondTravel { .. })
            | Self::Rotary(AxisError::SoftBeyondTravel { .. }) => "stay within the travel".into(),
            Self::Rotary(AxisError::RestOutOfReach { .. }) => {
                "0 is level and must be inside".into()
            }
            Self::Linear(AxisError::RestOutOfReach { rest, soft, .. }) => {
                let is_within = |mm| soft.contains(Position::new(mm));
                with_unit_hint("put it within".into(), "clear_mm", rest.value(), is_within)
            }
            // Targets are not in a rig file, and the ranges of the keys exclude the other errors.
            Self::Linear(_) | Self::Rotary(_) => return None,
            Self::NoStep { .. } => "give the distance that one count of the drive moves the \
                                    axis"
                .into(),
            Self::CoarseStep { found, .. } => tolerance_for(*found),
            Self::TooFast { limit, .. } => format!("use at most {limit}"),
            Self::FineStep { key, found, finest, .. } => {
                let is_right = |meant: f64| *finest <= meant.abs() && meant.abs() <= 1.0;
                // A drive may count downwards.
                let least = finest.copysign(*found);
                let key = if *key == "mm_per_step" { "step_mm" } else { key };
                with_unit_hint(format!("use {least} or coarser"), key, *found, is_right)
            }
            Self::Narrow { key, min, max, narrowest, .. } => {
                let is_right = |meant| *narrowest <= meant && meant <= LONGEST_MM;
                let meant = unit_hint(key, max - min, is_right)
                    .map(|_| format!("; if it is in metres, write [{}, {}]", 1e3 * min, 1e3 * max));
                format!("give the range of the mechanics{}", meant.unwrap_or_default())
            }
            Self::NotClear { clear, highest, reach_mm } => {
                clear_advice(*clear, *highest, *reach_mm)
            }
            Self::ThinPin { .. } => "use a thicker pin, or narrower soft limits".into(),
            Self::NoRoomBelow { found, limit, room } => {
                let is_right = |mm| limit + room <= mm && mm <= LONGEST_MM;
                with_unit_hint(
                    format!("use at least {}", limit + room),
                    "surface_mm",
                    *found,
                    is_right,
                )
            }
        };
        Some(suggestion)
    }
}

/// Advice for a clear position that is too low, which the linear stage may not reach.
fn clear_advice(clear: f64, highest: Position<Mm>, reach_mm: Option<f64>) -> String {
    if let Some(reach_mm) = reach_mm.filter(|reach_mm| *reach_mm <= highest.value()) {
        return format!(
            "the soft limits of the linear stage end at {reach_mm} mm, which is too low: check surface_mm and \
             sample_half_width_mm, or narrow soft_limits_deg of [rotary]"
        );
    }
    let is_right = |mm| highest.value() < mm && mm <= LONGEST_MM;
    with_unit_hint(format!("use more than {:.3}", highest.value()), "clear_mm", clear, is_right)
}

/// A fault of the linear axis, in the words of its keys.
fn of_linear(fault: &AxisError<Mm>) -> String {
    match fault {
        AxisError::RestOutOfReach { rest, soft, .. } => {
            format!(
                "clear_mm = {} is outside the soft limits {soft} of the linear stage",
                rest.value()
            )
        }
        other => other.to_string(),
    }
}

/// Advice for a step that is too coarse. It is a fact of the bench: a finer one in the file would only be wrong.
fn tolerance_for(step: f64) -> String {
    let least = step.abs() / 2.0;
    format!(
        "give the tolerance at least {least}, or set a finer step in the drive and give that one"
    )
}
