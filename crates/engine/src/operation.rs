//! Operations of the devices, one at a time, and their reports.

use std::time::Duration;

use rig_model::{Deg, DriveLevel, Mm, Position, Reading, RigLimits, RigTime, SweepPoint, Target};

/// Identifies an operation, so that a late report is never taken for a present one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct OperationId(pub u64);

/// An operation of the devices. One is in flight at a time. The engine waits for the end of each
/// operation, except for an interrupted measurement: the way out of contact must not wait for the
/// analyzer, and its late report is ignored.
#[derive(Debug, Clone, PartialEq)]
pub enum Operation {
    /// Home the linear stage, in the direction that is set in its drive: only after a person has stated
    /// that nothing is below the probe.
    HomeLinear {
        /// Whether it is homed although its drive says that it is homed: its position may be wrong.
        anew: bool,
    },
    /// Home the rotary stage if it is not homed.
    PrepareRotary,
    /// Find the linear stage again after a fault: open its port again, identify its drive, and read
    /// back where it is.
    FindLinear {
        /// Whether an alarm of the drive is reset. Without this, an alarm is a failure.
        may_reset_alarm: bool,
    },
    /// Home a linear stage that has lost its position, and whose homing leads away from the sample.
    HomeUpwards,
    /// Move the probe up or down and read its position back.
    MoveLinear {
        /// Target of the linear stage, within its soft limits, mm.
        target: Target<Mm>,
        /// Speed, mm/s.
        speed_mm_per_s: f64,
    },
    /// Tilt the sample and read its position back.
    MoveRotary {
        /// Target of the rotary stage, within its soft limits, degrees.
        target: Target<Deg>,
        /// Speed, °/s.
        speed_deg_per_s: f64,
    },
    /// Measure the impedance at these frequencies, in this order.
    Measure {
        /// The frequencies, each with its settling and integration.
        points: Vec<SweepPoint>,
        /// The level of the drive.
        level: DriveLevel,
    },
    /// Lower the probe evenly while the impedance is read at one frequency without a pause. Each reading is an
    /// [`Input::Read`](crate::Input::Read). It ends at its target, after
    /// [`Effect::EndDescent`](crate::Effect::EndDescent), or when the stream of readings breaks off.
    Descend {
        /// Target of the linear stage, within its soft limits, mm.
        target: Target<Mm>,
        /// Speed, mm/s.
        speed_mm_per_s: f64,
        /// The frequency, and the integration of each reading.
        point: SweepPoint,
        /// The level of the drive.
        level: DriveLevel,
    },
    /// Stop both axes where they are.
    StopMotion,
    /// Stop the rotary stage again, which has not answered a stop.
    StopRotary,
}

/// The report of an operation.
#[derive(Debug, Clone, PartialEq)]
pub enum Report {
    /// The read-back of the linear stage.
    LinearAt(Position<Mm>),
    /// The linear stage was found, has lost its position, and can be homed away from the sample.
    Unhomed,
    /// The read-back of a linear stage that had lost its position and was homed.
    LinearHomed(Position<Mm>),
    /// The read-back of the rotary stage.
    RotaryAt(Position<Deg>),
    /// The readings: one without a flag for each requested point, after its flagged ones. The last
    /// one is flagged if the analyzer gave up on its point.
    Measured(Vec<Reading>),
    /// The probe is at rest after a descent.
    Descended {
        /// The read-back of the linear stage.
        at: Position<Mm>,
        /// Positions during the descent with their times.
        way: Vec<(RigTime, Position<Mm>)>,
    },
    /// Both axes have stopped; the read-back of the linear stage, if its drive knows where it is.
    Stopped(Option<Position<Mm>>),
    /// The rotary stage has stopped; its read-back, if its drive knows where it is.
    RotaryStopped(Option<Position<Deg>>),
}

/// The move that takes the probe to this target, at its clear position or above. It is always allowed.
pub(crate) const fn retract(limits: &RigLimits, target: Target<Mm>) -> Operation {
    Operation::MoveLinear { target, speed_mm_per_s: limits.motion.travel_speed_mm_per_s }
}

/// The longest time that an operation may take.
///
/// Drivers have tighter limits of their own; this one catches a driver that never reports.
pub(crate) fn limit(operation: &Operation, travel_mm: f64, travel_deg: f64) -> Duration {
    const SLACK_S: f64 = 60.0;
    let seconds = match operation {
        Operation::HomeLinear { .. }
        | Operation::HomeUpwards
        | Operation::PrepareRotary
        | Operation::FindLinear { .. } => 300.0,
        Operation::MoveLinear { speed_mm_per_s, .. }
        | Operation::Descend { speed_mm_per_s, .. } => travel_mm / speed_mm_per_s,
        Operation::MoveRotary { speed_deg_per_s, .. } => travel_deg / speed_deg_per_s,
        // An analyzer may be much slower than the requested integration.
        Operation::Measure { points, .. } => {
            10.0 * points.iter().map(SweepPoint::duration_s).sum::<f64>() + points.len() as f64
        }
        Operation::StopMotion | Operation::StopRotary => 0.0,
    };
    Duration::from_secs_f64(seconds + SLACK_S)
}

/// Name of an operation in messages.
pub(crate) const fn name(operation: &Operation) -> &'static str {
    match operation {
        Operation::HomeLinear { .. } => "homing the linear stage",
        Operation::PrepareRotary => "homing the rotary stage",
        Operation::FindLinear { .. } => "finding the linear stage again",
        Operation::HomeUpwards => "homing the linear stage upwards",
        Operation::MoveLinear { .. } => "a move of the linear stage",
        Operation::Descend { .. } => "a descent of the linear stage",
        Operation::MoveRotary { .. } => "a move of the rotary stage",
        Operation::Measure { .. } => "a measurement",
        Operation::StopMotion => "stopping both axes",
        Operation::StopRotary => "stopping the rotary stage again",
    }
}

/// An operation in flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pending {
    pub(crate) id: OperationId,
    pub(crate) operation: Operation,
    pub(crate) deadline: RigTime,
    /// Whether it was asked to end early.
    pub(crate) is_interrupted: bool,
    /// Number of times that this measurement was held up and repeated.
    pub(crate) repeats: u32,
    /// Whether the host was held up during it, so that the times of its readings are wrong.
    pub(crate) is_held_up: bool,
}
