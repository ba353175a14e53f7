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
    /// Distance of an edge of the sample from the rotary axis, along its surface on the same side.
    pub edge_mm: f64,
    /// Radius of a pin in place of each sample, along the rotary axis, whose top is where a level sample is touched.
    pub pin_mm: Option<f64>,
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
        if let Some(pin_mm) = self.pin_mm {
            let top_mm = self.top_above_probe_mm(pin_mm, tilt_deg, radius_mm, raised_mm);
            return top_mm - centre_mm;
        }
        // The surface is the plane n·x = d with the normal (sin θ, cos θ).
        let distance_mm = self.probe_beside_pivot_mm * sine + centre_mm * cosine
            - (self.surface_above_pivot_mm + raised_mm);
        (radius_mm - distance_mm) / cosine
    }

    /// Height of the centre of a ball that touches the pin, above the rotary axis, mm; minus infinity beside the pin.
    fn top_above_probe_mm(
        &self,
        pin_mm: f64,
        tilt_deg: f64,
        radius_mm: f64,
        raised_mm: f64,
    ) -> f64 {
        let (x, y) = self.turned(tilt_deg, self.surface_above_pivot_mm + raised_mm - pin_mm);
        let angle = ((x - self.probe_beside_pivot_mm) / (pin_mm + radius_mm)).asin();
        // Beside the pin there is no such angle.
        if angle.is_nan() { f64::NEG_INFINITY } else { y + (pin_mm + radius_mm) * angle.cos() }
    }

    /// Where a point of the table is that is under the probe, and at this height above the rotary axis, when the table is
    /// level: beside and above that axis, mm.
    fn turned(&self, tilt_deg: f64, height_mm: f64) -> (f64, f64) {
        let (sine, cosine) = tilt_deg.to_radians().sin_cos();
        let x = self.probe_beside_pivot_mm;
        (x * cosine + height_mm * sine, height_mm * cosine - x * sine)
    }

    /// The slope of the surface that is touched, against that of the table, degrees: zero for a flat sample.
    pub(super) fn slope_deg(&self, tilt_deg: f64, radius_mm: f64) -> f64 {
        let Some(pin_mm) = self.pin_mm else { return 0.0 };
        let (x, _) = self.turned(tilt_deg, self.surface_above_pivot_mm - pin_mm);
        let sine = (x - self.probe_beside_pivot_mm) / (pin_mm + radius_mm);
        -sine.clamp(-1.0, 1.0).asin().to_degrees() - tilt_deg
    }

    /// How far it is along the surface from the touched point to the edge of the sample, mm; negative beyond it.
    pub(super) fn edge_distance_mm(&self, tip_mm: f64, tilt_deg: f64, radius_mm: f64) -> f64 {
        let (sine, cosine) = tilt_deg.to_radians().sin_cos();
        let pivot_mm = self.surface_mm - self.surface_above_pivot_mm;
        let centre_mm = tip_mm + radius_mm - pivot_mm;
        self.edge_mm - (self.probe_beside_pivot_mm * cosine - centre_mm * sine)
    }
}

#[cfg(test)]
mod tests {
    use rig_model::{ContactAngle, Direction, Geometry, Position};

    use super::*;

    #[test]
    fn a_tilted_sample_is_touched_up_its_slope() {
        let geometry = TrueGeometry {
            surface_mm: 10.0,
            surface_above_pivot_mm: 4.0,
            probe_beside_pivot_mm: 0.0,
            edge_mm: 3.0,
            pin_mm: None,
        };
        // The side that sinks at 45° has its edge further away, and nearer at -45°.
        for (tilt_deg, expected_mm) in [(0.0, 3.0), (45.0, 3.0 + 4.5), (-45.0, 3.0 - 4.5)] {
            let tip_mm = 10.0 - 4.0 + 4.5 / f64::to_radians(tilt_deg).cos() - 0.5;
            let found_mm = geometry.edge_distance_mm(tip_mm, tilt_deg, 0.5);
            assert!((found_mm - expected_mm).abs() < 1e-12, "{tilt_deg}°: {found_mm}");
        }
    }

    #[test]
    fn the_ball_touches_where_the_daemon_expects_it_when_the_bench_is_as_drawn() {
        let geometry = TrueGeometry {
            surface_mm: 10.0,
            surface_above_pivot_mm: 4.0,
            probe_beside_pivot_mm: 0.3,
            edge_mm: f64::INFINITY,
            pin_mm: None,
        };
        let drawn = Geometry {
            surface: Position::new(10.0),
            surface_above_pivot_mm: 4.0,
            probe_beside_pivot_mm: 0.3,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 20.0,
            surface_tolerance_mm: 0.5,
            pin_radius_mm: None,
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
                // A pin too, whose slope against the probe is that of the line between both centres.
                let (geometry, drawn) = (
                    TrueGeometry { pin_mm: Some(2.0), ..geometry },
                    Geometry { pin_radius_mm: Some(2.0), ..drawn },
                );
                let tip = drawn.surface_at(direction, angle).value();
                let off = geometry.indentation_mm(tip, tilt, 0.5, 0.0);
                assert!(off.abs() < 1e-12, "{direction} {angle}: {off}");
                let contact_deg = tilt + geometry.slope_deg(tilt, 0.5);
                assert!(contact_deg * tilt <= 0.0 && contact_deg.abs() < 45.0, "{contact_deg}");
            }
        }
        let thin = TrueGeometry { pin_mm: Some(0.5), ..geometry };
        assert_eq!(thin.indentation_mm(0.0, 45.0, 0.5, 0.0), f64::NEG_INFINITY);
    }
}
