//! What the surfaces that the touches of a run have found show of a bench, as the journal has them.

use std::path::{Path, PathBuf};

use jiff::Timestamp;
use rig_commission::{
    Basis, Finding, Kind, holding,
    latency::{DescentTouch, NoLatency, StatedLatency, latency},
    metrology::{BlockTouch, NoGeometry, PinPrior, PinTouch, TouchNoise},
    prior_by_blocks, prior_by_rule, probe_radius,
    repeatability::{LevelTouch, TooFewTouches, repeatability},
};
use rig_files::rig_file::RigFile;
use rig_model::{Geometry, ReadingStream, RigLimits};
use rig_store::{Onset, Reader, Record, Run, RunStarted, StoreError};

use crate::{
    bench_check::tilt_deg,
    calibrations::{self, CalibrationsError, InPieces, Witness, in_one_piece},
    loaded_rig::FileError,
    run_of_bench::{NotOfBench, is_of_bench, still_shows, times},
};

/// Largest tilt of a touch that counts as level, degrees.
const LEVEL_DEG: f64 = 1.0;

/// Error of a tilt, as a share of the tolerance of the rotary stage.
const TILT_SHARE: f64 = 0.5;

/// Difference of two radii of a pin that are the same, mm: the last digit that a person writes.
const SAME_PIN_MM: f64 = 0.000_5;

/// Why a run shows nothing.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BlockRunError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    RigFile(#[from] FileError),
    #[error(transparent)]
    NotOfBench(#[from] NotOfBench),
    #[error("{run} has {too_few}")]
    TooFew { run: String, too_few: TooFewTouches },
    #[error("{run} has {no_latency}")]
    NoLatency { run: String, no_latency: NoLatency },
    #[error("{run} was made without geometry.pin_radius_mm in its rig file: it is no run on a pin")]
    NoPin { run: String },
    #[error(
        "{run} was made with geometry.pin_radius_mm = {run_mm} in its rig file, but {asked_mm} mm was given"
    )]
    OtherPin { run: String, run_mm: f64, asked_mm: f64 },
    #[error("{run}: {why}")]
    NoRadius { run: String, why: NoGeometry },
    #[error(transparent)]
    NoGeometry(#[from] NoGeometry),
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
    #[error(transparent)]
    InPieces(#[from] InPieces),
}

/// The bench that a run shows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bench<'a> {
    /// Name of the rig.
    pub(crate) rig: &'a str,
    /// What its calibrations rest on.
    pub(crate) basis: &'a Basis,
    /// The data directory, with them.
    pub(crate) data: &'a Path,
}

/// A surface that a touch of a run has found.
struct FoundSurface {
    tilt_deg: f64,
    height_mm: f64,
    sigma_mm: f64,
    /// Speed of its descent, mm/s, and its fit; `None` for a search in steps.
    descent: Option<(f64, Onset)>,
}

/// The surfaces that a run has found, in order, for a calibration of a kind. The other mounting of the sensor has the ball
/// elsewhere. A run that does not show the bench as it is now has none.
fn surfaces(
    reader: &Reader,
    run: &Run,
    kind: Kind,
    bench: Bench<'_>,
) -> Result<Vec<FoundSurface>, BlockRunError> {
    in_one_piece(reader, run)?;
    let mut surfaces = Vec::new();
    let mut speed_mm_per_s = None;
    for stored in reader.records(run.id)? {
        if !["run_started", "descended", "surface_found"].contains(&stored.kind.as_str()) {
            continue;
        }
        let surface = match stored.record().map_err(StoreError::from)? {
            Record::SurfaceFound(surface) => surface,
            Record::Descended(descent) => {
                speed_mm_per_s = Some(descent.speed_mm_per_s);
                continue;
            }
            Record::RunStarted(started) => {
                is_of_bench(run, &started, (bench.rig, bench.basis))?;
                continue;
            }
            _ => continue,
        };
        let descent = speed_mm_per_s.take().zip(surface.onset);
        let Some(tilt_deg) = tilt_deg(surface.pose) else { continue };
        let (height_mm, sigma_mm) = (surface.position_mm, surface.sigma_mm);
        surfaces.push(FoundSurface { tilt_deg, height_mm, sigma_mm, descent });
    }
    let known = calibrations::read(bench.data)?;
    still_shows(run, kind, Timestamp::now(), (&known, bench.basis))?;
    Ok(surfaces)
}

