//! The page of the study.

use rig_chart::{Axis, Band, BandEdge, Chart, Point, Series};

use super::{
    Args, TruthRuns,
    budget::{OF_OTHER_LAW, PartRuns},
    summary::Summary,
    truth::{HALFWAY_MM, Truth},
};
use crate::{
    files::Csv,
    page::{Page, Table},
};

/// The file of the table in the folder of the page.
pub(super) const TABLE: &str = "truths.csv";

/// The page on the runs of all truths.
pub(super) fn page(args: &Args, all: &[TruthRuns], parts: &[PartRuns]) -> Page {
    let title = "Truths that the model was not made for".to_owned();
    let mut page = Page { title, parts: Vec::new() };
    page.text(format!(
        "This page is written by `cargo run --release -p rig-study -- truths --out docs/studies`, in ten \
         minutes on two cores, with {} runs of each truth and seed {}. The same seed gives the same bytes on \
         any number of cores.",
        args.runs, args.seed
    ));
    page.text(
        "A simulated bench whose sensor, contact and friction are those of its description shows how an \
         analysis deals with noise, not whether its model is right. Here the truth differs from the \
         description. Each run has the paper's protocol: five samples, three directions, four angles, then \
         fifty blind touches at random angles. The shifts are those of the reference model under the truth. \
         The standard deviations of the nuisances are those that the rig file states: 0.3 Hz for each shift, \
         20 µm of depth, half of its variance shared by the touches at one place of the stages, 1° of slope, \
         and 3 % of stiffness from point to point.",
    );
    page.text(
        "The analysis is that of a run of the daemon (`rig_analysis::run`), with tier E1s, all samples \
         known, and calibrated at 0°. It is made twice: with the model of the rig file \
         (`model = \"described\"`), and with the model learnt from the main touches (`model = \"learnt\"`, \
         the default; [decision 61](../decisions/0061-a-run-learns-its-model.md)).",
    );
    page.heading("Before and after");
    page.text(
        "Recognition, error and coverage of the 95 % intervals are those of the blind touches against the \
         stiffness of the point touched. A run is noticed when its model is strained or rejected \
         ([decision 60](../decisions/0060-every-run-judges-its-model.md)); the intervals are then wider.",
    );
    page.table(before_and_after(all));
    let share = || Axis::linear("share, %").including(100.0);
    let mut coverage = chart(all, "Coverage of the 95 % intervals", share(), Summary::coverage);
    let (low, high) = COVERAGE_GOAL;
    let edges =
        [100.0 * low, 100.0 * high].map(|x| BandEdge { x, low: 0.0, high: all.len() as f64 + 1.0 });
    let band = Some("93 % to 97 %".to_owned());
    coverage.bands.push(Band { name: band, edges: edges.to_vec(), colour: 6 });
    page.chart("coverage.svg", coverage);
    let share = share().including(0.0);
    let alarms = chart(all, "Runs whose model does not hold", share, Summary::noticed);
    page.chart("noticed.svg", alarms);
    page.data(TABLE, csv(all));
    page.heading("What is noticed");
    page.text(
        "The pattern is the cause whose further term removes most of χ², with the share of the runs that \
         name it. *At most* is the chance of the best test there can be, which knows the truth and calls one \
         true model in fifty false, as the verdict of a run may: with χ² of the same run without nuisances as λ² it \
         notices a truth with the probability Φ(λ − 2.05) (Neyman and Pearson). Where that is a few per cent, the main touches \
         cannot show that the model is another one: *the model holds* says that they agree with it, not that \
         it is true. A share of noticed runs above it comes from errors that are larger than stated under that \
         truth, or from runs that did not identify the arm.",
    );
    page.table(noticed(all));
    false_alarms(&mut page, all);
    page.heading("What is learnt");
    page.table(learnt(all));
    halfway(&mut page, all);
    outside(&mut page);
    budget(&mut page, parts);
    limits(&mut page, all, parts);
    page
}

/// The same runs with touches that are measured at two depths.
fn halfway(page: &mut Page, all: &[TruthRuns]) {
    page.heading("Two depths");
    page.text(format!(
        "With `halfway_mm = {HALFWAY_MM}` in the protocol each touch is also measured on the way to its depth, \
         at the same point and with the same reference. Under a model that holds, both depths give one \
         stiffness. The runs above, learnt with these differences \
         ([decision 68](../decisions/0068-two-depths-and-a-budget.md)):"
    ));
    let mut table = Table::new(&[
        "truth differs by",
        "recognised, %",
        "error, % rms",
        "coverage, %",
        "noticed, %, one depth",
        "two depths",
        "at most",
        "rejected, %, two depths",
        "pattern, two depths",
        "depth held by the stage, %, one depth",
        "two depths",
    ]);
    for TruthRuns { truth, learnt, halfway, at_most, .. } in all {
        table.row([
            truth.name.to_owned(),
            percent(halfway.recognition(), 2),
            percent(halfway.rms(), 1),
            percent(halfway.coverage(), 1),
            percent(learnt.noticed(), 1),
            percent(halfway.noticed(), 1),
            percent(at_most[2], 1),
            percent(halfway.rejected(), 1),
            pattern(halfway),
            percent(learnt.held_by_stage(), 0),
            percent(halfway.held_by_stage(), 0),
        ]);
    }
    page.table(table);
}

