//! `rig-study design`: which length, ball, indentation and probe arm a sensor should have.
//!
//! Every design of a grid is judged by four merits that pull against each other; those that no other
//! design beats in all four are the front. The rows go to a file as they are found, so that a study
//! that was interrupted goes on where it stopped.

mod front;
mod grid;
mod merit;
mod rows;

use std::{collections::BTreeSet, io::Write, path::PathBuf};

use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use rig_chart::{Axis, Chart, Point, Series};

use crate::{
    files::{Csv, Folder},
    outcome::StudyError,
    paper_bench::Control,
};
use grid::{Design, Grid, Span};
use merit::Merit;
use rows::Rows;

/// The front of sensor designs over angle influence, discrimination, sensitivity and time.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Lengths of the bimorph, mm.
    #[arg(long, default_value = "15:60:200", value_name = "FROM:TO:COUNT")]
    length_mm: Span,
    /// Radii of the ball, mm.
    #[arg(long, default_value = "0.25:1.5:200", value_name = "FROM:TO:COUNT")]
    radius_mm: Span,
    /// Indentations, mm.
    #[arg(long, default_value = "0.5", value_name = "FROM:TO:COUNT")]
    indentation_mm: Span,
    /// Lengths of the probe arm, mm.
    #[arg(long, default_value = "8", value_name = "FROM:TO:COUNT")]
    arm_mm: Span,
    /// Let the stage hold the depth, to which the sensor gives way.
    #[arg(long)]
    stage: bool,
    /// Folder for the tables and charts; a study that was interrupted goes on.
    #[arg(long, default_value = "target/study/design")]
    out: PathBuf,
}

/// The paper's choice and the two sensors that it compares it with.
const COMPARED: [(&str, f64, f64); 3] = [
    ("35 mm, 0.5 mm (chosen)", 35.0, 0.5),
    ("35 mm, 1 mm", 35.0, 1.0),
    ("20 mm, 0.5 mm", 20.0, 0.5),
];

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let control = if args.stage { Control::Stage } else { Control::Indentation };
    let grid = Grid {
        lengths_mm: args.length_mm,
        radii_mm: args.radius_mm,
        indentations_mm: args.indentation_mm,
        arms_mm: args.arm_mm,
        control,
    };
    let folder = Folder::at(&args.out)?;
    let designs = judge_all(&grid, &folder)?;
    let front = front::front(&designs);
    folder.write("front.csv", &rows::table(front.iter().map(|&index| &designs[index])))?;
    let compared = compared(control);
    folder.write("compared.csv", &compared_table(&compared))?;
    for chart in charts(&designs, &front, &compared) {
        let (name, chart) = chart;
        folder.write(name, &chart.file()?)?;
    }
    let usable = designs.iter().filter(|(_, merit)| merit.is_some()).count();
    writeln!(
        out,
        "{} designs, {usable} within the models, {} on the front",
        designs.len(),
        front.len()
    )?;
    for (name, merit) in &compared {
        let Some(merit) = merit else { continue };
        let is_beaten = designs.iter().any(|(_, other)| other.is_some_and(|o| o.beats(merit)));
        let verdict =
            if is_beaten { "beaten by others in every merit or equal" } else { "on the front" };
        writeln!(out, "{name}: {merit}; {verdict}")?;
    }
    Ok(())
}

/// Judges the designs that the file does not have yet, a length at a time.
fn judge_all(grid: &Grid, folder: &Folder) -> Result<Vec<(Design, Option<Merit>)>, StudyError> {
    let mut rows = Rows::open(&folder.path("design.csv"), grid)?;
    let blocks = grid.blocks();
    let bar = ProgressBar::new(blocks.len() as u64).with_style(style());
    bar.set_position(rows.blocks_done() as u64);
    for block in blocks.iter().skip(rows.blocks_done()) {
        let judged: Vec<(Design, Option<Merit>)> =
            block.par_iter().map(|design| (*design, Merit::of(design))).collect();
        rows.append(&judged)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(rows.into_designs())
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{bar:40} {pos} of {len} lengths, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}

fn compared(control: Control) -> Vec<(&'static str, Option<Merit>)> {
    let design = |length_mm, radius_mm| Design {
        length_mm,
        radius_mm,
        indentation_mm: crate::paper_bench::INDENTATION_MM,
        arm_mm: 8.0,
        control,
    };
    COMPARED.map(|(name, length, radius)| (name, Merit::of(&design(length, radius)))).to_vec()
}

fn compared_table(compared: &[(&str, Option<Merit>)]) -> String {
    let mut table = Csv::new(&[
        "sensor",
        "angle_influence_percent",
        "discrimination_percent",
        "sensitivity_hz_per_mpa",
        "point_s",
    ]);
    for (name, merit) in compared {
        let values = merit.map_or_else(Vec::new, |merit| merit.cells().to_vec());
        table.row([name.replace(',', "")].into_iter().chain(values));
    }
    table.text().to_owned()
}

/// Two views of the front: influence against sensitivity, and discrimination against time.
fn charts(
    designs: &[(Design, Option<Merit>)],
    front: &[usize],
    compared: &[(&'static str, Option<Merit>)],
) -> [(&'static str, Chart); 2] {
    let view = |title: &str, x: Axis, y: Axis, of: fn(&Merit) -> (f64, f64)| {
        let description = "Points stand for the designs that no other beats in angle influence, \
                           discrimination, sensitivity and time together; the paper's three \
                           sensors stand out.";
        let mut chart = Chart::new(title, description, x, y);
        let on_front = front.iter().filter_map(|&index| {
            let (design, merit) = &designs[index];
            let (x, y) = of(merit.as_ref()?);
            Some(Point { x, y, error: None, note: Some(design.to_string()) })
        });
        chart.series.push(Series::scatter("front", 6, thinned(on_front.collect())));
        for (colour, (name, merit)) in compared.iter().enumerate() {
            let point = merit.iter().map(|merit| Point::from(of(merit)));
            chart.series.push(Series::scatter(name, colour, point));
        }
        chart
    };
    [
        (
            "influence-sensitivity.svg",
            view(
                "Angle influence and sensitivity of the designs on the front",
                Axis::linear("sensitivity, Hz/MPa"),
                Axis::linear("largest fall of a shift to 45°, %"),
                |merit| (merit.sensitivity_hz_per_mpa, 100.0 * merit.angle_influence),
            ),
        ),
        (
            "discrimination-time.svg",
            view(
                "Discrimination and time of the designs on the front",
                Axis::linear("time of one frequency, s"),
                Axis::linear("smallest gap between neighbouring samples over all angles, %"),
                |merit| (merit.point_s, 100.0 * merit.discrimination),
            ),
        ),
    ]
}

/// Few enough points to be told apart: the first in each field of a raster over them all.
fn thinned(points: Vec<Point>) -> Vec<Point> {
    const FIELDS: f64 = 50.0;
    let ends = |of: fn(&Point) -> f64| {
        let least = points.iter().map(of).fold(f64::INFINITY, f64::min);
        let most = points.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        (least, (most - least).max(f64::MIN_POSITIVE))
    };
    let (x, y) = (ends(|point| point.x), ends(|point| point.y));
    let mut taken = BTreeSet::new();
    let field = |value: f64, (least, width): (f64, f64)| {
        // Whole numbers from 0 to 50, compared by their bits.
        ((value - least) / width * FIELDS).floor().to_bits()
    };
    points
        .into_iter()
        .filter(|point| taken.insert((field(point.x, x), field(point.y, y))))
        .collect()
}
