//! The geometry of a bench, and the error of its linear screw, by runs on hard flat blocks, as the journal has them.

use std::path::PathBuf;

use jiff::Timestamp;
use rig_commission::{
    Change, Finding, Kind, Value,
    metrology::{BlockGeometry, BlockTouch, fit},
};
use rig_model::{Geometry, RigLimits};
use rig_store::{Reader, Run};

use crate::{
    block_runs::{Bench, BlockRunError, noise, of_run},
    calibrations::{self, Witness},
    run_of_bench::{NotOfBench, times},
};

/// Differences from the rig file that are accepted, beyond three standard deviations.
const LENGTH_MM: f64 = 0.05;
const ANGLE_DEG: f64 = 0.1;

/// The geometry that touches on blocks have shown, with its record.
#[derive(Debug)]
pub(crate) struct KeptGeometry {
    /// What was found.
    pub(crate) finding: Finding,
    /// The record.
    pub(crate) path: PathBuf,
    /// Number of touches.
    pub(crate) touches: usize,
}

/// Finds the geometry by the touches of runs on blocks, each with its height above the first block, mm, keeps the record, and
/// returns both. `zero_deg` is the zero of the rotary stage in the rig file. A record that is not accepted is kept as well.
///
/// # Errors
/// [`BlockRunError`]. There is then no new record.
pub(crate) fn keep_geometry(
    reader: &Reader,
    runs: &[(Run, f64)],
    (limits, zero_deg): (&RigLimits, f64),
    bench: Bench<'_>,
    (person, temperature_c): (String, Option<f64>),
) -> Result<KeptGeometry, BlockRunError> {
    let mut found = Vec::new();
    for (run, raised_mm) in runs {
        found.extend(of_run(reader, run, *raised_mm, (Kind::Blocks, bench))?);
    }
    let (touches, sigmas_mm): (Vec<BlockTouch>, Vec<f64>) = found.into_iter().unzip();
    let noise = noise(sigmas_mm.into_iter(), limits);
    let geometry = fit(&touches, &noise, &heights(&touches))?;
    let finding = finding(&limits.geometry, zero_deg, &geometry);
    let journal = runs.iter().map(|(run, _)| run.id.to_string()).collect();
    let witness = Witness { person, journal, temperature_c };
    // It holds as long as its oldest run.
    let ended = runs.iter().map(|(run, _)| times(run).map(|times| times.ended));
    let ended = ended.collect::<Result<Vec<_>, NotOfBench>>()?;
    let made = ended.into_iter().min().unwrap_or_else(Timestamp::now);
    let found = (Kind::Blocks, finding.clone());
    let path = calibrations::write_of_runs(bench.basis, bench.data, made, found, witness)?;
    Ok(KeptGeometry { finding, path, touches: touches.len() })
}

/// Distance between the heights of the map of the screw, and how far it goes beyond the touches, mm. Between two heights the
/// error is a straight line, which is half of the shortest length over which the fit lets it change.
const MAP_STEP_MM: f64 = 0.1;
const MAP_BEYOND_MM: f64 = 0.1;

/// Most heights of a map: a bench with a longer way of touches has a wrong touch.
const MAP_HEIGHTS: u32 = 200;

/// Heights for the map of the screw, mm: from below the lowest touch to above the highest one.
fn heights(touches: &[BlockTouch]) -> Vec<f64> {
    let ends = touches.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), touch| {
        (low.min(touch.height_mm), high.max(touch.height_mm))
    });
    let (low, high) = (ends.0 - MAP_BEYOND_MM, ends.1 + MAP_BEYOND_MM);
    (0..MAP_HEIGHTS)
        .map(|step| low + MAP_STEP_MM * f64::from(step))
        .take_while(|height| *height < high + MAP_STEP_MM)
        .collect()
}

fn finding(geometry: &Geometry, zero_deg: f64, found: &BlockGeometry) -> Finding {
    let sigmas = found.sigmas();
    let rows = [
        ("geometry.surface_mm", geometry.surface.value(), found.surface_mm, "mm"),
        (
            "geometry.surface_above_pivot_mm",
            geometry.surface_above_pivot_mm,
            found.surface_and_radius_mm - geometry.probe_radius_mm,
            "mm",
        ),
        (
            "geometry.probe_beside_pivot_mm",
            geometry.probe_beside_pivot_mm,
            found.probe_beside_pivot_mm,
            "mm",
        ),
        ("rotary.zero_deg", zero_deg, zero_deg + found.zero_deg, "°"),
    ];
    let mut values = Vec::new();
    let mut changes = Vec::new();
    for ((key, from, value, unit), sigma) in rows.into_iter().zip(sigmas) {
        values.push(Value { name: key, value, standard_uncertainty: sigma, unit });
        let accepted = if unit == "mm" { LENGTH_MM } else { ANGLE_DEG };
        if (value - from).abs() > accepted + 3.0 * sigma {
            changes.push(Change { key, from, to: (1e4 * value).round() / 1e4 });
        }
    }
    Finding::of(values, changes)
        .with_covariance(found.covariance.iter().map(|row| row.to_vec()).collect())
        .with_screw(found.screw.clone())
}
