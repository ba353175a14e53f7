//! What the models of the sensor say of touches before they are made, for a protocol with an aim.

use std::cell::OnceCell;

use rig_analysis::stiffness::Compensation;
use rig_contact::{Pose, SensorDescription};
use rig_protocol::{ExpectedTouch, NoSensitivity, Sensitivity, TouchModel};

/// The sensor of a rig file and the samples that are known.
#[derive(Debug)]
pub(crate) struct RigModel<'a> {
    sensor: &'a SensorDescription,
    /// Names of samples, and Young's modulus of each, MPa.
    known: &'a [(String, f64)],
    /// Made when it is first asked for: most protocols have no aim.
    compensation: OnceCell<Compensation>,
}

impl<'a> RigModel<'a> {
    pub(crate) const fn new(sensor: &'a SensorDescription, known: &'a [(String, f64)]) -> Self {
        Self { sensor, known, compensation: OnceCell::new() }
    }
}

impl TouchModel for RigModel<'_> {
    fn sensitivity(&self, touch: &ExpectedTouch<'_>) -> Result<Sensitivity, NoSensitivity> {
        let known = self.known.iter().find(|(name, _)| name == touch.sample);
        let young_mpa = known.map(|(_, mpa)| *mpa).or(touch.assumed_mpa);
        let young_mpa = young_mpa.ok_or(NoSensitivity::UnknownSample)?;
        // The surface is a part of its own.
        let compensation = self.compensation.get_or_init(|| Compensation::new(self.sensor, 0.0));
        let pose = Pose::leaning(touch.pose.direction, touch.pose.angle.radians());
        let pose = pose.map_err(|_| NoSensitivity::OutsideModel)?;
        let depth = self.sensor.depth(touch.indentation_mm);
        let of = compensation.sensitivity(pose, depth, young_mpa);
        let of = of.map_err(|_| NoSensitivity::OutsideModel)?;
        Ok(Sensitivity {
            per_hz: of.per_hz,
            per_mm: of.per_mm,
            of_depth: of.of_depth,
            of_angle: of.of_angle,
        })
    }
}
