//! Position of the probe relative to the tilted sample. Computed from the signed distance of the
//! ball's centre to the plane, not by the formula that the daemon uses.

/// True positions, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueGeometry {
    /// Position of the linear stage at which the tip touches the level sample as drawn.
    pub surface_mm: f64,
    /// Height of that surface above the rotary axis.
    pub surface_above_pivot_mm: f64,
    /// Distance of the probe from the rotary axis, positive on the side that sinks at positive
    /// angles.
    pub probe_beside_pivot_mm: f64,
}

impl TrueGeometry {
    /// Depth of the ball in the undeformed surface along the probe, mm; negative while it is clear.
    /// `raised_mm` is the excess height of this mounting.
    pub(super) fn indentation_mm(
        &self,
        tip_mm: f64,
        tilt_deg: f64,
        radius_mm: f64,
        raised_mm: f64,
    ) -> f64 {
        let (sine, cosine) = tilt_deg.to_radians().sin_cos();
        let pivot_mm = self.surface_mm - self.surface_above_pivot_mm;
        let centre_mm = tip_mm + radius_mm - pivot_mm;
        // The surface is the plane n·x = d with the normal (sin θ, cos θ).
        let distance_mm = self.probe_beside_pivot_mm * sine + centre_mm * cosine
            - (self.surface_above_pivot_mm + raised_mm);
        (radius_mm - distance_mm) / cosine
    }
}

#[cfg(test)]
mod tests {
    use rig_model::{ContactAngle, Direction, Geometry, Position};

    use super::*;

    #[test]
    fn the_ball_touches_where_the_daemon_expects_it_when_the_bench_is_as_drawn() {
        let geometry = TrueGeometry {
            surface_mm: 10.0,
            surface_above_pivot_mm: 4.0,
            probe_beside_pivot_mm: 0.3,
        };
        let drawn = Geometry {
            surface: Position::new(10.0),
            surface_above_pivot_mm: 4.0,
            probe_beside_pivot_mm: 0.3,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 20.0,
            surface_tolerance_mm: 0.5,
        };
        for degrees in [0.0, 15.0, 30.0, 45.0] {
            let angle = ContactAngle::new(degrees).unwrap();
            for direction in Direction::ALL {
                let tip = drawn.surface_at(direction, angle).value();
                let tilt = direction.rotary_position(angle).value();
                assert!(
                    geometry.indentation_mm(tip, tilt, 0.5, 0.0).abs() < 1e-12,
                    "{direction} {angle}"
                );
                let deeper = geometry.indentation_mm(tip - 0.5, tilt, 0.5, 0.0);
                assert!((deeper - 0.5).abs() < 1e-12, "{direction} {angle}: {deeper}");
            }
        }
    }
}
