//! The calibrations of a data directory: a file each, written once.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use jiff::Timestamp;
use rig_commission::{
    Basis, BenchChange, Calibration, Circumstances, Finding, Kind, Standing, Step,
    UnreadableCalibration, Verdict, checks, file_name, holding, is_homing_begun,
};
use rig_store::{
    CitedCalibration, Digest, Ending, Reader, Run, RunStatus, ScrewMap, StoreError, make_directory,
};
use sha2::{Digest as _, Sha256};

use crate::{
    durable::{self, FOR_ALL},
    rig::SOFTWARE,
};

/// Their folder in a data directory.
pub(crate) const FOLDER: &str = "calibrations";

/// Why calibrations cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationsError {
    /// The folder or a file.
    #[error("{}", path.display())]
    File {
        /// Its path.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A file that is no calibration.
    #[error("{} is no calibration that this rigd reads", path.display())]
    Unreadable {
        /// Its path.
        path: PathBuf,
        /// Why not.
        source: UnreadableCalibration,
    },
    /// A number that TOML does not have.
    #[error("the calibration cannot be written as TOML")]
    Unwritable(#[from] rig_commission::Unwritable),
}

/// What the calibrations of a data directory show of a rig.
///
/// # Errors
/// [`CalibrationsError`]. A folder that is not there has none.
pub fn standing(basis: &Basis, data: &Path) -> Result<Standing, CalibrationsError> {
    Ok(Standing::of(&read(data)?, basis, Timestamp::now().as_second()))
}

/// All calibrations of a data directory, in the order of their names.
///
/// # Errors
/// [`CalibrationsError`]. A folder that is not there has none.
pub fn read(data: &Path) -> Result<Vec<Calibration>, CalibrationsError> {
    Ok(read_files(data)?.into_iter().map(|(_, calibration)| calibration).collect())
}

/// A file with a calibration.
struct Filed {
    path: PathBuf,
    text: String,
}

fn read_files(data: &Path) -> Result<Vec<(Filed, Calibration)>, CalibrationsError> {
    let folder = data.join(FOLDER);
    let failed = |path: &Path| {
        let path = path.to_owned();
        |source| CalibrationsError::File { path, source }
    };
    let entries = match fs::read_dir(&folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(failed(&folder))?,
    };
    let paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>, io::Error>>();
    let mut paths = paths.map_err(failed(&folder))?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).map_err(failed(&path))?;
        match Calibration::read(&text) {
            Ok(calibration) => Ok((Filed { path, text }, calibration)),
            Err(source) => Err(CalibrationsError::Unreadable { path, source }),
        }
    };
    paths.into_iter().map(read).collect()
}

/// The calibrations that hold now, and the last daily check whatever it says, for the record of a run.
///
/// # Errors
/// [`CalibrationsError`]. A folder that is not there has none.
pub(crate) fn cited(
    basis: &Basis,
    data: &Path,
) -> Result<Vec<CitedCalibration>, CalibrationsError> {
    let (files, records): (Vec<_>, Vec<_>) = read_files(data)?.into_iter().unzip();
    let now_s = Timestamp::now().as_second();
    let cite = |kind: Kind| {
        let found = match kind {
            Kind::Check => checks(&records, basis, None).pop()?,
            kind => holding(kind, &records, basis, now_s).ok()?,
        };
        let at = records.iter().position(|record| std::ptr::eq(record, found))?;
        let Filed { path, text } = files.get(at)?;
        Some(CitedCalibration {
            kind: kind.name().to_owned(),
            made: found.made().to_owned(),
            person: found.person().to_owned(),
            file: path.file_name()?.to_string_lossy().into_owned(),
            sha256: Digest::from_bytes(Sha256::digest(text.as_bytes()).into()).to_string(),
            verdict: (kind == Kind::Check).then(|| found.verdict.clone()),
            screw: screw(found),
            cable: None,
        })
    };
    Ok(Kind::ALL.into_iter().filter_map(cite).collect())
}

