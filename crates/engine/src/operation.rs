//! What the devices are asked to do, one thing at a time, and what they report.

use std::time::Duration;

use rig_model::{Deg, DriveLevel, Mm, Position, Reading, RigLimits, RigTime, SweepPoint, Target};

/// Tells one operation from another, so that a late report is never taken for a present one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct OperationId(pub u64);

/// Something for the devices to do. One is in flight at a time, and none is ever abandoned.
#[derive(Debug, Clone, PartialEq)]
pub enum Operation {
    /// Home the linear stage if it is not homed. It homes upwards.
    PrepareLinear,
    /// Home the rotary stage if it is not homed.
    PrepareRotary,
    /// Move the probe up or down and read back where it is.
    MoveLinear {
        /// Where to.
        target: Target<Mm>,
        /// How fast, mm/s.
        speed_mm_per_s: f64,
    },
    /// Tilt the sample and read back where it is.
    MoveRotary {
        /// Where to.
        target: Target<Deg>,
        /// How fast, °/s.
        speed_deg_per_s: f64,
    },
    /// Measure the impedance at these frequencies, in this order.
    Measure {
        /// The frequencies, each with its settling and integration.
        points: Vec<SweepPoint>,
        /// The level of the drive.
        level: DriveLevel,
    },
    /// Stop both axes where they are.
    StopMotion,
}

/// What an operation achieved.
#[derive(Debug, Clone, PartialEq)]
pub enum Report {
    /// The linear stage stands here, read back after the move.
    LinearAt(Position<Mm>),
    /// The rotary stage stands here, read back after the move.
    RotaryAt(Position<Deg>),
    /// The readings: one by which the analyzer stands for each point asked for, and before it those
    /// that it flagged. The last one is flagged when it gave up on that point.
    Measured(Vec<Reading>),
    /// Both axes have stopped.
    Stopped,
}

/// The move that takes the probe clear. It is always allowed.
pub(crate) fn retract(limits: &RigLimits) -> Operation {
    Operation::MoveLinear {
        target: limits.linear.rest_target(),
        speed_mm_per_s: limits.motion.travel_speed_mm_per_s,
    }
}

/// How long an operation may take before something must be wrong.
///
/// Drivers have tighter limits of their own; this one catches a driver that never reports.
pub(crate) fn limit(operation: &Operation, travel_mm: f64, travel_deg: f64) -> Duration {
    const SLACK_S: f64 = 60.0;
    let seconds = match operation {
        Operation::PrepareLinear | Operation::PrepareRotary => 300.0,
        Operation::MoveLinear { speed_mm_per_s, .. } => travel_mm / speed_mm_per_s,
        Operation::MoveRotary { speed_deg_per_s, .. } => travel_deg / speed_deg_per_s,
        // An analyzer may be a good deal slower than the integration it is asked for.
        Operation::Measure { points, .. } => {
            10.0 * points.iter().map(SweepPoint::duration_s).sum::<f64>() + points.len() as f64
        }
        Operation::StopMotion => 0.0,
    };
    Duration::from_secs_f64(seconds + SLACK_S)
}

/// What an operation is called in a message.
pub(crate) const fn name(operation: &Operation) -> &'static str {
    match operation {
        Operation::PrepareLinear => "homing the linear stage",
        Operation::PrepareRotary => "homing the rotary stage",
        Operation::MoveLinear { .. } => "a move of the linear stage",
        Operation::MoveRotary { .. } => "a move of the rotary stage",
        Operation::Measure { .. } => "a measurement",
        Operation::StopMotion => "stopping both axes",
    }
}

/// An operation in flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pending {
    pub(crate) id: OperationId,
    pub(crate) operation: Operation,
    pub(crate) deadline: RigTime,
    /// It has been asked to end early.
    pub(crate) is_interrupted: bool,
}
