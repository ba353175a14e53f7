//! The page of the study.

use super::{
    Args, accuracy,
    case::{COUPLINGS, Case, NOISE, NOISES, QUALITIES},
    charts,
    estimator::SweepEstimator,
    finder,
    finder::Searches,
    goals::{self, Evidence},
    method::{LABORATORY, LIMIT_S, Method, SURVEY_S},
    trial::Group,
};
use crate::page::{Page, Table};

pub(super) fn page(args: &Args, evidence: &Evidence, searches: &[Searches]) -> Page {
    let mut page = Page { title: "Speed against accuracy".to_owned(), parts: Vec::new() };
    introduction(&mut page, args);
    page.heading("Goals");
    page.text(
        "Unless a row says otherwise, the noise is 0.5 % at ten cycles, and times start with the \
         sensor at rest. Warm readings follow one another: the resonance moves by up to a \
         linewidth in between. All planners have the analyzer of any phase described above.",
    );
    page.table(goals::table(&goals::judge(evidence)));
    page.heading("The cost of a resonance");
    page.text(laboratory_text(&evidence.groups));
    for noise in NOISES {
        page.text(format!("Noise {} %:", 100.0 * noise));
        page.table(costs(noise, &evidence.groups));
    }
    page.heading("Other estimators");
    page.text(
        "Errors on the laboratory sweep, 201 settled points with 0.5 % noise, in mHz rms. Errors \
         far above the first row are bias and not noise: those estimators define another frequency \
         or assume another model. [failures.md](failures.md) maps where each estimator is right, \
         refuses, or is silently wrong.",
    );
    page.table(estimators(&evidence.groups));
    for noise in NOISES {
        page.heading(&format!("Charts at {} % noise", 100.0 * noise));
        for case in Case::all().iter().filter(|case| case.noise == noise) {
            let chart = charts::time_against_error(case, &evidence.groups);
            page.chart(&format!("{}.svg", case.file()), chart);
        }
    }
    page.data("sweeps.csv", super::sweeps_table(&evidence.groups));
    page.heading("Error over bound");
    page.text(
        "Ideal readings at 101 even points, with noise as the only disturbance: the error over the \
         Cramér–Rao bound of the same readings. The table also has the cases of the wider map.",
    );
    page.chart("accuracy.svg", accuracy::chart(&evidence.chart_cases));
    let cases = [&evidence.chart_cases[..], &evidence.map_cases].concat();
    page.data("accuracy.csv", accuracy::table(&cases));
    page.heading("The surface finder");
    page.text(finder_text(searches));
    page.chart("finder.svg", finder::chart(searches));
    page.data("finder.csv", finder::table(searches));
    page
}

fn introduction(page: &mut Page, args: &Args) {
    page.text(format!(
        "This page, its charts and its tables are written by `cargo run --release -p rig-study -- \
         speed-accuracy --out docs/studies`, in minutes on two cores. The same seed (here {}) \
         gives the same bytes on any number of cores. `rig-study speed-accuracy --host` measures \
         the time of a fit on a computer, which is not kept here.",
        args.seed
    ));
    page.text(format!(
        "Each method of measuring is tried {} times in each of 18 cases: quality 10, 30 and 100, \
         effective coupling 0.02 and 0.1, noise 0.1, 0.5 and 2 % of each part of an impedance \
         integrated over ten cycles. The analyzer is that of the simulated bench, exact in time, \
         with the motion of the sensor carried from point to point. The resonance lies between 130 \
         and 150 Hz and is sought from 112 to 168 Hz; the loss tangent is 0.018. A planner knows \
         the noise of its analyzer and, from a survey of {SURVEY_S} s before its sweeps, what stays \
         the same on the bench; its times are those of the sweeps, each of which has {LIMIT_S} s. A survey \
         that is refused twice counts as a sweep that takes that long without a result.",
        args.trials
    ));
    page.text(
        "`uniform`: even points with ten cycles, each after five time constants of settling (201, \
         101, 51 and 21 points; the first is careful laboratory practice). `fast uniform`: even \
         points without waiting; the model includes the ring-up. `free-decay planner`: that of the \
         daemon, on an analyzer whose drive starts at any phase at each change of frequency, with \
         gaps of up to 3 ms before each reading, known to 1 ms, for targets of 300, 100, 30, \
         10 and 3 mHz. \
         Errors are root mean squares, including bias. The dashed line of integration alone is the \
         bound of settled readings at the best frequencies, without lost time. The ring-up carries \
         information on the resonance too, so that methods without waiting may lie below it. \
         `sweeps.csv` has all numbers for all estimators; the baselines, which need an even grid \
         and do not model the ring-up, get the uniform sweeps only.",
    );
}

