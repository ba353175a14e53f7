//! The truths, and the runs that they make.

use std::f64::consts::PI;

use rig_analysis::stiffness::PosedTouch;
use rig_contact::{
    Contact, ContactLaw, Depth, Direction, Friction, Models, Pose, Sensor, SensorDesign, Tier,
    Tissue,
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
    /// Error of every angle, degrees.
    angle_deg: f64,
    loss: f64,
    poisson: f64,
    law: ContactLaw,
    friction: Friction,
    /// Above this angle it slides, degrees.
    slips_beyond_deg: f64,
    is_held_by_stage: bool,
    /// The exponent with which the stiffness grows with the depth along the normal.
    layered: f64,
}

impl Truth {
    const MATCHED: Self = Self {
        name: "nothing",
        is_within: true,
        arm_rel: 1.0,
        radius_rel: 1.0,
        angle_deg: 0.0,
        loss: 0.1,
        poisson: 0.5,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        slips_beyond_deg: f64::INFINITY,
        is_held_by_stage: false,
        layered: 0.0,
    };

    /// Every truth of the page.
    pub(super) fn all() -> Vec<Self> {
        let one = Self::MATCHED;
        let elastic = |name, tangential_ratio| Self {
            name,
            friction: Friction::Elastic { tangential_ratio },
            ..one
        };
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
            Self { name: "slip beyond 8.5°", is_within: false, slips_beyond_deg: 8.53, ..one },
            Self { name: "stiffer with depth", is_within: false, layered: 0.5, ..one },
        ]
    }

    pub(super) fn bench(&self) -> Bench {
        let reference = SensorDesign::reference();
        let design = SensorDesign {
            arm_mm: self.arm_rel * reference.arm_mm,
            probe_radius_mm: self.radius_rel * reference.probe_radius_mm,
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

impl Bench {
    /// A run of the paper's protocol.
    pub(super) fn run(&self, seed: u64, truth: u64, run: u64) -> RunOfTruth {
        let mut random = Stream::of_trial(seed, truth, run);
        let shared_mm = SHARED_DEPTH.sqrt() * NUISANCES.depth_mm;
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
                    main.push(self.touch(nominal, place_mm, &mut random).0);
                }
            }
        }
        for _ in 0..BLIND {
            let sample = random.below(SAMPLES_MPA.len());
            let direction = random.pick(&Direction::ALL);
            let nominal = Nominal { sample, direction, angle_deg: 45.0 * random.uniform() };
            let place_mm = shared_mm * random.normal();
            let (touch, young_mpa) = self.touch(nominal, place_mm, &mut random);
            blind.push(touch);
            blind_mpa.push(young_mpa);
        }
        RunOfTruth { main, blind, blind_mpa }
    }

    /// A touch, and Young's modulus of the point touched, MPa.
    fn touch(&self, nominal: Nominal, place_mm: f64, random: &mut Stream) -> (PosedTouch, f64) {
        let Nominal { sample, direction, angle_deg } = nominal;
        let truth = &self.truth;
        let young_mpa = SAMPLES_MPA[sample] * (1.0 + NUISANCES.young_rel * random.normal());
        let true_deg = angle_deg + NUISANCES.angle_deg * random.normal() + truth.angle_deg;
        let own_mm = (1.0 - SHARED_DEPTH).sqrt() * NUISANCES.depth_mm * random.normal();
        let surface_mm = SURFACE_MM * random.normal();
        let noise_hz = NUISANCES.shift_hz * random.normal();

        let azimuth = direction.azimuth_rad();
        // A negative angle leans the surface the other way; right is the mirror image of left.
        let is_mirrored = true_deg < 0.0 && direction != Direction::Left;
        let azimuth = if is_mirrored { azimuth + PI } else { azimuth };
        let pose = Pose::new(true_deg.abs().to_radians(), azimuth).expect("far from 90°");
        let radius_mm = self.models.sensor().design().probe_radius_mm;
        // The neo-Hookean law ends at one radius, which the largest depths exceed a little.
        let deepest_mm = 0.999_999 * truth.law.depth_limit_rel() * radius_mm / pose.cos();
        let along_probe_mm = (INDENTATION_MM + place_mm + own_mm + surface_mm).min(deepest_mm);
        let depth = if truth.is_held_by_stage {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        };
        let is_slipping = true_deg.abs() > truth.slips_beyond_deg;
        let friction = if is_slipping { Friction::Frictionless } else { truth.friction };
        let contact = Contact { pose, depth, law: truth.law, friction };
        let felt_mpa =
            young_mpa * (along_probe_mm * pose.cos() / INDENTATION_MM).powf(truth.layered);
        let tissue = Tissue::new(felt_mpa, truth.poisson, truth.loss).expect("it is positive");
        let found = self.models.predict(Tier::Reference, &tissue, &contact);
        let shift_hz = found.expect("the depth is within the law").shift_hz + noise_hz;
        let touch = PosedTouch {
            sample,
            pose: Pose::leaning(direction, angle_deg.to_radians()).expect("at most 45°"),
            depth: Depth::Indentation { along_probe_mm: INDENTATION_MM },
            shift_hz,
            sigma_hz: NUISANCES.shift_hz,
            reference_sigma_hz: NUISANCES.shift_hz * std::f64::consts::FRAC_1_SQRT_2,
            halfway: None,
        };
        (touch, young_mpa)
    }
}
