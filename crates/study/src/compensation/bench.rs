//! The simulated bench of the study: the paper's samples with the nuisances of a good laboratory.

use std::f64::consts::{PI, TAU};

use rand_core::Rng;
use rand_pcg::Pcg64;
use rig_contact::{Contact, ContactLaw, Depth, Direction, Models, Pose, Sensor, Tier, Tissue};

use crate::paper_bench::{SAMPLES_MPA, tissue};

/// Standard deviations of what a bench does not know.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nuisances {
    /// Of a shift, Hz.
    pub(super) shift_hz: f64,
    /// Of the surface that was found, mm: shared by the touches of one place.
    pub(super) surface_mm: f64,
    /// Of the depth of each touch below it, mm.
    pub(super) depth_mm: f64,
    /// Of the slope of the surface at a point, rad.
    pub(super) slope_rad: f64,
    /// Of the stiffness from one point of a sample to the next, relative.
    pub(super) sample_rel: f64,
}

/// 0.3 Hz, 20 µm, 1° and 3 %; and two micrometres of the encoder.
pub(super) const NUISANCES: Nuisances = Nuisances {
    shift_hz: 0.3,
    surface_mm: 0.02,
    depth_mm: 0.002,
    slope_rad: PI / 180.0,
    sample_rel: 0.03,
};
/// The largest contact angle.
pub(super) const MAX_ANGLE_RAD: f64 = 0.25 * PI;

/// What is true on the bench: shifts by the finest model, which no inverse uses.
#[derive(Debug)]
pub(super) struct Bench {
    models: Models,
}

/// One point of a sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Its stiffness, MPa.
    pub(super) young_mpa: f64,
    tissue: Tissue,
    /// How far its surface was found from where it is, mm.
    surface_mm: f64,
}

/// Random numbers of one trial.
#[derive(Debug)]
pub(super) struct Chance(Pcg64);

impl Chance {
    /// The numbers of this trial of this protocol, whatever others have used.
    pub(super) fn new(seed: u64, protocol: u64, trial: u64) -> Self {
        let mut state = Pcg64::new(u128::from(seed), u128::from(protocol));
        // Neighbouring states give neighbouring numbers at first: scatter them.
        let scattered = u128::from(trial).wrapping_mul(0x9E37_79B9_7F4A_7C15_F39C_C060_5CED_C835);
        let offset = u128::from(state.next_u64()) << 64 | u128::from(state.next_u64());
        let mut chance = Pcg64::new(scattered ^ offset, u128::from(protocol));
        chance.next_u64();
        Self(chance)
    }

    /// Even in [0, 1).
    pub(super) fn even(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal with mean 0 and variance 1.
    pub(super) fn normal(&mut self) -> f64 {
        let (radius, angle) = (1.0 - self.even(), self.even());
        (-2.0 * radius.ln()).sqrt() * (TAU * angle).cos()
    }

    /// One of the samples, by its index.
    pub(super) fn sample(&mut self) -> usize {
        let draw = self.even();
        let below = |&index: &usize| draw < (index + 1) as f64 / SAMPLES_MPA.len() as f64;
        (0..SAMPLES_MPA.len()).find(below).unwrap_or_default()
    }

    /// One of the directions.
    pub(super) fn direction(&mut self) -> Direction {
        let draw = self.even();
        let [front, back, left] = Direction::ALL;
        if draw < 1.0 / 3.0 {
            front
        } else if draw < 2.0 / 3.0 {
            back
        } else {
            left
        }
    }
}

impl Bench {
    pub(super) fn new() -> Self {
        Self { models: Models::new(&Sensor::reference(), ContactLaw::Sneddon) }
    }

    /// A point of a sample, with its surface found once.
    pub(super) fn point(sample: usize, chance: &mut Chance) -> Point {
        let young_mpa = SAMPLES_MPA[sample] * (1.0 + NUISANCES.sample_rel * chance.normal());
        let surface_mm = NUISANCES.surface_mm * chance.normal();
        Point { young_mpa, tissue: tissue(young_mpa), surface_mm }
    }

    /// What is measured at a point: the shift at this angle, azimuth and depth, with its noise, Hz.
    pub(super) fn measure_hz(
        &self,
        point: &Point,
        angle_rad: f64,
        azimuth_rad: f64,
        depth_mm: f64,
        chance: &mut Chance,
    ) -> f64 {
        // A surface that leans past the upright leans to the other side.
        let azimuth_rad = if angle_rad < 0.0 { azimuth_rad + PI } else { azimuth_rad };
        let pose = Pose::new(angle_rad.abs(), azimuth_rad).expect("the slopes are far from 90°");
        let along_probe_mm = depth_mm + point.surface_mm + NUISANCES.depth_mm * chance.normal();
        let contact = Contact::new(pose, Depth::Indentation { along_probe_mm });
        let prediction = self.models.predict(Tier::Reference, &point.tissue, &contact);
        let shift_hz = prediction.expect("the law holds to twice the depth").shift_hz;
        shift_hz + NUISANCES.shift_hz * chance.normal()
    }

    /// A slope of the surface, rad.
    pub(super) fn slope_rad(chance: &mut Chance) -> f64 {
        NUISANCES.slope_rad * chance.normal()
    }
}