/// The map of the screw in a calibration; those of earlier versions have no covariance, and are not used.
fn screw(found: &Calibration) -> Option<ScrewMap> {
    let covariance_um2 = found.screw_covariance_um2.clone();
    let part = |part: usize| found.screw_mm.iter().map(|row| row[part]).collect();
    (!covariance_um2.is_empty()).then(|| ScrewMap {
        heights_mm: part(0),
        errors_mm: part(1),
        covariance_um2,
    })
}

/// Why a run is no measurement of a bench in one piece.
#[derive(Debug, thiserror::Error)]
pub(crate) enum InPieces {
    /// A part of it is missing.
    #[error("{run} is {status}, and not completed: begin a new one")]
    NotCompleted { run: String, status: String },
    /// What lay under the probe, and the zero of an axis, may be others than before.
    #[error(
        "{run} was resumed after an interruption, in which sample and axes may have moved: begin a new one"
    )]
    Resumed { run: String },
    /// A touch of it does not count.
    #[error("a touch of {run} was left out or measured again: begin a new one")]
    Amended { run: String },
    /// The record of the journal.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Refuses a run that does not show a bench in one piece.
///
/// # Errors
/// [`InPieces`].
pub(crate) fn in_one_piece(reader: &Reader, run: &Run) -> Result<(), InPieces> {
    let name = || run.short_name();
    let is_completed =
        matches!(run.status, RunStatus::Ended(Ending::Completed | Ending::CompletedWithRefusals));
    if !is_completed {
        return Err(InPieces::NotCompleted { run: name(), status: run.status.describe() });
    }
    if reader.records(run.id)?.iter().any(|stored| stored.kind == "resumed") {
        return Err(InPieces::Resumed { run: name() });
    }
    if run.amendments > 0 {
        return Err(InPieces::Amended { run: name() });
    }
    Ok(())
}

/// Who saw a step, in which session of the journal, and at which temperature.
#[derive(Debug, Clone)]
pub struct Witness {
    /// Name of the person.
    pub person: String,
    /// The session of the journal with the motions, or the runs that were evaluated.
    pub journal: Vec<String>,
    /// °C, if it was told.
    pub temperature_c: Option<f64>,
}

/// Writes a calibration that has just ended, waits for the disk, and returns its path.
///
/// # Errors
/// [`CalibrationsError`]. There is then no new file.
pub fn write(
    basis: &Basis,
    data: &Path,
    (kind, finding): (Kind, Finding),
    witness: Witness,
) -> Result<PathBuf, CalibrationsError> {
    let record = |around| Calibration::new(kind, finding, basis, around);
    keep(data, kind, witness, record)
}

/// Writes that a change of the bench has voided a calibration, and returns the path of the record.
///
/// # Errors
/// [`CalibrationsError`]. There is then no new file.
pub fn void(
    basis: &Basis,
    data: &Path,
    (kind, change): (Kind, BenchChange),
    witness: Witness,
) -> Result<PathBuf, CalibrationsError> {
    let record = |around| Calibration::void(kind, change, basis, around);
    keep(data, kind, witness, record)
}

/// Writes the record of a step of commissioning that has just ended, and returns its path. A homing that did not end well, after
/// the power of the drives went, takes along what rests on the zero of a drive.
///
/// # Errors
/// [`CalibrationsError`].
pub(crate) fn write_step(
    basis: &Basis,
    data: &Path,
    (step, finding): (Step, Finding),
    witness: Witness,
) -> Result<PathBuf, CalibrationsError> {
    if step == Step::Homing
        && finding.verdict != Verdict::Accepted
        && is_homing_begun(&read(data)?, basis)
    {
        // The record of the homing comes last: until then it is begun, and the others are voided again if this is interrupted.
        for &kind in BenchChange::Zero.voids().iter().filter(|kind| **kind != Kind::Homing) {
            void(basis, data, (kind, BenchChange::Zero), witness.clone())?;
        }
    }
    write(basis, data, (step.into(), finding), witness)
}

