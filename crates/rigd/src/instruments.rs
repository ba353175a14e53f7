//! The instruments that a rig file names: the shipped ones, and those with a file of their own.

use std::path::{Path, PathBuf};

use rig_files::{
    Complaint, Faults, FileKind, Location,
    instrument::{Dialect, Named, RegisterMap},
    rig_file::RigFile,
};
use rig_model::{AnalyzerMake, DriveMake};
use rig_store::{Digest, Source};
use sha2::{Digest as _, Sha256};

use crate::files::{FileError, read};

/// What the devices of a rig must be told.
#[derive(Debug, Clone, Copy)]
pub struct Instruments {
    /// The analyzer.
    pub analyzer: &'static Dialect,
    /// The drive of the linear stage.
    pub linear: &'static RegisterMap,
    /// The drive of the rotary stage.
    pub rotary: &'static RegisterMap,
    /// The files of analyzer, linear and rotary stage, in this order; `None` for shipped ones.
    pub own_files: [Option<&'static Source>; 3],
}

/// The makes that play the devices of a simulated rig.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(
    not(feature = "simulator"),
    expect(
        dead_code,
        reason = "a program without the simulator only asks whether there are such makes"
    )
)]
pub(crate) struct SimulatedMakes {
    /// The analyzer.
    pub analyzer: AnalyzerMake,
    /// The drive of the linear stage.
    pub linear: DriveMake,
    /// The drive of the rotary stage.
    pub rotary: DriveMake,
}

/// An instrument that no simulated device plays.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no simulated device plays the instrument {name}")]
pub struct NotSimulated {
    /// Its name.
    pub name: String,
}

/// Why a rig file and an instrument file do not go together.
#[derive(Debug, thiserror::Error)]
enum InstrumentRefusal {
    #[error("{}: {instead}", path.display())]
    Missing { path: PathBuf, instead: String },
    #[error("frequency_hz of [analyzer] is outside the range of {name}, {min} Hz to {max} Hz")]
    Frequency { name: String, min: f64, max: f64 },
    #[error("max_level_v = {found} is above the {limit} V that {name} can give")]
    Level { found: f64, limit: f64, name: String },
    #[error(transparent)]
    NotSimulated(NotSimulated),
}

impl Complaint for InstrumentRefusal {
    fn suggestion(&self) -> Option<String> {
        Some(match self {
            Self::Missing { .. } => "`rigd instrument new` writes one".to_owned(),
            Self::Frequency { min, max, .. } => format!("stay within [{min}, {max}]"),
            Self::Level { limit, .. } => format!("use at most {limit}"),
            Self::NotSimulated(_) => {
                "write `simulated_as` in its file, or connection = \"ports\"".to_owned()
            }
        })
    }
}

impl Instruments {
    /// The instruments of a rig file that names shipped ones alone; `None` for another one.
    pub fn shipped(file: &RigFile) -> Option<Self> {
        let (Named::Shipped(analyzer), Named::Shipped(linear), Named::Shipped(rotary)) =
            (&file.analyzer.instrument, &file.linear.instrument, &file.rotary.instrument)
        else {
            return None;
        };
        Some(Self {
            analyzer: Dialect::of(*analyzer),
            linear: RegisterMap::of(*linear),
            rotary: RegisterMap::of(*rotary),
            own_files: [None; 3],
        })
    }

    /// Reads the instrument files that the rig file at `path` names.
    ///
    /// # Errors
    /// Every fault of an instrument file, or that it does not fit the rig file.
    pub(crate) fn load(path: &Path, rig: &RigFile) -> Result<Self, FileError> {
        let name = path.display().to_string();
        let (analyzer, of_analyzer) = match &rig.analyzer.instrument {
            Named::Shipped(make) => (Dialect::of(*make), None),
            Named::File { path: file, location } => {
                let (file, text) = beside(path, file, *location, FileKind::Analyzer)?;
                let dialect = Dialect::read_and_keep(&file, &text).map_err(FileError::Faults)?;
                within_ranges(&name, *location, rig, dialect)?;
                (dialect, Some(kept(&dialect.name, text)))
            }
        };
        let drive = |instrument: &Named<DriveMake>| match instrument {
            Named::Shipped(make) => Ok((RegisterMap::of(*make), None)),
            Named::File { path: file, location } => {
                let (file, text) = beside(path, file, *location, FileKind::Drive)?;
                let map = RegisterMap::read_and_keep(&file, &text).map_err(FileError::Faults)?;
                Ok((map, Some(kept(&map.name, text))))
            }
        };
        let (linear, of_linear) = drive(&rig.linear.instrument)?;
        let (rotary, of_rotary) = drive(&rig.rotary.instrument)?;
        Ok(Self { analyzer, linear, rotary, own_files: [of_analyzer, of_linear, of_rotary] })
    }

