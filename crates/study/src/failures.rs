//! `rig-study failures`: where estimators of the resonance are right, refuse, or are silently
//! wrong.
//!
//! Every estimator gets sweeps that deteriorate along one axis at a time, for sensors from poor to
//! good. The production fit must never be silently wrong; the other estimators are shown for
//! comparison.

mod axis;
mod judge;
mod maps;
mod power;
mod simulated_sweep;
mod spring;

use std::{io::Write, path::PathBuf};

use rig_resonance::Estimator;

use crate::{
    files::Folder,
    outcome::StudyError,
    page::{Page, Table},
    progress,
};
use axis::Axis;
use judge::AxisPoint;

/// Maps of the failures of estimators, and the power of their detection.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `failures.md` and, in `failures/`, the tables and charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// Random seed.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Sweeps of each of the six sensors at each point of each axis.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    trials: u32,
}

/// A silently wrong production fit.
#[derive(Debug, thiserror::Error)]
#[error("maximum-likelihood: silently wrong in {wrong} of {sweeps} sweeps")]
struct SilentlyWrong {
    wrong: u32,
    sweeps: u32,
}

/// The name of the page and of its folder.
const NAME: &str = "failures";

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    let points = judge_all(args.trials, args.seed);
    page(args, &points).write(&folder, NAME)?;
    for estimator in Estimator::ALL {
        let (wrong, sweeps) = silently_wrong(estimator, on_grid(&points));
        writeln!(out, "{}: silently wrong in {wrong} of {sweeps} sweeps", estimator.name())?;
    }
    writeln!(out, "{}", folder.path("failures.md").display())?;
    match silently_wrong(Estimator::MaximumLikelihood, on_grid(&points)) {
        (0, _) => Ok(()),
        (wrong, sweeps) => Err(StudyError::refused(SilentlyWrong { wrong, sweeps })),
    }
}

fn judge_all(trials: u32, seed: u64) -> Vec<AxisPoint> {
    let jobs: Vec<(Axis, usize)> = Axis::ALL
        .into_iter()
        .flat_map(|axis| (0..axis.values().len()).map(move |point| (axis, point)))
        .collect();
    let bar = progress::bar(jobs.len(), "points");
    let judge = |(axis, point)| {
        let found = judge::judge(axis, point, trials, seed);
        bar.inc(1);
        found
    };
    let points = jobs.into_iter().filter_map(judge).collect();
    bar.finish_and_clear();
    points
}

/// The points at which the production fit may never be silently wrong.
fn on_grid(points: &[AxisPoint]) -> impl Iterator<Item = &AxisPoint> {
    points.iter().filter(|point| !point.axis.is_beyond_one_sweep())
}

/// The number of silently wrong sweeps of an estimator, and of all its sweeps.
fn silently_wrong<'a>(
    estimator: Estimator,
    points: impl Iterator<Item = &'a AxisPoint>,
) -> (u32, u32) {
    let row = Estimator::ALL.iter().position(|one| *one == estimator);
    let counts = points.filter_map(|point| Some(&point.counts[row?]));
    counts.fold((0, 0), |(wrong, all), one| (wrong + one.wrong, all + one.sweeps()))
}

fn page(args: &Args, points: &[AxisPoint]) -> Page {
    let mut page =
        Page { title: "Where estimators of the resonance fail".to_owned(), parts: Vec::new() };
    introduction(&mut page, args);
    page.heading("Silently wrong results");
    page.table(totals(points));
    page.text(format!(
        "The production fit on this grid: {}.",
        where_wrong(on_grid(points)).unwrap_or_else(|| "silently wrong nowhere".to_owned())
    ));
    for axis in Axis::ALL.into_iter().filter(|axis| !axis.is_beyond_one_sweep()) {
        section(&mut page, axis, points);
    }
    page.heading("Limits of a single sweep");
    page.text(
        "A spring that softens slightly at the peak changes the readings of one sweep in the same \
         way as another resonance does. No estimator can detect it in the readings, and all of \
         them, the production fit included, are silently wrong here. A second sweep at another \
         level detects it (above, `with a step of the level`: the results at the full and at half \
         the level give the result without drive, or a refusal if they differ). This map is not \
         part of the count.",
    );
    let beyond = points.iter().filter(|point| point.axis.is_beyond_one_sweep());
    page.text(format!(
        "The production fit here: {}.",
        where_wrong(beyond).unwrap_or_else(|| "silently wrong nowhere".to_owned())
    ));
    for axis in Axis::ALL.into_iter().filter(|axis| axis.is_beyond_one_sweep()) {
        section(&mut page, axis, points);
    }
    page.heading("Data");
    page.data("failures.csv", maps::table(points));
    page.data("power.csv", power::table(points));
    page
}

fn introduction(page: &mut Page, args: &Args) {
    page.text(format!(
        "This page, its charts and its tables are written by `cargo run --release -p rig-study -- \
         failures --out docs/studies`, in minutes on two cores. The same seed (here {}) gives the \
         same bytes on any number of cores. Each cell of a map stands for {} sweeps of each of six \
         sensors: quality 10, 30 and 100, effective coupling 0.02 and 0.1. Unless the axis says \
         otherwise, a sweep has 101 settled points from 112 to 168 Hz and 0.5 % noise.",
        args.seed, args.trials
    ));
    page.text(
        "The production fit, `maximum-likelihood`, is silently wrong if it accepts a resonance \
         with an error of more than five of its own standard deviations. The other estimators \
         state no uncertainty; they are silently wrong if their error exceeds ten Cramér–Rao \
         bounds of the undisturbed sweep. For a sensor without a resonance every number is wrong. \
         The truth is the series resonance at a small drive, at the middle of the sweep; for the \
         production fit, which states the effective time of its result, it is the resonance at \
         that time. A sweep in one direction cannot distinguish a drift from another resonance, \
         but it knows when it passed the resonance.",
    );
}

