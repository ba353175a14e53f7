//! `rig-study failures`: where estimators of the resonance are right, flagged, or silently wrong.
//!
//! Every estimator reads sweeps that get worse along one axis at a time, of sensors from hopeless to
//! good. The production fit must never be silently wrong; the others are shown as they are.

mod axis;
mod judge;
mod maps;
mod power;
mod scene;
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
use judge::Place;

/// Maps of where estimators fail, and the power of what notices it.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `failures.md` and, in `failures/`, the tables and charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// Decides all chance.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Sweeps of each of the six sensors at each value of each axis.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    trials: u32,
}

/// The production fit was silently wrong.
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
    let places = judge_all(args.trials, args.seed);
    page(args, &places).write(&folder, NAME)?;
    for estimator in Estimator::ALL {
        let (wrong, sweeps) = silently_wrong(estimator, on_grid(&places));
        writeln!(out, "{}: silently wrong in {wrong} of {sweeps} sweeps", estimator.name())?;
    }
    writeln!(out, "{}", folder.path("failures.md").display())?;
    match silently_wrong(Estimator::MaximumLikelihood, on_grid(&places)) {
        (0, _) => Ok(()),
        (wrong, sweeps) => Err(StudyError::refused(SilentlyWrong { wrong, sweeps })),
    }
}

fn judge_all(trials: u32, seed: u64) -> Vec<Place> {
    let jobs: Vec<(Axis, usize)> = Axis::ALL
        .into_iter()
        .flat_map(|axis| (0..axis.values().len()).map(move |place| (axis, place)))
        .collect();
    let bar = progress::bar(jobs.len(), "places");
    let judge = |(axis, place)| {
        let found = judge::judge(axis, place, trials, seed);
        bar.inc(1);
        found
    };
    let places = jobs.into_iter().filter_map(judge).collect();
    bar.finish_and_clear();
    places
}

/// The places on which nothing may be silently wrong.
fn on_grid(places: &[Place]) -> impl Iterator<Item = &Place> {
    places.iter().filter(|place| !place.axis.is_beyond_one_sweep())
}

/// How many sweeps an estimator read silently wrong, and of how many.
fn silently_wrong<'a>(estimator: Estimator, places: impl Iterator<Item = &'a Place>) -> (u32, u32) {
    let row = Estimator::ALL.iter().position(|one| *one == estimator);
    let counts = places.filter_map(|place| Some(&place.counts[row?]));
    counts.fold((0, 0), |(wrong, all), one| (wrong + one.wrong, all + one.sweeps()))
}

fn page(args: &Args, places: &[Place]) -> Page {
    let mut page =
        Page { title: "Where estimators of the resonance fail".to_owned(), parts: Vec::new() };
    introduction(&mut page, args);
    page.heading("How often each was silently wrong");
    page.table(totals(places));
    page.text(format!(
        "The production fit on this grid: {}.",
        where_wrong(on_grid(places)).unwrap_or_else(|| "silently wrong nowhere".to_owned())
    ));
    for axis in Axis::ALL.into_iter().filter(|axis| !axis.is_beyond_one_sweep()) {
        section(&mut page, axis, places);
    }
    page.heading("What one sweep cannot tell");
    page.text(
        "A spring that is a little softer at the peak changes the readings of one sweep as another \
         resonance would. No estimator sees it in the readings, and the production fit is silently \
         wrong here as all others are. What sees it is a second look at another level (above, `with a \
         step of the level`: the results at the level and at half of it give that of no drive, or a \
         refusal where they differ). This map is no part of the count.",
    );
    let beyond = places.iter().filter(|place| place.axis.is_beyond_one_sweep());
    page.text(format!(
        "The production fit here: {}.",
        where_wrong(beyond).unwrap_or_else(|| "silently wrong nowhere".to_owned())
    ));
    for axis in Axis::ALL.into_iter().filter(|axis| axis.is_beyond_one_sweep()) {
        section(&mut page, axis, places);
    }
    page.heading("All numbers");
    page.data("failures.csv", maps::table(places));
    page.data("power.csv", power::table(places));
    page
}

