//! `rig-study touch`: rig time of a touch against the error of its stiffness, for each setting of protocol and rig.
//!
//! Each run is one of the daemon, through its drivers, against the simulated bench. Its error is that against the
//! stiffness of the touched point, which only the simulator knows.

mod document;
mod setting;
mod summary;
mod trial;

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use rayon::prelude::*;

use crate::{bench_run::BenchError, files::Folder, outcome::StudyError, progress};
use setting::{Files, SETTINGS, SHIPPED, Scene, Setting, TROUBLES};
use summary::Summary;
use trial::Trial;

/// Rig time of a touch against the error of its stiffness, on the simulated bench.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Runs of each setting; the seed of a run is that of its scene and its protocol.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=1000))]
    runs: u32,
    /// Seed of the first run.
    #[arg(long, default_value_t = 1)]
    seed: u32,
    /// Folder for `touch.md` and, in `touch/`, the tables and the charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// Folder of the configuration that is tried.
    #[arg(long, default_value = "config")]
    config: PathBuf,
    /// Play the settings as shipped again and compare them with the table in the folder.
    #[arg(long)]
    check: bool,
    /// Print the table of the settings whose knob begins with this, beside those as shipped, and write no page.
    #[arg(long, value_name = "KNOB", conflicts_with = "check")]
    only: Option<String>,
}

/// The page is not what the runs give.
#[derive(Debug, thiserror::Error)]
#[error("{}: no row is \"{row}\", which the runs give now: write the page again", path.display())]
struct Differs {
    path: PathBuf,
    row: String,
}

/// A setting on a scene, with its runs in the order of their seeds.
#[derive(Debug)]
struct Group {
    setting: &'static Setting,
    scene: Scene,
    summary: Summary,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let files = Files::read(&args.config)?;
    let folder = Folder::at(&args.out)?;
    let path = folder.path("touch").join(document::TABLE);
    if args.check {
        return check(args, &files, &path, out);
    }
    let is_asked = |setting: &&Setting| {
        let only = args.only.as_deref().unwrap_or_default();
        setting.knob == SHIPPED || setting.knob.starts_with(only)
    };
    let settings = |scene| SETTINGS.iter().filter(is_asked).map(move |setting| (setting, scene));
    let asked: Vec<_> = [Scene::Paper, Scene::Matched].into_iter().flat_map(settings).collect();
    let groups = play(args, &files, &asked)?;
    if args.only.is_some() {
        return Ok(write!(out, "{}", document::rows(&groups).markdown("touch"))?);
    }
    let troubles: Vec<_> = TROUBLES.iter().map(|setting| (setting, Scene::Paper)).collect();
    let troubles = play(args, &files, &troubles)?;
    document::page(args, &groups, &troubles).write(&folder, "touch", out)
}

fn check(args: &Args, files: &Files, path: &Path, out: &mut impl Write) -> Result<(), StudyError> {
    let file = |source| StudyError::File { path: path.to_owned(), source };
    let written = fs::read_to_string(path).map_err(file)?;
    let groups = play(args, files, &[(&SETTINGS[0], Scene::Paper)])?;
    let found = document::csv(&groups);
    if let Some(row) = found.lines().find(|row| !written.lines().any(|line| line == *row)) {
        return Err(StudyError::refused(Differs { path: path.to_owned(), row: row.to_owned() }));
    }
    Ok(writeln!(
        out,
        "{}: the row of the settings as shipped is what the runs give",
        path.display()
    )?)
}

/// The groups that are asked for, in order.
fn play(
    args: &Args,
    files: &Files,
    asked: &[(&'static Setting, Scene)],
) -> Result<Vec<Group>, StudyError> {
    let seeds = args.seed..args.seed + args.runs;
    let bar = progress::bar(asked.len() * args.runs as usize, "runs");
    let cells: Vec<_> = asked
        .iter()
        .flat_map(|(setting, scene)| seeds.clone().map(move |seed| (*setting, *scene, seed)))
        .collect();
    let trials: Vec<Result<Trial, BenchError>> = cells
        .into_par_iter()
        .map(|(setting, scene, seed)| {
            let trial = Trial::play(files, setting, scene, seed);
            bar.inc(1);
            trial
        })
        .collect();
    bar.finish_and_clear();
    let mut trials = trials.into_iter();
    asked
        .iter()
        .map(|(setting, scene)| {
            let of_group: Result<Vec<_>, _> = trials.by_ref().take(args.runs as usize).collect();
            let of_group = of_group.map_err(StudyError::bench)?;
            Ok(Group { setting, scene: *scene, summary: Summary::of(&of_group) })
        })
        .collect()
}
