//! The rig file: the devices with their ports, and the limits and the geometry of the bench.
//!
//! The files in `config/rigs` are the manual of its keys. The value `connection` decides whether a rig
//! is real or simulated; no other value has to differ.

mod axis;
mod fault;
mod port;
mod sections;
mod sensor;

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use crate::{
    Faults, Location,
    instrument::Named,
    samples::KnownSample,
    settings::{self, InForce},
};
use rig_contact::SensorDescription;
use rig_model::{
    AnalyzerMake, Deg, DriveMake, LineSettings, Mm, PortKind, RigLimits, Scale, Terminator,
};

/// A checked rig file.
#[derive(Debug, Clone)]
pub struct RigFile {
    /// Name of the rig.
    pub name: String,
    /// Whether its devices are real or simulated.
    pub connection: Connection,
    /// Axes, geometry and limits, for the protocol and the engine.
    pub limits: RigLimits,
    /// The impedance analyzer.
    pub analyzer: AnalyzerFile,
    /// Port of the line of both axes.
    pub bus: PortFile,
    /// Drive of the vertical axis.
    pub linear: AxisFile<Mm>,
    /// Drive of the axis that tilts the sample.
    pub rotary: AxisFile<Deg>,
    /// The sensor by which shifts are turned into stiffness.
    pub sensor: SensorDescription,
    /// Samples whose stiffness was measured by another method.
    pub samples: Vec<KnownSample>,
    /// Patience with a linear stage that does not answer on the way out of contact, s.
    pub recovery_patience_s: f64,
}

/// The value in which a simulated and a real rig differ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Connection {
    /// Real devices on their ports.
    Ports,
    /// Simulated devices behind the same drivers.
    Simulated(Simulation),
}

/// The settings of a simulation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Simulation {
    /// The scene file, relative to the directory of the rig file.
    pub scene: PathBuf,
    /// Location of its name in the rig file.
    pub scene_location: Location,
    /// Speed of its time.
    pub pace: Pace,
    /// The answers to prompts.
    pub person: SimulatedPerson,
}

/// Speed of time on a simulated rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As fast as the simulation computes.
    Virtual,
    /// As fast as the wall clock.
    Real,
}

/// The simulated person, who carries out prompts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimulatedPerson {
    /// The person answers the prompt.
    Answers,
    /// The person waits for the answer of a user, and acts then.
    Waits,
}

/// The impedance analyzer.
#[derive(Debug, Clone)]
pub struct AnalyzerFile {
    /// The instrument, which selects the dialect.
    pub instrument: Named<AnalyzerMake>,
    /// Port of the analyzer.
    pub port: PortFile,
    /// End of a message in both directions; `None` for the usual one of the make.
    pub terminator: Option<Terminator>,
    /// Longest time for an answer about its settings, s.
    pub reply_timeout_s: f64,
}

/// The port of a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PortFile {
    /// A serial port.
    Serial {
        /// Device file of the operating system.
        path: String,
        /// Speed and format of characters.
        line: LineSettings,
    },
    /// A TCP port.
    Tcp {
        /// Address in the form `host:port`.
        address: String,
    },
    /// An instrument on USB, behind the driver `usbtmc` of Linux.
    Usbtmc {
        /// Device file of the operating system, or the socket of a simulated instrument.
        path: String,
    },
}

impl PortFile {
    /// What the port is to the computer.
    pub const fn kind(&self) -> PortKind {
        match self {
            Self::Serial { .. } => PortKind::Serial,
            Self::Tcp { .. } => PortKind::Network,
            Self::Usbtmc { .. } => PortKind::Usb,
        }
    }

    /// Format of the characters on a serial port; `None` for another port.
    pub const fn line(&self) -> Option<LineSettings> {
        match self {
            Self::Serial { line, .. } => Some(*line),
            Self::Tcp { .. } | Self::Usbtmc { .. } => None,
        }
    }

    /// The device file or the address.
    pub fn place(&self) -> &str {
        match self {
            Self::Serial { path, .. } | Self::Usbtmc { path } => path,
            Self::Tcp { address } => address,
        }
    }
}

/// The drive of an axis.
#[derive(Debug, Clone)]
pub struct AxisFile<U> {
    /// The instrument, which selects the register map.
    pub instrument: Named<DriveMake>,
    /// Modbus address, 1 to 247.
    pub unit_id: u8,
    /// Positions of its counts.
    pub scale: Scale<U>,
    /// Whether its homing is known to move the axis upwards, away from the sample.
    pub is_homing_up: bool,
}

impl RigFile {
    /// Reads and checks the `text` of a rig `file`.
    ///
    /// # Errors
    /// All faults of the file.
    pub fn read(file: &str, text: &str) -> Result<Self, Faults> {
        let (rig, faults) = settings::read(file, text, sections::rig);
        faults.finish(rig)
    }

    /// The values in force of a rig file, each with its place.
    ///
    /// # Errors
    /// All faults of the file.
    pub fn in_force(file: &str, text: &str) -> Result<Vec<InForce>, Faults> {
        let (_, faults, values) = settings::in_force(file, text, sections::rig);
        faults.finish(values)
    }

    /// The JSON Schema of rig files.
    pub fn schema() -> serde_json::Value {
        settings::schema("rig file of rigd", sections::rig)
    }

    /// The scene file of a simulated rig whose rig file is at `path`.
    pub fn scene(&self, path: &Path) -> Option<PathBuf> {
        let Connection::Simulated(simulation) = &self.connection else { return None };
        Some(path.parent().unwrap_or(Path::new("")).join(&simulation.scene))
    }
}
