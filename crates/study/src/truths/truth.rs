//! The truths, and the runs that they make.

use std::f64::consts::PI;

use rig_analysis::stiffness::{Halfway, PosedTouch};
use rig_contact::{
    Contact, ContactLaw, Depth, Direction, Friction, Models, Pose, Refusal, Sensor, SensorDesign,
    Specimen, Tier, Tissue,
};
use rig_model::random::Stream;

use crate::{
    paper_bench::{ANGLES_DEG, INDENTATION_MM, SAMPLES_MPA},
    simulate::Nuisances,
};

/// The nuisances that the rig file states.
pub(super) const NUISANCES: Nuisances = Nuisances::BENCH;
/// Standard deviation of the surface found, mm.
pub(super) const SURFACE_MM: f64 = 0.002;
/// The part of the variance of the depth that all touches at one place of the stages share.
const SHARED_DEPTH: f64 = 0.5;
/// The smaller depth of a touch that is measured twice, mm.
pub(super) const HALFWAY_MM: f64 = 0.25;
/// Sets the chance of the measurements halfway apart from that of every truth.
const HALFWAY: u64 = 1000;
/// Blind touches of a run.
const BLIND: usize = 50;

/// A bench that differs from its description.
#[derive(Debug, Clone, Copy)]
pub(super) struct Truth {
    /// What differs.
    pub(super) name: &'static str,
    /// Whether a learnt model should cover it.
    pub(super) is_within: bool,
    arm_rel: f64,
    radius_rel: f64,
    /// Offset of the ball from the probe's axis, along the bimorph and across it, mm.
    offset_mm: [f64; 2],
    /// Error of every angle, degrees.
    angle_deg: f64,
    loss: f64,
    poisson: f64,
    law: ContactLaw,
    friction: Friction,
    /// Above this angle it slides, degrees.
    slips_beyond_deg: f64,
    /// It sticks up to this tangential over normal force.
    sticks_up_to: f64,
    is_held_by_stage: bool,
    /// The exponent with which the stiffness grows with the depth along the normal.
    layered: f64,
    /// Work of adhesion between samples and ball, J/m².
    adhesion_j_per_m2: f64,
    /// Of every sample on its hard base, mm.
    thickness_mm: f64,
    /// The part of the force that the sample has lost by relaxing, under a depth held by the stage.
    relaxed: f64,
    /// Radius of a flat on the ball, in ball radii.
    flat_rel: f64,
    /// Tilt of every sample towards the front, degrees.
    tilt_deg: f64,
    /// Error of the mounting of the sensor about its own axis, degrees.
    turned_deg: f64,
    pub(super) nuisances: Nuisances,
    /// Standard deviation of the surface found, mm.
    pub(super) surface_mm: f64,
}

impl Truth {
    const MATCHED: Self = Self {
        name: "nothing",
        is_within: true,
        arm_rel: 1.0,
        radius_rel: 1.0,
        offset_mm: [0.0; 2],
        angle_deg: 0.0,
        loss: 0.1,
        poisson: 0.5,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        slips_beyond_deg: f64::INFINITY,
        sticks_up_to: f64::INFINITY,
        is_held_by_stage: false,
        layered: 0.0,
        adhesion_j_per_m2: 0.0,
        thickness_mm: f64::INFINITY,
        relaxed: 0.0,
        flat_rel: 0.0,
        tilt_deg: 0.0,
        turned_deg: 0.0,
        nuisances: NUISANCES,
        surface_mm: SURFACE_MM,
    };

    /// The described bench with these nuisances alone.
    pub(super) const fn with_only(nuisances: Nuisances, surface_mm: f64) -> Self {
        Self { nuisances, surface_mm, ..Self::MATCHED }
    }

    /// This truth with samples of this contact law.
    pub(super) const fn of_law(self, law: ContactLaw) -> Self {
        Self { law, ..self }
    }

    /// The same truth on a bench without chance.
    pub(super) const fn without_nuisances(self) -> Self {
        Self { nuisances: Nuisances::NONE, surface_mm: 0.0, ..self }
    }

