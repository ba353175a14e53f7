//! The section of the sensor. Only the analysis of a run and the check of a protocol use it.

use rig_contact::{SensorDescription, SensorDesign, Uncertainty};
use rig_model::Geometry;

use crate::{
    sensor::{ContactKeys, DesignKeys, contact},
    settings::{Presence, Table},
};

/// The values of the section.
struct SensorKeys {
    design: DesignKeys,
    contact: ContactKeys,
    uncertainty: Uncertainty,
}

/// Reads the section. The ball is that of the geometry, or of the reference sensor if the geometry is
/// faulty.
pub(super) fn sensor(table: &mut Table<'_>, geometry: Option<&Geometry>) -> SensorDescription {
    let mut reference = SensorDesign::reference();
    if let Some(geometry) = geometry {
        reference.probe_radius_mm = geometry.probe_radius_mm;
    }
    let default = SensorKeys {
        design: DesignKeys::new(reference),
        contact: ContactKeys::DEFAULT,
        uncertainty: Uncertainty::TYPICAL,
    };
    let radius_mm = Some(reference.probe_radius_mm);
    let section = |table: &mut Table<'_>| SensorKeys {
        design: DesignKeys::read(table, Presence::Optional, radius_mm),
        contact: contact(table, Presence::Optional),
        uncertainty: table.section("uncertainty", uncertainty).or(Uncertainty::TYPICAL).value,
    };
    let section = table.section("sensor", section).or(default);
    let sensor = section.value.design.sensor(table, &section);
    let SensorKeys { contact, uncertainty, .. } = section.value;
    let ContactKeys { deflects, law, friction, kind } = contact;
    SensorDescription { sensor, deflects, law, friction, kind, uncertainty }
}

fn uncertainty(table: &mut Table<'_>) -> Uncertainty {
    let mut size = |key, most, default| table.number(key).range(0.0..=most).or(default).value;
    Uncertainty {
        depth_mm: size("depth_mm", 5.0, Uncertainty::TYPICAL.depth_mm),
        angle_deg: size("angle_deg", 45.0, Uncertainty::TYPICAL.angle_deg),
        sample_rel: size("sample_rel", 1.0, Uncertainty::TYPICAL.sample_rel),
        scale_rel: size("scale_rel", 1.0, Uncertainty::TYPICAL.scale_rel),
    }
}
