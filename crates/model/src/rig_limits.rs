//! The limits of a rig: axes, geometry, motion and analyzer range.

use crate::{
    AnalyzerMake, Axis, ContactAngle, Deg, Direction, Mm, Position, SweepRequest,
    SweepRequestError, Target, Window,
};

/// Whether the probe is known to be away from the sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clearance {
    /// A read-back of the current move shows the probe at the clear position.
    Clear,
    /// The probe was lowered towards the sample and has not been shown clear since.
    InContact,
    /// Unknown, as after a start or a fault. Treated as contact.
    Unknown,
}

impl Clearance {
    /// What is known of the probe, for a person: that it was lowered does not show a contact.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::InContact => "lowered, and may be in contact",
            Self::Unknown => "not shown to be clear",
        }
    }

    /// The word in results, for a program.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::InContact => "in contact",
            Self::Unknown => "unknown",
        }
    }
}

/// Geometry of the bench.
///
/// The linear stage carries the sensor; its position is the height of the probe tip and grows
/// upwards. The rotary stage tilts the sample about a horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Linear position at which the tip touches the level sample.
    pub surface: Position<Mm>,
    /// Height of that surface above the rotary axis (negative below), mm.
    pub surface_above_pivot_mm: f64,
    /// Distance of the probe from the rotary axis, mm, positive on the side that sinks at positive
    /// angles.
    pub probe_beside_pivot_mm: f64,
    /// Radius of the spherical probe tip, in mm.
    pub probe_radius_mm: f64,
    /// Half the width of the largest sample, in mm: its edge rises when it is tilted.
    pub sample_half_width_mm: f64,
    /// Tolerance of the height of a surface, in mm.
    pub surface_tolerance_mm: f64,
    /// Radius of the cylindrical pin that lies in place of a flat sample with its axis along the rotary axis, in mm.
    pub pin_radius_mm: Option<f64>,
}

/// Sine of the steepest slope of a pin that is touched, 64°: beyond it, a small error of the place of the pin is a large one
/// of the height.
const STEEPEST_SINE: f64 = 0.9;

impl Geometry {
    /// The linear position at which the tip is expected to touch the tilted sample.
    ///
    /// A plane at distance d from the pivot, tilted by α, has the height (d − x sin α)/cos α at the
    /// lateral offset x. A ball of radius R that touches it has its centre R/cos α above, and its
    /// lowest point R below the centre.
    pub fn surface_at(&self, direction: Direction, angle: ContactAngle) -> Position<Mm> {
        self.surface_at_tilt(direction.rotary_position(angle))
    }

    /// The linear position at which the tip is expected to touch the sample when the rotary stage
    /// is at `tilt`. See [`Geometry::surface_at`].
    pub fn surface_at_tilt(&self, tilt: Position<Deg>) -> Position<Mm> {
        let tilt = tilt.value().to_radians();
        let (d, r) = (self.surface_above_pivot_mm, self.probe_radius_mm);
        let height = match self.pin_radius_mm {
            None => (d + r - self.probe_beside_pivot_mm * tilt.sin()) / tilt.cos() - r,
            Some(pin_mm) => self.centre_on_pin(pin_mm, tilt) - r,
        };
        self.surface.offset(height - d)
    }

    /// Height of the centre of the ball above the rotary axis when it touches a pin, mm, at a tilt in rad. The level pin is
    /// touched at its top, so that its axis is ρ below the surface, and ρ + R from the centre of the ball at each tilt.
    fn centre_on_pin(&self, pin_mm: f64, tilt: f64) -> f64 {
        let reach_mm = self.probe_radius_mm + pin_mm;
        let (beside_mm, above_mm) = self.axis_of_pin(pin_mm, tilt);
        // A ball that passes beside the pin is expected at the height of its axis.
        above_mm + (reach_mm * reach_mm - beside_mm * beside_mm).max(0.0).sqrt()
    }

    /// How far the axis of the pin lies beside the probe, and above the rotary axis, mm.
    fn axis_of_pin(&self, pin_mm: f64, tilt: f64) -> (f64, f64) {
        let (x, y) = (self.probe_beside_pivot_mm, self.surface_above_pivot_mm - pin_mm);
        let (sin, cos) = tilt.sin_cos();
        (x * cos + y * sin - self.probe_beside_pivot_mm, y * cos - x * sin)
    }

    /// Whether the ball touches the pin from above at this tilt, and not at its side or beside it. A flat sample is touched
    /// at each tilt.
    pub fn is_above_pin(&self, tilt: Position<Deg>) -> bool {
        self.pin_radius_mm.is_none_or(|pin_mm| {
            let (beside_mm, _) = self.axis_of_pin(pin_mm, tilt.value().to_radians());
            beside_mm.abs() <= STEEPEST_SINE * (self.probe_radius_mm + pin_mm)
        })
    }