    /// Every truth of the page.
    pub(super) fn all() -> Vec<Self> {
        let one = Self::MATCHED;
        let elastic = |name, tangential_ratio| Self {
            name,
            friction: Friction::Elastic { tangential_ratio },
            ..one
        };
        let thin = |name, thickness_mm| Self { name, is_within: false, thickness_mm, ..one };
        vec![
            one,
            Self { name: "arm +5 %", arm_rel: 1.05, ..one },
            Self { name: "arm −15 %", arm_rel: 0.85, ..one },
            Self { name: "arm −30 %", arm_rel: 0.7, ..one },
            Self { name: "arm 4 mm", arm_rel: 0.5, ..one },
            Self { name: "radius +3 %", radius_rel: 1.03, ..one },
            Self { name: "angle +1°", angle_deg: 1.0, ..one },
            Self { name: "loss 0.3", loss: 0.3, ..one },
            Self { name: "Poisson 0.45", poisson: 0.45, ..one },
            Self { name: "neo-Hookean", law: ContactLaw::NeoHookean, ..one },
            Self { name: "depth held by the stage", is_held_by_stage: true, ..one },
            elastic("tangential ratio 1/3", 1.0 / 3.0),
            elastic("tangential ratio 1", 1.0),
            Self { name: "frictionless", friction: Friction::Frictionless, ..one },
            Self { name: "radius +10 %", radius_rel: 1.1, ..one },
            Self { name: "flat of 0.2 radii on the ball", flat_rel: 0.2, ..one },
            Self { name: "ball 0.3 mm off along the bimorph", offset_mm: [0.3, 0.0], ..one },
            Self { name: "ball 0.3 mm off across the bimorph", offset_mm: [0.0, 0.3], ..one },
            Self { name: "samples tilted by 2°", tilt_deg: 2.0, ..one },
            Self { name: "sensor turned by 10°", turned_deg: 10.0, ..one },
            Self {
                name: "held by the stage; relaxed by 20 %",
                relaxed: 0.2,
                is_held_by_stage: true,
                ..one
            },
            Self {
                name: "as in the shipped scene",
                arm_rel: 8.3 / 8.0,
                radius_rel: 1.02,
                law: ContactLaw::NeoHookean,
                friction: Friction::Elastic { tangential_ratio: 0.65 },
                is_held_by_stage: true,
                relaxed: 0.1,
                ..one
            },
            Self { name: "slip beyond 8.5°", is_within: false, slips_beyond_deg: 8.53, ..one },
            Self { name: "stiffer with depth", is_within: false, layered: 0.5, ..one },
            Self { name: "softer with depth", is_within: false, layered: -0.3, ..one },
            Self { name: "adhesion of 0.05 J/m²", adhesion_j_per_m2: 0.05, ..one },
            thin("samples 5 mm thick on a hard base", 5.0),
            thin("samples 2 mm thick on a hard base", 2.0),
            Self { name: "Hertz's law", is_within: false, law: ContactLaw::Hertz, ..one },
            Self { name: "slip at a friction of 0.7", is_within: false, sticks_up_to: 0.7, ..one },
            Self { name: "slip at a friction of 1", is_within: false, sticks_up_to: 1.0, ..one },
        ]
    }

    pub(super) fn bench(&self) -> Bench {
        let reference = SensorDesign::reference();
        let design = SensorDesign {
            arm_mm: self.arm_rel * reference.arm_mm,
            probe_radius_mm: self.radius_rel * reference.probe_radius_mm,
            probe_offset_mm: self.offset_mm,
            ..reference
        };
        let sensor = Sensor::new(design).expect("it differs little from the reference");
        Bench { truth: *self, models: Models::new(&sensor, self.law) }
    }
}

/// A bench with its true sensor.
pub(super) struct Bench {
    truth: Truth,
    models: Models,
}

/// The touches of a run.
pub(super) struct RunOfTruth {
    pub(super) main: Vec<PosedTouch>,
    pub(super) blind: Vec<PosedTouch>,
    /// Young's modulus under each blind touch, MPa.
    pub(super) blind_mpa: Vec<f64>,
}

/// The nominal pose of a touch.
#[derive(Clone, Copy)]
struct Nominal {
    sample: usize,
    direction: Direction,
    angle_deg: f64,
}

/// A contact as it is.
struct True {
    young_mpa: f64,
    pose: Pose,
    friction: Friction,
}

