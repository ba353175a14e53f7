//! What a calibration rests on: the keys of the rig file that it was made with, and the drives with their instrument files.

use rig_files::{
    instrument::Named,
    rig_file::{AxisFile, Connection, RigFile},
};
use rig_model::{Axis, Unit};
use rig_record::{Digest, DigestPart};

use crate::Kind;

/// What the place of a simulated drive begins with.
pub(crate) const SIMULATED: &str = "simulated, ";

/// The keys of a rig file on which calibrations rest, as digests, and its drives.
///
/// The digests are of values, not of text: comments, order and other keys may change.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Basis {
    axes: Digest,
    geometry: Digest,
    limits: Digest,
    latency: Digest,
    nothing: Digest,
    drives: [String; 2],
}

impl Basis {
    /// The basis of a rig file. `drive_files` are the SHA-256 of the instrument files of its drives, the linear stage
    /// first; `None` for a shipped drive, whose registers are in the program.
    pub fn of(rig: &RigFile, drive_files: [Option<Digest>; 2]) -> Self {
        let mut keys = Vec::new();
        keys.extend(axis("linear", &rig.linear, &rig.limits.linear));
        keys.extend(axis("rotary", &rig.rotary, &rig.limits.rotary));
        let axes = digest(&keys);
        let stream = &rig.limits.analyzer.stream;
        let mut latency = keys.clone();
        latency.extend([
            ("analyzer.latency_s".to_owned(), stream.latency_s),
            ("analyzer.latency_sigma_s".to_owned(), stream.latency_sigma_s),
        ]);
        let mut limits = keys.clone();
        limits.extend(soft("linear", &rig.limits.linear));
        limits.extend(soft("rotary", &rig.limits.rotary));
        let geometry = &rig.limits.geometry;
        keys.extend([
            ("geometry.surface_mm".to_owned(), geometry.surface.value()),
            ("geometry.surface_above_pivot_mm".to_owned(), geometry.surface_above_pivot_mm),
            ("geometry.probe_beside_pivot_mm".to_owned(), geometry.probe_beside_pivot_mm),
            ("geometry.probe_radius_mm".to_owned(), geometry.probe_radius_mm),
        ]);
        let pin = geometry.pin_radius_mm;
        keys.extend(pin.map(|pin_mm| ("geometry.pin_radius_mm".to_owned(), pin_mm)));
        let [of_linear, of_rotary] = drive_files;
        let drives = [drive(&rig.linear, rig, of_linear), drive(&rig.rotary, rig, of_rotary)];
        Self {
            axes,
            geometry: digest(&keys),
            limits: digest(&limits),
            latency: digest(&latency),
            nothing: digest(&[]),
            drives,
        }
    }

    /// SHA-256 of the keys on which a calibration rests.
    pub fn sha256(&self, kind: Kind) -> String {
        let digest = match kind {
            kind if kind.rests_on_no_key() => &self.nothing,
            kind if kind.rests_on_geometry() => &self.geometry,
            kind if kind.rests_on_soft_limits() => &self.limits,
            Kind::Latency => &self.latency,
            _ => &self.axes,
        };
        digest.to_string()
    }

    /// Whether the bench is a simulated one.
    pub fn is_simulated(&self) -> bool {
        self.drives.iter().any(|drive| drive.contains(SIMULATED))
    }

    /// The drives: make, or instrument file with its SHA-256, address and port, the linear stage first. Few drives
    /// report an identity.
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

fn soft<U: Unit>(name: &str, axis: &Axis<U>) -> [(String, f64); 2] {
    let soft = axis.soft();
    [("soft_min", soft.min), ("soft_max", soft.max)]
        .map(|(key, value)| (format!("{name}.{key}"), value.value()))
}

fn drive<U>(file: &AxisFile<U>, rig: &RigFile, sha256: Option<Digest>) -> String {
    let instrument = match (&file.instrument, sha256) {
        (Named::Shipped(make), _) => make.to_string(),
        (Named::File { path, .. }, None) => path.display().to_string(),
        (Named::File { path, .. }, Some(sha256)) => {
            format!("{} with SHA-256 {sha256}", path.display())
        }
    };
    let place = match (&rig.connection, &rig.bus) {
        (Connection::Simulated(simulation), _) => {
            format!("{SIMULATED}{}", simulation.scene.display())
        }
        (Connection::Ports, bus) => bus.place().to_owned(),
    };
    format!("{instrument} at unit {}, {place}", file.unit_id)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(changes: &[(&str, &str)]) -> RigFile {
        let text = include_str!("../../../config/rigs/simulated.toml").to_owned();
        let text = changes.iter().fold(text, |text, (old, new)| {
            assert!(text.contains(old), "{old}");
            text.replacen(old, new, 1)
        });
        RigFile::read("rig.toml", &text).unwrap()
    }

    #[test]
    fn a_calibration_rests_on_values_and_not_on_other_keys_or_comments() {
        let none = [None, None];
        let basis = Basis::of(&rig(&[]), none);
        let faster = ("max_speed_mm_per_s = 20", "# slower\nmax_speed_mm_per_s = 21");
        assert_eq!(Basis::of(&rig(&[faster]), none), basis);
        let other = Basis::of(&rig(&[("probe_radius_mm", "probe_radius_mm = 0.6 # ")]), none);
        assert_eq!(other.sha256(Kind::Scale), basis.sha256(Kind::Scale));
        assert_ne!(other.sha256(Kind::Geometry), basis.sha256(Kind::Geometry));
        let pin = ("[geometry]", "[geometry]\npin_radius_mm = 2");
        let other = Basis::of(&rig(&[pin]), none);
        assert_eq!(other.sha256(Kind::Scale), basis.sha256(Kind::Scale));
        assert_ne!(other.sha256(Kind::Geometry), basis.sha256(Kind::Geometry));
        let other =
            Basis::of(&rig(&[("soft_limits_mm = [8, 45]", "soft_limits_mm = [8, 44]")]), none);
        assert_eq!(other.sha256(Kind::Scale), basis.sha256(Kind::Scale));
        assert_ne!(other.sha256(Kind::Limits), basis.sha256(Kind::Limits));
        let late = Basis::of(&rig(&[("[analyzer]", "[analyzer]\nlatency_s = 0.02")]), none);
        assert_eq!(late.sha256(Kind::Homing), basis.sha256(Kind::Homing));
        assert_ne!(late.sha256(Kind::Latency), basis.sha256(Kind::Latency));
    }

    #[test]
    fn a_changed_instrument_file_is_another_drive() {
        let own = ("register_map = \"oriental-az\"", "register_map = \"drive.toml\"");
        let parity = ("baud = 115200 }", "baud = 115200, parity = \"even\" }");
        let rig = rig(&[own, parity]);
        let text = |text: &str| Some(Digest::of([DigestPart::Text(text)]));
        let [one, other] = ["a", "b"].map(|file| Basis::of(&rig, [text(file), None]));
        assert_eq!(one, Basis::of(&rig, [text("a"), None]));
        assert_ne!(one.drives()[0], other.drives()[0]);
        assert_eq!(one.drives()[1], other.drives()[1]);
        assert!(one.drives()[0].starts_with("drive.toml with SHA-256 "), "{:?}", one.drives());
    }
}
