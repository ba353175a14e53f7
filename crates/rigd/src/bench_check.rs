//! The daily check of a bench: from two runs in the journal to a judged record beside the calibrations.

pub(crate) mod trend;

use std::path::{Path, PathBuf};

use jiff::{SignedDuration, Timestamp};
use rig_commission::{
    Basis, Calibration, Kind,
    check::{BlockHeight, CheckValues, Checked, Readings, Unmeasured, judge},
    checks,
};
use rig_model::{ContactAngle, Direction, counted};
use rig_record::{Digest, DigestPart, SweepOutcome, SweepPurpose};
use rig_store::{Reader, Record, Run, RunStarted, RunStatus, StoreError};

use crate::{
    calibrations::{self, CalibrationsError, InPieces, Witness, in_one_piece},
    loaded_rig::{FileError, RigFacts},
    local_time::local,
    protocol_file::LoadedProtocol,
    run_of_bench::{NotOfBench, is_of_bench, still_shows, times},
};

/// The shipped protocols of a check.
const BLOCK: (&str, &str) =
    ("check-block.toml", include_str!("../../../config/protocols/check-block.toml"));
const REFERENCES: (&str, &str) =
    ("check-references.toml", include_str!("../../../config/protocols/check-references.toml"));

/// The kinds of records from which a check is read.
const KINDS: [&str; 4] = ["run_started", "surface_found", "sweep", "touch_result"];

/// How long after the end of the touches on the block those on the references may begin. A check is of one day: over more time the
/// bench may change between both parts.
const TOGETHER: SignedDuration = SignedDuration::from_hours(12);

/// Why a bench was not checked.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CheckError {
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Unmeasured(#[from] Unmeasured),
    #[error(transparent)]
    NotOfBench(#[from] NotOfBench),
    #[error("{run} has {}, and {part} has {needed}", counted(*found, "sample"))]
    Samples { run: String, found: usize, part: &'static str, needed: usize },
    #[error(transparent)]
    InPieces(#[from] InPieces),
    #[error("{run} belongs to the check of {made} already, and a run counts once")]
    Used { run: String, made: String },
    #[error(
        "{references} was begun {} and {block} ended {}: the references are touched after the block, and within {} h",
        local(begun), local(ended), TOGETHER.as_hours()
    )]
    Apart { block: String, ended: String, references: String, begun: String },
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
    let records = calibrations::read(data)?;
    let mut readings = Readings::default();
    let on_block = read(reader, block, rig, ("the check on the block", 1), &mut readings)?;
    let part = ("the check on the references", 2);
    let on_references = read(reader, references, rig, part, &mut readings)?;
    let made = admit([block, references], &records, basis)?;
    let values = readings.values()?;
    let texts = [&on_block, &on_references].map(|run| DigestPart::Text(&run.protocol.toml));
    let protocols = Digest::of(texts).to_string();
    let mut before = checks(&records, basis, Some(&protocols));
    before.retain(|record| record.made_unix_s() <= made.as_second());
    let mut all: Vec<_> = before.iter().filter_map(|record| CheckValues::of(record)).collect();
    all.push(values);
    let judged = judge(&all);
    let record = |around| Calibration::check(values, &judged, protocols, basis, around);
    let record = calibrations::keep_check(data, made, witness, record)?;
    let trend = trend::write(name, basis, data)?;
    Ok(KeptCheck { values, judged, record, trend })
}

/// The time of a check, which is the end of its runs.
///
/// # Errors
/// [`CheckError`], if both runs are not one check of the bench as it is now, or if a check has used one of them.
fn admit(runs: [&Run; 2], records: &[Calibration], basis: &Basis) -> Result<Timestamp, CheckError> {
    for run in runs {
        let id = run.id.to_string();
        let is_used =
            |record: &&Calibration| record.kind == Kind::Check && record.journal().contains(&id);
        if let Some(used) = records.iter().find(is_used) {
            return Err(CheckError::Used { run: run.short_name(), made: local(used.made()) });
        }
    }
    let [block, references] = runs;
    let [on_block, on_references] = [times(block)?, times(references)?];
    let after = on_references.begun.duration_since(on_block.ended);
    if after < SignedDuration::ZERO || TOGETHER < after {
        return Err(CheckError::Apart {
            block: block.short_name(),
            ended: on_block.ended.to_string(),
            references: references.short_name(),
            begun: references.started_at.clone(),
        });
    }
    still_shows(block, Kind::Check, Timestamp::now(), (records, basis))?;
    Ok(on_references.ended)
}

/// Adds what a run has measured to the readings, and returns its first record. `part` names the run and the number of its
/// samples.
fn read(
    reader: &Reader,
    run: &Run,
    rig: (&str, &Basis),
    (part, needed): (&'static str, usize),
    readings: &mut Readings,
) -> Result<RunStarted, CheckError> {
    if run.status != RunStatus::Running {
        in_one_piece(reader, run)?;
    }
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
                is_of_bench(run, &started, rig)?;
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
