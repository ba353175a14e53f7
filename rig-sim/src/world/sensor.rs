//! The sensor and its impedance, clear and in contact.

use std::cell::Cell;

use rig_contact::{
    Choice, Circuit, Contact, ContactLaw, Depth, Direction, Friction, Models, Pose, Refusal,
    Requirements, SensorDesign, SensorError, Specimen, SpecimenError, Tier, Tissue, TissueError,
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
    /// Tangential over normal stiffness of a contact that sticks; 0 without friction.
    pub tangential_ratio: f64,
    /// Coefficient of friction; infinite if no contact slips.
    pub friction_coefficient: f64,
    /// Relaxation of the tissue under a resting load.
    pub relaxation: Relaxation,
    /// Work of adhesion between samples and ball, J/m².
    pub adhesion_j_per_m2: f64,
    /// Poisson's ratio of all samples.
    pub poisson: f64,
    /// Loss factor of all samples.
    pub tissue_loss: f64,
    /// Largest difference from the reference allowed to the model, Hz. The cheapest model within it is
    /// used.
    pub tolerance_hz: f64,
}

impl SensorScene {
    /// A sample of this stiffness.
    pub(super) fn tissue(&self, stiffness_mpa: f64) -> Result<Tissue, TissueError> {
        Tissue::new(stiffness_mpa, self.poisson, self.tissue_loss)
    }

    /// A sample of this thickness.
    pub(super) fn specimen(&self, thickness_mm: f64) -> Result<Specimen, SpecimenError> {
        Specimen::new(self.adhesion_j_per_m2, thickness_mm)
    }
}

/// Relaxation of a tissue: the force of a resting contact falls. A vibration at the sensor's resonance
/// is too fast for it and meets the unrelaxed modulus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relaxation {
    /// The part of the force that is lost in the end, 0 to 1.
    pub part: f64,
    /// Time constant, s.
    pub time_s: f64,
}

impl Relaxation {
    /// An elastic tissue.
    pub const NONE: Self = Self { part: 0.0, time_s: 1.0 };

    /// The force over its first value, this long after the last move.
    fn left(&self, rested_s: f64) -> f64 {
        1.0 - self.part * (1.0 - (-rested_s.max(0.0) / self.time_s).exp())
    }
}

/// A contact of the simulated world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WorldContact {
    pub(super) stiffness_mpa: f64,
    /// Along the probe.
    pub(super) indentation_mm: f64,
    /// The angle between probe and surface normal, with the sign of the tilt.
    pub(super) contact_deg: f64,
    pub(super) orientation: Orientation,
    /// Time since the last move, s.
    pub(super) rested_s: f64,
    /// Of the sample on its hard base; infinite for a thick one.
    pub(super) thickness_mm: f64,
}

/// A checked sensor with its models.
#[derive(Debug, Clone, Copy)]
pub(super) struct SensorModel {
    scene: SensorScene,
    models: Models,
    choice: Choice,
    /// The last contact that was held by friction, at rest from the beginning, and the part of the
    /// tangential stiffness that it had.
    held: Option<(WorldContact, f64)>,
    /// The last contact deeper than its model, without its depth, and the largest depth of the model, mm.
    deepest: Option<(WorldContact, f64)>,
}

/// The scenes are those of contacts up to the paper's largest angle.
const TILT_MAX_DEG: f64 = 45.0;

/// Beyond this angle the model of a half space has long lost its sense, and the probe lies flat.
const STEEPEST_DEG: f64 = 80.0;

