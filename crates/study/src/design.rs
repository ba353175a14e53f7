//! `rig-study design`: which length, ball, indentation and probe arm a sensor should have.
//!
//! Every design of a grid is judged by four merits that pull against each other; those that no other
//! design beats in all four are the front. The rows go to a file as they are found, so that a study
//! that was interrupted goes on where it stopped.

mod document;
mod front;
mod grid;
mod merit;
mod rows;

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use rayon::prelude::*;

use crate::{files::Folder, outcome::StudyError, paper_bench::Control, progress};
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
    /// Folder for `design.md`, `design.html`, and the charts in `design`.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// File of all designs judged, beside which `front.csv` comes; a study that was interrupted goes
    /// on where it stopped.
    #[arg(long, default_value = "target/study/design.csv")]
    rows: PathBuf,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let control = if args.stage { Control::Stage } else { Control::Indentation };
    let grid = Grid {
        lengths_mm: args.length_mm,
        radii_mm: args.radius_mm,
        indentations_mm: args.indentation_mm,
        arms_mm: args.arm_mm,
        control,
    };
    let rows_folder = Folder::at(args.rows.parent().unwrap_or(Path::new("")))?;
    let designs = judge_all(&grid, &args.rows)?;
    let front = front::front(&designs);
    rows_folder.write("front.csv", &rows::table(front.iter().map(|&index| &designs[index])))?;
    let folder = Folder::at(&args.out)?;
    document::page(&grid, &designs, &front).write(&folder, "design")?;
    let usable = designs.iter().filter(|(_, merit)| merit.is_some()).count();
    let (all, on_front) = (designs.len(), front.len());
    writeln!(out, "{all} designs, {usable} within the models, {on_front} on the front")?;
    writeln!(out, "{}", folder.path("design.md").display())?;
    Ok(())
}

/// Judges the designs that the file does not have yet, a length at a time.
fn judge_all(grid: &Grid, path: &Path) -> Result<Vec<(Design, Option<Merit>)>, StudyError> {
    let mut rows = Rows::open(path, grid)?;
    let blocks = grid.blocks();
    let bar = progress::bar(blocks.len(), "lengths");
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
