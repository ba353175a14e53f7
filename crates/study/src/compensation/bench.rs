//! The simulated bench of the study: the paper's samples with the nuisances of a good laboratory.

use std::f64::consts::PI;

use rig_contact::{Contact, ContactLaw, Depth, Models, Pose, Sensor, Tier, Tissue};

use crate::{
    paper_bench::{SAMPLES_MPA, tissue},
    simulate::Nuisances,
};
use rig_model::random::Stream;

/// What the bench does not know; of the depth it is the surface, which the touches of a place share.
pub(super) const NUISANCES: Nuisances = Nuisances::BENCH;
/// Standard deviation of each depth below that surface, by the encoder, mm.
pub(super) const ENCODER_MM: f64 = 0.002;
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

impl Bench {
    pub(super) fn new() -> Self {
        Self { models: Models::new(&Sensor::reference(), ContactLaw::Sneddon) }
    }

    /// A point of a sample, with its surface found once.
    pub(super) fn point(sample: usize, random: &mut Stream) -> Point {
        let young_mpa = SAMPLES_MPA[sample] * (1.0 + NUISANCES.young_rel * random.normal());
        let surface_mm = NUISANCES.depth_mm * random.normal();
        Point { young_mpa, tissue: tissue(young_mpa), surface_mm }
    }

    /// What is measured at a point: the shift at this angle, azimuth and depth, with its noise, Hz.
    pub(super) fn measure_hz(
        &self,
        point: &Point,
        angle_rad: f64,
        azimuth_rad: f64,
        depth_mm: f64,
        random: &mut Stream,
    ) -> f64 {
        // A surface that leans past the upright leans to the other side.
        let azimuth_rad = if angle_rad < 0.0 { azimuth_rad + PI } else { azimuth_rad };
        let pose = Pose::new(angle_rad.abs(), azimuth_rad).expect("the slopes are far from 90°");
        let along_probe_mm = depth_mm + point.surface_mm + ENCODER_MM * random.normal();
        let contact = Contact::new(pose, Depth::Indentation { along_probe_mm });
        let prediction = self.models.predict(Tier::Reference, &point.tissue, &contact);
        let shift_hz = prediction.expect("the law holds to twice the depth").shift_hz;
        shift_hz + NUISANCES.shift_hz * random.normal()
    }

    /// A slope of the surface, rad.
    pub(super) fn slope_rad(random: &mut Stream) -> f64 {
        NUISANCES.angle_deg.to_radians() * random.normal()
    }
}
