//! The contents of a simulated world.

use std::fmt;

use rig_contact::{SensorError, SpecimenError, TissueError};
use rig_model::Orientation;

use super::{nuisance::Nuisances, sensor::SensorScene, true_geometry::TrueGeometry};
use crate::{plant::NotRinging, wiring::AxisWiring};

/// Everything that a world is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Name of the scene.
    pub name: String,
    /// Decides all that is left to chance.
    pub seed: u64,
    /// The sensor and its description.
    pub sensor: SensorScene,
    /// Samples that can be placed under the probe.
    pub samples: Vec<Sample>,
    /// True positions on the bench.
    pub place: TrueGeometry,
    /// The stage that carries the sensor, in mm.
    pub linear: Mechanics,
    /// The stage that tilts the sample, in degrees.
    pub rotary: Mechanics,
    /// The initial orientation of the sensor.
    pub orientation: Orientation,
    /// Drift, noise, backlash and scatter of the bench.
    pub nuisances: Nuisances,
    /// The person at the bench.
    pub person: PersonScene,
}

/// The mechanics of a stage, in the unit of its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mechanics {
    /// Its initial position.
    pub start: f64,
    /// Positions of its limit switches: the lower and the upper one.
    pub travel: (f64, f64),
    /// What is true of its drive.
    pub assembly: Assembly,
}

/// What is true of a stage and its drive, where that is not what the rig file says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assembly {
    /// Way of the stage for one step of its drive, in the unit of its axis; negative if the motor turns the other
    /// way.
    pub units_per_step: Option<f64>,
    /// Position of the stage where its drive counts zero, in the unit of its axis.
    pub zero: Option<f64>,
}

impl Assembly {
    /// As the rig file says.
    pub const AS_DESCRIBED: Self = Self { units_per_step: None, zero: None };

    /// The wiring of a drive in truth, where `described` is that of the rig file.
    pub(crate) fn of(self, described: AxisWiring) -> AxisWiring {
        AxisWiring {
            units_per_step: self.units_per_step.unwrap_or(described.units_per_step),
            zero: self.zero.unwrap_or(described.zero),
            ..described
        }
    }

    /// Whether a rig file with this step and this zero describes what is true.
    pub fn is_described_by(self, units_per_step: f64, zero: f64) -> bool {
        self.units_per_step.is_none_or(|step| step == units_per_step)
            && self.zero.is_none_or(|true_zero| true_zero == zero)
    }
}

/// The person at a simulated bench, who says what is to be seen there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PersonScene {
    /// Share of the answers that are wrong.
    pub wrong_answers: f64,
}

impl PersonScene {
    /// Never wrong.
    pub const RELIABLE: Self = Self { wrong_answers: 0.0 };
}

/// One of the two stages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum AxisId {
    /// The vertical stage that carries the sensor.
    Linear,
    /// The stage that tilts the sample.
    Rotary,
}

impl fmt::Display for AxisId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Linear => "linear",
            Self::Rotary => "rotary",
        })
    }
}

/// A sample with its true stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The name on its label.
    pub name: String,
    /// Nominal elastic modulus, MPa.
    pub stiffness_mpa: f64,
    /// Depth at which it tears, mm.
    pub max_indentation_mm: f64,
    /// Thickness on a hard base to which it is bonded, mm; infinite for one that is thick.
    pub thickness_mm: f64,
}

/// Why a scene cannot be played.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// The sensor cannot be built.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The sensor's losses leave no resonance.
    #[error(transparent)]
    NotRinging(#[from] NotRinging),
    /// A sample cannot be made.
    #[error("sample \"{name}\"")]
    Sample {
        /// The name of the sample.
        name: String,
        /// The fault of the value.
        source: TissueError,
    },
    /// A sample with a base cannot be made.
    #[error("sample \"{name}\"")]
    Specimen {
        /// The name of the sample.
        name: String,
        /// The fault of the value.
        source: SpecimenError,
    },
    /// The initial position of a stage is not between its limit switches.
    #[error("{axis} stage: start {start} is outside its travel [{min}, {max}]")]
    Start {
        /// The stage with the wrong initial position.
        axis: AxisId,
        /// Its initial position.
        start: f64,
        /// The lower limit switch.
        min: f64,
        /// The upper limit switch.
        max: f64,
    },
}

/// There is no sample of this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no sample named \"{name}\"")]
pub struct NoSuchSample {
    /// The requested name.
    pub name: String,
}
