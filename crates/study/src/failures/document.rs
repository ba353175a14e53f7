//! The page.

use super::{
    Args,
    axis::Axis,
    counts, coverage, gate,
    judge::{Cell, Counts, SURVEY_OF_POOR_S, SURVEY_S, others},
    maps,
    path::Path,
    power, reasons,
};
use crate::page::{Page, Table};

/// Largest share of silently wrong results over all maps and both paths.
const WRONG_MAX: f64 = 1e-5;

/// A share of the sweeps at some values of an axis.
struct ShareGoal {
    path: Path,
    axis: Axis,
    values: &'static [f64],
    is_accepted: bool,
    least: f64,
}

const fn accepted_goal(path: Path, axis: Axis, values: &'static [f64], least: f64) -> ShareGoal {
    ShareGoal { path, axis, values, is_accepted: true, least }
}

const fn refused_goal(path: Path, axis: Axis, values: &'static [f64], least: f64) -> ShareGoal {
    ShareGoal { path, axis, values, is_accepted: false, least }
}

const SHARES: [ShareGoal; 8] = [
    accepted_goal(Path::Fit, Axis::Outliers, &[1.0, 2.0, 5.0], 0.99),
    accepted_goal(Path::Fit, Axis::Outliers, &[10.0], 0.92),
    accepted_goal(Path::Fit, Axis::NoiseStated, &[1.0], 0.99),
    refused_goal(Path::Fit, Axis::NoiseStated, &[2.0], 0.95),
    accepted_goal(Path::Planner, Axis::Outliers, &[1.0, 2.0, 5.0], 0.9),
    accepted_goal(Path::Planner, Axis::NoiseStated, &[1.0], 0.99),
    refused_goal(Path::Planner, Axis::NoiseStated, &[2.0], 0.95),
    refused_goal(Path::Planner, Axis::SecondMode, &[20.0], 0.9),
];

pub(super) fn page(args: &Args, cells: &[Cell]) -> Page {
    let title = "Where estimators of the resonance fail".to_owned();
    let mut page = Page { title, parts: Vec::new() };
    introduction(&mut page, args);
    page.heading("Silently wrong results");
    page.table(totals(cells));
    page.table(goals(cells));
    let on_grid = cells.iter().filter(|cell| !cell.axis.is_beyond_one_sweep());
    let wrong = where_wrong(on_grid);
    if !wrong.is_empty() {
        page.table(wrong_table(&wrong));
    }
    accepted(&mut page, cells);
    refused(&mut page, cells);
    for axis in Axis::ALL.into_iter().filter(|axis| !axis.is_beyond_one_sweep()) {
        section(&mut page, axis, cells);
    }
    beyond(&mut page, cells);
    page.heading("Data");
    page.data("failures.csv", maps::table(cells));
    page.data("power.csv", power::table(cells));
    page.data("coverage.csv", coverage::table(cells));
    page.data("reasons.csv", reasons::table(cells));
    page.data("wrong.csv", coverage::wrong(cells));
    page.data(gate::FILE, gate::table(cells, args.seed));
    page
}

