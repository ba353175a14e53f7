//! The bench of the tests: the surface is expected at 10 mm, and may lie 0.5 mm higher or lower.

use rig_interlock::{Interlock, Outcome, PortCommand};
use rig_model::{
    AnalyzerRange, Axis, AxisLimits, Geometry, MotionLimits, Position, RigLimits, RigTime, Span,
};

pub(crate) const REST_MM: f64 = 40.0;
pub(crate) const SURFACE_MM: f64 = 10.0;
pub(crate) const TOLERANCE_MM: f64 = 0.5;
pub(crate) const DEEPEST_MM: f64 = 0.6;
pub(crate) const FLOOR_MM: f64 = SURFACE_MM - TOLERANCE_MM - DEEPEST_MM;

pub(crate) fn limits() -> RigLimits {
    RigLimits {
        linear: Axis::new(
            "linear stage",
            AxisLimits {
                travel: Span::new(0.0, 50.0),
                soft: Span::new(1.0, 49.0),
                rest: Position::new(REST_MM),
                tolerance: 0.01,
                max_speed_per_s: 20.0,
            },
        )
        .unwrap(),
        rotary: Axis::new(
            "rotary stage",
            AxisLimits {
                travel: Span::new(-90.0, 90.0),
                soft: Span::new(-50.0, 50.0),
                rest: Position::new(0.0),
                tolerance: 0.05,
                max_speed_per_s: 30.0,
            },
        )
        .unwrap(),
        geometry: Geometry {
            surface: Position::new(SURFACE_MM),
            surface_above_pivot_mm: 0.0,
            probe_beside_pivot_mm: 0.0,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 20.0,
            surface_tolerance_mm: TOLERANCE_MM,
        },
        motion: MotionLimits {
            max_indentation_mm: DEEPEST_MM,
            travel_speed_mm_per_s: 10.0,
            contact_speed_mm_per_s: 1.0,
            rotary_speed_deg_per_s: 20.0,
        },
        analyzer: AnalyzerRange { frequency_hz: (4.0, 1e6), max_level_v: 5.0 },
    }
}

pub(crate) fn lower(mm: f64) -> PortCommand {
    PortCommand::MoveLinear { to: Position::new(mm), speed_mm_per_s: 1.0 }
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
    let mut interlock = Interlock::new(limits());
    for (command, outcome) in [
        (PortCommand::HomeLinear, linear_at(49.0)),
        (lift(), linear_at(REST_MM)),
        (PortCommand::HomeRotary, rotary_at(0.0)),
    ] {
        interlock.admit(now, &command).unwrap();
        interlock.ended(now, &command, &outcome);
    }
    interlock
}
