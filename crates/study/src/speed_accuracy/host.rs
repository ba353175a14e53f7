//! The time of a fit and of a planning step on this computer. These numbers are not reproducible,
//! and are stored apart from the others.

use std::{hint::black_box, io::Write, time::Instant};

use rig_chart::{Axis, Chart, Marker, Rule, Series};
use rig_model::{Reading, random::Stream};
use rig_resonance::{Estimator, FitOptions, Fitter, Next, Planner, Timing};

use super::{
    case::{COUPLINGS, Case, NOISE, QUALITIES},
    estimator::SweepEstimator,
    method::{Measured, Method, cold, request},
    trial::{self, quantile},
};
use crate::{
    analyzer::{Analyzer, Gaps, WINDOW, sensor},
    files::{Csv, Folder},
    outcome::StudyError,
};

/// The case of the timed fits.
const CASE: Case = Case { q: 30.0, coupling: 0.1, noise: NOISE };
/// Number of sweeps fitted in turn, so that no fit gets the same readings twice in a row.
const SWEEPS: u64 = 500;
/// Number of fits of each sweep.
const ROUNDS: usize = 9;
/// Points of the timed production fits, with the goals of the mean and of 99 % of the fits, µs.
const FITS: [(u32, Timing, [Option<f64>; 2]); 4] = [
    (21, Timing::Waited, [None, None]),
    (101, Timing::Waited, [Some(10.0), Some(100.0)]),
    (401, Timing::Waited, [Some(40.0), None]),
    (101, Timing::Unknown, [Some(20.0), None]),
];
/// Goals of a planning step, ms: the mean, 99.9 % of the steps, and the longest.
const STEP_GOALS_MS: [f64; 3] = [0.3, 2.0, 20.0];
/// Sweeps of each case whose planning steps are timed.
const PLANNED: u64 = 8;

/// Measures, writes `host.csv` and `host.svg`, and prints the goals.
pub(super) fn run(folder: &Folder, seed: u64, out: &mut impl Write) -> Result<(), StudyError> {
    let mut table = Csv::new(&["what", "points", "statistic", "us", "goal_us"]);
    let mut tell =
        |what: &str, points: Option<u32>, statistic: &str, micros: f64, goal_us: Option<f64>| {
            let points = points.map_or_else(String::new, |points| points.to_string());
            let goal = goal_us.map_or_else(String::new, |goal| goal.to_string());
            let of_points =
                if points.is_empty() { String::new() } else { format!(", {points} points") };
            table.row([what, &points, statistic, &format!("{micros:.2}"), &goal]);
            let judgement = match goal_us {
                None => String::new(),
                Some(goal) if micros <= goal => format!(" (goal {goal} µs: met)"),
                Some(goal) => format!(" (goal {goal} µs: NOT MET)"),
            };
            writeln!(out, "{what}{of_points}, {statistic}: {micros:.2} µs{judgement}")
        };
    for (points, timing, [mean_us, most_us]) in FITS {
        let what = match timing {
            Timing::Unknown => "maximum-likelihood, times unknown",
            _ => "maximum-likelihood",
        };
        let times = production_us(points, timing, seed);
        tell(what, Some(points), "median", quantile(&times, 0.5), None)?;
        tell(what, Some(points), "mean", mean(&times), mean_us)?;
        tell(what, Some(points), "99 %", quantile(&times, 0.99), most_us)?;
    }
    let production = production_us(101, Timing::Waited, seed);
    let mut costs = vec![(SweepEstimator::Production, quantile(&production, 0.5))];
    for estimator in Estimator::ALL {
        if estimator != Estimator::MaximumLikelihood {
            let times = baseline_us(estimator, seed);
            tell(estimator.name(), Some(101), "median", quantile(&times, 0.5), None)?;
            tell(estimator.name(), Some(101), "mean", mean(&times), None)?;
            costs.push((SweepEstimator::Baseline(estimator), quantile(&times, 0.5)));
        }
    }
    let steps = planning_us(seed);
    let [mean_ms, most_ms, longest_ms] = STEP_GOALS_MS.map(|ms| Some(1000.0 * ms));
    let what = "a step of planning";
    tell(what, None, "median", quantile(&steps, 0.5), None)?;
    tell(what, None, "mean", mean(&steps), mean_ms)?;
    tell(what, None, "99.9 %", quantile(&steps, 0.999), most_ms)?;
    tell(what, None, "longest", quantile(&steps, 1.0), longest_ms)?;
    folder.write("host.csv", table.text())?;
    folder.write("host.svg", &chart(&costs, seed).file()?)?;
    Ok(())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
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

fn production_us(points: u32, timing: Timing, seed: u64) -> Vec<f64> {
    let options = FitOptions { window: Some(WINDOW), timing, ..FitOptions::default() };
    let mut fitter = Fitter::default();
    times_us(&sweeps(points, seed), |readings| {
        black_box(fitter.fit(readings, &options));
    })
}

fn baseline_us(estimator: Estimator, seed: u64) -> Vec<f64> {
    times_us(&sweeps(101, seed), |readings| {
        // A refusal takes time as well.
        let _ = black_box(estimator.estimate(readings, WINDOW));
    })
}

/// The time of each fit, µs, sorted.
fn times_us(sweeps: &[Measured], mut fit: impl FnMut(&[Reading])) -> Vec<f64> {
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
    times
}

/// The time between a reading and the next point, µs, sorted, over cold sweeps to 10 mHz in every case.
fn planning_us(seed: u64) -> Vec<f64> {
    let mut times = Vec::new();
    for q in QUALITIES {
        for (coupling, sweep) in
            COUPLINGS.into_iter().flat_map(|k| (0..PLANNED).map(move |n| (k, n)))
        {
            let case = Case { q, coupling, noise: NOISE };
            let random = Stream::of_trial(seed, case.number(), sweep);
            let mut analyzer =
                Analyzer::at_rest(case.middle(), case.noise, random).with_any_phase(Gaps::USUAL);
            let mut planner = Planner::new(&request(0.01), Some(&cold(case.noise)));
            loop {
                let begun = Instant::now();
                let next = planner.next();
                times.push(1e6 * begun.elapsed().as_secs_f64());
                let Next::Measure(points) = next else { break };
                let readings: Vec<_> = points.iter().map(|point| analyzer.visit(point)).collect();
                let begun = Instant::now();
                planner.add(&readings);
                if let Some(last) = times.last_mut() {
                    *last += 1e6 * begun.elapsed().as_secs_f64();
                }
            }
        }
    }
    times.sort_by(f64::total_cmp);
    times
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
