//! `rigd commission blocks`: the geometry of a bench from touches on hard blocks, as the journal has them.

use std::str::FromStr;

use clap::Args;
use rig_commission::{
    Change, Finding, Kind, Value,
    metrology::{BlockGeometry, BlockTouch, fit},
};
use rig_files::rig_file::RigFile;
use rig_model::counted;
use rig_store::Reader;

use super::{CommissionFailure, judged};
use crate::{
    block_runs::{noise, of_run},
    calibrations::{self, Witness},
    cli::{
        Failure,
        args::{BenchArgs, temperature},
        screen::say,
        table::{facts, print},
    },
};

/// Fits surface, rotary axis, probe and the zero of the rotary stage to the touches of a run on a hard flat block, such as
/// one of `config/protocols/block.toml`, together with the error of the linear screw. Touches do not find the sign of the
/// rotary stage, nor the radius of the ball. Runs with other scales and zeros of the axes in the rig file are refused
#[derive(Debug, Args)]
pub(super) struct BlocksArgs {
    /// Run on the block: its name such as `block-1`, its id, or `latest`
    run: String,
    /// Run on a second block, and by how much it is higher, mm: it finds the zero of the rotary stage ten times better
    #[arg(long, value_name = "RUN=MM")]
    raised: Vec<Raised>,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

/// A run on a higher block.
#[derive(Debug, Clone)]
struct Raised {
    run: String,
    by_mm: f64,
}

impl FromStr for Raised {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parts = text.rsplit_once('=').and_then(|(run, by)| Some((run, by.parse().ok()?)));
        match parts {
            Some((run, by_mm)) if f64::is_finite(by_mm) => Ok(Self { run: run.to_owned(), by_mm }),
            _ => Err("a run and a height in mm, such as block-2=10"),
        }
    }
}

/// Differences from the rig file that are accepted, beyond three standard deviations.
const LENGTH_MM: f64 = 0.05;
const ANGLE_DEG: f64 = 0.1;

pub(super) fn blocks(args: &BlocksArgs) -> Result<(), Failure> {
    let data = args.bench.data.dir();
    let rig = args.bench.rig.load()?;
    let mut runs = vec![(args.run.clone(), 0.0)];
    runs.extend(args.raised.iter().map(|raised| (raised.run.clone(), raised.by_mm)));
    let reader =
        Reader::open(&data).map_err(|source| Failure::Data { data: data.clone(), source })?;
    let (mut touches, mut ids, mut sigmas_mm) = (Vec::new(), Vec::new(), Vec::new());
    for (run, raised_mm) in runs {
        let run = reader.find(&run)?;
        let found = of_run(&reader, &run, raised_mm, &rig.basis());
        for (touch, sigma_mm) in found.map_err(CommissionFailure::from)? {
            touches.push(touch);
            sigmas_mm.push(sigma_mm);
        }
        ids.push(run.id.to_string());
    }
    let noise = noise(sigmas_mm.into_iter(), &rig.file.limits);
    let found = fit(&touches, &noise, &heights(&touches)).map_err(CommissionFailure::from)?;
    let finding = finding(&rig.file, &found);
    print(&facts(&rows(&finding)))?;
    say(&format!("From {}.", counted(touches.len(), "touch")));
    let verdict = finding.verdict.clone();
    let witness = Witness {
        person: args.bench.operator.name().as_str().to_owned(),
        journal: ids,
        temperature_c: args.temperature,
    };
    let path = calibrations::write(&rig.basis(), &data, (Kind::Blocks, finding), witness)
        .map_err(CommissionFailure::from)?;
    say(&format!("Record: {}", path.display()));
    judged(Kind::Blocks, verdict)
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

fn finding(rig: &RigFile, found: &BlockGeometry) -> Finding {
    let geometry = &rig.limits.geometry;
    let sigmas = found.sigmas();
    let zero = rig.rotary.scale.zero.value();
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
        ("rotary.zero_deg", zero, zero + found.zero_deg, "°"),
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

/// The values of a finding, for a person.
pub(super) fn rows(finding: &Finding) -> Vec<(&'static str, String)> {
    let row = |value: &Value| {
        let Value { name, value, standard_uncertainty, unit } = value;
        // That of a ratio is 1.
        let unit = if *unit == "1" { String::new() } else { format!(" {unit}") };
        (*name, format!("{value:.4} ± {standard_uncertainty:.4}{unit}"))
    };
    finding.values.iter().map(row).collect()
}