/// The surfaces that a run on a block has found, in order, each with its standard deviation, mm.
///
/// # Errors
/// [`BlockRunError`].
pub(crate) fn of_run(
    reader: &Reader,
    run: &Run,
    raised_mm: f64,
    (kind, bench): (Kind, Bench<'_>),
) -> Result<Vec<(BlockTouch, f64)>, BlockRunError> {
    let touch = |surface: FoundSurface| {
        let FoundSurface { tilt_deg, height_mm, sigma_mm, .. } = surface;
        (BlockTouch { tilt_deg, height_mm, raised_mm }, sigma_mm)
    };
    Ok(surfaces(reader, run, kind, bench)?.into_iter().map(touch).collect())
}

/// A level touch of the sensor as it was first mounted.
fn is_level(surface: &FoundSurface) -> bool {
    surface.tilt_deg.abs() < LEVEL_DEG
}

/// Judges how well the level touches of a run repeat, keeps the record, and returns both. A record that is not accepted is
/// kept as well.
///
/// # Errors
/// [`BlockRunError`]. There is then no new record.
pub(crate) fn keep_repeatability(
    (reader, run): (&Reader, &Run),
    bench: Bench<'_>,
    person: (String, Option<f64>),
) -> Result<(Finding, PathBuf), BlockRunError> {
    let level: Vec<LevelTouch> = surfaces(reader, run, Kind::Touches, bench)?
        .into_iter()
        .filter(is_level)
        .map(|FoundSurface { height_mm, sigma_mm, .. }| LevelTouch { height_mm, sigma_mm })
        .collect();
    let too_few = |too_few| BlockRunError::TooFew { run: run.short_name(), too_few };
    let finding = repeatability(&level).map_err(too_few)?;
    keep((Kind::Touches, finding), run, bench, person)
}

/// Finds the latency by the level touches of a run whose surfaces were found by descents, keeps the record, and returns
/// both, as [`keep_repeatability`] does.
///
/// # Errors
/// [`BlockRunError`]. There is then no new record.
pub(crate) fn keep_latency(
    (reader, run): (&Reader, &Run),
    stated: ReadingStream,
    bench: Bench<'_>,
    person: (String, Option<f64>),
) -> Result<(Finding, PathBuf), BlockRunError> {
    let touch = |surface: FoundSurface| {
        let (speed_mm_per_s, onset) = surface.descent?;
        Some(DescentTouch {
            speed_mm_per_s,
            surface_mm: surface.height_mm,
            latency_s: onset.latency_s,
            mm_per_latency_s: onset.mm_per_latency_s,
        })
    };
    let level = surfaces(reader, run, Kind::Latency, bench)?.into_iter().filter(is_level);
    let touches: Vec<DescentTouch> = level.filter_map(touch).collect();
    let ReadingStream { latency_s, latency_sigma_s, .. } = stated;
    let finding = latency(&touches, StatedLatency { latency_s, sigma_s: latency_sigma_s });
    let none = |no_latency| BlockRunError::NoLatency { run: run.short_name(), no_latency };
    keep((Kind::Latency, finding.map_err(none)?), run, bench, person)
}

fn keep(
    (kind, finding): (Kind, Finding),
    run: &Run,
    Bench { basis, data, .. }: Bench<'_>,
    (person, temperature_c): (String, Option<f64>),
) -> Result<(Finding, PathBuf), BlockRunError> {
    let witness = Witness { person, journal: vec![run.id.to_string()], temperature_c };
    let (made, found) = (times(run)?.ended, (kind, finding.clone()));
    let path = calibrations::write_of_runs(basis, data, made, found, witness)?;
    Ok((finding, path))
}

/// The standard deviations of touches: of their heights by the search, and of their tilts by the tolerance of the stage.
pub(crate) fn noise(
    sigmas_mm: impl ExactSizeIterator<Item = f64>,
    limits: &RigLimits,
) -> TouchNoise {
    let count = sigmas_mm.len().max(1) as f64;
    let variance = sigmas_mm.map(|sigma_mm| sigma_mm * sigma_mm).sum::<f64>() / count;
    TouchNoise { height_mm: variance.sqrt(), tilt_deg: TILT_SHARE * limits.rotary.tolerance() }
}

/// The radius of the ball that touches on a pin have shown, with its record.
#[derive(Debug)]
pub(crate) struct KeptRadius {
    /// What was found.
    pub(crate) finding: Finding,
    /// The record.
    pub(crate) path: PathBuf,
    /// Number of touches.
    pub(crate) touches: usize,
    /// When the blocks were touched whose record says where the rotary axis is; `None` if a rule has shown it.
    pub(crate) blocks: Option<String>,
}

/// Finds the radius of the ball by the touches of a run on a pin of radius `pin_mm`, keeps the record, and returns both. A
/// record that is not accepted is kept as well.
///
/// # Errors
/// [`BlockRunError`]. There is then no new record.
pub(crate) fn keep_probe_radius(
    (reader, run): (&Reader, &Run),
    pin_mm: f64,
    limits: &RigLimits,
    bench: Bench<'_>,
    person: (String, Option<f64>),
) -> Result<KeptRadius, BlockRunError> {
    let found = of_run(reader, run, 0.0, (Kind::Pin, bench))?;
    is_of_pin(reader, run, pin_mm)?;
    let (prior, blocks) = prior(bench.basis, &limits.geometry, bench.data)?;
    let noise = noise(found.iter().map(|(_, sigma_mm)| *sigma_mm), limits);
    let touch = |(touch, _): &(BlockTouch, f64)| PinTouch {
        tilt_deg: touch.tilt_deg,
        height_mm: touch.height_mm,
    };
    let touches: Vec<PinTouch> = found.iter().map(touch).collect();
    let radii = (pin_mm, limits.geometry.probe_radius_mm);
    let finding = probe_radius(&touches, &noise, &prior, radii)
        .map_err(|why| BlockRunError::NoRadius { run: run.short_name(), why })?;
    let (finding, path) = keep((Kind::Pin, finding), run, bench, person)?;
    Ok(KeptRadius { finding, path, touches: touches.len(), blocks })
}

/// Refuses a run whose rig file has no pin, or one of another radius.
fn is_of_pin(reader: &Reader, run: &Run, asked_mm: f64) -> Result<(), BlockRunError> {
    let begun = reader.records(run.id)?.into_iter().find(|stored| stored.kind == "run_started");
    let begun = begun.map(|stored| stored.record()).transpose().map_err(StoreError::from)?;
    let rig = match begun {
        Some(Record::RunStarted(RunStarted { rig, .. })) => {
            Some(RigFile::read(&rig.name, &rig.toml).map_err(FileError::Faults)?)
        }
        _ => None,
    };
    let name = run.short_name();
    match rig.and_then(|rig| rig.limits.geometry.pin_radius_mm) {
        None => Err(BlockRunError::NoPin { run: name }),
        Some(run_mm) if (run_mm - asked_mm).abs() < SAME_PIN_MM => Ok(()),
        Some(run_mm) => Err(BlockRunError::OtherPin { run: name, run_mm, asked_mm }),
    }
}

/// Where the rotary axis and the probe are, and the time of the record of blocks that says so.
fn prior(
    basis: &Basis,
    geometry: &Geometry,
    data: &Path,
) -> Result<(PinPrior, Option<String>), BlockRunError> {
    let records = calibrations::read(data)?;
    let blocks = holding(Kind::Blocks, &records, basis, Timestamp::now().as_second()).ok();
    let by_blocks = blocks.and_then(|blocks| {
        let prior = prior_by_blocks(blocks, geometry.probe_radius_mm)?;
        Some((prior, Some(blocks.made().to_owned())))
    });
    Ok(by_blocks.unwrap_or_else(|| (prior_by_rule(geometry), None)))
}