fn introduction(page: &mut Page, args: &Args) {
    let Args { seed, seeds, trials, planned, .. } = args;
    page.text(format!(
        "This page, its charts and its tables are written by `cargo run --release -p rig-study -- \
         failures --out docs/studies`, in about half an hour on two cores. The same seeds (here {seed} \
         to {}) give the same bytes on any number of cores; `--seed K --seeds N` takes others, and \
         `--axis NAME` one axis. `--check` computes a part of the first seed again and compares. \
         Each cell of a map stands for {trials} fitted and {planned} planned sweeps of each of six \
         sensors and each seed: quality 10, 30 and 100, effective coupling 0.02 and 0.1 (of two \
         where there is no resonance). Drifts and phase errors have both signs.",
        seed + seeds - 1
    ));
    page.text(format!(
        "Unless the axis says otherwise, a fitted sweep has 101 settled points from 112 to 168 Hz, \
         and noise of 0.5 %. The `planner` is that of the daemon, on an analyzer whose drive starts \
         at any phase at each change of frequency, with gaps of up to 3 ms before each reading, known \
         to 1 ms. As in a run by `three-direction.toml`, a survey of {SURVEY_S} s comes first ({SURVEY_OF_POOR_S} s for a quality of \
         10, which would miss its target), on a bench that stands \
         still but has the other disturbances of the axis; if it is refused twice, the sweep counts as refused and does \
         not begin. `planner without a survey` is that of a protocol without `survey_s`: nothing is known of the \
         phase of the analyzer and of the dielectric, and second modes are looked for in each sweep alone. The sweep itself starts cold, with a limit of 30 s and a target of 10 mHz \
         (quality 10, coupling 0.02: 30 mHz). Half of the surveys know the noise, as after an earlier \
         run, and the others nothing. On the axis `contact` the sweep starts from the survey, as every \
         touch starts from a sweep without a sample; the resonance then lies where a contact may put it, \
         or below.",
    ));
    page.text(
        "The production fit, `maximum-likelihood`, and the planner are silently wrong if they accept a \
         resonance with an error of more than five of its own standard deviations. The other \
         estimators state no uncertainty; they are silently wrong if their error exceeds ten \
         Cramér–Rao bounds of the undisturbed sweep. For a sensor without a resonance every number is \
         wrong. The truth is the series resonance at a small drive, at the effective time of the \
         result if it has one, otherwise at the middle of the sweep. A sweep in one direction cannot \
         distinguish a drift from another resonance, but it knows when it passed the resonance. \
         Outliers are readings wrong by a factor of 0.01 to 100, in both parts or in one, with the \
         wrong sign, or stuck, alone and in bursts of up to four.",
    );
}

fn totals(cells: &[Cell]) -> Table {
    let mut table = Table::new(&[
        "estimator",
        "silently wrong",
        "sweeps",
        "share",
        "accepted",
        "share of the accepted",
    ]);
    let mut row = |name: &str, counts: Counts| {
        table.row([
            format!("`{name}`"),
            counts.wrong.to_string(),
            counts.sweeps().to_string(),
            percent(counts),
            (counts.right + counts.wrong).to_string(),
            format!(
                "{:.3} %",
                100.0 * f64::from(counts.wrong) / f64::from((counts.right + counts.wrong).max(1))
            ),
        ]);
    };
    for (index, estimator) in others().enumerate() {
        let of = cells.iter().filter(|cell| !cell.axis.is_beyond_one_sweep());
        let of = of.filter_map(|cell| cell.others.get(index));
        row(estimator.name(), of.fold(Counts::default(), |sum, one| sum.plus(*one)));
    }
    for path in Path::ALL {
        row(path.name(), counts(path, cells));
    }
    table
}

fn percent(counts: Counts) -> String {
    format!("{:.3} %", 100.0 * counts.share(counts.wrong))
}

fn goals(cells: &[Cell]) -> Table {
    let [fit, planner] = [Path::Fit, Path::Planner].map(|path| counts(path, cells));
    let both = fit.plus(planner);
    let mut table = Table::new(&["goal", "limit", "found", "met"]);
    let mut row = |quantity: String, limit: String, found: String, is_met: bool| {
        let met = if is_met { "yes" } else { "**no**" };
        table.row([quantity, limit, found, met.to_owned()]);
    };
    let share = both.share(both.wrong);
    row(
        "silently wrong, fit and planner together".to_owned(),
        format!("{:.0} in 100,000", 1e5 * WRONG_MAX),
        format!("{} of {}: {:.1} in 100,000", both.wrong, both.sweeps(), 1e5 * share),
        share <= WRONG_MAX,
    );
    for ShareGoal { path, axis, values, is_accepted, least } in SHARES {
        let is_of =
            |cell: &&Cell| (cell.axis, cell.path) == (axis, path) && values.contains(&cell.value);
        let all = cells.iter().filter(is_of).map(Cell::counts);
        let counts = all.fold(Counts::default(), Counts::plus);
        if counts.sweeps() == 0 {
            continue;
        }
        let refused = counts.share(counts.refused);
        let (found, verb) =
            if is_accepted { (1.0 - refused, "accepted") } else { (refused, "refused") };
        let values: Vec<String> = values.iter().map(f64::to_string).collect();
        let results = cells.iter().filter(is_of).flat_map(|cell| &cell.results);
        let surveys = results.filter(|result| result.time_s.is_none()).count();
        let by_survey = if path.is_planned() && !is_accepted {
            format!(", {surveys} of them in the survey")
        } else {
            String::new()
        };
        row(
            format!("{verb} by `{}`: {} {}", path.name(), axis.label(), values.join(", ")),
            format!("{:.0} %", 100.0 * least),
            format!("{:.1} % of {}{by_survey}", 100.0 * found, counts.sweeps()),
            found >= least,
        );
    }
    table
}

