//! The page that says it in words.

use super::{
    Args, accuracy,
    cell::{COUPLINGS, Cell, NOISE, NOISES, QUALITIES},
    charts, finder,
    finder::Searches,
    goals::{self, Evidence},
    reader::Reader,
    trial::Group,
    way::{LIMIT_S, PRACTICE, Way},
};
use crate::page::{Page, Table};

pub(super) fn page(args: &Args, evidence: &Evidence, searches: &[Searches]) -> Page {
    let mut page = Page { title: "Speed against accuracy".to_owned(), parts: Vec::new() };
    introduction(&mut page, args);
    page.heading("Goals");
    page.text(
        "Noise is 0.5 % at ten cycles, and times count everything from the sensor at rest, unless \
         a row says otherwise. Warm readings follow one another while the resonance moves by up to \
         1 Hz in between and the drive never stops. A plan made with the sensor known needs no \
         reading to find it: three frequencies in turn, searched for with the Cramér–Rao bound. \
         How far a planner stays behind it is what finding costs, and judging: a verdict takes no \
         fewer than seven readings, which at two cycles each last 0.10 s.",
    );
    page.table(goals::table(&goals::judge(evidence)));
    page.heading("What a resonance costs");
    page.text(practice_text(&evidence.groups));
    page.table(costs(&evidence.groups));
    page.heading("Other estimators");
    page.text(
        "Errors on the sweep of practice, 201 settled points with 0.5 % noise, in mHz rms. What is \
         far above the first row is not noise but bias: those estimators mean another frequency, \
         or another model. [failures.md](failures.md) maps where each is right, refuses, or is \
         silently wrong.",
    );
    page.table(estimators(&evidence.groups));
    for noise in NOISES {
        page.heading(&format!("Charts at {} % noise", 100.0 * noise));
        for cell in Cell::all().iter().filter(|cell| cell.noise == noise) {
            let chart = charts::time_against_error(cell, &evidence.groups);
            page.chart(&format!("{}.svg", cell.file()), chart);
        }
    }
    page.data("sweeps.csv", super::sweeps_table(&evidence.groups));
    page.heading("How near the bound");
    page.text(
        "Ideal readings at 101 even points, where nothing but noise disturbs: the error over the \
         Cramér–Rao bound of the same readings. The table has the cells of the wider map as well.",
    );
    page.chart("accuracy.svg", accuracy::chart(&evidence.chart_cells));
    let cells = [&evidence.chart_cells[..], &evidence.map_cells].concat();
    page.data("accuracy.csv", accuracy::table(&cells));
    page.heading("The surface finder");
    page.text(finder_text(searches));
    page.chart("finder.svg", finder::chart(searches));
    page.data("finder.csv", finder::table(searches));
    page
}

fn introduction(page: &mut Page, args: &Args) {
    page.text(format!(
        "This page, its charts and its tables are written by \
         `cargo run --release -p rig-study -- speed-accuracy --out docs`, in minutes on two cores. \
         The same seed (here {}) gives the same bytes whatever the number of cores. What depends on \
         the computer, microseconds per fit against error, is written by \
         `rig-study speed-accuracy --host` and is not kept here.",
        args.seed
    ));
    page.text(format!(
        "Each way of measuring is tried {} times in each of 18 cells: quality 10, 30 and 100, \
         effective coupling 0.02 and 0.1, noise 0.1, 0.5 and 2 % of each part of an impedance \
         integrated over ten cycles. The analyzer is the one of the simulated bench, exact in time, \
         with the motion of the sensor carried from point to point. The resonance lies anywhere \
         from 130 to 150 Hz and is sought from 112 to 168 Hz; the loss tangent is 0.018. A planner \
         knows the noise of its analyzer and nothing of the sensor, and has {LIMIT_S} s.",
        args.trials
    ));
    page.text(
        "`uniform`: even points with ten cycles, five time constants waited for before each (201, \
         101, 51 and 21 points; the first is careful laboratory practice). `fast uniform`: even \
         points without waiting, the ring-up being part of the model. `settled planner` and \
         `transient-aware planner`: the daemon's, asked for 100, 30, 10 and 3 mHz. Errors are root \
         mean squares with the bias. The dashed line of integration alone is the bound of settled \
         readings at the best frequencies, with no time lost; the ring-up tells of the resonance \
         too, so that ways that do not wait may pass below it. `sweeps.csv` has every number, for every estimator: those that \
         need an even grid, and have no model of the ring-up, read the uniform sweeps only.",
    );
}