/// Runs of the bench of `tests/peers/truths.py`, which is stored with the command that the page names.
const OUTSIDE: &str = include_str!("outside.csv");

/// The runs of a bench that another program makes.
fn outside(page: &mut Page) {
    page.heading("Judged from outside");
    page.text(
        "`tests/peers/truths.py` is a bench in another language: a rod in space as the sensor, and tissues, balls and a \
         slip of its own. `rig-study analyse` makes of its touches what a run of the daemon would, with the learnt model. \
         The table is stored, and is written by `python tests/peers/truths.py target/release/rig-study 200 1 \
         crates/study/src/truths/outside.csv`. A truth that is noticed in few runs at one depth and whose intervals do not \
         cover is one that the verdict of such a run does not exclude.",
    );
    let mut rows =
        OUTSIDE.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let Some(_) = rows.next() else { return };
    let mut table = Table::new(&[
        "truth differs by",
        "depths",
        "runs",
        "refused touches",
        "error, % rms",
        "coverage, %",
        "coverage of the samples, %",
        "noticed, %",
        "pattern",
    ]);
    for row in rows {
        table.row(row);
    }
    page.table(table);
}

/// The parts of the budget against simulated causes.
fn budget(page: &mut Page, parts: &[PartRuns]) {
    page.heading("Uncertainty budget");
    page.text(
        "A part of the budget of each blind touch or sample, and what this cause alone changes in its stiffness, in \
         as many runs of the described bench. Root mean squares, %. *Sensor* is the factor of the described model, \
         and *sensor and model* are factor and learnt terms together, both by the errors of the main touches alone. \
         *Sample* is the variation from point to point in the mean of a sample that is not known. *All together* is \
         the whole budget of a known sample, whose touches are also in the factor and in what is learnt \
         ([decision 123](../decisions/0123-one-covariance-of-the-main-touches.md)). These are all parts that a \
         budget has; sweep and reference are tried together, because both err in the shift. The errors are those of \
         the simulation of this page and of known size: whether a real screw or clamp errs as its rig file states \
         is not tried here. The last rows are those of samples whose contact law is not that of the budget. \
         `cargo test -p rig-study the_parts_of_a_budget` tries the other rows with 20 runs.",
    );
    let mut table = Table::new(&["cause", "of each", "stated", "found", "found over stated"]);
    for PartRuns { part, of, predicted_rel, found_rel } in parts {
        let ratio = format!("{:.3}", found_rel / predicted_rel);
        let (stated, found) = (percent(*predicted_rel, 3), percent(*found_rel, 3));
        table.row([(*part).to_owned(), (*of).to_owned(), stated, found, ratio]);
    }
    page.table(table);
}

fn pattern(summary: &Summary) -> String {
    let named = |(name, share)| format!("{name} ({} %)", percent(share, 0));
    summary.pattern().map_or_else(String::new, named)
}

fn percent(share: f64, decimals: usize) -> String {
    format!("{:.decimals$}", 100.0 * share)
}

fn before_and_after(all: &[TruthRuns]) -> Table {
    let mut table = Table::new(&[
        "truth differs by",
        "recognised, %, described",
        "learnt",
        "error, % rms, described",
        "learnt",
        "coverage, %, described",
        "learnt",
        "noticed, %, described",
        "learnt",
    ]);
    for TruthRuns { truth, described, learnt, .. } in all {
        let pair = |of: &dyn Fn(&Summary) -> f64, decimals| {
            [percent(of(described), decimals), percent(of(learnt), decimals)]
        };
        let cells = [marked(truth)]
            .into_iter()
            .chain(pair(&Summary::recognition, 2))
            .chain(pair(&Summary::rms, 1))
            .chain(pair(&Summary::coverage, 1))
            .chain(pair(&Summary::noticed, 1));
        table.row(cells);
    }
    table.row(["* outside of what a run can learn", "", "", "", "", "", "", "", ""]);
    table
}

