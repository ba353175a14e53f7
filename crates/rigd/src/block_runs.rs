//! What runs on hard blocks show of a bench: the surfaces that their touches have found, as the journal has them.

use std::path::{Path, PathBuf};

use rig_commission::{
    Basis, Finding, Kind,
    metrology::BlockTouch,
    repeatability::{LevelTouch, TooFewTouches, repeatability},
};
use rig_store::{Reader, Record, Run, StoreError};

use crate::{
    bench_check::tilt_deg,
    calibrations::{self, CalibrationsError, Witness},
    loaded_rig::FileError,
};

/// Largest tilt of a touch that counts as level, degrees.
const LEVEL_DEG: f64 = 1.0;

/// Why a run on a block shows nothing.
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
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
}

/// The surfaces that a run has found, in order, each with its standard deviation, mm. The other mounting of the sensor has
/// the ball elsewhere. Heights and tilts of another scale or zero are not those of the present rig file.
///
/// # Errors
/// [`BlockRunError`].
pub(crate) fn of_run(
    reader: &Reader,
    run: &Run,
    raised_mm: f64,
    basis: &Basis,
) -> Result<Vec<(BlockTouch, f64)>, BlockRunError> {
    let mut touches = Vec::new();
    for stored in reader.records(run.id)? {
        if !["run_started", "surface_found"].contains(&stored.kind.as_str()) {
            continue;
        }
        let surface = match stored.record().map_err(StoreError::from)? {
            Record::SurfaceFound(surface) => surface,
            Record::RunStarted(started) => {
                if !calibrations::has_axes_of(&started, basis)? {
                    return Err(BlockRunError::OtherAxes { run: run.short_name() });
                }
                continue;
            }
            _ => continue,
        };
        let Some(tilt_deg) = tilt_deg(surface.pose) else { continue };
        let touch = BlockTouch { tilt_deg, height_mm: surface.position_mm, raised_mm };
        touches.push((touch, surface.sigma_mm));
    }
    Ok(touches)
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
    (person, temperature_c): (String, Option<f64>),
) -> Result<(Finding, PathBuf), BlockRunError> {
    let level: Vec<LevelTouch> = of_run(reader, run, 0.0, basis)?
        .into_iter()
        .filter(|(touch, _)| touch.tilt_deg.abs() < LEVEL_DEG)
        .map(|(touch, sigma_mm)| LevelTouch { height_mm: touch.height_mm, sigma_mm })
        .collect();
    let too_few = |too_few| BlockRunError::TooFew { run: run.short_name(), too_few };
    let finding = repeatability(&level).map_err(too_few)?;
    let witness = Witness { person, journal: vec![run.id.to_string()], temperature_c };
    let path = calibrations::write(basis, data, (Kind::Touches, finding.clone()), witness)?;
    Ok((finding, path))
}
