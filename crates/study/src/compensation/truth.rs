//! The truth of the study: the paper's samples with the nuisances of a good laboratory.

use std::f64::consts::PI;

use rig_contact::{Contact, ContactLaw, Depth, Models, Pose, Sensor, Tier, Tissue};

use crate::{
    paper_bench::{SAMPLES_MPA, tissue},
    simulate::Nuisances,
};
use rig_model::random::Stream;

/// The nuisances. The depth error is that of the surface, which the touches of a site share.
pub(super) const NUISANCES: Nuisances = Nuisances::BENCH;
/// Standard deviation of each depth below the surface, from the encoder, mm.
pub(super) const ENCODER_MM: f64 = 0.002;
/// The largest contact angle.
pub(super) const MAX_ANGLE_RAD: f64 = 0.25 * PI;

/// The true shifts, by the reference model, which no inference uses.
#[derive(Debug)]
pub(super) struct TruthModel {
    models: Models,
}

/// A point of a sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct SamplePoint {
    /// Young's modulus at this point, MPa.
    pub(super) young_mpa: f64,
    tissue: Tissue,
    /// Error of the surface found at this point, mm.
    surface_mm: f64,
}

impl TruthModel {
    pub(super) fn new() -> Self {
        Self { models: Models::new(&Sensor::reference(), ContactLaw::Sneddon) }
    }

    /// A random point of a sample.
    pub(super) fn point(sample: usize, random: &mut Stream) -> SamplePoint {
        let young_mpa = SAMPLES_MPA[sample] * (1.0 + NUISANCES.young_rel * random.normal());
        let surface_mm = NUISANCES.depth_mm * random.normal();
        SamplePoint { young_mpa, tissue: tissue(young_mpa), surface_mm }
    }

    /// The measured shift at an angle, azimuth and depth, with noise, Hz.
    pub(super) fn measure_hz(
        &self,
        point: &SamplePoint,
        angle_rad: f64,
        azimuth_rad: f64,
        depth_mm: f64,
        random: &mut Stream,
    ) -> f64 {
        // A negative angle leans the surface to the other side.
        let azimuth_rad = if angle_rad < 0.0 { azimuth_rad + PI } else { azimuth_rad };
        let pose = Pose::new(angle_rad.abs(), azimuth_rad).expect("the slopes are far from 90°");
        let along_probe_mm = depth_mm + point.surface_mm + ENCODER_MM * random.normal();
        let contact = Contact::new(pose, Depth::Indentation { along_probe_mm });
        let prediction = self.models.predict(Tier::Reference, &point.tissue, &contact);
        let shift_hz = prediction.expect("the law holds to twice the depth").shift_hz;
        shift_hz + NUISANCES.shift_hz * random.normal()
    }

    /// A random slope of the surface, rad.
    pub(super) fn slope_rad(random: &mut Stream) -> f64 {
        NUISANCES.angle_deg.to_radians() * random.normal()
    }
}
