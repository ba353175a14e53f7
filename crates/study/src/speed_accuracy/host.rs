//! The time of a fit and of a planning step on this computer. These numbers are not reproducible,
//! and are stored apart from the others.

use std::{hint::black_box, io::Write, time::Instant};

use rig_chart::{Axis, Chart, Marker, Rule, Series};
use rig_model::{Reading, random::Stream};
use rig_resonance::{Estimator, FitOptions, Fitter, Next, Planner};

use super::{
    case::{COUPLINGS, Case, NOISE, QUALITIES},
    estimator::SweepEstimator,
    method::{Measured, Method, cold, request},
    trial::{self, quantile},
};
use crate::{
    analyzer::{Analyzer, WINDOW, sensor},
    files::{Csv, Folder},
    outcome::StudyError,
};

/// The case of the timed fits.
const CASE: Case = Case { q: 30.0, coupling: 0.1, noise: NOISE };
/// Number of sweeps fitted in turn, so that no fit gets the same readings twice in a row.
const SWEEPS: u64 = 64;
/// Number of fits of each sweep.
const ROUNDS: usize = 31;
/// Points and time goal, µs, of the production fit.
const GOALS: [(u32, f64); 3] = [(21, 2.0), (101, 5.0), (401, 16.0)];
const LOSS_GOAL_US: f64 = 7.0;
const PLANNING_GOAL_MS: f64 = 1.0;

/// Measures, writes `host.csv` and `host.svg`, and prints the goals.
pub(super) fn run(folder: &Folder, seed: u64, out: &mut impl Write) -> Result<(), StudyError> {
    let mut table = Csv::new(&["what", "points", "median_us", "goal_us"]);
    let mut tell = |what: &str, points: Option<u32>, micros: f64, goal_us: Option<f64>| {
        let points = points.map_or_else(String::new, |points| points.to_string());
        let goal = goal_us.map_or_else(String::new, |goal| goal.to_string());
        let of_points =
            if points.is_empty() { String::new() } else { format!(", {points} points") };
        table.row([what.to_owned(), points, format!("{micros:.2}"), goal]);
        let judgement = match goal_us {
            None => String::new(),
            Some(goal) if micros <= goal => format!(" (goal {goal} µs: met)"),
            Some(goal) => format!(" (goal {goal} µs: NOT MET)"),
        };
        writeln!(out, "{what}{of_points}: {micros:.2} µs{judgement}")
    };
    for (points, goal_us) in GOALS {
        let micros = production_us(points, false, seed);
        tell("maximum-likelihood", Some(points), micros, Some(goal_us))?;
    }
    let with_loss = production_us(101, true, seed);
    tell("maximum-likelihood with loss", Some(101), with_loss, Some(LOSS_GOAL_US))?;
    let mut costs = vec![(SweepEstimator::Production, production_us(101, false, seed))];
    for estimator in Estimator::ALL {
        if estimator != Estimator::MaximumLikelihood {
            let micros = baseline_us(estimator, seed);
            tell(estimator.name(), Some(101), micros, None)?;
            costs.push((SweepEstimator::Baseline(estimator), micros));
        }
    }
    let step_us = 1000.0 * planning_ms(seed);
    tell("a step of planning", None, step_us, Some(1000.0 * PLANNING_GOAL_MS))?;
    folder.write("host.csv", table.text())?;
    folder.write("host.svg", &chart(&costs, seed).file()?)?;
    Ok(())
}

/// Sweeps with a number of points.
fn sweeps(points: u32, seed: u64) -> Vec<Measured> {
    let sweep = |number| {
        let mut random = Stream::new(seed, number);
        let circuit = sensor(135.0 + 10.0 * random.uniform(), CASE.q, CASE.coupling);
        Method::Steady { points }.measure(&circuit, &CASE, random)
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
        // A refusal takes time as well.
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

/// The median time between a reading and the next point, ms, over cold sweeps to 10 mHz in every
/// case.
fn planning_ms(seed: u64) -> f64 {
    let mut times = Vec::new();
    for q in QUALITIES {
        for coupling in COUPLINGS {
            let case = Case { q, coupling, noise: NOISE };
            let random = Stream::new(seed, case.number());
            let mut analyzer = Analyzer::at_rest(case.middle(), case.noise, random);
            let mut planner = Planner::new(&request(0.01), Some(&cold(case.noise)));
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

/// Time of a fit against its error over the bound, on sweeps of 101 settled points.
fn chart(costs: &[(SweepEstimator, f64)], seed: u64) -> Chart {
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
    let groups = trial::run(CASE, Method::Even { points: 101 }, TRIALS, seed);
    for (colour, (estimator, micros)) in costs.iter().enumerate() {
        let Some(group) = groups.iter().find(|group| group.estimator == *estimator) else {
            continue;
        };
        if let (Some(rmse_hz), Some(bound_hz)) = (group.rmse_hz(), group.bound_hz()) {
            let mut series =
                Series::scatter(estimator.name(), colour, [(*micros, rmse_hz / bound_hz)]);
            // Repeated colours get another marker.
            series.marker = Some(Marker::of(colour + colour / rig_chart::COLOURS));
            chart.series.push(series);
        }
    }
    chart
}