/// Writes that the power of the drives is about to go for a homing.
///
/// # Errors
/// [`CalibrationsError`].
pub(crate) fn begin_homing(
    basis: &Basis,
    data: &Path,
    witness: Witness,
) -> Result<(), CalibrationsError> {
    let record = |around| Calibration::begun(Kind::Homing, basis, around);
    keep(data, Kind::Homing, witness, record).map(drop)
}

/// Voids what rests on the zero of a drive if a homing was interrupted, and returns whether one was.
///
/// # Errors
/// [`CalibrationsError`].
pub(crate) fn void_after_interrupted_homing(
    basis: &Basis,
    data: &Path,
    witness: &Witness,
) -> Result<bool, CalibrationsError> {
    if !is_homing_begun(&read(data)?, basis) {
        return Ok(false);
    }
    let kinds = BenchChange::Zero.voids();
    // That of the homing is the last one.
    let (homing, others): (Vec<Kind>, Vec<_>) =
        kinds.iter().partition(|kind| **kind == Kind::Homing);
    for kind in others.into_iter().chain(homing) {
        void(basis, data, (kind, BenchChange::Zero), witness.clone())?;
    }
    Ok(true)
}

/// What is said after that.
pub(crate) const HOMING_WAS_INTERRUPTED: &str = "A homing was interrupted: the zero of a drive may be at another place. The steps that rest \
     on it are asked for again.";

/// What is said when each step has its record and the rig is not in service all the same.
pub(crate) fn not_in_service(missing: &str) -> String {
    format!("No step of commissioning is missing. The rig is not in service: {missing}.")
}

/// Writes a daily check by runs that ended at `made`, and returns the path of its record.
///
/// # Errors
/// [`CalibrationsError`]. There is then no new file.
pub(crate) fn keep_check(
    data: &Path,
    made: Timestamp,
    witness: Witness,
    record: impl FnOnce(Circumstances) -> Calibration,
) -> Result<PathBuf, CalibrationsError> {
    keep_at((made, made), data, Kind::Check, witness, record)
}

/// Writes a calibration by runs that ended at `made`, from when on it holds, and returns its path. The same runs may be judged
/// again: the name of the file has the time of now.
///
/// # Errors
/// [`CalibrationsError`]. There is then no new file.
pub(crate) fn write_of_runs(
    basis: &Basis,
    data: &Path,
    made: Timestamp,
    (kind, finding): (Kind, Finding),
    witness: Witness,
) -> Result<PathBuf, CalibrationsError> {
    let record = |around| Calibration::new(kind, finding, basis, around);
    // The clock may have been set back since.
    let now = Timestamp::now();
    keep_at((made.min(now), now), data, kind, witness, record)
}

fn keep(
    data: &Path,
    kind: Kind,
    witness: Witness,
    record: impl FnOnce(Circumstances) -> Calibration,
) -> Result<PathBuf, CalibrationsError> {
    let now = Timestamp::now();
    keep_at((now, now), data, kind, witness, record)
}

fn keep_at(
    (made, named): (Timestamp, Timestamp),
    data: &Path,
    kind: Kind,
    witness: Witness,
    record: impl FnOnce(Circumstances) -> Calibration,
) -> Result<PathBuf, CalibrationsError> {
    let Witness { person, journal, temperature_c } = witness;
    let last = read(data)?.iter().map(Calibration::sequence).max().unwrap_or(0);
    let calibration = record(Circumstances {
        sequence: last + 1,
        unix_s: made.as_second(),
        made: made.strftime("%Y-%m-%dT%H:%M:%SZ").to_string(),
        person,
        software: SOFTWARE.to_owned(),
        journal,
        temperature_c,
    });
    let folder = data.join(FOLDER);
    // Names of one kind sort by time, also within a second.
    let path = folder.join(file_name(kind, &named.strftime("%Y%m%dT%H%M%S.%6fZ").to_string()));
    let text = calibration.to_toml()?;
    let failed = |source| CalibrationsError::File { path: path.clone(), source };
    make_directory(&folder).map_err(failed)?;
    durable::replace_bytes(&path, text.as_bytes(), FOR_ALL).map_err(failed)?;
    Ok(path)
}