    /// SHA-256 of the files of both drives, the linear stage first; `None` for shipped ones.
    pub(crate) fn drive_files(&self) -> [Option<Digest>; 2] {
        let [_, linear, rotary] = self.own_files;
        let digest =
            |file: &Source| Digest::from_bytes(Sha256::digest(file.toml.as_bytes()).into());
        [linear.map(digest), rotary.map(digest)]
    }

    /// The makes that play them on a simulated rig.
    ///
    /// # Errors
    /// [`NotSimulated`] for the first one that no simulated device plays.
    pub(crate) fn simulated(&self) -> Result<SimulatedMakes, NotSimulated> {
        let not = |name: &str| NotSimulated { name: name.to_owned() };
        let drive = |map: &RegisterMap| map.simulated_as.ok_or_else(|| not(&map.name));
        Ok(SimulatedMakes {
            analyzer: self.analyzer.simulated_as.ok_or_else(|| not(&self.analyzer.name))?,
            linear: drive(self.linear)?,
            rotary: drive(self.rotary)?,
        })
    }

    /// Refuses a simulated rig with an instrument that no simulated device plays.
    pub(crate) fn check_simulated(&self, path: &Path, rig: &RigFile) -> Result<(), FileError> {
        let Err(refusal) = self.simulated() else { return Ok(()) };
        let named = |name: &str, file: Option<Location>| (name == refusal.name).then_some(file);
        let at = named(&self.analyzer.name, location(&rig.analyzer.instrument))
            .or_else(|| named(&self.linear.name, location(&rig.linear.instrument)))
            .or_else(|| named(&self.rotary.name, location(&rig.rotary.instrument)))
            .flatten();
        Err(refused(
            &path.display().to_string(),
            at.unwrap_or(Location { line: 1, column: 1 }),
            &InstrumentRefusal::NotSimulated(refusal),
        ))
    }
}

/// The text of a file, for as long as the program runs, as what was read from it.
fn kept(name: &str, toml: String) -> &'static Source {
    Box::leak(Box::new(Source { name: name.to_owned(), toml }))
}

/// Where a rig file names the file of an instrument.
fn location<M>(named: &Named<M>) -> Option<Location> {
    match named {
        Named::Shipped(_) => None,
        Named::File { location, .. } => Some(*location),
    }
}

/// Name and text of a file whose path begins at the directory of the rig file.
fn beside(
    rig: &Path,
    file: &Path,
    location: Location,
    kind: FileKind,
) -> Result<(String, String), FileError> {
    let path = rig.parent().unwrap_or(Path::new("")).join(file);
    read(&path, kind).map_err(|error| match error {
        FileError::Missing { path, instead } => {
            let refusal = InstrumentRefusal::Missing { path, instead };
            refused(&rig.display().to_string(), location, &refusal)
        }
        error => error,
    })
}

/// The ranges of the rig file lie within those of its analyzer.
fn within_ranges(
    name: &str,
    location: Location,
    rig: &RigFile,
    dialect: &Dialect,
) -> Result<(), FileError> {
    let range = &rig.limits.analyzer;
    let ((lowest, highest), (min, max)) = (range.frequency_hz, dialect.frequency_hz);
    let name_of = || dialect.name.clone();
    if lowest < min || max < highest {
        let refusal = InstrumentRefusal::Frequency { name: name_of(), min, max };
        return Err(refused(name, location, &refusal));
    }
    let (found, limit) = (range.max_level_v, dialect.highest_level_v());
    if limit < found {
        let refusal = InstrumentRefusal::Level { found, limit, name: name_of() };
        return Err(refused(name, location, &refusal));
    }
    Ok(())
}

fn refused(name: &str, location: Location, refusal: &InstrumentRefusal) -> FileError {
    let mut faults = Faults::new(name);
    faults.refuse(location, refusal);
    FileError::Faults(faults)
}
