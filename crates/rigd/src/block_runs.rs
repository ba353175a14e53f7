//! What the surfaces that the touches of a run have found show of a bench, as the journal has them.

use std::path::{Path, PathBuf};

use rig_commission::{
    Basis, Finding, Kind,
    latency::{DescentTouch, NoLatency, StatedLatency, latency},
    metrology::BlockTouch,
    repeatability::{LevelTouch, TooFewTouches, repeatability},
};
use rig_model::ReadingStream;
use rig_store::{Onset, Reader, Record, Run, StoreError};

use crate::{
    bench_check::tilt_deg,
    calibrations::{self, CalibrationsError, Witness},
    loaded_rig::FileError,
};

/// Largest tilt of a touch that counts as level, degrees.
const LEVEL_DEG: f64 = 1.0;

/// Why a run shows nothing.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BlockRunError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    RigFile(#[from] FileError),
    #[error("{run} was made with other values of [linear] or [rotary] than the rig file has now")]
    OtherAxes { run: String },
    #[error("{run} has {too_few}")]
    TooFew { run: String, too_few: TooFewTouches },
    #[error("{run} has {no_latency}")]
    NoLatency { run: String, no_latency: NoLatency },
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
}

/// A surface that a touch of a run has found.
struct FoundSurface {
    tilt_deg: f64,
    height_mm: f64,
    sigma_mm: f64,
    /// Speed of its descent, mm/s, and its fit; `None` for a search in steps.
    descent: Option<(f64, Onset)>,
}

/// The surfaces that a run has found, in order. The other mounting of the sensor has the ball elsewhere. Heights and tilts of
/// another scale or zero are not those of the present rig file.
fn surfaces(reader: &Reader, run: &Run, basis: &Basis) -> Result<Vec<FoundSurface>, BlockRunError> {
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
                if !calibrations::has_axes_of(&started, basis)? {
                    return Err(BlockRunError::OtherAxes { run: run.short_name() });
                }
                continue;
            }
            _ => continue,
        };
        let descent = speed_mm_per_s.take().zip(surface.onset);
        let Some(tilt_deg) = tilt_deg(surface.pose) else { continue };
        let (height_mm, sigma_mm) = (surface.position_mm, surface.sigma_mm);
        surfaces.push(FoundSurface { tilt_deg, height_mm, sigma_mm, descent });
    }
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
    basis: &Basis,
) -> Result<Vec<(BlockTouch, f64)>, BlockRunError> {
    let touch = |surface: FoundSurface| {
        let FoundSurface { tilt_deg, height_mm, sigma_mm, .. } = surface;
        (BlockTouch { tilt_deg, height_mm, raised_mm }, sigma_mm)
    };
    Ok(surfaces(reader, run, basis)?.into_iter().map(touch).collect())
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
    basis: &Basis,
    data: &Path,
    person: (String, Option<f64>),
) -> Result<(Finding, PathBuf), BlockRunError> {
    let level: Vec<LevelTouch> = surfaces(reader, run, basis)?
        .into_iter()
        .filter(is_level)
        .map(|FoundSurface { height_mm, sigma_mm, .. }| LevelTouch { height_mm, sigma_mm })
        .collect();
    let too_few = |too_few| BlockRunError::TooFew { run: run.short_name(), too_few };
    let finding = repeatability(&level).map_err(too_few)?;
    keep((Kind::Touches, finding), run, (basis, data), person)
}

/// Finds the latency by the level touches of a run whose surfaces were found by descents, keeps the record, and returns
/// both, as [`keep_repeatability`] does.
///
/// # Errors
/// [`BlockRunError`]. There is then no new record.
pub(crate) fn keep_latency(
    (reader, run): (&Reader, &Run),
    stated: ReadingStream,
    (basis, data): (&Basis, &Path),
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
    let level = surfaces(reader, run, basis)?.into_iter().filter(is_level);
    let touches: Vec<DescentTouch> = level.filter_map(touch).collect();
    let ReadingStream { latency_s, latency_sigma_s, .. } = stated;
    let finding = latency(&touches, StatedLatency { latency_s, sigma_s: latency_sigma_s });
    let none = |no_latency| BlockRunError::NoLatency { run: run.short_name(), no_latency };
    keep((Kind::Latency, finding.map_err(none)?), run, (basis, data), person)
}

fn keep(
    (kind, finding): (Kind, Finding),
    run: &Run,
    (basis, data): (&Basis, &Path),
    (person, temperature_c): (String, Option<f64>),
) -> Result<(Finding, PathBuf), BlockRunError> {
    let witness = Witness { person, journal: vec![run.id.to_string()], temperature_c };
    let path = calibrations::write(basis, data, (kind, finding.clone()), witness)?;
    Ok((finding, path))
}