fn totals(points: &[AxisPoint]) -> Table {
    let mut table = Table::new(&["estimator", "silently wrong", "sweeps", "share"]);
    for estimator in Estimator::ALL {
        let (wrong, sweeps) = silently_wrong(estimator, on_grid(points));
        let share = 100.0 * f64::from(wrong) / f64::from(sweeps.max(1));
        table.row([
            format!("`{}`", estimator.name()),
            wrong.to_string(),
            sweeps.to_string(),
            format!("{share:.2} %"),
        ]);
    }
    table
}

/// The axis points with silently wrong production fits, in words; `None` if there are none.
fn where_wrong<'a>(points: impl Iterator<Item = &'a AxisPoint>) -> Option<String> {
    let one = |point: &AxisPoint| {
        let counts = point.counts[Estimator::ALL.len() - 1];
        let (axis, value) = (point.axis.file(), point.value);
        let said = format!("`{axis}` at {value}: {} of {}", counts.wrong, counts.sweeps());
        (counts.wrong > 0).then_some(said)
    };
    let all: Vec<String> = points.filter_map(one).collect();
    (!all.is_empty()).then(|| format!("silently wrong in {}", all.join(", ")))
}

/// The map of an axis, and the detection power of the production fit.
fn section(page: &mut Page, axis: Axis, points: &[AxisPoint]) {
    page.heading(axis.label());
    page.chart(&format!("{}.svg", axis.file()), maps::map(axis, points));
    if let Some(chart) = power::chart(axis, points) {
        page.chart(&format!("power-{}.svg", axis.file()), chart);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_production_fit_is_never_silently_wrong_and_a_peak_pick_often() {
        let points = judge_all(2, 11);
        let (wrong, sweeps) = silently_wrong(Estimator::MaximumLikelihood, on_grid(&points));
        let where_wrong: Vec<_> = on_grid(&points)
            .filter(|point| point.counts[Estimator::ALL.len() - 1].wrong > 0)
            .map(|point| (point.axis, point.value))
            .collect();
        assert_eq!(wrong, 0, "of {sweeps}: {where_wrong:?}");
        assert!(sweeps > 1000, "{sweeps}");
        let (wrong, sweeps) = silently_wrong(Estimator::MagnitudeMinimum, on_grid(&points));
        assert!(2 * wrong > sweeps, "{wrong} of {sweeps}");
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes() {
        let bytes = |seed| {
            let points: Vec<AxisPoint> =
                (0..3).filter_map(|point| judge::judge(Axis::SecondMode, point, 2, seed)).collect();
            (maps::table(&points), maps::map(Axis::SecondMode, &points).file().unwrap())
        };
        assert_eq!(bytes(3), bytes(3));
    }

    /// Each boundary from both sides: a value at which the production fit answers nearly every
    /// sweep, and one at which it names the cause, models it, or refuses.
    #[test]
    fn harmless_sweeps_are_answered_and_hopeless_ones_are_detected() {
        for (axis, harmless, hopeless) in [
            (Axis::FigureOfMerit, 1.0, 0.0),
            (Axis::WindowOffset, 0.95, 1.05),
            (Axis::DriftBothWays, 0.01, 2.0),
            (Axis::SecondMode, 0.2, 10.0),
            (Axis::Outliers, 0.0, 30.0),
            (Axis::DriveLevelStep, 0.0, 0.5),
            (Axis::Settling, 10.0, 0.5),
        ] {
            let judge = |value: f64| {
                let point = axis.values().iter().position(|one| *one == value).unwrap();
                judge::judge(axis, point, 4, 13).unwrap()
            };
            let answered = judge(harmless).counts[Estimator::ALL.len() - 1];
            assert!(answered.right >= 23, "{axis:?} at {harmless}: {answered:?}");
            let power::Power { named, modelled, refused, .. } = power::Power::of(&judge(hopeless));
            let seen = named + modelled + refused;
            assert!(seen > 90.0, "{axis:?} at {hopeless}: {seen} %");
        }
    }

    /// In one direction a drift changes only the effective time of the result.
    #[test]
    fn drift_is_invisible_in_one_direction_and_seen_in_two() {
        let judge = |axis: Axis| {
            let point = axis.values().iter().position(|one| *one == 1.0).unwrap();
            judge::judge(axis, point, 4, 13).unwrap()
        };
        let production = Estimator::ALL.len() - 1;
        let rising = judge(Axis::Drift);
        assert_eq!(rising.counts[production].right, 24);
        assert_eq!(power::Power::of(&rising).modelled, 0.0);
        let baseline =
            Estimator::ALL.iter().position(|one| *one == Estimator::ConductanceLorentzian);
        assert!(rising.counts[baseline.unwrap()].wrong > 12);
        let both_ways = power::Power::of(&judge(Axis::DriftBothWays));
        assert!(both_ways.modelled > 50.0 && both_ways.wrong == 0.0);
    }
}