/// Bisections of the largest depth of a model: a crash of 50 mm is found within a nanometre.
const HALVINGS: u32 = 36;

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
        // Deeper than its law a contact does not grow.
        let limit_mm = scene.law.depth_limit_rel() * scene.design.probe_radius_mm;
        if limit_mm < deepest_mm {
            let law = scene.law.name();
            tracing::info!(
                law,
                limit_mm,
                deepest_mm,
                "a contact deeper than its law grows no further"
            );
        }
        let deepest_mm = deepest_mm.min(limit_mm);
        // A scene that the reference does not take in whole is left to it, as far as it does.
        let choice = scene.tissue(stiffest_mpa).ok().and_then(|stiffest| {
            let asked = Requirements {
                sensor,
                stiffest,
                deepest: depth(&scene, deepest_mm),
                law: scene.law,
                friction: friction(&scene),
                tilt_max_rad: TILT_MAX_DEG.to_radians(),
                needs_impedance: true,
            };
            cheapest_for(&asked, scene.tolerance_hz)
        });
        let choice = choice.unwrap_or(reference);
        tracing::info!(%choice, "the model of the sensor");
        Ok(Self {
            scene,
            models: Models::new(&sensor, scene.law),
            choice,
            held: None,
            deepest: None,
        })
    }

    /// The circuit without contact or in contact, with the free resonance shifted by `shift_hz`.
    pub(super) fn circuit(&mut self, touched: Option<WorldContact>, shift_hz: f64) -> Circuit {
        // Without depth any tissue leaves the free sensor.
        let circuit = self.touching(touched.unwrap_or(WorldContact {
            stiffness_mpa: 1.0,
            indentation_mm: 0.0,
            contact_deg: 0.0,
            orientation: Orientation::FrontBack,
            rested_s: 0.0,
            thickness_mm: f64::INFINITY,
        }));
        // Warmth softens the beam: it scales the resonance with and without contact alike.
        let factor = 1.0 + shift_hz / self.models.no_load_hz(self.choice.tier);
        Circuit { series_resonance_hz: circuit.series_resonance_hz * factor, ..circuit }
    }

    fn touching(&mut self, touched: WorldContact) -> Circuit {
        if let Ok(circuit) = self.pressed(&touched) {
            return circuit;
        }
        // Deeper than the law holds, or with more force than the sensor bears: the contact grows no further.
        let deepest_mm = self.deepest_mm(&touched);
        let deepest = WorldContact { indentation_mm: deepest_mm, ..touched };
        self.pressed(&deepest).unwrap_or_else(|_| self.models.free_circuit())
    }

    /// The largest depth along the probe that the model takes, mm, up to that of the contact. All else is that of the
    /// contact.
    fn deepest_mm(&mut self, touched: &WorldContact) -> f64 {
        let of = WorldContact { indentation_mm: 0.0, ..*touched };
        if let Some((known, deepest_mm)) = self.deepest
            && known == of
            && deepest_mm < touched.indentation_mm
        {
            return deepest_mm;
        }
        let (mut low_mm, mut high_mm) = (0.0, touched.indentation_mm);
        for _ in 0..HALVINGS {
            let indentation_mm = 0.5 * (low_mm + high_mm);
            let tried = WorldContact { indentation_mm, ..*touched };
            let side = if self.pressed(&tried).is_ok() { &mut low_mm } else { &mut high_mm };
            *side = indentation_mm;
        }
        self.deepest = Some((of, low_mm));
        low_mm
    }

    /// The circuit in contact.
    ///
    /// # Errors
    /// [`Refusal`] of a contact outside the law or the model.
    fn pressed(&mut self, touched: &WorldContact) -> Result<Circuit, Refusal> {
        let tissue = self.scene.tissue(touched.stiffness_mpa).expect("stiffness was checked");
        let specimen = self.scene.specimen(touched.thickness_mm).expect("thickness was checked");
        let direction = match touched.orientation {
            Orientation::FrontBack if touched.contact_deg < 0.0 => Direction::Back,
            Orientation::FrontBack => Direction::Front,
            // Right is the mirror image of left.
            Orientation::Left => Direction::Left,
        };
        let angle_deg = touched.contact_deg.abs().min(STEEPEST_DEG);
        let pose = Pose::leaning(direction, angle_deg.to_radians()).expect("the angle is acute");
        let scene = self.scene;
        let depth = depth(&scene, touched.indentation_mm);
        let pressed = Contact { pose, depth, law: scene.law, friction: friction(&scene) };
        let rested = self.at_rest(touched, &pressed, &specimen)?;
        let tangential_ratio =
            scene.tangential_ratio * self.held_part(touched, &tissue, &pressed)?;
        let friction = Friction::Elastic { tangential_ratio };
        let contact = Contact { friction, ..rested };
        let load = self.models.sensor().load_on(&tissue, &contact, &specimen)?;
        self.models.circuit_of_load(self.choice.tier, &tissue, &pose, &load)
    }

    /// The contact with the indentation that it has come to while the tissue relaxed: a sensor that
    /// deflects then presses less and goes deeper.
    fn at_rest(
        &self,
        touched: &WorldContact,
        pressed: &Contact,
        specimen: &Specimen,
    ) -> Result<Contact, Refusal> {
        let left = self.scene.relaxation.left(touched.rested_s);
        if !self.scene.deflects || left == 1.0 {
            return Ok(*pressed);
        }
        let softer =
            self.scene.tissue(touched.stiffness_mpa * left).expect("stiffness was checked");
        let normal_mm = self.models.sensor().load_on(&softer, pressed, specimen)?.depth_mm;
        let depth = Depth::Indentation { along_probe_mm: normal_mm / pressed.pose.cos() };
        Ok(Contact { depth, ..*pressed })
    }

    /// The part of the tangential stiffness that friction leaves: the rim of the contact slips first,
    /// and with the whole contact the last of it.
    ///
    /// # Source
    /// Mindlin, J. Appl. Mech. 16 (1949) 259: the cube root of 1 - T/μN under a rising force T.
    fn held_part(
        &mut self,
        touched: &WorldContact,
        tissue: &Tissue,
        pressed: &Contact,
    ) -> Result<f64, Refusal> {
        let coefficient = self.scene.friction_coefficient;
        if coefficient.is_infinite() || self.scene.tangential_ratio == 0.0 {
            return Ok(1.0);
        }
        // Friction is loaded while the ball goes in, not while the tissue relaxes.
        let key = WorldContact { rested_s: 0.0, ..*touched };
        if let Some((of, part)) = self.held
            && of == key
        {
            return Ok(part);
        }
        let needed = self.models.sensor().needed_friction(tissue, pressed)?;
        let part = (1.0 - needed / coefficient).max(0.0).cbrt();
        self.held = Some((key, part));
        Ok(part)
    }
}

