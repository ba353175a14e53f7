//! The sensor: what it looks like to the analyzer, clear and in contact.

use rig_contact::{
    Circuit, Contact, ContactLaw, Depth, Direction, Element, Friction, Pose, SensorDesign,
    SensorError, Tissue, TissueError,
};
use rig_model::Orientation;

/// The sensor and how it meets its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorScene {
    /// What it is made of.
    pub design: SensorDesign,
    /// Whether it gives way to the sample, as a real one does, or the indentation is held.
    pub gives_way: bool,
    /// How the contact grows with depth.
    pub law: ContactLaw,
    /// Whether the contact sticks sideways while it vibrates; it slides without resistance if not.
    pub sticks: bool,
    /// Poisson's ratio of all samples.
    pub poisson: f64,
    /// Loss factor of all samples.
    pub tissue_loss: f64,
}

/// A contact as the world has it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Touched {
    pub(super) stiffness_mpa: f64,
    /// Along the probe.
    pub(super) indentation_mm: f64,
    /// The angle between probe and surface normal, with the sign of the tilt.
    pub(super) contact_deg: f64,
    pub(super) orientation: Orientation,
}

/// A checked sensor with what the model of it needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct SensorModel {
    scene: SensorScene,
    sensor: rig_contact::Sensor,
    element: Element,
}

/// Beyond this angle the model of a half space has long lost its sense, and the probe lies flat.
const STEEPEST_DEG: f64 = 80.0;

impl SensorModel {
    pub(super) fn new(scene: SensorScene) -> Result<Self, SensorError> {
        let sensor = rig_contact::Sensor::new(scene.design)?;
        Ok(Self { scene, sensor, element: Element::new(&sensor) })
    }

    pub(super) fn tissue(&self, stiffness_mpa: f64) -> Result<Tissue, TissueError> {
        Tissue::new(stiffness_mpa, self.scene.poisson, self.scene.tissue_loss)
    }

    /// The circuit without contact or in contact, with the free resonance shifted by `shift_hz`.
    pub(super) fn circuit(&self, touched: Option<Touched>, shift_hz: f64) -> Circuit {
        let circuit =
            touched.map_or_else(|| self.element.free_circuit(), |touched| self.touching(touched));
        // Warmth softens the beam: it scales the resonance with and without contact alike.
        let factor = 1.0 + shift_hz / self.element.no_load_hz();
        Circuit { series_resonance_hz: circuit.series_resonance_hz * factor, ..circuit }
    }

    fn touching(&self, touched: Touched) -> Circuit {
        let tissue = self.tissue(touched.stiffness_mpa).expect("stiffness was checked");
        let direction = match touched.orientation {
            Orientation::FrontBack if touched.contact_deg < 0.0 => Direction::Back,
            Orientation::FrontBack => Direction::Front,
            // Right is the mirror image of left.
            Orientation::Left => Direction::Left,
        };
        let angle_deg = touched.contact_deg.abs().min(STEEPEST_DEG);
        let pose = Pose::leaning(direction, angle_deg.to_radians()).expect("the angle is acute");
        let along_probe_mm = touched.indentation_mm;
        let depth = if self.scene.gives_way {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        };
        let SensorScene { law, sticks, .. } = self.scene;
        let friction = if sticks { Friction::Sticking } else { Friction::Frictionless };
        let contact = Contact { pose, depth, law, friction };
        let load = self.sensor.load(&tissue, &contact).unwrap_or_else(|_| {
            // Deeper than the law holds, as in a crash: the contact grows no further.
            let along_probe_mm = law.depth_limit_rel() * self.scene.design.probe_radius_mm;
            let deepest = Contact {
                pose: Pose::UPRIGHT,
                depth: Depth::Indentation { along_probe_mm },
                ..contact
            };
            self.sensor.load(&tissue, &deepest).expect("this is the limit of the law")
        });
        self.element.circuit(&pose, &load, &tissue)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::paper;

    fn circuit(gives_way: bool, indentation_mm: f64, contact_deg: f64) -> Circuit {
        let scene = SensorScene { gives_way, ..paper().sensor };
        let orientation = Orientation::FrontBack;
        let touched = Touched { stiffness_mpa: 0.649, indentation_mm, contact_deg, orientation };
        SensorModel::new(scene).unwrap().circuit(Some(touched), 0.0)
    }

    #[test]
    fn the_reference_sensor_has_the_shift_that_the_paper_prints() {
        let model = SensorModel::new(paper().sensor).unwrap();
        let free_hz = model.circuit(None, 0.0).series_resonance_hz;
        assert!((free_hz - 140.4).abs() < 0.2, "{free_hz}");
        assert!((model.circuit(None, 0.3).series_resonance_hz - free_hz - 0.3).abs() < 1e-3);
        // 134.11 Hz/MPa between samples 1 and 5 leaves 88.99 Hz for sample 5 (0.5 mm, upright).
        let shift_hz = circuit(false, 0.5, 0.0).series_resonance_hz - free_hz;
        assert!((shift_hz - 88.99).abs() < 1.0, "{shift_hz}");
        // A sensor that gives way indents sample 5 by half of it only.
        let shift_hz = circuit(true, 0.5, 0.0).series_resonance_hz - free_hz;
        assert!((shift_hz - 74.3).abs() < 1.0, "{shift_hz}");
    }

    #[test]
    fn front_and_back_differ_and_a_crash_is_still_a_circuit() {
        let front_hz = circuit(false, 0.5, 45.0).series_resonance_hz;
        let back_hz = circuit(false, 0.5, -45.0).series_resonance_hz;
        assert!(front_hz - back_hz > 5.0, "{front_hz} {back_hz}");
        let crash_hz = circuit(false, 20.0, 45.0).series_resonance_hz;
        assert!(crash_hz.is_finite() && crash_hz > front_hz, "{crash_hz}");
    }
}
