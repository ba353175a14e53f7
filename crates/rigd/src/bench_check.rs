//! The daily check of a bench: from two runs in the journal to a judged record beside the calibrations.

pub(crate) mod trend;

use std::path::{Path, PathBuf};

use rig_commission::{
    Basis, Calibration,
    check::{BlockHeight, CheckValues, Checked, Readings, Unmeasured, judge},
    checks,
};
use rig_model::{ContactAngle, Direction};
use rig_record::{Digest, DigestPart, SweepOutcome, SweepPurpose};
use rig_store::{Reader, Record, Run, RunStarted, StoreError};

use crate::{
    calibrations::{self, CalibrationsError, Witness},
    loaded_rig::{FileError, RigFacts},
    protocol_file::LoadedProtocol,
};

/// The shipped protocols of a check.
const BLOCK: (&str, &str) =
    ("check-block.toml", include_str!("../../../config/protocols/check-block.toml"));
const REFERENCES: (&str, &str) =
    ("check-references.toml", include_str!("../../../config/protocols/check-references.toml"));

/// The kinds of records from which a check is read.
const KINDS: [&str; 4] = ["run_started", "surface_found", "sweep", "touch_result"];

/// Why a bench was not checked.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CheckError {
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    RigFile(#[from] FileError),
    #[error(transparent)]
    Unmeasured(#[from] Unmeasured),
    #[error("{run} was made with other values of [linear] or [rotary] than the rig file has now")]
    OtherAxes { run: String },
    #[error("{run} has {found} samples, and {part} has {needed}")]
    Samples { run: String, found: usize, part: &'static str, needed: usize },
    #[error("{}", path.display())]
    Trend { path: PathBuf, source: std::io::Error },
}

/// The protocols of a check, on the block and on the references: those of these files, or the shipped ones.
///
/// # Errors
/// [`FileError`], with every fault of a file on this rig.
pub(crate) fn protocols(
    files: [Option<&Path>; 2],
    rig: &RigFacts,
) -> Result<[LoadedProtocol; 2], FileError> {
    let load = |file: Option<&Path>, (name, text): (&str, &str)| match file {
        Some(path) => LoadedProtocol::load(path, rig),
        None => LoadedProtocol::check(name, text, rig).map_err(FileError::Faults),
    };
    let [block, references] = files;
    Ok([load(block, BLOCK)?, load(references, REFERENCES)?])
}

/// A check that was judged and kept.
#[derive(Debug)]
pub(crate) struct KeptCheck {
    /// Its values.
    pub(crate) values: CheckValues,
    /// What the charts say.
    pub(crate) judged: Checked,
    /// Its record.
    pub(crate) record: PathBuf,
    /// The page with the trend.
    pub(crate) trend: PathBuf,
}

/// Judges a check by its runs, on the block and on the references, and keeps it.
///
/// # Errors
/// [`CheckError`]. There is then no new record.
pub(crate) fn keep(
    rig: (&str, &Basis),
    data: &Path,
    reader: &Reader,
    [block, references]: [&Run; 2],
    witness: Witness,
) -> Result<KeptCheck, CheckError> {
    let (name, basis) = rig;
    let mut readings = Readings::default();
    let on_block = read(reader, block, basis, ("the check on the block", 1), &mut readings)?;
    let part = ("the check on the references", 2);
    let on_references = read(reader, references, basis, part, &mut readings)?;
    let values = readings.values()?;
    let texts = [&on_block, &on_references].map(|run| DigestPart::Text(&run.protocol.toml));
    let protocols = Digest::of(texts).to_string();
    let records = calibrations::read(data)?;
    let before = checks(&records, basis, Some(&protocols));
    let mut all: Vec<_> = before.iter().filter_map(|record| CheckValues::of(record)).collect();
    all.push(values);
    let judged = judge(&all);
    let record = |around| Calibration::check(values, &judged, protocols, basis, around);
    let record = calibrations::keep_check(data, witness, record)?;
    let trend = trend::write(name, basis, data)?;
    Ok(KeptCheck { values, judged, record, trend })
}

/// Adds what a run has measured to the readings, and returns its first record. `part` names the run and the number of its
/// samples.
fn read(
    reader: &Reader,
    run: &Run,
    basis: &Basis,
    (part, needed): (&'static str, usize),
    readings: &mut Readings,
) -> Result<RunStarted, CheckError> {
    let mut begun = None;
    for stored in reader.records(run.id)? {
        if !KINDS.contains(&stored.kind.as_str()) {
            continue;
        }
        match stored.record().map_err(StoreError::from)? {
            Record::RunStarted(started) => {
                let found = started.samples.len();
                if found != needed {
                    return Err(CheckError::Samples { run: run.short_name(), found, part, needed });
                }
                if !calibrations::has_axes_of(&started, basis)? {
                    return Err(CheckError::OtherAxes { run: run.short_name() });
                }
                begun = Some(started);
            }
            Record::SurfaceFound(surface) if needed == 1 => {
                let height_mm = surface.position_mm;
                let tilt = tilt_deg(surface.pose);
                readings.block.extend(tilt.map(|tilt_deg| BlockHeight { tilt_deg, height_mm }));
            }
            Record::Sweep(sweep) if sweep.purpose == SweepPurpose::NoLoad => {
                if let SweepOutcome::Accepted { resonance_hz, .. } = sweep.outcome {
                    readings.free_hz.push(resonance_hz);
                }
            }
            Record::TouchResult(touch) if needed == 2 => {
                let samples = begun.iter().flat_map(|begun: &RunStarted| &begun.samples);
                let index = samples.into_iter().position(|known| known.name == touch.touch.sample);
                if let Some(shifts) = index.and_then(|index| readings.references_hz.get_mut(index))
                {
                    shifts.push(touch.shift_hz);
                }
            }
            _ => {}
        }
    }
    // The journal of a run begins with this record.
    begun.ok_or(CheckError::Samples { run: run.short_name(), found: 0, part, needed })
}

/// Where the rotary stage stands in a pose, degrees; `None` with the sensor turned, when the ball is elsewhere.
pub(crate) fn tilt_deg(pose: rig_record::Pose) -> Option<f64> {
    let direction = match pose.direction {
        rig_record::Direction::Front => Direction::Front,
        rig_record::Direction::Back => Direction::Back,
        rig_record::Direction::Left => return None,
    };
    let angle = ContactAngle::new(pose.angle_deg).ok()?;
    Some(direction.rotary_position(angle).value())
}
