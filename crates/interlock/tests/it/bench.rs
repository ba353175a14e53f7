//! An interlock of the ideal bench, in service.

use rig_interlock::{Interlock, Outcome, PortCommand, Proven};
use rig_model::{Position, RigTime};

#[path = "../../../model/tests/support/limits.rs"]
mod limits;
pub(crate) use limits::{
    DEEPEST_MM, EXPECTED_SURFACE_MM as SURFACE_MM, REST_MM, TOLERANCE_MM, limits,
};

pub(crate) const FLOOR_MM: f64 = SURFACE_MM - TOLERANCE_MM - DEEPEST_MM;

pub(crate) fn lower(mm: f64) -> PortCommand {
    PortCommand::MoveLinear { to: Position::new(mm), speed_mm_per_s: 1.0 }
}

/// A rig that is commissioned, and of whose axes nothing is known.
pub(crate) fn fresh() -> Interlock {
    Interlock::new(limits(), Proven::Bench)
}

pub(crate) fn lift() -> PortCommand {
    PortCommand::MoveLinear { to: Position::new(REST_MM), speed_mm_per_s: 10.0 }
}

pub(crate) fn turn(degrees: f64) -> PortCommand {
    PortCommand::MoveRotary { to: Position::new(degrees), speed_deg_per_s: 20.0 }
}

pub(crate) fn linear_at(mm: f64) -> Outcome {
    Outcome::LinearAt(Position::new(mm))
}

pub(crate) fn rotary_at(degrees: f64) -> Outcome {
    Outcome::RotaryAt(Position::new(degrees))
}

/// An interlock of a rig in service: both axes identified, the probe clear, the sample level.
pub(crate) fn prepared(now: RigTime) -> Interlock {
    in_service(fresh(), now)
}

/// The same with a pin of this radius in place of the samples.
pub(crate) fn prepared_with_pin(now: RigTime, pin_mm: f64) -> Interlock {
    let mut limits = limits();
    limits.geometry.pin_radius_mm = Some(pin_mm);
    in_service(Interlock::new(limits, Proven::Bench), now)
}

fn in_service(mut interlock: Interlock, now: RigTime) -> Interlock {
    for (command, outcome) in [
        (PortCommand::FindLinear, linear_at(49.0)),
        (lift(), linear_at(REST_MM)),
        (PortCommand::HomeRotary, rotary_at(0.0)),
    ] {
        interlock.admit(now, &command).unwrap();
        interlock.ended(now, &command, &outcome);
    }
    interlock
}