    /// The highest point that any sample reaches when it is tilted by up to `tilt_degrees`.
    pub fn highest_sample_point(&self, tilt_degrees: f64) -> Position<Mm> {
        let d = self.surface_above_pivot_mm + self.surface_tolerance_mm;
        let w = self.sample_half_width_mm;
        // d cos α + w sin α is largest at atan(w/d), or at the end of the range.
        let best = w.atan2(d).clamp(0.0, tilt_degrees.abs().to_radians());
        let height = d * best.cos() + w * best.sin();
        self.surface.offset(height - self.surface_above_pivot_mm)
    }
}

/// Limits of motion: speeds and depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// Deepest indentation below the surface found, in mm.
    pub max_indentation_mm: f64,
    /// Speed with the probe clear, in mm/s.
    pub travel_speed_mm_per_s: f64,
    /// Speed while the surface is sought and in contact, in mm/s.
    pub contact_speed_mm_per_s: f64,
    /// Speed of the rotary stage, in °/s.
    pub rotary_speed_deg_per_s: f64,
    /// The slowest move of the drive of the linear stage, in mm/s; 0 if that is not known.
    pub slowest_mm_per_s: f64,
}

/// The range of the analyzer of a rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnalyzerRange {
    /// Lowest and highest frequency, in Hz.
    pub frequency_hz: (f64, f64),
    /// Highest level, in V.
    pub max_level_v: f64,
    /// Lowest level that it gives, in V; 0 if that is not known.
    pub min_level_v: f64,
    /// It integrates no shorter than this at [`RESONANCE_HZ`](Self::RESONANCE_HZ), s; 0 if that is not known.
    pub shortest_integration_s: f64,
    /// Readings one after the other.
    pub stream: ReadingStream,
}

/// A stream of readings at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadingStream {
    /// Longest time of a reading beside its integration, s; `None` if the analyzer gives no stream.
    pub overhead_s: Option<f64>,
    /// How much later than its readings say the analyzer integrates, beside the clock of the stage, s.
    pub latency_s: f64,
    /// Standard deviation of that latency, s.
    pub latency_sigma_s: f64,
}

impl ReadingStream {
    /// Standard deviation of a latency that nobody has measured, s.
    pub const LATENCY_SIGMA_S: f64 = 0.003;

    /// That of a make of analyzer, with a latency that nobody has measured.
    pub const fn of(make: AnalyzerMake) -> Self {
        Self {
            overhead_s: make.stream_overhead_s(),
            latency_s: 0.0,
            latency_sigma_s: Self::LATENCY_SIGMA_S,
        }
    }
}

impl AnalyzerRange {
    /// A sensor of this bench resonates near this frequency, Hz.
    pub const RESONANCE_HZ: f64 = 140.0;

    /// Every reason for which this analyzer cannot make the sweep.
    pub fn faults(&self, request: &SweepRequest) -> Vec<SweepRequestError> {
        let (min_hz, max_hz) = self.frequency_hz;
        let Window { min_hz: from_hz, max_hz: to_hz } = request.window;
        let asked = [
            ("min_hz", from_hz, min_hz, max_hz),
            ("max_hz", to_hz, min_hz, max_hz),
            ("level_v", request.level.volt, self.min_level_v, self.max_level_v),
        ];
        let refuse = |(what, found, min, max): (&'static str, f64, f64, f64)| {
            let is_within = min <= found && found <= max;
            (!is_within).then_some(SweepRequestError::OutOfRange { what, found, min, max })
        };
        asked.into_iter().filter_map(refuse).collect()
    }
}

/// Room between the probe and everything that a sample reaches in a turn, beyond the tolerances of the rig
/// file, mm: twenty times the slip that the check of the surface notices in the shipped protocol.
const TURN_ROOM_MM: f64 = 0.5;

/// The limits of a rig, for protocol and engine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigLimits {
    /// The vertical stage that carries the sensor.
    pub linear: Axis<Mm>,
    /// The stage that tilts the sample.
    pub rotary: Axis<Deg>,
    /// Geometry of the bench.
    pub geometry: Geometry,
    /// Speeds and depth.
    pub motion: MotionLimits,
    /// Range of the analyzer.
    pub analyzer: AnalyzerRange,
}

impl RigLimits {
    /// The highest position at which the tip can touch the tilted sample: its height is uncertain along
    /// its normal, and the rotary stage stands within twice its tolerance, once for the move and once for
    /// the reading.
    pub fn highest_surface(&self, direction: Direction, angle: ContactAngle) -> Position<Mm> {
        let tilt = direction.rotary_position(angle);
        let tolerance_deg = 2.0 * self.rotary.tolerance();
        let ends = [-tolerance_deg, tolerance_deg].map(|by_deg| {
            let tilt = tilt.offset(by_deg);
            let tolerance_mm = self.geometry.surface_tolerance_mm / tilt.value().to_radians().cos();
            self.geometry.surface_at_tilt(tilt).offset(tolerance_mm)
        });
        if ends[0] < ends[1] { ends[1] } else { ends[0] }
    }