fn noticed(all: &[TruthRuns]) -> Table {
    let mut table = Table::new(&[
        "truth differs by",
        "χ² for each degree, described",
        "learnt",
        "rejected, %, described",
        "learnt",
        "pattern, described",
        "learnt",
        "noticed, %, learnt",
        "at most",
    ]);
    for TruthRuns { truth, described, learnt, at_most, .. } in all {
        table.row([
            truth.name.to_owned(),
            format!("{:.2}", described.chi2_per_dof()),
            format!("{:.2}", learnt.chi2_per_dof()),
            percent(described.rejected(), 1),
            percent(learnt.rejected(), 1),
            pattern(described),
            pattern(learnt),
            percent(learnt.noticed(), 1),
            percent(at_most[1], 1),
        ]);
    }
    table
}

fn false_alarms(page: &mut Page, all: &[TruthRuns]) {
    let Some(matched) = all.first() else { return };
    let rate = |summary: &Summary| {
        let (low, high) = summary.noticed_95();
        format!("{} % ({} to {})", percent(summary.noticed(), 1), percent(low, 1), percent(high, 1))
    };
    page.text(format!(
        "False alarms: of the matched runs, {} were strained with the described model and {} with the \
         learnt one; {} % and {} % were rejected.",
        rate(&matched.described),
        rate(&matched.learnt),
        percent(matched.described.rejected(), 1),
        percent(matched.learnt.rejected(), 1),
    ));
}

fn learnt(all: &[TruthRuns]) -> Table {
    let mut table = Table::new(&[
        "truth differs by",
        "tangential ratio, mean",
        "arm, mean, mm",
        "runs that learn the arm, %",
        "runs that find the depth held by the stage, %",
        "coverage of the samples, %",
    ]);
    for TruthRuns { truth, learnt, .. } in all {
        table.row([
            truth.name.to_owned(),
            format!("{:.3}", learnt.ratio()),
            format!("{:.2}", learnt.arm_mm()),
            percent(learnt.arm_learnt(), 0),
            percent(learnt.held_by_stage(), 0),
            percent(learnt.samples_coverage(), 1),
        ]);
    }
    table
}

/// The goals of coverage and recognition.
const COVERAGE_GOAL: (f64, f64) = (0.93, 0.97);
const RECOGNITION_GOAL: f64 = 0.995;

fn limits(page: &mut Page, all: &[TruthRuns], parts: &[PartRuns]) {
    let range = |of: &dyn Fn(&Summary) -> f64, which: &dyn Fn(&TruthRuns) -> bool| {
        let found = all.iter().filter(|one| which(one)).map(|one| of(&one.learnt));
        found.fold((1.0_f64, 0.0_f64), |(least, most), share| (least.min(share), most.max(share)))
    };
    let shown =
        |(least, most): (f64, f64)| format!("{} % to {} %", percent(least, 1), percent(most, 1));
    let within = |one: &TruthRuns| one.truth.is_within;
    let unseen = |one: &TruthRuns| !one.truth.is_within && one.learnt.noticed() < 0.5;
    let coverage = range(&Summary::coverage, &within);
    let (recognition, _) = range(&Summary::recognition, &within);
    let is_met = |is_met: bool| if is_met { "met" } else { "not met" };
    let (low, high) = COVERAGE_GOAL;
    page.heading("Limits");
    page.text(format!(
        "Over the rows without \\*, the coverage of the learnt model is from {} (the goal of {} is {}), that of the samples \
         from {}, and its recognition at least {} % (the goal of {} % is {}). Of the rows with \\*, those that are noticed at \
         one depth in less than half of the runs have a coverage from {}, and of the samples from {}.",
        shown(coverage),
        shown(COVERAGE_GOAL),
        is_met(low <= coverage.0 && coverage.1 <= high),
        shown(range(&Summary::samples_coverage, &within)),
        percent(recognition, 2),
        percent(RECOGNITION_GOAL, 1),
        is_met(recognition >= RECOGNITION_GOAL),
        shown(range(&Summary::coverage, &unseen)),
        shown(range(&Summary::samples_coverage, &unseen)),
    ));
    page.text(
        "Where the stage holds the depth, the intervals allow for another contact law, which one depth does not show \
         ([decision 73](../decisions/0073-another-law-where-the-stage-holds-the-depth.md)). For samples of the law of \
         the analysis they are therefore wide.",
    );
    page.text(
        "Hertz's law grows faster with depth than Sneddon's. At one depth a run learns a shorter arm and a smaller \
         tangential ratio in its place, and even the best test could not tell: the report of a run says which \
         exponent of the depth its touches would show, and that two depths show less. A ball that slips in a few \
         touches, those of the stiffest sample at the steepest angle, is looked for by the friction that each touch \
         needs ([decision 124](../decisions/0124-what-a-run-can-notice.md)), with each number of slipping touches weighted by the \
         coefficients that it stands for ([decision 163](../decisions/0163-the-forms-of-a-slip-are-weighted.md)). At a \
         coefficient of 1 it is one touch of sixty, that of sample 5 at 45° to the front. The error of this touch hides \
         its slide in some runs, and the report of a run says below which coefficient its touches show a slip in 95 of \
         100 runs ([decision 134](../decisions/0134-what-a-run-can-notice-of-a-slip.md)).",
    );
    let of_other_law = |name: &str| {
        let part = parts.iter().find(|one| one.of == OF_OTHER_LAW && one.part == name);
        part.map_or_else(String::new, |one| format!("{:.2}", one.found_rel / one.predicted_rel))
    };
    page.text(format!(
        "A neo-Hookean contact grows less with depth than the analysis assumes. An error of the depth or of the surface \
         changes its stiffness {} and {} times as much as the budget states, one of the angle {} times and one of the shift {} \
         times (the last rows of the budget), so that its intervals are wide. At one depth contact laws are not told apart: \
         their residuals are those of another arm, and a budget that knew this law would be too narrow for another one. \
         Two depths tell them apart, and the model is strained or rejected.",
        of_other_law("depth"),
        of_other_law("surface"),
        of_other_law("angle"),
        of_other_law("sweep and reference"),
    ));
    page.text(
        "A stiffness that grows with depth looks at 45° like a softer sample, and to a learnt model like \
         another friction or arm: the depth along the normal changes with the angle alone. One depth cannot \
         tell them apart, two depths do. A thin sample on a hard base (Dimitriadis et al.) is stiffer with depth \
         too. A sample that sticks to the ball (Johnson, Kendall and Roberts) has a wider contact, and the more \
         so the softer it is; 0.05 J/m² is about the work of adhesion of silicone on glass.",
    );
}