fn introduction(page: &mut Page, args: &Args) {
    page.text(format!(
        "This page, its charts and its tables are written by \
         `cargo run --release -p rig-study -- failures --out docs`. The same seed (here {}) gives \
         the same bytes whatever the number of cores. Each cell of a map stands for {} sweeps of \
         each of six sensors: quality 10, 30 and 100, effective coupling 0.02 and 0.1. Unless the \
         axis says otherwise a sweep has 101 settled points from 112 to 168 Hz, and 0.5 % noise.",
        args.seed, args.trials
    ));
    page.text(
        "The production fit, `maximum-likelihood`, is silently wrong when it accepts a resonance \
         that is more than five of its own standard deviations off. The others claim no \
         uncertainty: they are silently wrong when they give a number more than ten Cramér–Rao \
         bounds of the undisturbed sweep off. Where there is no resonance, every number is wrong. \
         The truth is the series resonance of a small drive in the middle of the time; for the \
         production fit, which says for which moment its resonance holds, that of this moment. In one \
         direction nothing tells a drift from another resonance, but the sweep knows when it passed \
         the resonance.",
    );
}

fn totals(places: &[Place]) -> Table {
    let mut table = Table::new(&["estimator", "silently wrong", "sweeps", "share"]);
    for estimator in Estimator::ALL {
        let (wrong, sweeps) = silently_wrong(estimator, on_grid(places));
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

/// In words, where the production fit was silently wrong; nothing where it never was.
fn where_wrong<'a>(places: impl Iterator<Item = &'a Place>) -> Option<String> {
    let one = |place: &Place| {
        let counts = place.counts[Estimator::ALL.len() - 1];
        let (axis, value) = (place.axis.file(), place.value);
        let said = format!("`{axis}` at {value}: {} of {}", counts.wrong, counts.sweeps());
        (counts.wrong > 0).then_some(said)
    };
    let all: Vec<String> = places.filter_map(one).collect();
    (!all.is_empty()).then(|| format!("silently wrong in {}", all.join(", ")))
}

/// The map of an axis, and what the production fit sees along it.
fn section(page: &mut Page, axis: Axis, places: &[Place]) {
    page.heading(axis.label());
    page.chart(&format!("{}.svg", axis.file()), maps::map(axis, places));
    if let Some(chart) = power::chart(axis, places) {
        page.chart(&format!("power-{}.svg", axis.file()), chart);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_production_fit_is_never_silently_wrong_and_a_peak_pick_often() {
        let places = judge_all(2, 11);
        let (wrong, sweeps) = silently_wrong(Estimator::MaximumLikelihood, on_grid(&places));
        let where_wrong: Vec<_> = on_grid(&places)
            .filter(|place| place.counts[Estimator::ALL.len() - 1].wrong > 0)
            .map(|place| (place.axis, place.value))
            .collect();
        assert_eq!(wrong, 0, "of {sweeps}: {where_wrong:?}");
        assert!(sweeps > 1000, "{sweeps}");
        let (wrong, sweeps) = silently_wrong(Estimator::MagnitudeMinimum, on_grid(&places));
        assert!(2 * wrong > sweeps, "{wrong} of {sweeps}");
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes() {
        let bytes = |seed| {
            let places: Vec<Place> =
                (0..3).filter_map(|place| judge::judge(Axis::SecondMode, place, 2, seed)).collect();
            (maps::table(&places), maps::map(Axis::SecondMode, &places).file().unwrap())
        };
        assert_eq!(bytes(3), bytes(3));
    }

    /// Each boundary, from both sides: a value at which the production fit answers nearly every
    /// sweep, and one at which it names what is wrong, takes it into the model, or refuses.
    #[test]
    fn what_is_harmless_is_answered_and_what_is_hopeless_is_seen() {
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
                let place = axis.values().iter().position(|one| *one == value).unwrap();
                judge::judge(axis, place, 4, 13).unwrap()
            };
            let answered = judge(harmless).counts[Estimator::ALL.len() - 1];
            assert!(answered.right >= 23, "{axis:?} at {harmless}: {answered:?}");
            let power::Power { named, modelled, refused, .. } = power::Power::of(&judge(hopeless));
            let seen = named + modelled + refused;
            assert!(seen > 90.0, "{axis:?} at {hopeless}: {seen} %");
        }
    }

    /// In one direction a drift changes nothing but the moment for which the result holds.
    #[test]
    fn drift_is_invisible_in_one_direction_and_seen_in_two() {
        let judge = |axis: Axis| {
            let place = axis.values().iter().position(|one| *one == 1.0).unwrap();
            judge::judge(axis, place, 4, 13).unwrap()
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
