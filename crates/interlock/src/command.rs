//! Commands to the devices, as the interlock sees them, and their outcomes.

use rig_model::{Deg, Mm, Position};

/// A command to the devices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PortCommand {
    /// Stop both axes.
    Stop,
    /// Identify the linear drive and read where the stage is; home it only away from the sample.
    FindLinear,
    /// Bring the linear drive into service. An axis that is not homed is homed, in the direction
    /// that is set in the drive.
    HomeLinear,
    /// Bring the rotary drive into service, homing it if it is not homed.
    HomeRotary,
    /// Move the probe.
    MoveLinear {
        /// The target.
        to: Position<Mm>,
        /// Speed, mm/s.
        speed_mm_per_s: f64,
    },
    /// Tilt the sample.
    MoveRotary {
        /// The target.
        to: Position<Deg>,
        /// Speed, °/s.
        speed_deg_per_s: f64,
    },
    /// Measure the impedance where the axes are.
    Measure,
}

impl PortCommand {
    /// The command in messages.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Stop => "a stop",
            Self::FindLinear => "finding the linear stage",
            Self::HomeLinear => "homing the linear stage",
            Self::HomeRotary => "homing the rotary stage",
            Self::MoveLinear { .. } => "a move of the linear stage",
            Self::MoveRotary { .. } => "a move of the rotary stage",
            Self::Measure => "a measurement",
        }
    }

    /// Whether it goes to the drive of the linear stage and may move it.
    pub(crate) const fn is_linear(&self) -> bool {
        matches!(self, Self::FindLinear | Self::HomeLinear | Self::MoveLinear { .. })
    }

    /// Whether it may turn the sample.
    pub(crate) const fn is_turn(&self) -> bool {
        matches!(self, Self::HomeRotary | Self::MoveRotary { .. })
    }
}

/// What a person says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// A command that opens nothing.
    Command,
    /// The cause of the fault is understood.
    Acknowledgement,
    /// The same, and nothing is below the probe, down to the end of its travel.
    NothingBelow,
}

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// The read-back of the linear stage, at rest and without an alarm.
    LinearAt(Position<Mm>),
    /// The read-back of the rotary stage, at rest and without an alarm.
    RotaryAt(Position<Deg>),
    /// In order, without a position.
    Done,
    /// Early, after a requested stop.
    Interrupted,
    /// It failed.
    Failed,
}
