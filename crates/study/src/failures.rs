//! `rig-study failures`: where the resonance is right, refused, or silently wrong.
//!
//! Sweeps deteriorate along one axis at a time, for sensors from poor to good. The production fit gets
//! sweeps of points chosen in advance; the planner of the daemon chooses its own points. Neither may be
//! silently wrong. Other estimators are shown for comparison.

mod axis;
mod cause;
mod coverage;
mod document;
mod gate;
mod judge;
mod load;
mod maps;
mod outliers;
mod path;
mod power;
mod reasons;
mod scene;
mod spring;

use std::{io::Write, ops::Range, path::PathBuf};

use crate::{
    chunk::{ChunkArgs, ChunkNumber, Todo, Whole},
    files::Folder,
    outcome::StudyError,
    progress,
};
use axis::Axis;
use judge::{Cell, Counts};
use path::Path;

/// Maps of the failures of fit and planner, and the power of their detection.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `failures.md` and, in `failures/`, the tables and charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// First random seed.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Number of random seeds, one after the other.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Fitted sweeps of each of the six sensors at each point of each axis, for each seed.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    trials: u32,
    /// The same for planned sweeps.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    planned: u32,
    /// Only this axis, such as `second-mode`.
    #[arg(long)]
    axis: Option<String>,
    /// Compare a part of the sweeps of the first seed with those of the page in the folder, and write
    /// nothing.
    #[arg(long, conflicts_with_all = ["axis", "chunk", "merge", "queue"])]
    check: bool,
    #[command(flatten)]
    chunks: ChunkArgs,
}

/// No axis has this name.
#[derive(Debug, thiserror::Error)]
#[error("there is no axis {name}; the axes are {}", names())]
struct NoSuchAxis {
    name: String,
}

fn names() -> String {
    Axis::ALL.map(Axis::file).join(", ")
}

/// The name of the page and of its folder.
const NAME: &str = "failures";

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    if args.check {
        return gate::check(&Folder::at(&args.out)?.path(NAME), args.seed, out);
    }
    let axes: Vec<Axis> = Axis::ALL
        .into_iter()
        .filter(|axis| args.axis.as_ref().is_none_or(|name| axis.file() == name))
        .collect();
    if let (Some(name), true) = (&args.axis, axes.is_empty()) {
        return Err(StudyError::arguments(NoSuchAxis { name: name.clone() }));
    }
    let jobs = jobs(&axes);
    let judge =
        |jobs| judge_jobs(jobs, args.trials, args.planned, args.seed..args.seed + args.seeds);
    let compute = |chunk: ChunkNumber| judge(chunk.of(jobs.iter().copied()).collect());
    let todo = args.chunks.run(|| args.whole(), jobs.len(), &args.out, out, compute)?;
    let (folder, found) = match todo {
        Todo::All(folder) => (folder, judge(jobs)),
        Todo::Page(folder, found) => (folder, found),
        Todo::Nothing => return Ok(()),
    };
    let cells: Vec<Cell> = found.into_iter().flatten().collect();
    for path in Path::ALL {
        let Counts { wrong, .. } = counts(path, &cells);
        let sweeps = counts(path, &cells).sweeps();
        writeln!(out, "{}: silently wrong in {wrong} of {sweeps} sweeps", path.name())?;
    }
    for (value, count) in document::where_wrong(cells.iter()) {
        writeln!(out, "  {value}: {count}")?;
    }
    document::page(args, &cells).write(&folder, NAME, out)
}

impl Args {
    /// What a chunk with these arguments is a part of.
    fn whole(&self) -> Result<Whole, StudyError> {
        let Self { seed, seeds, trials, planned, axis, .. } = self;
        let axis = axis.as_deref().unwrap_or("all");
        let arguments = format!(
            "--seed {seed} --seeds {seeds} --trials {trials} --planned {planned}, axis {axis}"
        );
        Whole::new(NAME, arguments)
    }
}

/// A path at a point of an axis.
type Job = (Axis, Path, usize);

/// All paths on these axes.
fn jobs(axes: &[Axis]) -> Vec<Job> {
    axes.iter()
        .flat_map(|&axis| Path::ALL.map(|path| (axis, path)))
        .flat_map(|(axis, path)| (0..axis.values().len()).map(move |point| (axis, path, point)))
        .collect()
}

/// Judges all paths on these axes.
fn judge_all(axes: &[Axis], trials: u32, planned: u32, seeds: Range<u64>) -> Vec<Cell> {
    judge_jobs(jobs(axes), trials, planned, seeds).into_iter().flatten().collect()
}

/// What is found in each job; `None` where the axis has no effect on the path, or there is no sweep.
fn judge_jobs(jobs: Vec<Job>, trials: u32, planned: u32, seeds: Range<u64>) -> Vec<Option<Cell>> {
    let bar = progress::bar(jobs.len(), "points");
    let judge = |(axis, path, point)| {
        let trials = match path {
            Path::Fit => trials,
            Path::Planner | Path::Unsurveyed => planned,
        };
        let found = judge::judge((axis, path), point, trials, seeds.clone());
        bar.inc(1);
        found
    };
    let found = jobs.into_iter().map(judge).collect();
    bar.finish_and_clear();
    found
}

/// The outcomes of a path at all points at which it may never be silently wrong.
fn counts(path: Path, cells: &[Cell]) -> Counts {
    cells
        .iter()
        .filter(|cell| cell.path == path && !cell.axis.is_beyond_one_sweep())
        .map(Cell::counts)
        .fold(Counts::default(), Counts::plus)
}

#[cfg(test)]
mod tests;