    /// The lowest position at which the sample may turn from one tilt to another below the probe: above the edge
    /// that rises highest on the way, and never above the clear position, which is above every edge.
    ///
    /// `from` is read back, within the tolerance of the rotary stage; at `to` it stands within twice its
    /// tolerance, once for the move and once for the reading.
    pub fn clear_for_turn(&self, from: Position<Deg>, to: Position<Deg>) -> Target<Mm> {
        let tolerance_deg = self.rotary.tolerance();
        let to_deg = to.value().abs() + 2.0 * tolerance_deg;
        self.clear_up_to(to_deg.max(from.value().abs() + tolerance_deg))
    }

    /// The lowest position at which the probe is clear of the sample where the rotary stage was read back.
    pub fn clear_at(&self, tilt: Position<Deg>) -> Target<Mm> {
        self.clear_up_to(tilt.value().abs() + self.rotary.tolerance())
    }

    fn clear_up_to(&self, steepest_deg: f64) -> Target<Mm> {
        let clear = self.geometry.highest_sample_point(steepest_deg).offset(TURN_ROOM_MM);
        let rest = self.linear.rest_target();
        self.linear.target(clear).ok().filter(|_| clear < rest.position()).unwrap_or(rest)
    }

    /// The lowest position that any touch may need at this tilt: the deepest indentation into a
    /// surface that lies as low as it may.
    pub fn floor_at(&self, tilt: Position<Deg>) -> Position<Mm> {
        let below_mm = self.geometry.surface_tolerance_mm + self.motion.max_indentation_mm;
        self.geometry.surface_at_tilt(tilt).offset(-below_mm)
    }