impl Bench {
    /// A run of the paper's protocol.
    pub(super) fn run(&self, seed: u64, truth: u64, run: u64) -> RunOfTruth {
        let mut random = Stream::of_trial(seed, truth, run);
        // The measurements halfway have chance of their own, so that they change nothing else.
        let mut halfway = Stream::of_trial(seed, truth + HALFWAY, run);
        let shared_mm = SHARED_DEPTH.sqrt() * self.truth.nuisances.depth_mm;
        // One place for each angle, and on the other side for the back; upright all are one.
        let places: [[f64; 2]; ANGLES_DEG.len()] =
            std::array::from_fn(|_| [0, 1].map(|_| shared_mm * random.normal()));
        let (mut main, mut blind, mut blind_mpa) = (Vec::new(), Vec::new(), Vec::new());
        for sample in 0..SAMPLES_MPA.len() {
            for direction in Direction::ALL {
                for (index, angle_deg) in ANGLES_DEG.into_iter().enumerate() {
                    let is_back = direction == Direction::Back && angle_deg > 0.0;
                    let place_mm = places[index][usize::from(is_back)];
                    let nominal = Nominal { sample, direction, angle_deg };
                    main.push(self.touch(nominal, place_mm, &mut random, &mut halfway).0);
                }
            }
        }
        for _ in 0..BLIND {
            let sample = random.below(SAMPLES_MPA.len());
            let direction = random.pick(&Direction::ALL);
            let nominal = Nominal { sample, direction, angle_deg: 45.0 * random.uniform() };
            let place_mm = shared_mm * random.normal();
            let (touch, young_mpa) = self.touch(nominal, place_mm, &mut random, &mut halfway);
            blind.push(touch);
            blind_mpa.push(young_mpa);
        }
        RunOfTruth { main, blind, blind_mpa }
    }

    /// A touch, and Young's modulus of the point touched, MPa.
    fn touch(
        &self,
        nominal: Nominal,
        place_mm: f64,
        random: &mut Stream,
        halfway: &mut Stream,
    ) -> (PosedTouch, f64) {
        let Nominal { sample, direction, angle_deg } = nominal;
        let truth = &self.truth;
        let nuisances = &truth.nuisances;
        let young_mpa = SAMPLES_MPA[sample] * (1.0 + nuisances.young_rel * random.normal());
        let true_deg = angle_deg + nuisances.angle_deg * random.normal() + truth.angle_deg;
        let own_mm = (1.0 - SHARED_DEPTH).sqrt() * nuisances.depth_mm;
        let mut depth_mm = place_mm + own_mm * random.normal();
        let surface_mm = truth.surface_mm * random.normal();
        let noise_hz = nuisances.shift_hz * random.normal();

        let is_slipping = true_deg.abs() > truth.slips_beyond_deg;
        let friction = if is_slipping { Friction::Frictionless } else { truth.friction };
        let contact = True { young_mpa, pose: truth.pose(direction, true_deg), friction };
        let shift_hz = |nominal_mm: f64, depth_mm: f64| {
            self.shift_hz(&contact, nominal_mm + depth_mm + surface_mm)
        };
        let found_hz = shift_hz(INDENTATION_MM, depth_mm) + noise_hz;
        // Reference and point are the same, and half of the variance of the depth is.
        depth_mm = place_mm + own_mm * halfway.normal();
        let own_hz = nuisances.shift_hz * std::f64::consts::FRAC_1_SQRT_2;
        let before_hz = shift_hz(HALFWAY_MM, depth_mm)
            + noise_hz / 2.0
            + own_hz * 1.5_f64.sqrt() * halfway.normal();
        let touch = PosedTouch {
            sample,
            pose: Pose::leaning(direction, angle_deg.to_radians()).expect("at most 45°"),
            depth: Depth::Indentation { along_probe_mm: INDENTATION_MM },
            shift_hz: found_hz,
            sigma_hz: NUISANCES.shift_hz,
            reference_sigma_hz: NUISANCES.shift_hz * std::f64::consts::FRAC_1_SQRT_2,
            halfway: Some(Halfway {
                along_probe_mm: HALFWAY_MM,
                shift_hz: before_hz,
                sigma_hz: NUISANCES.shift_hz * std::f64::consts::FRAC_1_SQRT_2,
            }),
            stage_sigma_mm: None,
        };
        (touch, young_mpa)
    }