fn of<'a>(groups: &'a [Group], case: &Case, method: Method) -> Option<&'a Group> {
    let is_asked = |group: &&Group| {
        group.case == *case
            && group.method == method
            && group.estimator == SweepEstimator::Production
    };
    groups.iter().find(is_asked)
}

/// The laboratory method and the planners in each case.
fn costs(noise: f64, groups: &[Group]) -> Table {
    let mut table = Table::new(&[
        "case",
        "laboratory sweep",
        "free decay, 10 mHz",
        "free decay, 100 mHz",
        "fast uniform, 101 points, 2 cycles",
        "fastest method as accurate as the laboratory sweep",
    ]);
    let methods = [
        LABORATORY,
        Method::Decay { target_hz: 0.01 },
        Method::Decay { target_hz: 0.1 },
        Method::Fast { points: 101, cycles: 2 },
    ];
    for q in QUALITIES {
        for coupling in COUPLINGS {
            let case = Case { q, coupling, noise };
            let laboratory = of(groups, &case, LABORATORY);
            let costs = methods.map(|method| {
                of(groups, &case, method).map_or_else(String::new, |group| cost(group, laboratory))
            });
            let faster = faster(groups, &case);
            table.row(
                [vec![format!("Q {q}, k² {coupling}")], costs.to_vec(), vec![faster]].concat(),
            );
        }
    }
    table
}

/// Relative standard error of the ratio of the mean square errors of two methods.
fn relative_error(one: &Group, other: &Group) -> Option<f64> {
    Some(one.mean_square_rel()?.hypot(other.mean_square_rel()?))
}

/// A ratio with two digits.
fn digits(ratio: f64) -> String {
    if ratio >= 10.0 {
        let unit = 10_f64.powf(ratio.log10().floor() - 1.0);
        return format!("{:.0}", (ratio / unit).round() * unit);
    }
    format!("{ratio:.*}", if ratio >= 1.0 { 1 } else { 2 })
}

/// Time and error of a method, with its gain over the laboratory sweep at equal accuracy.
fn cost(group: &Group, laboratory: Option<&Group>) -> String {
    let (answers, all) = (group.answers(), group.trials.len());
    let Some(rmse_hz) = group.rmse_hz() else { return format!("refused {all} of {all}") };
    let refused = if answers == all {
        String::new()
    } else {
        format!(", refused {} of {all}", all - answers)
    };
    let gain =
        laboratory.filter(|laboratory| laboratory.method != group.method).and_then(|laboratory| {
            let effort = |group: &Group| Some(group.mean_time_s() * group.rmse_hz()?.powi(2));
            let gain = effort(laboratory)? / effort(group)?;
            let factor = (2.0 * relative_error(group, laboratory)?).exp();
            Some(format!(
                ", gain {} ({} to {})",
                digits(gain),
                digits(gain / factor),
                digits(gain * factor)
            ))
        });
    format!(
        "{:.2} s (mean {:.2}, 95 % {:.2}), {:.1} mHz{}{refused}",
        group.time_s(0.5),
        group.mean_time_s(),
        group.time_s(0.95),
        1000.0 * rmse_hz,
        gain.unwrap_or_default()
    )
}

/// Largest ratio of two errors that count as equal.
const AS_GOOD: f64 = 1.05;

