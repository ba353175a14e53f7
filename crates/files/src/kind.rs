//! The kinds of files that a person gives, recognised by their content.

use crate::{Complaint, Faults, Location};

/// The kinds of files that a person gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// Devices with their ports, limits and geometry of the bench.
    Rig,
    /// The steps of a measurement.
    Protocol,
    /// The contents of a simulated bench.
    Scene,
    /// The settings of the daemon.
    Service,
    /// What an analyzer must be told.
    Analyzer,
    /// What an axis drive must be told.
    Drive,
    /// The readings of a sweep, CSV or Touchstone.
    Sweep,
}

/// A file of another kind than the one expected.
#[derive(Debug, thiserror::Error)]
#[error("this looks like a {}, not like a {}", found.name(), expected.name())]
struct OtherKind {
    expected: FileKind,
    found: FileKind,
}

impl Complaint for OtherKind {
    fn suggestion(&self) -> Option<String> {
        let suggestion = match (self.expected, self.found) {
            (FileKind::Rig, _) => "give the rig file with --rig",
            (FileKind::Protocol, FileKind::Rig) => {
                "give a protocol file here, and this one with --rig"
            }
            (FileKind::Protocol, FileKind::Sweep) => "`rigd fit` takes sweeps",
            (FileKind::Protocol, _) => "give a protocol file",
            (FileKind::Scene, _) => "give a scene file; [simulation] of a rig file names one",
            (FileKind::Analyzer, _) => "name an analyzer file as the dialect of the rig file",
            (FileKind::Drive, _) => "name a drive file as a register_map of the rig file",
            (FileKind::Service, _) => "name the service file with --config",
            (FileKind::Sweep, _) => "give the readings of a sweep, as CSV or Touchstone",
        };
        Some(suggestion.to_owned())
    }
}

impl FileKind {
    /// The kind in words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rig => "rig file",
            Self::Protocol => "protocol file",
            Self::Scene => "scene file",
            Self::Service => "service file",
            Self::Analyzer => "analyzer file",
            Self::Drive => "drive file",
            Self::Sweep => "sweep file",
        }
    }

    /// Keys and sections at the top of files of this kind and of no other.
    const fn marks(self) -> &'static [&'static str] {
        match self {
            Self::Rig => &["connection", "simulation", "analyzer", "bus", "geometry"],
            Self::Protocol => {
                &["directions", "angles_deg", "touch", "approach", "no_load_sweep", "contact_sweep"]
            }
            Self::Scene => &["orientation", "contact", "place", "nuisances"],
            Self::Service => &["listen", "allow_hosts", "token_file", "release_queue", "tls"],
            Self::Analyzer => &[
                "models",
                "model_prefixes",
                "delay_max_s",
                "frequency_steps",
                "transport",
                "setup",
                "measure",
            ],
            Self::Drive => &[
                "drives",
                "speed_unit",
                "acceleration_unit",
                "start_within_ms",
                "signature",
                "steps",
            ],
            Self::Sweep => &[],
        }
    }

    /// The kind of a text, if it has more keys of this kind than of any other. Its syntax may be faulty.
    fn of(text: &str) -> Option<Self> {
        if is_sweep(text) {
            return Some(Self::Sweep);
        }
        let names = top_names(text);
        let count = |kind: Self| kind.marks().iter().filter(|mark| names.contains(*mark)).count();
        let kinds =
            [Self::Rig, Self::Protocol, Self::Scene, Self::Service, Self::Analyzer, Self::Drive];
        let mut counts = kinds.map(|kind| (count(kind), kind));
        counts.sort_by_key(|&(count, _)| count);
        let [.., (second, _), (most, kind)] = counts;
        // A single key may be a mistake.
        (most >= 2 && second < most).then_some(kind)
    }

    /// Refuses a text of another kind, whose faults as this kind would not help.
    ///
    /// # Errors
    /// One fault for such a text.
    pub fn expect(self, file: &str, text: &str) -> Result<(), Faults> {
        match Self::of(text) {
            Some(found) if found != self => {
                let mut faults = Faults::new(file);
                faults.refuse(Location::START, &OtherKind { expected: self, found });
                Err(faults)
            }
            _ => Ok(()),
        }
    }
}

/// Names of the keys before the first section, and of the sections.
fn top_names(text: &str) -> Vec<&str> {
    let mut is_top = true;
    let name = |line: &'_ str| {
        let end = line.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        end.unwrap_or(line.len())
    };
    let mut names = Vec::new();
    for line in text.lines().map(str::trim_start) {
        if line.starts_with('[') {
            is_top = false;
            let header = line.trim_start_matches(['[', ' ']);
            names.push(&header[..name(header)]);
        } else if is_top && !line.starts_with('#') {
            names.push(&line[..name(line)]);
        }
    }
    names
}

/// Whether a text begins like a table of readings.
fn is_sweep(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let Some(first) = lines.next() else { return false };
    let first = first.to_ascii_lowercase();
    // Touchstone begins with comments, or with its option line.
    let is_touchstone = first.starts_with('!')
        || ["# hz ", "# khz ", "# mhz ", "# ghz "].iter().any(|unit| first.starts_with(unit));
    let is_table = first.contains("freq") && first.contains([',', ';', '\t']);
    is_touchstone || is_table && !first.starts_with('#')
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = include_str!("../../../config/rigs/bench.toml");
    const PROTOCOL: &str = include_str!("../../../config/protocols/smoke.toml");
    const SCENE: &str = include_str!("../../../config/scenes/paper.toml");
    const ANALYZER: &str = include_str!("../../../config/instruments/keysight-e4990a.toml");
    const DRIVE: &str = include_str!("../../../config/instruments/iai-rc.toml");
    const SERVICE: &str = include_str!("../../../config/service/service.toml");

    #[test]
    fn a_file_of_another_kind_is_known_by_its_keys_also_when_it_is_faulty() {
        let kinds = [
            (FileKind::Rig, RIG),
            (FileKind::Protocol, PROTOCOL),
            (FileKind::Scene, SCENE),
            (FileKind::Service, SERVICE),
            (FileKind::Analyzer, ANALYZER),
            (FileKind::Drive, DRIVE),
            (FileKind::Sweep, "frequency_hz,resistance_ohm,reactance_ohm\n140,1,2\n"),
            (FileKind::Sweep, "\n! a network analyzer\n# HZ S RI R 50\n"),
            (FileKind::Sweep, "Freq (Hz);Rs;X\n"),
        ];
        for (kind, text) in kinds {
            assert_eq!(FileKind::of(text), Some(kind), "{text}");
            // With the quotation marks gone, nothing is TOML any more.
            assert_eq!(FileKind::of(&text.replace('"', "")), Some(kind), "{text}");
            for (expected, _) in kinds {
                assert_eq!(expected.expect("x", text).is_ok(), expected == kind, "{text}");
            }
        }
        for text in ["", "name = 1\n", "{\"name\": 1}", "# a, comment on frequency\nx = 1"] {
            assert_eq!(FileKind::of(text), None, "{text}");
        }
        assert_eq!(
            FileKind::Rig.expect("smoke.toml", PROTOCOL).unwrap_err().to_string(),
            "smoke.toml:1:1: this looks like a protocol file, not like a rig file; give the rig file \
             with --rig"
        );
    }
}
