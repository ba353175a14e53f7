//! Files that a person names: what kind they are, which there are in their place, and their text.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use rig_files::{Complaint, Faults, Location};

/// The kinds of files that a person gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// Which device is on which port, and what the bench can do.
    Rig,
    /// What to do.
    Protocol,
    /// What stands on a simulated bench.
    Scene,
    /// The readings of a sweep, CSV or Touchstone.
    Sweep,
}

/// Why a file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// There is no file of this name.
    #[error("{}: {instead}", path.display())]
    Missing {
        /// The name.
        path: PathBuf,
        /// What there is instead.
        instead: String,
    },
    /// It cannot be read.
    #[error("{}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It has faults.
    #[error(transparent)]
    Faults(Faults),
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
            (FileKind::Scene, _) => "name a scene file in [simulation] of the rig file",
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
            Self::Sweep => &[],
        }
    }

    /// What a text looks like, if it looks like one kind more than like any other. Its syntax may be
    /// faulty.
    fn of(text: &str) -> Option<Self> {
        if is_sweep(text) {
            return Some(Self::Sweep);
        }
        let names = top_names(text);
        let count = |kind: Self| kind.marks().iter().filter(|mark| names.contains(*mark)).count();
        let mut counts = [Self::Rig, Self::Protocol, Self::Scene].map(|kind| (count(kind), kind));
        counts.sort_by_key(|&(count, _)| count);
        let [_, (second, _), (most, kind)] = counts;
        // One mark alone may be a slip.
        (most >= 2 && second < most).then_some(kind)
    }

    /// Refuses a text that looks like another kind: its faults as this kind would tell nothing.
    ///
    /// # Errors
    /// The one fault of such a text.
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

/// The names of keys before the first section, and of sections.
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

/// Whether a text begins as tables of readings do.
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

/// The name of a file, as faults show it, and its text, which is of the kind expected.
pub(crate) fn read(path: &Path, kind: FileKind) -> Result<(String, String), FileError> {
    let (name, bytes) = read_bytes(path)?;
    let text = rig_files::settings::text(&name, &bytes).map_err(FileError::Faults)?.to_owned();
    kind.expect(&name, &text).map_err(FileError::Faults)?;
    Ok((name, text))
}

/// The name of a file, as faults show it, and its bytes.
pub(crate) fn read_bytes(path: &Path) -> Result<(String, Vec<u8>), FileError> {
    match fs::read(path) {
        Ok(bytes) => Ok((path.display().to_string(), bytes)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Err(FileError::Missing { path: path.to_path_buf(), instead: instead(path) })
        }
        Err(error) if error.kind() == io::ErrorKind::IsADirectory => {
            let instead = format!("a directory, no file; {}", listed(path, None));
            Err(FileError::Missing { path: path.to_path_buf(), instead })
        }
        Err(source) => Err(FileError::Unreadable { path: path.to_path_buf(), source }),
    }
}

/// What there is in place of a file that is not there.
fn instead(path: &Path) -> String {
    let folder = match path.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => return "no such file".to_owned(),
    };
    if !folder.is_dir() {
        return format!("no such file; there is no directory {}", folder.display());
    }
    format!("no such file; {}", listed(folder, path.extension()))
}

/// What a directory holds, or only those files that have the extension of the one that was meant.
fn listed(folder: &Path, extension: Option<&std::ffi::OsStr>) -> String {
    /// As many as a person looks through.
    const SHOWN: usize = 8;
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_like = |path: &PathBuf| {
        extension.is_none_or(|extension| path.is_file() && path.extension() == Some(extension))
    };
    let name = |path: PathBuf| {
        let name = path.file_name()?.to_string_lossy().into_owned();
        Some(if path.is_dir() { name + "/" } else { name })
    };
    let mut names: Vec<String> = entries.filter(is_like).filter_map(name).collect();
    names.sort();
    if names.is_empty() {
        return format!("{} holds none of its kind", folder.display());
    }
    let more = names.len().saturating_sub(SHOWN);
    names.truncate(SHOWN);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    format!("{} holds {}{more}", folder.display(), names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = include_str!("../../../config/rigs/bench.toml");
    const PROTOCOL: &str = include_str!("../../../config/protocols/smoke.toml");
    const SCENE: &str = include_str!("../../../config/scenes/paper.toml");

    #[test]
    fn a_file_of_another_kind_is_known_by_its_keys_also_when_it_is_faulty() {
        let kinds = [
            (FileKind::Rig, RIG),
            (FileKind::Protocol, PROTOCOL),
            (FileKind::Scene, SCENE),
            (FileKind::Sweep, "frequency_hz,resistance_ohm,reactance_ohm\n140,1,2\n"),
            (FileKind::Sweep, "\n! a network analyzer\n# HZ S RI R 50\n"),
            (FileKind::Sweep, "Freq (Hz);Rs;X\n"),
        ];
        for (kind, text) in kinds {
            assert_eq!(FileKind::of(text), Some(kind), "{text}");
            // With the quotation marks gone, nothing is TOML any more.
            assert_eq!(FileKind::of(&text.replace('"', "")), Some(kind), "{text}");
            for expected in [FileKind::Rig, FileKind::Protocol, FileKind::Scene, FileKind::Sweep] {
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

    #[test]
    fn a_file_that_is_not_there_is_told_with_those_that_are() {
        let scratch = tempfile::TempDir::new().unwrap();
        let path = |name: &str| scratch.path().join(name);
        for name in ["b.toml", "a.toml", "notes.txt"] {
            fs::write(path(name), "").unwrap();
        }
        let said = |name: &str| {
            let error = read(&path(name), FileKind::Rig).unwrap_err().to_string();
            error.replace(&scratch.path().display().to_string(), "DIR")
        };
        assert_eq!(said("c.toml"), "DIR/c.toml: no such file; DIR holds a.toml, b.toml");
        assert_eq!(said("c.csv"), "DIR/c.csv: no such file; DIR holds none of its kind");
        assert_eq!(said("x/c.toml"), "DIR/x/c.toml: no such file; there is no directory DIR/x");
        assert_eq!(said(""), "DIR/: a directory, no file; DIR/ holds a.toml, b.toml, notes.txt");
        for n in 0..20 {
            fs::write(path(&format!("n{n}.toml")), "").unwrap();
        }
        assert!(
            said("c.toml").ends_with(", n12.toml, n13.toml, and 14 more"),
            "{}",
            said("c.toml")
        );
    }
}
