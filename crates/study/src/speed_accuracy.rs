//! `rig-study speed-accuracy`: measuring time against the error of a resonance.

mod accuracy;
mod case;
mod charts;
mod document;
mod estimator;
mod finder;
mod goals;
mod host;
mod method;
mod trial;
mod warm;

use std::{io::Write, path::PathBuf};

use crate::{
    files::{Csv, Folder},
    outcome::StudyError,
    progress,
};
use case::Case;
use goals::Evidence;
use method::Method;
use trial::Group;

/// Measuring time against error for every planner and every estimator.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `speed-accuracy.md` and, in `speed-accuracy/`, the tables and charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// Random seed.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Sweeps of each method in each case.
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    trials: u32,
    /// Measure the cost of fits on this computer instead, into `speed-accuracy/host.csv` and
    /// `.svg`.
    #[arg(long)]
    host: bool,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    if args.host {
        return host::run(&Folder::at(&folder.path(NAME))?, args.seed, out);
    }
    let evidence = measure(args);
    let searches = finder::try_all(args.trials, args.seed);
    for goal in goals::judge(&evidence) {
        let met = if goal.is_met { "met" } else { "NOT MET" };
        writeln!(out, "{met}: {}: {} (goal {})", goal.quantity, goal.measured, goal.limit)?;
    }
    document::page(args, &evidence, &searches).write(&folder, NAME, out)
}

/// The name of the page and of its folder.
const NAME: &str = "speed-accuracy";
/// Factor on the trials for the accuracy, which is judged to a hundredth.
const TRIALS_OF_ACCURACY: u32 = 100;
/// Factor on the trials for the share of fast runs, which is judged to a hundredth.
const TRIALS_OF_GOALS: u32 = 10;

fn measure(args: &Args) -> Evidence {
    let Args { trials, seed, .. } = *args;
    let groups = try_all(args);
    Evidence {
        groups,
        cold: goals::start(TRIALS_OF_GOALS * trials, seed),
        chart_cases: accuracy::of_charts(TRIALS_OF_ACCURACY * trials, seed),
        map_cases: accuracy::of_map(TRIALS_OF_ACCURACY * trials, seed),
        loose: goals::start_loosely(TRIALS_OF_GOALS * trials, seed),
        warm: goals::track(trials.div_ceil(2), seed),
    }
}

/// Target standard deviations of the planners, Hz.
const TARGETS_HZ: [f64; 5] = [0.3, 0.1, 0.03, 0.01, 0.003];

/// The compared methods.
fn methods() -> Vec<Method> {
    let even = [201, 101, 51, 21].map(|points| Method::Even { points });
    let fast = [(51, 2), (101, 2), (101, 10)];
    let fast = fast.map(|(points, cycles)| Method::Fast { points, cycles });
    let decay = TARGETS_HZ.map(|target_hz| Method::Decay { target_hz });
    even.into_iter().chain(fast).chain(decay).collect()
}

fn try_all(args: &Args) -> Vec<Group> {
    let jobs: Vec<(Case, Method)> = Case::all()
        .into_iter()
        .flat_map(|case| methods().into_iter().map(move |method| (case, method)))
        .collect();
    let bar = progress::bar(jobs.len(), "methods to measure");
    let mut groups = Vec::new();
    for (case, method) in jobs {
        groups.extend(trial::run(case, method, args.trials, args.seed));
        bar.inc(1);
    }
    bar.finish_and_clear();
    groups
}

fn sweeps_table(groups: &[Group]) -> String {
    let mut table = Csv::new(&[
        "q",
        "k_eff_squared",
        "noise_percent",
        "method",
        "detail",
        "estimator",
        "sweeps",
        "answers",
        "time_median_s",
        "time_mean_s",
        "time_95_percent_s",
        "time_99_percent_s",
        "bias_hz",
        "rmse_hz",
        "bound_hz",
        "worst_sigmas",
    ]);
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.5}"));
    for group in groups {
        let Case { q, coupling, noise } = group.case;
        table.row([
            q.to_string(),
            coupling.to_string(),
            (100.0 * noise).to_string(),
            group.method.name().to_owned(),
            group.method.detail(),
            group.estimator.name().to_owned(),
            group.trials.len().to_string(),
            group.answers().to_string(),
            format!("{:.4}", group.time_s(0.5)),
            format!("{:.4}", group.mean_time_s()),
            format!("{:.4}", group.time_s(0.95)),
            format!("{:.4}", group.time_s(0.99)),
            number(group.bias_hz()),
            number(group.rmse_hz()),
            number(group.bound_hz()),
            group.worst_sigmas().map_or_else(String::new, |sigmas| format!("{sigmas:.2}")),
        ]);
    }
    table.text().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CASE: Case = Case { q: 30.0, coupling: 0.1, noise: case::NOISE };

    /// The ratio over 200 sweeps has a standard deviation of a twentieth.
    #[test]
    fn the_error_of_the_production_fit_is_near_the_bound_of_every_grid() {
        let methods = [
            Method::Steady { points: 101 },
            Method::Even { points: 51 },
            Method::Fast { points: 51, cycles: 2 },
        ];
        for method in methods {
            let groups = trial::run(CASE, method, 200, 7);
            let group = groups
                .iter()
                .find(|group| group.estimator == estimator::SweepEstimator::Production);
            let group = group.unwrap();
            let ratio = group.rmse_hz().unwrap() / group.bound_hz().unwrap();
            assert!((0.85..1.2).contains(&ratio), "{method:?}: {ratio}");
            assert!(group.answers() >= 199, "{method:?}: {}", group.answers());
            assert!(group.worst_sigmas().unwrap() < 4.5, "{method:?}: {:?}", group.worst_sigmas());
        }
    }

    #[test]
    fn the_laboratory_sweep_takes_the_expected_time() {
        for (q, seconds) in [(10.0, 37.0), (30.0, 83.0), (100.0, 243.0)] {
            let case = Case { q, ..CASE };
            let time_s = trial::run(case, method::LABORATORY, 5, 7)[0].time_s(0.5);
            assert!((time_s / seconds - 1.0).abs() < 0.1, "Q {q}: {time_s}");
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes_and_another_one_others() {
        let bytes = |seed| {
            let methods = [Method::Even { points: 21 }, Method::Decay { target_hz: 0.1 }];
            let groups: Vec<Group> =
                methods.into_iter().flat_map(|method| trial::run(CASE, method, 8, seed)).collect();
            let chart = charts::time_against_error(&CASE, &groups).file().unwrap();
            (sweeps_table(&groups), chart)
        };
        assert_eq!(bytes(1), bytes(1));
        let (one, other) = (bytes(1), bytes(2));
        assert_ne!(one.0, other.0);
        assert_ne!(one.1, other.1);
    }

    #[test]
    fn finer_steps_find_the_surface_better_and_take_longer() {
        let searches = finder::try_all(3, 5);
        let of = |fine_step_mm: f64| {
            searches
                .iter()
                .find(|one| {
                    one.sample == "3"
                        && one.approach.settle_s == 0.1
                        && one.approach.fine_step_mm == fine_step_mm
                })
                .unwrap()
        };
        let (coarse, fine) = (of(0.05), of(0.005));
        assert_eq!((coarse.found.len(), fine.found.len()), (3, 3));
        assert!(fine.rmse_um() < 0.5 * coarse.rmse_um(), "{coarse:?} {fine:?}");
        assert!(fine.mean_time_s() > coarse.mean_time_s(), "{coarse:?} {fine:?}");
    }
}