/// The points with silently wrong results of the production paths, the worst first.
pub(super) fn where_wrong<'a>(cells: impl Iterator<Item = &'a Cell>) -> Vec<(String, String)> {
    let mut all: Vec<(f64, String, String)> = cells
        .map(|cell| (cell, cell.counts()))
        .filter(|(_, counts)| counts.wrong > 0)
        .map(|(cell, counts)| {
            let place = format!("`{}`, `{}` at {}", cell.path.name(), cell.axis.file(), cell.value);
            let count = format!("{} of {} ({})", counts.wrong, counts.sweeps(), percent(counts));
            (counts.share(counts.wrong), place, count)
        })
        .collect();
    all.sort_by(|one, other| other.0.total_cmp(&one.0));
    all.into_iter().map(|(_, place, count)| (place, count)).collect()
}

fn wrong_table(wrong: &[(String, String)]) -> Table {
    let mut table = Table::new(&["silently wrong", "sweeps"]);
    for (place, count) in wrong {
        table.row([place.clone(), count.clone()]);
    }
    table
}

fn accepted(page: &mut Page, cells: &[Cell]) {
    page.heading("Accepted results");
    page.text(
        "Errors of accepted results in their own standard deviations, over all values of an axis. A \
         normal error has a mean of 0.80, a median of 0.67, 99 % within 2.58, and 95 % in the 95 % \
         interval; beside it stands the value at which that share is certainly lowest, with its own 95 % interval. \
         Results for sensors without a resonance have no error and are silently wrong. \
         `coverage.csv` has the same for each value.",
    );
    page.table(coverage::on_page(Path::Fit, cells));
    page.text("The planner, with its time on the rig:");
    page.table(coverage::on_page(Path::Planner, cells));
    page.text("The planner without a survey:");
    page.table(coverage::on_page(Path::Unsurveyed, cells));
}

fn refused(page: &mut Page, cells: &[Cell]) {
    page.heading("Reasons of refusals");
    page.text(
        "What refused sweeps state, in percent of the refused sweeps of each axis. Reasons that name the \
         cause of the axis are bold. `another cause` is the share that claims a cause that is not \
         there; noise, too few points, a misfit without a cause and a missed target claim none. \
         `reasons.csv` has the same for each value.",
    );
    page.table(reasons::on_page(Path::Fit, cells));
    page.text("The planner:");
    page.table(reasons::on_page(Path::Planner, cells));
}

/// The map of an axis, and the detection power of fit and planner.
fn section(page: &mut Page, axis: Axis, cells: &[Cell]) {
    if cells.iter().all(|cell| cell.axis != axis) {
        return;
    }
    page.heading(axis.label());
    page.chart(&format!("{}.svg", axis.file()), maps::map(axis, cells));
    for (path, prefix) in [(Path::Fit, "power"), (Path::Planner, "planner")] {
        if let Some(chart) = power::chart(axis, path, cells) {
            page.chart(&format!("{prefix}-{}.svg", axis.file()), chart);
        }
    }
}

fn beyond(page: &mut Page, cells: &[Cell]) {
    page.heading("Limits of a single sweep");
    page.text(
        "A spring that softens slightly at the peak changes the readings of one sweep in the same \
         way as another resonance does. No estimator can detect it in the readings, and all of \
         them, the production fit included, are silently wrong here. A second sweep at another \
         level detects it (above, `with a step of the level`: the result is a sweep at the full level, or a refusal by the \
         daemon's own check of the level, the `level_check` of a protocol. It measures until the difference of the levels is \
         certainly less than two standard deviations of a sweep. A softening that it does not show shifts a result by up to \
         2·4/3 = 2.7 of its standard deviations. A shift in contact is the difference of two sweeps at one level, in \
         which most of that cancels). This map is not part of the count.",
    );
    let wrong = where_wrong(cells.iter().filter(|cell| cell.axis.is_beyond_one_sweep()));
    if !wrong.is_empty() {
        page.table(wrong_table(&wrong));
    }
    for axis in Axis::ALL.into_iter().filter(|axis| axis.is_beyond_one_sweep()) {
        section(page, axis, cells);
    }
}
