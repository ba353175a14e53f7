//! The sensor and its impedance, clear and in contact.

use rig_contact::{
    Choice, Circuit, Contact, ContactLaw, Depth, Direction, Friction, Models, Pose, SensorDesign,
    SensorError, Tier, Tissue, TissueError,
};
use rig_model::Orientation;

/// The sensor and how it meets its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorScene {
    /// Dimensions and materials.
    pub design: SensorDesign,
    /// Whether it deflects at the sample, as a real one does, or the indentation is held.
    pub deflects: bool,
    /// The contact law.
    pub law: ContactLaw,
    /// Whether the contact sticks sideways while it vibrates; it slides without resistance if not.
    pub sticks: bool,
    /// Poisson's ratio of all samples.
    pub poisson: f64,
    /// Loss factor of all samples.
    pub tissue_loss: f64,
    /// Largest difference from the reference allowed to the model, Hz. The cheapest model within it is
    /// used.
    pub tolerance_hz: f64,
}

/// A contact of the simulated world.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorldContact {
    pub(super) stiffness_mpa: f64,
    /// Along the probe.
    pub(super) indentation_mm: f64,
    /// The angle between probe and surface normal, with the sign of the tilt.
    pub(super) contact_deg: f64,
    pub(super) orientation: Orientation,
}

/// A checked sensor with its models.
#[derive(Debug, Clone, Copy)]
pub(super) struct SensorModel {
    scene: SensorScene,
    models: Models,
    choice: Choice,
}

/// The scenes are those of contacts up to the paper's largest angle.
const TILT_MAX_DEG: f64 = 45.0;

/// Beyond this angle the model of a half space has long lost its sense, and the probe lies flat.
const STEEPEST_DEG: f64 = 80.0;

/// Depths that are tried for a contact deeper than its model, each half the one before.
const DEPTHS: i32 = 40;

impl SensorModel {
    /// The cheapest model of the sensor for samples of up to this stiffness, indented by up to this much.
    pub(super) fn new(
        scene: SensorScene,
        stiffest_mpa: f64,
        deepest_mm: f64,
    ) -> Result<Self, SensorError> {
        let sensor = rig_contact::Sensor::new(scene.design)?;
        let reference =
            Choice { tier: Tier::Reference, difference_hz: 0.0, tolerance_hz: scene.tolerance_hz };
        // A scene that the reference does not take in whole is left to it, as far as it does.
        let choice = tissue(&scene, stiffest_mpa).ok().and_then(|stiffest| {
            let asked = rig_contact::Requirements {
                sensor,
                stiffest,
                deepest: depth(&scene, deepest_mm),
                law: scene.law,
                friction: friction(&scene),
                tilt_max_rad: TILT_MAX_DEG.to_radians(),
                needs_impedance: true,
            };
            Tier::cheapest_for(&asked, scene.tolerance_hz).ok()
        });
        let choice = choice.unwrap_or(reference);
        tracing::info!(%choice, "the model of the sensor");
        Ok(Self { scene, models: Models::new(&sensor, scene.law), choice })
    }

    pub(super) fn tissue(&self, stiffness_mpa: f64) -> Result<Tissue, TissueError> {
        tissue(&self.scene, stiffness_mpa)
    }

    /// The circuit without contact or in contact, with the free resonance shifted by `shift_hz`.
    pub(super) fn circuit(&self, touched: Option<WorldContact>, shift_hz: f64) -> Circuit {
        // Without depth any tissue leaves the free sensor.
        let circuit = self.touching(touched.unwrap_or(WorldContact {
            stiffness_mpa: 1.0,
            indentation_mm: 0.0,
            contact_deg: 0.0,
            orientation: Orientation::FrontBack,
        }));
        // Warmth softens the beam: it scales the resonance with and without contact alike.
        let factor = 1.0 + shift_hz / self.models.no_load_hz(self.choice.tier);
        Circuit { series_resonance_hz: circuit.series_resonance_hz * factor, ..circuit }
    }

    fn touching(&self, touched: WorldContact) -> Circuit {
        let tissue = self.tissue(touched.stiffness_mpa).expect("stiffness was checked");
        let direction = match touched.orientation {
            Orientation::FrontBack if touched.contact_deg < 0.0 => Direction::Back,
            Orientation::FrontBack => Direction::Front,
            // Right is the mirror image of left.
            Orientation::Left => Direction::Left,
        };
        let angle_deg = touched.contact_deg.abs().min(STEEPEST_DEG);
        let pose = Pose::leaning(direction, angle_deg.to_radians()).expect("the angle is acute");
        let law = self.scene.law;
        let friction = friction(&self.scene);
        let depth = depth(&self.scene, touched.indentation_mm);
        let contact = Contact { pose, depth, law, friction };
        self.models.circuit(self.choice.tier, &tissue, &contact).unwrap_or_else(|_| {
            // Deeper than the law holds, or with more force than the sensor bears, as in a crash: the
            // contact grows no further.
            let limit_mm = law.depth_limit_rel() * self.scene.design.probe_radius_mm;
            let crashed = (0..DEPTHS).find_map(|halved| {
                let along_probe_mm = limit_mm * 0.5_f64.powi(halved);
                let depth = Depth::Indentation { along_probe_mm };
                let deepest = Contact { pose: Pose::UPRIGHT, depth, ..contact };
                self.models.circuit(Tier::Reference, &tissue, &deepest).ok()
            });
            crashed.unwrap_or_else(|| self.models.free_circuit())
        })
    }
}

fn tissue(scene: &SensorScene, stiffness_mpa: f64) -> Result<Tissue, TissueError> {
    Tissue::new(stiffness_mpa, scene.poisson, scene.tissue_loss)
}

const fn friction(scene: &SensorScene) -> Friction {
    if scene.sticks { Friction::Sticking } else { Friction::Frictionless }
}

/// The depth in the sample of a move of the stage.
const fn depth(scene: &SensorScene, along_probe_mm: f64) -> Depth {
    if scene.deflects {
        Depth::Stage { along_probe_mm }
    } else {
        Depth::Indentation { along_probe_mm }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::paper;

    fn circuit(deflects: bool, indentation_mm: f64, contact_deg: f64) -> Circuit {
        let scene = SensorScene { deflects, ..paper().sensor };
        let orientation = Orientation::FrontBack;
        let touched =
            WorldContact { stiffness_mpa: 0.649, indentation_mm, contact_deg, orientation };
        SensorModel::new(scene, 0.649, 1.0).unwrap().circuit(Some(touched), 0.0)
    }

    #[test]
    fn the_reference_sensor_has_the_shift_that_the_paper_prints() {
        let model = SensorModel::new(paper().sensor, 0.649, 1.0).unwrap();
        let free_hz = model.circuit(None, 0.0).series_resonance_hz;
        assert!((free_hz - 140.4).abs() < 0.2, "{free_hz}");
        assert!((model.circuit(None, 0.3).series_resonance_hz - free_hz - 0.3).abs() < 1e-3);
        // 134.11 Hz/MPa between samples 1 and 5 leaves 88.99 Hz for sample 5 (0.5 mm, upright).
        let shift_hz = circuit(false, 0.5, 0.0).series_resonance_hz - free_hz;
        assert!((shift_hz - 88.99).abs() < 1.0, "{shift_hz}");
        // A sensor that deflects indents sample 5 by half of the move only.
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
