//! What a calibration rests on: the keys of the rig file that it was made with, and the drives.

use rig_files::{
    instrument::Named,
    rig_file::{AxisFile, Connection, PortFile, RigFile},
};
use rig_model::{Axis, Unit};
use rig_record::{Digest, DigestPart};

use crate::Kind;

/// The keys of a rig file on which calibrations rest, as digests, and its drives.
///
/// The digests are of values, not of text: comments, order and other keys may change.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Basis {
    axes: Digest,
    geometry: Digest,
    drives: [String; 2],
}

impl Basis {
    /// The basis of a rig file.
    pub fn of(rig: &RigFile) -> Self {
        let mut keys = Vec::new();
        keys.extend(axis("linear", &rig.linear, &rig.limits.linear));
        keys.extend(axis("rotary", &rig.rotary, &rig.limits.rotary));
        let axes = digest(&keys);
        let geometry = &rig.limits.geometry;
        keys.extend([
            ("geometry.surface_mm".to_owned(), geometry.surface.value()),
            ("geometry.surface_above_pivot_mm".to_owned(), geometry.surface_above_pivot_mm),
            ("geometry.probe_beside_pivot_mm".to_owned(), geometry.probe_beside_pivot_mm),
            ("geometry.probe_radius_mm".to_owned(), geometry.probe_radius_mm),
        ]);
        let drives = [drive(&rig.linear, rig), drive(&rig.rotary, rig)];
        Self { axes, geometry: digest(&keys), drives }
    }

    /// SHA-256 of the keys on which a calibration rests.
    pub fn sha256(&self, kind: Kind) -> String {
        let digest = if kind.rests_on_geometry() { &self.geometry } else { &self.axes };
        digest.to_string()
    }

    /// The drives: make, address and port, the linear stage first. Few drives report an identity.
    pub const fn drives(&self) -> &[String; 2] {
        &self.drives
    }
}

fn digest(keys: &[(String, f64)]) -> Digest {
    let values: Vec<_> = keys.iter().map(|(key, value)| (key, format!("{value:?}"))).collect();
    let parts = values.iter().flat_map(|(key, value)| [key.as_str(), value.as_str()]);
    Digest::of(parts.map(DigestPart::Text))
}

fn axis<U: Unit>(
    name: &str,
    file: &AxisFile<U>,
    axis: &Axis<U>,
) -> impl Iterator<Item = (String, f64)> + use<U> {
    let scale = &file.scale;
    let travel = axis.travel();
    let keys = [
        ("step", scale.per_count),
        ("zero", scale.zero.value()),
        ("steps_per_revolution", scale.counts_per_revolution),
        ("travel_min", travel.min.value()),
        ("travel_max", travel.max.value()),
        ("homes_up", f64::from(u8::from(file.is_homing_up))),
    ];
    let name = name.to_owned();
    keys.into_iter().map(move |(key, value)| (format!("{name}.{key}"), value))
}

fn drive<U>(file: &AxisFile<U>, rig: &RigFile) -> String {
    let instrument = match &file.instrument {
        Named::Shipped(make) => make.to_string(),
        Named::File { path, .. } => path.display().to_string(),
    };
    let place = match (&rig.connection, &rig.bus) {
        (Connection::Simulated(simulation), _) => {
            format!("simulated, {}", simulation.scene.display())
        }
        (Connection::Ports, PortFile::Serial { path, .. }) => path.clone(),
        (Connection::Ports, PortFile::Tcp { address }) => address.clone(),
    };
    format!("{instrument} at unit {}, {place}", file.unit_id)
}
