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
    /// Lower the probe while the analyzer reads without a pause.
    Descend {
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
    /// Move the probe by a step, while the rig is commissioned.
    JogLinear {
        /// The read-back before it, by the rig file.
        from: Position<Mm>,
        /// Whether the drive said then that it knows where the stage is.
        is_homed: bool,
        /// The step, mm, upwards by the rig file.
        by_mm: f64,
        /// Speed, mm/s.
        speed_mm_per_s: f64,
    },
    /// Tilt the table by a step, while the rig is commissioned.
    JogRotary {
        /// The read-back before it, by the rig file.
        from: Position<Deg>,
        /// Whether the drive said then that it knows where the stage is.
        is_homed: bool,
        /// The step, degrees.
        by_deg: f64,
        /// Speed, °/s.
        speed_deg_per_s: f64,
    },
    /// Clear an alarm of the linear drive while the rig is commissioned.
    ClearLinear,
    /// Clear an alarm of the rotary drive while the rig is commissioned.
    ClearRotary,
    /// Have the linear drive find its zero while the rig is commissioned, in the direction that is set in the drive.
    SeekLinear,
    /// Have the rotary drive find its zero while the rig is commissioned.
    SeekRotary,
    /// Measure the impedance where the axes are.
    Measure,
    /// Measure the impedance again and again while the probe goes down, if it does.
    Stream,
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
            Self::Descend { .. } => "a descent of the linear stage",
            Self::MoveRotary { .. } => "a move of the rotary stage",
            Self::JogLinear { .. } => "a step of the linear stage",
            Self::JogRotary { .. } => "a step of the rotary stage",
            Self::ClearLinear => "clearing an alarm of the linear stage",
            Self::ClearRotary => "clearing an alarm of the rotary stage",
            Self::SeekLinear => "finding the zero of the linear stage",
            Self::SeekRotary => "finding the zero of the rotary stage",
            Self::Measure => "a measurement",
            Self::Stream => "a stream of readings",
        }
    }

    /// Whether it goes to the drive of the linear stage and may move it.
    pub(crate) const fn is_linear(&self) -> bool {
        matches!(
            self,
            Self::FindLinear
                | Self::HomeLinear
                | Self::MoveLinear { .. }
                | Self::Descend { .. }
                | Self::JogLinear { .. }
                | Self::SeekLinear
        )
    }

    /// Whether it belongs to the commissioning of a rig, which is not in service.
    pub(crate) const fn is_of_commissioning(&self) -> bool {
        matches!(
            self,
            Self::JogLinear { .. }
                | Self::JogRotary { .. }
                | Self::ClearLinear
                | Self::ClearRotary
                | Self::SeekLinear
                | Self::SeekRotary
        )
    }

    /// Whether it may turn the sample.
    pub(crate) const fn is_turn(&self) -> bool {
        matches!(
            self,
            Self::HomeRotary | Self::MoveRotary { .. } | Self::JogRotary { .. } | Self::SeekRotary
        )
    }
}

/// What a person says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// A command that opens nothing.
    Command,
    /// The cause of the fault is understood.
    Acknowledgement,
    /// The next step of commissioning may begin: nothing is below the probe, and a hand is at the stop.
    ThisStep,
    /// A gauge has shown that the last step of the linear stage was about as long as its drive says.
    LinearStepSeen,
    /// A person has seen a step of the rotary stage.
    RotaryStepSeen,
    /// The cause of the fault is understood, and nothing is below the probe, down to the end of its travel.
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