thread_local! {
    /// The last choice on this thread with what it was made for. A campaign sets up the same sensor for
    /// each of its runs, and a choice takes as long as a quarter of a run.
    static CHOSEN: Cell<Option<(Requirements, f64, Choice)>> = const { Cell::new(None) };
}

/// The cheapest model for these contacts within a tolerance, Hz, if the reference takes all of them.
fn cheapest_for(asked: &Requirements, tolerance_hz: f64) -> Option<Choice> {
    match CHOSEN.get() {
        Some((for_asked, within_hz, choice))
            if (&for_asked, within_hz) == (asked, tolerance_hz) =>
        {
            Some(choice)
        }
        _ => {
            let choice = Tier::cheapest_for(asked, tolerance_hz).ok()?;
            CHOSEN.set(Some((*asked, tolerance_hz, choice)));
            Some(choice)
        }
    }
}

const fn friction(scene: &SensorScene) -> Friction {
    Friction::Elastic { tangential_ratio: scene.tangential_ratio }
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
    use crate::scene::matched;

    fn touching(scene: SensorScene, indentation_mm: f64, contact_deg: f64) -> Circuit {
        rested(scene, indentation_mm, contact_deg, 0.0)
    }

    fn rested(scene: SensorScene, indentation_mm: f64, contact_deg: f64, rested_s: f64) -> Circuit {
        let orientation = Orientation::FrontBack;
        let stiffness_mpa = 0.649;
        let thickness_mm = f64::INFINITY;
        let touched = WorldContact {
            stiffness_mpa,
            indentation_mm,
            contact_deg,
            orientation,
            rested_s,
            thickness_mm,
        };
        SensorModel::new(scene, 0.649, 1.0).unwrap().circuit(Some(touched), 0.0)
    }

    /// The shift of sample 1, which is soft and of this thickness, Hz.
    fn soft_shift_hz(scene: SensorScene, thickness_mm: f64) -> f64 {
        let mut model = SensorModel::new(scene, 0.649, 1.0).unwrap();
        let touched = WorldContact {
            stiffness_mpa: 0.045,
            indentation_mm: 0.4,
            contact_deg: 0.0,
            orientation: Orientation::FrontBack,
            rested_s: 0.0,
            thickness_mm,
        };
        let free_hz = model.circuit(None, 0.0).series_resonance_hz;
        model.circuit(Some(touched), 0.0).series_resonance_hz - free_hz
    }

    /// So soft a contact shifts in proportion to its stiffness: as Johnson, Kendall and Roberts widen it, by
    /// the root of 1 + √(2π w a/E*)/d, and as a base at 3 mm stiffens it.
    #[test]
    fn adhesion_and_a_base_stiffen_a_soft_sample_as_the_theory_says() {
        let matched = SensorScene { law: ContactLaw::Hertz, ..matched().sensor };
        let sticky = SensorScene { adhesion_j_per_m2: 0.05, ..matched };
        let plain_hz = soft_shift_hz(matched, f64::INFINITY);
        let found = soft_shift_hz(sticky, f64::INFINITY) / plain_hz;
        let (radius, depth, modulus) = (0.5e-3_f64, 0.4e-3_f64, 0.06e6_f64);
        let mut wide = (radius * depth).sqrt();
        for _ in 0..50 {
            let deeper = depth + (std::f64::consts::TAU * 0.05 * wide / modulus).sqrt();
            wide = (radius * deeper).sqrt();
        }
        let expected = wide / (radius * depth).sqrt();
        assert!(expected > 1.04 && (found / expected - 1.0).abs() < 5e-3, "{found} {expected}");
        let found = soft_shift_hz(matched, 3.0) / plain_hz;
        let x = (0.5_f64 * 0.4).sqrt() / 3.0;
        let expected = 1.0 + 1.133 * 4.0 / 3.0 * x + 1.283 * 5.0 / 3.0 * x * x;
        assert!(expected > 1.2 && (found / expected - 1.0).abs() < 0.02, "{found} {expected}");
    }

    fn circuit(deflects: bool, indentation_mm: f64, contact_deg: f64) -> Circuit {
        touching(SensorScene { deflects, ..matched().sensor }, indentation_mm, contact_deg)
    }

    #[test]
    fn the_reference_sensor_has_the_shift_that_the_paper_prints() {
        let mut model = SensorModel::new(matched().sensor, 0.649, 1.0).unwrap();
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

    /// At the law's largest depth the resonance goes on as it was: pose, friction, relaxation and thickness stay.
    #[test]
    fn a_contact_deeper_than_its_law_stays_as_it_was_at_the_largest_depth() {
        let scene = crate::scene::paper().sensor;
        let thin = SensorScene { friction_coefficient: f64::INFINITY, ..scene };
        let held = SensorScene { deflects: false, ..scene };
        for (scene, contact_deg, thickness_mm, rested_s) in [
            (scene, -30.0, f64::INFINITY, 0.0),
            (scene, -30.0, f64::INFINITY, 5.0),
            (scene, 45.0, f64::INFINITY, 0.0),
            (scene, 0.0, f64::INFINITY, 3.0),
            (held, -30.0, f64::INFINITY, 0.0),
            (thin, 10.0, 2.0, 0.0),
        ] {
            let mut model = SensorModel::new(scene, 0.649, 1.0).unwrap();
            let mut at = |indentation_mm| {
                let orientation = Orientation::FrontBack;
                let stiffness_mpa = 0.045;
                let touched = WorldContact {
                    stiffness_mpa,
                    indentation_mm,
                    contact_deg,
                    orientation,
                    rested_s,
                    thickness_mm,
                };
                model.circuit(Some(touched), 0.0).series_resonance_hz
            };
            let hz: Vec<f64> = (0..=140).map(|step| at(0.3 + 0.005 * f64::from(step))).collect();
            let told = format!("{contact_deg}°, {thickness_mm} mm, {rested_s} s");
            let first_hz = hz[1] - hz[0];
            let steps_hz = || hz.windows(2).map(|pair| pair[1] - pair[0]);
            let most_hz = steps_hz().fold(0.0, f64::max);
            assert!(most_hz < 1.5 * first_hz, "{told}: {most_hz} {first_hz}");
            assert!(steps_hz().all(|step_hz| -1e-6 < step_hz), "{told}");
            let last_hz = hz[140];
            assert!((at(5.0) - last_hz).abs() < 1e-4, "{told}: {} {last_hz}", at(5.0));
        }
    }

    /// The end of the beam turns by 2.3° for each millimetre that it moves, so that a ball further from the
    /// clamp moves more. A ball across the beam only twists it.
    #[test]
    fn a_ball_beside_the_axis_feels_another_stiffness() {
        let shift_hz = |probe_offset_mm: [f64; 2]| {
            let mut scene = SensorScene { deflects: false, ..matched().sensor };
            scene.design.probe_offset_mm = probe_offset_mm;
            let free = SensorModel::new(scene, 0.649, 1.0).unwrap().circuit(None, 0.0);
            touching(scene, 0.1, 0.0).series_resonance_hz - free.series_resonance_hz
        };
        let on_axis_hz = shift_hz([0.0; 2]);
        let ratio = |offset_mm: [f64; 2]| shift_hz(offset_mm) / on_axis_hz;
        let (out, back) = (ratio([0.3, 0.0]), ratio([-0.3, 0.0]));
        assert!((1.01..1.03).contains(&out) && (0.97..0.99).contains(&back), "{out} {back}");
        let across = ratio([0.0, 0.3]);
        assert!((0.99..1.0).contains(&across), "{across}");
    }

    /// A choice is taken over for the same contacts and tolerance only.
    #[test]
    fn each_tolerance_has_the_model_that_it_would_have_alone() {
        let scene = matched().sensor;
        let chosen = |tolerance_hz| {
            SensorModel::new(SensorScene { tolerance_hz, ..scene }, 0.649, 0.5).unwrap().choice
        };
        let alone = |tolerance_hz| {
            std::thread::spawn(move || {
                SensorModel::new(SensorScene { tolerance_hz, ..scene }, 0.649, 0.5).unwrap().choice
            })
        };
        for tolerance_hz in [20.0, 20.0, 0.5, 1e-6, 20.0] {
            assert_eq!(chosen(tolerance_hz), alone(tolerance_hz).join().unwrap());
        }
        assert_ne!(chosen(20.0).tier, chosen(1e-6).tier);
    }

    /// The cube root of what is left of the friction, between that of a contact that sticks and of one
    /// that slides.
    #[test]
    fn friction_holds_a_part_of_the_tangential_stiffness() {
        let with = |tangential_ratio, friction_coefficient| {
            let scene = SensorScene { tangential_ratio, friction_coefficient, ..matched().sensor };
            touching(scene, 0.4, 30.0).series_resonance_hz
        };
        let infinite = f64::INFINITY;
        assert!((with(0.7, 1e9) - with(0.7, infinite)).abs() < 1e-3);
        assert_eq!(with(0.7, 0.01), with(0.0, infinite));
        let held = with(0.7, 2.0);
        assert!(with(0.0, infinite) + 1.0 < held && held < with(0.7, infinite) - 0.1, "{held}");
    }

    /// The indentation grows until the force of a tissue that is a fifth softer balances the sensor.
    #[test]
    fn a_tissue_relaxes_under_a_sensor_that_deflects() {
        let relaxation = Relaxation { part: 0.2, time_s: 2.0 };
        let at = |deflects, rested_s| {
            let scene = SensorScene { deflects, relaxation, ..matched().sensor };
            rested(scene, 0.4, 15.0, rested_s).series_resonance_hz
        };
        assert_eq!(at(false, 0.0), at(false, 100.0));
        let crept = at(true, 100.0) - at(true, 0.0);
        assert!((1.0..6.0).contains(&crept), "{crept} Hz");
        assert!((at(true, 2.0 * 2.0_f64.ln()) - at(true, 0.0) - crept / 2.0).abs() < 0.1 * crept);
    }
}
