//! `rig-study design`: length, ball, indentation and probe arm of a sensor.
//!
//! Every design of a grid is judged by four competing merits. The designs that no other design
//! beats in all four form the front. The rows go to a file as they are found, so that an
//! interrupted study can continue.

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

use crate::{
    chunk::{ChunkArgs, ChunkNumber, Todo, Whole},
    files::Folder,
    outcome::StudyError,
    paper_bench::Control,
    progress,
};
use grid::{Design, Grid, GridAxis};
use merit::Merit;
use rows::Rows;

/// The front of sensor designs over angle influence, discrimination, sensitivity and time.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Lengths of the bimorph, mm.
    #[arg(long, default_value = "15:60:200", value_name = "FROM:TO:COUNT")]
    length_mm: GridAxis,
    /// Radii of the ball, mm.
    #[arg(long, default_value = "0.25:1.5:200", value_name = "FROM:TO:COUNT")]
    radius_mm: GridAxis,
    /// Indentations, mm.
    #[arg(long, default_value = "0.5", value_name = "FROM:TO:COUNT")]
    indentation_mm: GridAxis,
    /// Lengths of the probe arm, mm.
    #[arg(long, default_value = "8", value_name = "FROM:TO:COUNT")]
    arm_mm: GridAxis,
    /// Hold the position of the stage instead of the indentation; the sensor deflects.
    #[arg(long)]
    stage: bool,
    /// Folder for `design.md`, `design.html`, and the charts in `design`.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// File of all judged designs, with `front.csv` beside it. An interrupted study continues from
    /// this file.
    #[arg(long, default_value = "target/study/design.csv")]
    rows: PathBuf,
    #[command(flatten)]
    chunks: ChunkArgs,
}

/// The name of the page and of its folder.
const NAME: &str = "design";

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let control = if args.stage { Control::Stage } else { Control::Indentation };
    let grid = Grid {
        lengths_mm: args.length_mm,
        radii_mm: args.radius_mm,
        indentations_mm: args.indentation_mm,
        arms_mm: args.arm_mm,
        control,
    };
    let (blocks, whole) = (grid.blocks(), || Whole::new(NAME, grid.to_string()));
    let compute =
        |chunk: ChunkNumber| chunk.of(&blocks).map(|block| rows::lines(&judge(block))).collect();
    let todo = args.chunks.run(whole, blocks.len(), &args.out, out, compute)?;
    let (folder, judged) = match todo {
        Todo::All(folder) => (folder, None),
        Todo::Page(folder, judged) => (folder, Some(judged)),
        Todo::Nothing => return Ok(()),
    };
    let rows_folder = Folder::at(args.rows.parent().unwrap_or(Path::new("")))?;
    if let Some(judged) = judged {
        rows::write(&args.rows, &grid, &judged)?;
    }
    let designs = judge_all(&grid, &args.rows)?;
    let front = front::front(&designs);
    rows_folder.write("front.csv", &rows::table(front.iter().map(|&index| &designs[index])))?;
    let usable = designs.iter().filter(|(_, merit)| merit.is_some()).count();
    let (all, on_front) = (designs.len(), front.len());
    writeln!(out, "{all} designs, {usable} within the models, {on_front} on the front")?;
    document::page(&grid, &designs, &front).write(&folder, NAME, out)
}

/// Judges the designs that are missing in the file, one length at a time.
fn judge_all(grid: &Grid, path: &Path) -> Result<Vec<(Design, Option<Merit>)>, StudyError> {
    let mut rows = Rows::open(path, grid)?;
    let blocks = grid.blocks();
    let bar = progress::bar(blocks.len(), "lengths");
    bar.set_position(rows.blocks_done() as u64);
    for block in blocks.iter().skip(rows.blocks_done()) {
        rows.append(&judge(block))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(rows.into_designs())
}

/// Judges the designs of a block.
fn judge(block: &[Design]) -> Vec<(Design, Option<Merit>)> {
    block.par_iter().map(|design| (*design, Merit::of(design))).collect()
}

#[cfg(test)]
mod tests;
