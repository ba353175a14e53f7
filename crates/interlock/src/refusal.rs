//! Why a command was refused.

use rig_model::{Deg, Mm, Position};

/// A command was refused. Nothing was sent.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The sample turns only under a probe that was read back clear of everything that it reaches.
    #[error("{what}: the last command to the linear stage has not shown the probe clear")]
    NotClear {
        /// The command.
        what: &'static str,
    },
    /// The probe was read back clear, but too long ago.
    #[error("{what}: the probe was read back clear {age_s:.0} s ago, more than {limit_s:.0} s")]
    ClearIsOld {
        /// The command.
        what: &'static str,
        /// Age of the read-back, s.
        age_s: f64,
        /// Largest age, s.
        limit_s: f64,
    },
    /// The tilt, on which the floor rests, was read back too long ago.
    #[error("{what}: the tilt was read back {age_s:.0} s ago, more than {limit_s:.0} s")]
    TiltIsOld {
        /// The command.
        what: &'static str,
        /// Age of the read-back, s.
        age_s: f64,
        /// Largest age, s.
        limit_s: f64,
    },
    /// A target that is too deep for every sample.
    #[error(
        "a move of the linear stage to {to}: the deepest that a touch may go at {tilt} is {floor}"
    )]
    BelowFloor {
        /// The target.
        to: Position<Mm>,
        /// The tilt of the sample.
        tilt: Position<Deg>,
        /// The floor.
        floor: Position<Mm>,
    },
    /// A step that is too long where a sample may be.
    #[error(
        "a move of the linear stage to {to}: {step_mm:.3} mm in one step, where at most \
         {limit_mm:.3} mm are allowed near the sample"
    )]
    StepTooLong {
        /// The target.
        to: Position<Mm>,
        /// Length of the step below the highest possible surface, mm.
        step_mm: f64,
        /// Longest step, mm.
        limit_mm: f64,
    },
    /// A move that is too fast.
    #[error("{what}: speed {asked:.3} {unit}/s is above {limit:.3} {unit}/s")]
    TooFast {
        /// The command.
        what: &'static str,
        /// Requested speed.
        asked: f64,
        /// Highest speed here.
        limit: f64,
        /// Unit of the axis.
        unit: &'static str,
    },
    /// The probe is lowered only as far as a durable record says.
    #[error(
        "a move of the linear stage to {to}: the journal has no durable intent to go that deep"
    )]
    NoIntent {
        /// The target.
        to: Position<Mm>,
    },
    /// The position of an axis is not known.
    #[error("{what}: the {axis} has not been identified and read back since it was last in doubt")]
    NotIdentified {
        /// The command.
        what: &'static str,
        /// The axis.
        axis: &'static str,
    },
    /// After a fault, only the way out of contact is open until a person acknowledges the fault.
    #[error("{what}: a fault has not been acknowledged")]
    Latched {
        /// The command.
        what: &'static str,
    },
    /// One command at a time goes to a port.
    #[error("{what}: {other} is still under way on the same port")]
    PortBusy {
        /// The command.
        what: &'static str,
        /// The command under way.
        other: &'static str,
    },
    /// A measurement needs axes at rest.
    #[error("a measurement: {other} is under way")]
    Moving {
        /// The command under way.
        other: &'static str,
    },
    /// Homing in an unknown direction, where a sample may be below the probe.
    #[error(
        "homing the linear stage: nobody has just stated that nothing is below the probe, and it may \
         home downwards"
    )]
    HomingUnproven,
    /// After a stop, only the way out of contact is open until the probe is clear.
    #[error("{what}: a stop was asked for, and the probe has not been retracted since")]
    Stopping {
        /// The command.
        what: &'static str,
    },
    /// Signs and scales of the drives are not shown.
    #[error("{what}: the rig is not commissioned, so that signs and scales may be wrong")]
    NotCommissioned {
        /// The command.
        what: &'static str,
    },
    /// Steps are for a rig that is being commissioned.
    #[error("{what}: the rig is commissioned and in service")]
    Commissioned {
        /// The command.
        what: &'static str,
    },
    /// Each step of commissioning needs the word of a person.
    #[error(
        "{what}: no person has confirmed in the last minute that it may begin and that nothing is below the probe"
    )]
    StepUnconfirmed {
        /// The command.
        what: &'static str,
    },
    /// A step that is too long for what is shown.
    #[error(
        "{what}: {asked:.3} {unit} is more than the {limit:.3} {unit} that are allowed before more is shown"
    )]
    JogTooLong {
        /// The command.
        what: &'static str,
        /// Length of the step.
        asked: f64,
        /// Longest step.
        limit: f64,
        /// Unit of the axis.
        unit: &'static str,
    },
    /// A step that is too long for an axis whose place nobody knows.
    #[error(
        "{what}: {asked:.3} {unit} is more than the {limit:.3} {unit} that are allowed while the drive says that it does not know where \
         its axis is"
    )]
    JogUnhomed {
        /// The command.
        what: &'static str,
        /// Length of the step.
        asked: f64,
        /// Longest step.
        limit: f64,
        /// Unit of the axis.
        unit: &'static str,
    },
    /// A step that is too fast.
    #[error("{what}: speed {asked:.3} {unit}/s is above {limit:.3} {unit}/s")]
    JogTooFast {
        /// The command.
        what: &'static str,
        /// Requested speed.
        asked: f64,
        /// Highest speed.
        limit: f64,
        /// Unit of the axis.
        unit: &'static str,
    },
    /// A step that leads out of the travel.
    #[error(
        "{what}: it would lead to {to:.3} {unit}, outside the travel from {min:.3} {unit} to {max:.3} {unit}"
    )]
    BeyondTravel {
        /// The command.
        what: &'static str,
        /// End of the step.
        to: f64,
        /// Lower end of the travel.
        min: f64,
        /// Upper end.
        max: f64,
        /// Unit of the axis.
        unit: &'static str,
    },
    /// A step that leads too far down, where table and sample are.
    #[error("{what}: it would lead down to {to:.3} mm, below the lower soft limit of {min:.3} mm")]
    BelowSoftLimit {
        /// The command.
        what: &'static str,
        /// End of the step, mm.
        to: f64,
        /// The limit, mm.
        min: f64,
    },
    /// A command without an operator.
    #[error("a command without the name of an operator")]
    Anonymous,
}
