//! The devices of a rig and its ports.

use std::time::Duration;

use rig_model::{AnalyzerMake, DriveMake};

use crate::modbus::NotModbus;

/// The devices of the bench and their connections.
#[derive(Debug, Clone, PartialEq)]
pub struct Wiring {
    /// The impedance analyzer.
    pub analyzer: AnalyzerMake,
    /// The drive of the linear stage.
    pub linear: AxisWiring,
    /// The drive of the rotary stage.
    pub rotary: AxisWiring,
    /// The framing of the drives' line.
    pub transport: LineTransport,
}

/// The drive of a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisWiring {
    /// The make of its drive.
    pub make: DriveMake,
    /// The drive's unit id on the line.
    pub unit_id: u8,
    /// Millimetres or degrees a step of the drive; negative when the motor counts the other way.
    pub units_per_step: f64,
    /// Position of the axis at count zero, mm or degrees.
    pub zero: f64,
    /// Steps for a revolution of the motor, as it is set in the drive.
    pub steps_per_revolution: f64,
}

impl Wiring {
    /// The devices of the paper's bench: a Hioki IM3536, and two Oriental Motor AZ drives with 1 µm and
    /// 0.01° a step.
    pub const fn paper(transport: LineTransport) -> Self {
        Self {
            analyzer: AnalyzerMake::HiokiIm3536,
            linear: AxisWiring::new(DriveMake::OrientalAz, 1, 0.001),
            rotary: AxisWiring::new(DriveMake::OrientalAz, 2, 0.01),
            transport,
        }
    }
}

impl AxisWiring {
    /// A drive whose count zero is at position zero, with 1000 steps for a revolution.
    pub const fn new(make: DriveMake, unit_id: u8, units_per_step: f64) -> Self {
        Self { make, unit_id, units_per_step, zero: 0.0, steps_per_revolution: 1000.0 }
    }
}

/// One of the rig's ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PortId {
    /// The port of the analyzer.
    Analyzer,
    /// The line of the drives.
    Bus,
}

/// The port closes the connection: the bytes on it cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the port hangs up")]
pub struct HangUp;

impl From<NotModbus> for HangUp {
    fn from(_: NotModbus) -> Self {
        Self
    }
}

/// The framing of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineTransport {
    /// A serial line at this many baud, eleven bits a character.
    Serial {
        /// Bits per second.
        baud: u32,
    },
    /// A network connection.
    Tcp,
}

impl LineTransport {
    /// Transfer time of `bytes` characters.
    pub(crate) fn duration_of(self, bytes: usize) -> Duration {
        match self {
            Self::Serial { baud } => Duration::from_secs_f64(11.0 * bytes as f64 / f64::from(baud)),
            Self::Tcp => Duration::ZERO,
        }
    }

    /// The silence that ends a frame: 3.5 characters, but never less than 1.75 ms.
    pub(crate) fn silence(self) -> Duration {
        self.duration_of(7).div_f64(2.0).max(Duration::from_micros(1750))
    }
}