/// The fastest method whose expected error is at most this many times that of the laboratory method, with its gain in speed.
fn faster(groups: &[Group], case: &Case) -> String {
    let Some(laboratory) = of(groups, case, LABORATORY) else { return String::new() };
    let is_as_good = |group: &&Group| {
        let is_answered = 2 * group.answers() > group.trials.len();
        let ratio = || Some(group.expected_hz()? / laboratory.expected_hz()?);
        is_answered && ratio().is_some_and(|ratio| ratio <= AS_GOOD)
    };
    let of_production = groups.iter().filter(|group| {
        group.case == *case
            && group.estimator == SweepEstimator::Production
            && group.method != LABORATORY
    });
    let fastest =
        of_production.filter(is_as_good).min_by(|a, b| a.time_s(0.5).total_cmp(&b.time_s(0.5)));
    fastest.map_or_else(
        || "none".to_owned(),
        |group| {
            let times = laboratory.time_s(0.5) / group.time_s(0.5);
            format!("{times:.1} times: {}, {}", group.method.name(), group.method.detail())
        },
    )
}

/// The error of every estimator on the laboratory sweep.
fn estimators(groups: &[Group]) -> Table {
    let cases: Vec<Case> = Case::all().into_iter().filter(|case| case.noise == NOISE).collect();
    let names = cases.iter().map(|Case { q, coupling, .. }| format!("Q {q}, k² {coupling}"));
    let columns: Vec<String> = [String::from("estimator")].into_iter().chain(names).collect();
    let mut table = Table { columns, rows: Vec::new() };
    for estimator in SweepEstimator::of(LABORATORY) {
        let error = |case: &Case| {
            let is_asked = |group: &&Group| {
                group.case == *case && group.method == LABORATORY && group.estimator == estimator
            };
            let group = groups.iter().find(is_asked)?;
            let (answers, all) = (group.answers(), group.trials.len());
            let milli = 1000.0 * group.rmse_hz()?;
            let refused = if answers == all {
                String::new()
            } else {
                format!(" ({} of {all} refused)", all - answers)
            };
            Some(format!("{milli:.1}{refused}"))
        };
        let errors = cases.iter().map(|case| error(case).unwrap_or_else(|| "refused".to_owned()));
        table.row([format!("`{}`", estimator.name())].into_iter().chain(errors));
    }
    table
}

fn laboratory_text(groups: &[Group]) -> String {
    let times = QUALITIES.map(|q| {
        let case = Case { q, coupling: 0.1, noise: NOISE };
        of(groups, &case, LABORATORY)
            .map_or_else(String::new, |group| format!("{:.0}", group.time_s(0.5)))
    });
    format!(
        "The laboratory sweep of 201 points takes {} s at quality 10, 30 and 100. Below are median, mean \
         and 95 % of the time of each method, and its error. The gain is the mean time times the mean \
         square error of the laboratory sweep over that of the method, with two standard errors: how many times \
         faster it is if each is repeated, and the mean taken, until both are equally accurate. One that stops at its \
         target can also be given a smaller one. A gain below 1 is a loss. A method counts as accurate as the \
         laboratory sweep if its expected error is at most {AS_GOOD} times that of the sweep: the Cramér–Rao bound of given points, \
         which the fit reaches, and the stated standard deviation of a planned sweep.",
        times.join(", ")
    )
}

fn finder_text(searches: &[Searches]) -> String {
    let lost: usize = searches.iter().map(|one| one.count as usize - one.found.len()).sum();
    let usual = searches
        .iter()
        .filter(|one| one.approach.fine_step_mm == 0.005 && one.approach.settle_s == 0.1)
        .map(|one| {
            format!(
                "sample {}: {:.1} s, {:.1} µm (bias {:.1} µm)",
                one.sample,
                one.mean_time_s(),
                one.rmse_um(),
                one.bias_um()
            )
        });
    format!(
        "The daemon's search on the simulated bench, upright, with the screws, mountings and noise \
         of the scene `matched`. Each begins at the place of the rig file, 0.8 mm above the surface, with ten cycles a reading. The last step is 50, 20, 10, 5 or 2 µm, after 20, 100 or 500 ms of \
         settling at each step. The error is the true depth of the tip at the surface found. With \
         5 µm and 100 ms: {}. Not found: {lost} of {} searches.",
        usual.collect::<Vec<_>>().join("; "),
        searches.iter().map(|one| one.count).sum::<u32>()
    )
}