const COLUMNS: [&str; 13] = [
    "truth",
    "model",
    "recognised_percent",
    "rms_percent",
    "coverage_percent",
    "samples_coverage_percent",
    "noticed_percent",
    "rejected_percent",
    "chi2_per_dof",
    "tangential_ratio",
    "arm_mm",
    "arm_learnt_percent",
    "held_by_stage_percent",
];

/// The table beside the page.
pub(super) fn csv(all: &[TruthRuns]) -> String {
    let mut table = Csv::new(&COLUMNS);
    for TruthRuns { truth, described, learnt, halfway, .. } in all {
        for (model, summary) in
            [("described", described), ("learnt", learnt), ("learnt from two depths", halfway)]
        {
            table.row([
                truth.name.to_owned(),
                model.to_owned(),
                percent(summary.recognition(), 3),
                percent(summary.rms(), 3),
                percent(summary.coverage(), 3),
                percent(summary.samples_coverage(), 3),
                percent(summary.noticed(), 3),
                percent(summary.rejected(), 3),
                format!("{:.4}", summary.chi2_per_dof()),
                format!("{:.4}", summary.ratio()),
                format!("{:.4}", summary.arm_mm()),
                percent(summary.arm_learnt(), 3),
                percent(summary.held_by_stage(), 3),
            ]);
        }
    }
    table.text().to_owned()
}

/// How far the marks of both models are from the middle of the row of their truth, in rows.
const APART: f64 = 0.2;

/// The name of a truth, with the mark of those that no run can learn.
fn marked(truth: &Truth) -> String {
    if truth.is_within { truth.name.into() } else { format!("{} *", truth.name) }
}

/// A share of each truth, with the described and with the learnt model, from the top in the order of the table.
fn chart(all: &[TruthRuns], title: &str, share: Axis, of: fn(&Summary) -> f64) -> Chart {
    let row = |one: &TruthRuns| (marked(&one.truth), [of(&one.described), of(&one.learnt)]);
    let rows: Vec<(String, [f64; 2])> = all.iter().map(row).collect();
    let height = |index: usize| (rows.len() - index) as f64;
    let names = rows.iter().enumerate().map(|(index, (name, _))| (height(index), name.as_str()));
    let mut chart = Chart::new(
        title,
        "Share for each truth, in the order of the table, with the described and the learnt model.",
        share,
        Axis::linear("").with_range(0.0, height(0) + 1.0).with_names(names),
    );
    chart.size_px = (720, 720);
    // Equal shares would hide each other.
    for (colour, (name, apart)) in
        [("described", APART), ("learnt", -APART)].into_iter().enumerate()
    {
        let point = |(index, (truth, shares)): (usize, &(String, [f64; 2]))| {
            let note = Some(format!("{truth}: {} %", percent(shares[colour], 1)));
            Point { x: 100.0 * shares[colour], y: height(index) + apart, error: None, note }
        };
        chart.series.push(Series::scatter(name, colour, rows.iter().enumerate().map(point)));
    }
    chart
}
