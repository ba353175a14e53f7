//! The rig file: which device is on which port, and what the bench can do.
//!
//! What it may say is shown, with comments, in the files that are shipped in `config/rigs`. The
//! value `connection` decides whether a rig is real or simulated; nothing else has to differ.

mod axis;
mod bench;
mod port;
mod refusal;
mod sensor;

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use rig_analysis::sensor::SensorDescription;
use rig_files::{Faults, Location};
use rig_model::{AnalyzerMake, Bench, Deg, DriveMake, LineSettings, Mm, Scale, Terminator};

/// A rig file, read and checked.
#[derive(Debug, Clone)]
pub struct RigFile {
    /// The name of the rig.
    pub name: String,
    /// Whether its devices are there or simulated.
    pub connection: Connection,
    /// What the protocol and the engine have to know of it.
    pub bench: Bench,
    /// The impedance analyzer.
    pub analyzer: AnalyzerFile,
    /// Where the line is on which both axes are.
    pub bus: PortFile,
    /// The vertical axis.
    pub linear: AxisFile<Mm>,
    /// The axis that tilts the sample.
    pub rotary: AxisFile<Deg>,
    /// The sensor by which shifts are turned into stiffness.
    pub sensor: SensorDescription,
    /// The samples whose stiffness was measured otherwise.
    pub samples: Vec<KnownSample>,
}

/// The one value in which a simulated and a real rig differ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Connection {
    /// The devices are on their ports.
    Ports,
    /// Simulated devices take their place, behind the same drivers.
    Simulated(Simulation),
}

/// What is simulated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Simulation {
    /// The scene file, relative to the directory of the rig file.
    pub scene: PathBuf,
    /// Where the rig file names it.
    pub scene_location: Location,
    /// How fast time passes.
    pub pace: Pace,
    /// Who answers the prompts.
    pub person: SimulatedPerson,
}

/// How fast time passes on a simulated rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As fast as it can be computed.
    Virtual,
    /// As on the wall.
    Real,
}

/// Who answers the prompts of a simulated rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimulatedPerson {
    /// The simulated person does what is asked, and says so.
    Answers,
    /// The simulated person does it as soon as somebody else says that it is done.
    Waits,
}

/// The impedance analyzer.
#[derive(Debug, Clone)]
pub struct AnalyzerFile {
    /// Its make, which says how to speak to it.
    pub make: AnalyzerMake,
    /// Where it is.
    pub port: PortFile,
    /// What ends a message, either way; what is usual for the make where it is None.
    pub terminator: Option<Terminator>,
    /// How long it may take to answer a question about its settings, s.
    pub reply_timeout_s: f64,
}

/// Where a device is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PortFile {
    /// On a serial port.
    Serial {
        /// The device file.
        path: String,
        /// How characters travel.
        line: LineSettings,
    },
    /// On the network, `host:port`.
    Tcp {
        /// The address.
        address: String,
    },
}

impl PortFile {
    /// Whether it is a serial line, and no connection.
    pub const fn is_serial(&self) -> bool {
        matches!(self, Self::Serial { .. })
    }
}

/// The controller of an axis.
#[derive(Debug, Clone)]
pub struct AxisFile<U> {
    /// The make of the drive, which says how to speak to it.
    pub make: DriveMake,
    /// Its address on the bus.
    pub unit_id: u8,
    /// How its counts correspond to positions.
    pub scale: Scale<U>,
}

/// A sample whose stiffness was measured otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownSample {
    /// The name on its label.
    pub name: String,
    /// Its Young's modulus, in MPa.
    pub stiffness_mpa: f64,
}

impl RigFile {
    /// Reads and checks the `text` of a rig `file`.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub fn read(file: &str, text: &str) -> Result<Self, Faults> {
        let (rig, faults) = rig_files::settings::read(file, text, bench::rig);
        faults.finish(rig)
    }

    /// The scene file of a simulated rig whose rig file is at `path`.
    pub fn scene(&self, path: &Path) -> Option<PathBuf> {
        let Connection::Simulated(simulation) = &self.connection else { return None };
        Some(path.parent().unwrap_or(Path::new("")).join(&simulation.scene))
    }
}
