//! What a rig file can be refused for, beyond its shape.

use rig_contact::SensorError;
use rig_model::{AnalyzerMake, AxisError, Deg, DriveMake, Mm, Position};
use rig_settings::Complaint;

/// One reason. Values and limits are in the unit that their key names.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum Refusal {
    // Ports.
    #[error("connection = \"simulated\" needs the section [simulation]")]
    NothingToSimulate,
    #[error("a port is either serial or tcp")]
    NeitherPort,
    #[error("a port is serial or tcp, not both")]
    BothPorts,
    #[error("{key} is for a serial port")]
    NotSerial { key: &'static str },
    #[error("a serial port needs its baud")]
    NoBaud,
    #[error(
        "a line of {linear} and {rotary} needs its parity: they leave the factory with different ones"
    )]
    NoParity { linear: DriveMake, rotary: DriveMake },
    #[error("tcp = \"{address}\" is not of the form host:port")]
    NotAnAddress { address: String },
    #[error("the analyzer and the bus cannot share the port {port}")]
    SharedPort { port: String },
    #[error("unit_id = {unit_id} is that of the linear stage, on the same bus")]
    SharedUnit { unit_id: u32 },

    // The analyzer.
    #[error("frequency_hz is beyond what {make} can do, {min} Hz to {max} Hz")]
    BeyondDialect { make: AnalyzerMake, min: f64, max: f64 },
    #[error("max_level_v = {found} is above the {limit} V that {make} can give")]
    LevelBeyondDialect { found: f64, limit: f64, make: AnalyzerMake },

    // The axes.
    #[error(transparent)]
    Linear(#[from] AxisError<Mm>),
    #[error(transparent)]
    Rotary(#[from] AxisError<Deg>),
    #[error("{key} = 0 moves nothing")]
    NoStep { key: &'static str },
    #[error(
        "{key} = {found} is coarser than twice the tolerance {tolerance}: no step may reach a target"
    )]
    CoarseStep { key: &'static str, found: f64, tolerance: f64 },
    #[error("{key} = {found} is above {limit_key} = {limit}")]
    TooFast { key: &'static str, found: f64, limit_key: &'static str, limit: f64 },

    // The geometry.
    #[error(
        "clear_mm = {clear} is not above {highest}, to which the edge of a sample rises within the \
         soft limits of the rotary stage"
    )]
    NotClear { clear: f64, highest: Position<Mm> },
    #[error(
        "surface_mm = {found} is less than {room} mm above the lower soft limit {limit} mm of the \
         linear stage: no room for surface_tolerance_mm and max_indentation_mm"
    )]
    NoRoomBelow { found: f64, room: f64, limit: f64 },

    // The sensor.
    #[error(transparent)]
    Sensor(#[from] SensorError),

    // The samples.
    #[error("\"{name}\" is listed twice")]
    KnownTwice { name: String },
}

impl Complaint for Refusal {
    fn suggestion(&self) -> Option<String> {
        let suggestion = match self {
            Self::NothingToSimulate => "add it, or write connection = \"ports\"".into(),
            Self::NeitherPort => {
                "write { serial = \"/dev/…\", baud = … } or { tcp = \"host:port\" }".into()
            }
            Self::BothPorts | Self::NotSerial { .. } | Self::KnownTwice { .. } => {
                "remove one".into()
            }
            Self::NoBaud => "see the display or the switches of the device".into(),
            Self::NoParity { .. } => {
                "set both drives to one parity, and write it here: parity = \"none\" or \"even\""
                    .into()
            }
            Self::NotAnAddress { .. } => "write it like \"192.168.0.10:3500\"".into(),
            Self::SharedPort { .. } => "give each its own".into(),
            Self::SharedUnit { .. } => "give each drive its own, in the drive and here".into(),
            Self::BeyondDialect { min, max, .. } => format!("stay within [{min}, {max}]"),
            Self::LevelBeyondDialect { limit, .. } => format!("use at most {limit}"),
            Self::Linear(AxisError::SoftBeyondTravel { .. })
            | Self::Rotary(AxisError::SoftBeyondTravel { .. }) => "stay within the travel".into(),
            Self::Rotary(AxisError::RestOutOfReach { .. }) => {
                "0 is level and must be within".into()
            }
            Self::Linear(AxisError::RestOutOfReach { .. }) => "put it within".into(),
            // It names the field and its limit.
            Self::Sensor(_) => return None,
            // A stage is not asked for targets here, and the other numbers were read as positive.
            Self::Linear(_) | Self::Rotary(_) => return None,
            Self::NoStep { .. } => "give how far one count of the drive moves the axis".into(),
            Self::CoarseStep { tolerance, .. } => format!("use at most {}", 2.0 * tolerance),
            Self::TooFast { limit, .. } => format!("use at most {limit}"),
            Self::NotClear { highest, .. } => format!("use more than {:.3}", highest.value()),
            Self::NoRoomBelow { limit, room, .. } => format!("use at least {}", limit + room),
        };
        Some(suggestion)
    }
}
