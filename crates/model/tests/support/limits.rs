//! The limits of an ideal bench, for the tests of the crates above this one: the surface is expected
//! at 10 mm, and may lie 0.5 mm higher or lower.

use rig_model::{
    AnalyzerMake, AnalyzerRange, Axis, AxisLimits, Geometry, MotionLimits, Position, ReadingStream,
    RigLimits, Span,
};

pub(crate) const REST_MM: f64 = 40.0;
pub(crate) const EXPECTED_SURFACE_MM: f64 = 10.0;
pub(crate) const TOLERANCE_MM: f64 = 0.5;
pub(crate) const DEEPEST_MM: f64 = 0.6;

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
            surface: Position::new(EXPECTED_SURFACE_MM),
            surface_above_pivot_mm: 0.0,
            probe_beside_pivot_mm: 0.0,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 20.0,
            surface_tolerance_mm: TOLERANCE_MM,
            pin_radius_mm: None,
        },
        motion: MotionLimits {
            max_indentation_mm: DEEPEST_MM,
            travel_speed_mm_per_s: 10.0,
            contact_speed_mm_per_s: 1.0,
            rotary_speed_deg_per_s: 20.0,
            slowest_mm_per_s: 0.001,
        },
        analyzer: AnalyzerRange {
            frequency_hz: (4.0, 1e6),
            max_level_v: 5.0,
            min_level_v: 0.005,
            shortest_integration_s: 0.0,
            stream: ReadingStream::of(AnalyzerMake::HiokiIm3536),
        },
    }
}