    /// The shift of a contact at a depth along the probe, without noise, Hz.
    fn shift_hz(&self, contact: &True, along_probe_mm: f64) -> f64 {
        let truth = &self.truth;
        let True { young_mpa, pose, friction } = *contact;
        let sensor = self.models.sensor();
        let radius_mm = sensor.design().probe_radius_mm;
        // The neo-Hookean law ends at one radius, which the largest depths exceed a little.
        let deepest_mm = 0.999_999 * truth.law.depth_limit_rel() * radius_mm / pose.cos();
        let along_probe_mm = along_probe_mm.min(deepest_mm);
        let normal_mm = along_probe_mm * pose.cos();
        // The contact of a flatted ball is as wide as its flat in the beginning.
        let radius_rel = truth.law.at(normal_mm / radius_mm).map_or(1.0, |patch| patch.radius_rel);
        let wider = (truth.flat_rel / radius_rel).hypot(1.0);
        let felt_mpa = young_mpa * (normal_mm / INDENTATION_MM).powf(truth.layered) * wider;
        let tissue = |young_mpa: f64| {
            Tissue::new(young_mpa, truth.poisson, truth.loss).expect("it is positive")
        };
        let depth = if truth.is_held_by_stage {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        };
        let specimen = Specimen::new(truth.adhesion_j_per_m2, truth.thickness_mm);
        let specimen = specimen.expect("both are possible");
        let mut contact = Contact { pose, depth, law: truth.law, friction };
        if truth.sticks_up_to.is_finite() {
            contact.friction = Friction::Coulomb { coefficient: truth.sticks_up_to };
            let load = sensor.load_on(&tissue(felt_mpa), &contact, &specimen);
            let slips = matches!(load, Err(Refusal::Slips { .. }));
            contact.friction = if slips { Friction::Frictionless } else { friction };
        }
        if truth.relaxed > 0.0 {
            // The sensor presses on a tissue that is softer at rest than in vibration.
            let softer = tissue(felt_mpa * (1.0 - truth.relaxed));
            let rested = sensor.load_on(&softer, &contact, &specimen);
            let rested = rested.expect("the depth is within the law");
            let along_probe_mm = rested.depth_mm / pose.cos();
            contact.depth = Depth::Indentation { along_probe_mm };
        }
        let tissue = tissue(felt_mpa);
        let load = sensor.load_on(&tissue, &contact, &specimen);
        let load = load.expect("the depth is within the law");
        self.models.shift_of_load(Tier::Reference, &tissue, &pose, &load)
    }
}

impl Truth {
    /// The true pose of a touch whose surface leans by this angle in a nominal direction.
    fn pose(&self, direction: Direction, true_deg: f64) -> Pose {
        let azimuth = direction.azimuth_rad();
        // A negative angle leans the surface the other way; right is the mirror image of left.
        let is_mirrored = true_deg < 0.0 && direction != Direction::Left;
        let azimuth = if is_mirrored { azimuth + PI } else { azimuth };
        let angle = true_deg.abs().to_radians();
        if self.tilt_deg == 0.0 && self.turned_deg == 0.0 {
            return Pose::new(angle, azimuth).expect("far from 90°");
        }
        let azimuth = azimuth + self.turned_deg.to_radians();
        let (sin, cos) = self.tilt_deg.to_radians().sin_cos();
        let (x, y, z) = (angle.sin() * azimuth.cos(), angle.sin() * azimuth.sin(), angle.cos());
        let (x, z) = (x * cos + z * sin, z * cos - x * sin);
        Pose::new(z.clamp(-1.0, 1.0).acos(), y.atan2(x)).expect("far from 90°")
    }
}

impl RunOfTruth {
    /// The same run without the measurements halfway.
    pub(super) fn at_one_depth(&self) -> Self {
        let once = |touches: &[PosedTouch]| {
            touches.iter().map(|touch| PosedTouch { halfway: None, ..*touch }).collect()
        };
        let (main, blind) = (once(&self.main), once(&self.blind));
        Self { main, blind, blind_mpa: self.blind_mpa.clone() }
    }
}