    /// The lowest target of one move of the linear stage at this tilt, from a position or from above the highest surface:
    /// further below the highest surface than a touch needs may go no single move.
    pub fn lowest_of_one_move(
        &self,
        from: Option<Position<Mm>>,
        tilt: Position<Deg>,
    ) -> Position<Mm> {
        let tolerance_mm = self.geometry.surface_tolerance_mm;
        let highest = self.geometry.surface_at_tilt(tilt).offset(tolerance_mm);
        let from = from.filter(|from| *from < highest).unwrap_or(highest);
        from.offset(-tolerance_mm - self.motion.max_indentation_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AxisLimits, Span};

    /// A bench whose linear stage rests here, mm.
    fn limits(rest_mm: f64) -> RigLimits {
        let linear = AxisLimits {
            travel: Span::new(0.0, 50.0),
            soft: Span::new(1.0, 49.0),
            rest: Position::new(rest_mm),
            tolerance: 0.01,
            max_speed_per_s: 20.0,
        };
        let rotary = AxisLimits {
            travel: Span::new(-90.0, 90.0),
            soft: Span::new(-50.0, 50.0),
            rest: Position::new(0.0),
            tolerance: 0.05,
            max_speed_per_s: 30.0,
        };
        RigLimits {
            linear: Axis::new("linear stage", linear).unwrap(),
            rotary: Axis::new("rotary stage", rotary).unwrap(),
            geometry: Geometry { surface_tolerance_mm: 0.5, ..geometry() },
            motion: MotionLimits {
                max_indentation_mm: 0.6,
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

    fn geometry() -> Geometry {
        Geometry {
            surface: Position::new(10.0),
            surface_above_pivot_mm: 4.0,
            probe_beside_pivot_mm: 0.3,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 20.0,
            surface_tolerance_mm: 0.0,
            pin_radius_mm: None,
        }
    }

    /// Touching is decided without the formula: the lowest ball centre whose distance to the
    /// tilted plane is the radius, found by bisection.
    fn touch_by_bisection(geometry: &Geometry, tilt: f64) -> f64 {
        let (mut low, mut high) = (-50.0_f64, 50.0_f64);
        for _ in 0..200 {
            let centre = 0.5 * (low + high);
            let distance = geometry.probe_beside_pivot_mm * tilt.sin() + centre * tilt.cos()
                - geometry.surface_above_pivot_mm;
            if distance < geometry.probe_radius_mm { low = centre } else { high = centre }
        }
        low - geometry.probe_radius_mm + geometry.surface.value() - geometry.surface_above_pivot_mm
    }

    #[test]
    fn the_surface_is_where_the_ball_touches_the_tilted_plane() {
        for degrees in [0.0, 15.0, 30.0, 45.0] {
            for direction in Direction::ALL {
                let angle = ContactAngle::new(degrees).unwrap();
                let tilt = direction.rotary_position(angle).value().to_radians();
                let expected = touch_by_bisection(&geometry(), tilt);
                let found = geometry().surface_at(direction, angle).value();
                assert!((found - expected).abs() < 1e-9, "{direction} {angle}: {found} {expected}");
            }
        }
    }

    /// The lowest centre of a ball that is nowhere nearer to the circle of the pin than its radius, by bisection.
    fn touch_of_pin_by_bisection(geometry: &Geometry, pin_mm: f64, tilt: f64) -> f64 {
        let pivot = geometry.surface.value() - geometry.surface_above_pivot_mm;
        let distance_mm = |tip_mm: f64| {
            let (x, y) =
                (geometry.probe_beside_pivot_mm, tip_mm + geometry.probe_radius_mm - pivot);
            // The point of the sample below the ball, as it lies when the sample is level.
            let (x, y) = (x * tilt.cos() - y * tilt.sin(), x * tilt.sin() + y * tilt.cos());
            let top = (geometry.probe_beside_pivot_mm, geometry.surface_above_pivot_mm);
            (x - top.0).hypot(y - (top.1 - pin_mm)) - pin_mm
        };
        // From the height of the axis of the pin upwards the distance grows.
        let axis_mm = pivot + (geometry.surface_above_pivot_mm - pin_mm) * tilt.cos()
            - geometry.probe_beside_pivot_mm * tilt.sin()
            - geometry.probe_radius_mm;
        let (mut low, mut high) = (axis_mm, axis_mm + 50.0);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if distance_mm(middle) < geometry.probe_radius_mm {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    #[test]
    fn a_pin_is_touched_where_the_distance_of_its_axis_from_the_ball_is_both_radii() {
        for pin_mm in [2.0, 3.5, 5.0] {
            let geometry = Geometry { pin_radius_mm: Some(pin_mm), ..geometry() };
            for tilt in [-45.0, -30.0, 0.0, 15.0, 45.0].map(Position::new) {
                let expected =
                    touch_of_pin_by_bisection(&geometry, pin_mm, tilt.value().to_radians());
                let found = geometry.surface_at_tilt(tilt).value();
                assert!((found - expected).abs() < 1e-9, "{pin_mm} {tilt}: {found} {expected}");
                assert!(geometry.is_above_pin(tilt));
            }
            assert_eq!(geometry.surface_at_tilt(Position::new(0.0)), geometry.surface);
        }
        let thin = Geometry { pin_radius_mm: Some(1.0), ..geometry() };
        assert!(!thin.is_above_pin(Position::new(45.0)) && thin.is_above_pin(Position::new(10.0)));
        assert!(thin.surface_at_tilt(Position::new(60.0)).value().is_finite());
    }

    #[test]
    fn a_probe_that_was_clear_for_a_turn_is_clear_for_the_way_back_wherever_the_stage_stands() {
        let limits = limits(40.0);
        let tolerance = limits.rotary.tolerance();
        for degrees in [0.0, 5.0, 15.0, -30.0, 45.0] {
            let (level, there) = (Position::new(0.0), Position::new(degrees));
            let before = limits.clear_for_turn(level, there).position();
            for off in [-tolerance, -0.3 * tolerance, 0.0, tolerance] {
                let stands = Position::new(degrees + off);
                for next in [there, level] {
                    let after = limits.clear_for_turn(stands, next).position();
                    assert!(after <= before, "{stands} to {next}: {after}, {before} before");
                    assert!(limits.clear_at(stands).position() <= after);
                }
            }
            let (sin, cos) = (degrees.abs() + 2.0 * tolerance).to_radians().sin_cos();
            let edge_mm = 6.0 + 4.5 * cos + 20.0 * sin;
            assert!((before.value() - edge_mm - 0.5).abs() < 1e-9, "{degrees}°: {before}");
        }
        let (low, steep) = (self::limits(23.8), Position::new(45.0));
        assert_eq!(low.clear_for_turn(steep, steep), low.linear.rest_target());
        assert!(limits.clear_for_turn(steep, steep).position().value() < 24.0);
    }

    #[test]
    fn the_highest_point_of_a_tilted_sample_is_not_always_at_the_end_of_the_range() {
        let level = geometry().highest_sample_point(0.0).value();
        assert!((level - 10.0).abs() < 1e-12);
        let mut by_search = f64::MIN;
        for step in 0..=4500 {
            let tilt = (f64::from(step) / 100.0).to_radians();
            by_search = by_search.max(6.0 + 4.0 * tilt.cos() + 20.0 * tilt.sin());
        }
        let found = geometry().highest_sample_point(45.0).value();
        assert!((found - by_search).abs() < 1e-6, "{found} {by_search}");
    }
}
