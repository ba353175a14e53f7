//! The uncertainty budget of a stiffness in its unit.

use rig_analysis::budget::{Budget, Part};
use schemars::JsonSchema;
use serde::Serialize;

/// The standard deviation of a stiffness by cause, MPa. The squares of the parts add up to its square. The
/// fields are an interface: scripts read them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct StiffnessBudget {
    /// From the resonance in contact, MPa.
    pub sweep_mpa: f64,
    /// From the reference, MPa.
    pub reference_mpa: f64,
    /// From the surface found, MPa.
    pub surface_mpa: f64,
    /// From the depth below the surface, MPa.
    pub depth_mpa: f64,
    /// From the contact angle, MPa. If it is inferred, from what the touches leave unknown of it.
    pub angle_mpa: f64,
    /// From the sensor: of the calibration by known samples, or of the description without any, MPa.
    pub sensor_mpa: f64,
    /// From the model: of what was learnt, and of the misfit, MPa.
    pub model_mpa: f64,
    /// From the sample, MPa: the scatter of its touches beyond all of these; 0 for a touch at a known angle. If
    /// the angle is inferred, also the variation of the sample from one point to the next.
    pub sample_mpa: f64,
}

impl StiffnessBudget {
    /// The budget of a stiffness in MPa.
    pub(crate) fn of(budget: &Budget, young_mpa: f64) -> Self {
        let part = |part| young_mpa * budget.of(part);
        Self {
            sweep_mpa: part(Part::Sweep),
            reference_mpa: part(Part::Reference),
            surface_mpa: part(Part::Surface),
            depth_mpa: part(Part::Depth),
            angle_mpa: part(Part::Angle),
            sensor_mpa: part(Part::Sensor),
            model_mpa: part(Part::Model),
            sample_mpa: part(Part::Sample),
        }
    }
}