fn of<'a>(groups: &'a [Group], cell: &Cell, way: Way) -> Option<&'a Group> {
    let is_asked = |group: &&Group| {
        group.cell == *cell && group.way == way && group.reader == Reader::Production
    };
    groups.iter().find(is_asked)
}

/// The way of practice and the planners, side by side.
fn costs(groups: &[Group]) -> Table {
    let mut table = Table::new(&[
        "cell",
        "practice",
        "transient-aware, 10 mHz",
        "settled, 10 mHz",
        "fast uniform, 101 points, 2 cycles",
        "as good as practice, and so much faster",
    ]);
    let cell_of = |group: Option<&Group>| {
        let group = group?;
        let milli = 1000.0 * group.rmse_hz()?;
        Some(format!("{:.2} s, {milli:.1} mHz", group.time_s(0.5)))
    };
    let ways = [
        PRACTICE,
        Way::Transient { target_hz: 0.01 },
        Way::Settled { target_hz: 0.01 },
        Way::Fast { points: 101, cycles: 2 },
    ];
    for q in QUALITIES {
        for coupling in COUPLINGS {
            let cell = Cell { q, coupling, noise: NOISE };
            let costs = ways
                .map(|way| cell_of(of(groups, &cell, way)).unwrap_or_else(|| "refused".to_owned()));
            let faster = faster(groups, &cell);
            table.row([vec![cell.to_string()], costs.to_vec(), vec![faster]].concat());
        }
    }
    table
}

/// The fastest way whose error is no larger than that of practice, and how much faster it is.
fn faster(groups: &[Group], cell: &Cell) -> String {
    let Some(practice) = of(groups, cell, PRACTICE) else { return String::new() };
    let allowed_hz = practice.rmse_hz().unwrap_or_default();
    let is_as_good = |group: &&Group| {
        let is_answered = 2 * group.answers() > group.trials.len();
        is_answered && group.rmse_hz().is_some_and(|rmse_hz| rmse_hz <= allowed_hz)
    };
    let of_production = groups.iter().filter(|group| {
        group.cell == *cell && group.reader == Reader::Production && group.way != PRACTICE
    });
    let fastest =
        of_production.filter(is_as_good).min_by(|a, b| a.time_s(0.5).total_cmp(&b.time_s(0.5)));
    fastest.map_or_else(
        || "none".to_owned(),
        |group| {
            let times = practice.time_s(0.5) / group.time_s(0.5);
            format!("{times:.1} times: {}, {}", group.way.name(), group.way.detail())
        },
    )
}

/// The error of every estimator on the sweep of practice.
fn estimators(groups: &[Group]) -> Table {
    let cells: Vec<Cell> = Cell::all().into_iter().filter(|cell| cell.noise == NOISE).collect();
    let names = cells.iter().map(|Cell { q, coupling, .. }| format!("Q {q}, k² {coupling}"));
    let columns: Vec<String> = [String::from("estimator")].into_iter().chain(names).collect();
    let mut table = Table { columns, rows: Vec::new() };
    for reader in Reader::of(PRACTICE) {
        let error = |cell: &Cell| {
            let is_asked = |group: &&Group| {
                group.cell == *cell && group.way == PRACTICE && group.reader == reader
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
        let errors = cells.iter().map(|cell| error(cell).unwrap_or_else(|| "refused".to_owned()));
        table.row([format!("`{}`", reader.name())].into_iter().chain(errors));
    }
    table
}

fn practice_text(groups: &[Group]) -> String {
    let times = QUALITIES.map(|q| {
        let cell = Cell { q, coupling: 0.1, noise: NOISE };
        of(groups, &cell, PRACTICE)
            .map_or_else(String::new, |group| format!("{:.0}", group.time_s(0.5)))
    });
    format!(
        "Practice, 201 points, takes {} s at quality 10, 30 and 100. Median time and error of each \
         way, at {} % noise:",
        times.join(", "),
        100.0 * NOISE
    )
}

fn finder_text(searches: &[Searches]) -> String {
    let lost: usize = searches.iter().map(|one| one.count as usize - one.found.len()).sum();
    let shipped = searches
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
        "The daemon's search on the simulated bench, upright, with the shipped scene's screws, \
         mountings and noise: the last step is 50, 20, 10, 5 or 2 µm, and 20, 100 or 500 ms are \
         waited for at each step. The error is how deep the tip is where the search says the \
         surface begins. As shipped (5 µm, 100 ms): {}. Not found: {lost} of {} searches.",
        shipped.collect::<Vec<_>>().join("; "),
        searches.iter().map(|one| one.count).sum::<u32>()
    )
}
