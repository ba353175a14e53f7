//! What a fit and a step of a planner cost on this computer. These numbers are not the same twice,
//! and stand apart from everything that is.

use std::{hint::black_box, io::Write, time::Instant};

use rig_chart::{Axis, Chart, Marker, Rule, Series};
use rig_model::{Reading, SweepMethod, random::Stream};
use rig_resonance::{Estimator, FitOptions, Fitter, Next, Planner};

use super::{
    cell::{COUPLINGS, Cell, NOISE, QUALITIES},
    reader::Reader,
    trial::{self, quantile},
    way::{Measured, Way, cold, request},
};
use crate::{
    analyzer::{Analyzer, WINDOW, sensor},
    files::{Csv, Folder},
    outcome::StudyError,
};

/// The sensor that fits are timed with.
const CELL: Cell = Cell { q: 30.0, coupling: 0.1, noise: NOISE };
/// Sweeps fitted in turn, so that no fit sees the same readings twice in a row.
const SWEEPS: u64 = 64;
/// Times that each of them is fitted.
const ROUNDS: usize = 31;
/// (points, goal in µs) of the production fit.
const GOALS: [(u32, f64); 3] = [(21, 2.0), (101, 5.0), (401, 16.0)];
const LOSS_GOAL_US: f64 = 7.0;
const PLANNING_GOAL_MS: f64 = 1.0;

/// Measures, writes `host.csv` and `host.svg`, and says what was aimed at.
pub(super) fn run(folder: &Folder, seed: u64, out: &mut impl Write) -> Result<(), StudyError> {
    let mut table = Csv::new(&["what", "points", "median_us", "goal_us"]);
    let mut tell = |what: &str, points: Option<u32>, micros: f64, goal_us: Option<f64>| {
        let points = points.map_or_else(String::new, |points| points.to_string());
        let goal = goal_us.map_or_else(String::new, |goal| goal.to_string());
        let of_points =
            if points.is_empty() { String::new() } else { format!(", {points} points") };
        table.row([what.to_owned(), points, format!("{micros:.2}"), goal]);
        let verdict = match goal_us {
            None => String::new(),
            Some(goal) if micros <= goal => format!(" (goal {goal} µs: met)"),
            Some(goal) => format!(" (goal {goal} µs: NOT MET)"),
        };
        writeln!(out, "{what}{of_points}: {micros:.2} µs{verdict}")
    };
    for (points, goal_us) in GOALS {
        let micros = production_us(points, false, seed);
        tell("maximum-likelihood", Some(points), micros, Some(goal_us))?;
    }
    let with_loss = production_us(101, true, seed);
    tell("maximum-likelihood with loss", Some(101), with_loss, Some(LOSS_GOAL_US))?;
    let mut costs = vec![(Reader::Production, production_us(101, false, seed))];
    for estimator in Estimator::ALL {
        if estimator != Estimator::MaximumLikelihood {
            let micros = baseline_us(estimator, seed);
            tell(estimator.name(), Some(101), micros, None)?;
            costs.push((Reader::Baseline(estimator), micros));
        }
    }
    for method in [SweepMethod::Adaptive, SweepMethod::Transient] {
        let what = format!("a step of planning, {method:?}");
        tell(&what, None, 1000.0 * planning_ms(method, seed), Some(1000.0 * PLANNING_GOAL_MS))?;
    }
    folder.write("host.csv", table.text())?;
    folder.write("host.svg", &chart(&costs, seed).file()?)?;
    Ok(())
}

/// Sweeps of so many points.
fn sweeps(points: u32, seed: u64) -> Vec<Measured> {
    let sweep = |number| {
        let mut chance = Stream::new(seed, number);
        let circuit = sensor(135.0 + 10.0 * chance.uniform(), CELL.q, CELL.coupling);
        Way::Steady { points }.measure(&circuit, &CELL, chance)
    };
    (0..SWEEPS).map(sweep).collect()
}

fn production_us(points: u32, always_loss: bool, seed: u64) -> f64 {
    let options = FitOptions { window: Some(WINDOW), always_loss, ..FitOptions::default() };
    let mut fitter = Fitter::default();
    median_us(&sweeps(points, seed), |readings| {
        black_box(fitter.fit(readings, &options));
    })
}

fn baseline_us(estimator: Estimator, seed: u64) -> f64 {
    median_us(&sweeps(101, seed), |readings| {
        // A refusal takes its time as well.
        let _ = black_box(estimator.estimate(readings, WINDOW));
    })
}

fn median_us(sweeps: &[Measured], mut fit: impl FnMut(&[Reading])) -> f64 {
    let mut times = Vec::new();
    for round in 0..=ROUNDS {
        for sweep in sweeps {
            let begun = Instant::now();
            fit(black_box(&sweep.readings));
            // The first round fills the caches.
            if round > 0 {
                times.push(1e6 * begun.elapsed().as_secs_f64());
            }
        }
    }
    times.sort_by(f64::total_cmp);
    quantile(&times, 0.5)
}

/// The median time between a reading and the next point, over cold sweeps to 10 mHz in every cell.
fn planning_ms(method: SweepMethod, seed: u64) -> f64 {
    let mut times = Vec::new();
    for q in QUALITIES {
        for coupling in COUPLINGS {
            let cell = Cell { q, coupling, noise: NOISE };
            let chance = Stream::new(seed, cell.number());
            let mut analyzer = Analyzer::at_rest(cell.middle(), cell.noise, chance);
            let mut planner = Planner::new(&request(method, 0.01), Some(&cold(cell.noise)));
            loop {
                let begun = Instant::now();
                let next = planner.next();
                times.push(1e3 * begun.elapsed().as_secs_f64());
                let Next::Measure(points) = next else { break };
                let readings: Vec<_> = points.iter().map(|point| analyzer.visit(point)).collect();
                let begun = Instant::now();
                planner.add(&readings);
                if let Some(last) = times.last_mut() {
                    *last += 1e3 * begun.elapsed().as_secs_f64();
                }
            }
        }
    }
    times.sort_by(f64::total_cmp);
    quantile(&times, 0.5)
}

/// Microseconds of a fit against the error of practice's sweep of 101 points, over its bound.
fn chart(costs: &[(Reader, f64)], seed: u64) -> Chart {
    const TRIALS: u32 = 400;
    let mut chart = Chart::new(
        "Time of a fit on this computer against its error",
        "Median time of a fit to 101 points against its root mean square error over the \
         Cramér–Rao bound, quality 30, coupling 0.1, noise 0.5 %.",
        Axis::log("time of a fit (µs)"),
        Axis::log("error over bound"),
    );
    chart.size_px = (720, 460);
    chart.rules.push(Rule::AtY { value: 1.0, label: "Cramér–Rao bound".to_owned() });
    let groups = trial::run(CELL, Way::Even { points: 101 }, TRIALS, seed);
    for (colour, (reader, micros)) in costs.iter().enumerate() {
        let Some(group) = groups.iter().find(|group| group.reader == *reader) else { continue };
        if let (Some(rmse_hz), Some(bound_hz)) = (group.rmse_hz(), group.bound_hz()) {
            let mut series =
                Series::scatter(reader.name(), colour, [(*micros, rmse_hz / bound_hz)]);
            // There are more estimators than colours; the shape then tells them apart.
            series.marker = Some(Marker::of(colour + colour / rig_chart::COLOURS));
            chart.series.push(series);
        }
    }
    chart
}
