//! `rig-study compensation`: what the angle's compensation is worth on a bench with nuisances.
//!
//! Every protocol touches the paper's samples at random angles, many times. The truth is the finest
//! model with noise, scatter, slope and an uncertain depth; the reading is what the analysis of a
//! run does. The classes are the samples' nominal stiffnesses.

mod bench;
mod protocol;
mod tally;

use std::{io::Write, path::PathBuf};

use rayon::prelude::*;
use rig_chart::{Axis, Band, BandEdge, Chart, Point, Series};

use crate::{
    files::{Csv, Folder},
    outcome::StudyError,
    paper_bench::SAMPLES_MPA,
    progress,
};
use bench::Bench;
use protocol::{Protocol, Reader, Trial};
use rig_model::random::Stream;
use tally::Tally;

/// Recognition, error and coverage of compensated stiffness on the simulated bench.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Trials of each protocol.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    trials: u32,
    /// Decides all chance.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Folder for the tables and charts.
    #[arg(long, default_value = "target/study/compensation")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    let trials = try_all(args);
    folder.write("samples.csv", &samples_table(&trials))?;
    folder.write("angles.csv", &angles_table(&trials))?;
    folder.write("recognition.svg", &recognition_chart(&trials).file()?)?;
    folder.write("error.svg", &error_chart(&trials).file()?)?;
    folder.write("coverage.svg", &coverage_chart(&trials).file()?)?;
    for (protocol, trials) in &trials {
        say(*protocol, &Tally::of(trials), out)?;
    }
    let known = trials.iter().find(|(protocol, _)| *protocol == Protocol::KnownAngle);
    for (sample, young_mpa) in SAMPLES_MPA.into_iter().enumerate() {
        let Some((_, trials)) = known else { continue };
        let tally = Tally::of(trials.iter().filter(|trial| trial.sample == sample));
        let (rms, within) = (percent(tally.rms(), 2), percent(tally.within_3_percent(), 1));
        let number = sample + 1;
        writeln!(
            out,
            "angle known, sample {number} ({young_mpa} MPa): error {rms} % rms, {within} % within 3 %"
        )?;
    }
    Ok(())
}

/// Every trial of every protocol, in order.
fn try_all(args: &Args) -> Vec<(Protocol, Vec<Trial>)> {
    let (bench, reader) = (Bench::new(), Reader::new());
    let all = args.trials as usize * Protocol::ALL.len();
    let bar = progress::bar(all, "trials");
    let trials = Protocol::ALL.into_iter().zip(0_u64..).map(|(protocol, number)| {
        let trial = |trial: u32| {
            let mut random = Stream::of_trial(args.seed, number, u64::from(trial));
            let found = protocol.trial(&bench, &reader, &mut random);
            bar.inc(1);
            found
        };
        (protocol, (0..args.trials).into_par_iter().map(trial).collect())
    });
    let trials = trials.collect();
    bar.finish_and_clear();
    trials
}

fn say(protocol: Protocol, tally: &Tally, out: &mut impl Write) -> Result<(), StudyError> {
    let name = protocol.name();
    let Some((rate, (low, high))) = tally.recognition() else { return Ok(()) };
    let [rate, low, high] = [rate, low, high].map(|share| percent(Some(share), 2));
    write!(out, "{name}: recognised {rate} % ({low} to {high})")?;
    if let Some((coverage, _)) = tally.coverage() {
        let (rms, coverage) = (percent(tally.rms(), 2), percent(Some(coverage), 2));
        let refused = tally.refused();
        write!(out, ", error {rms} % rms, coverage {coverage} %, {refused} refused")?;
    }
    writeln!(out)?;
    Ok(())
}

/// A share in percent; nothing for none.
fn percent(share: Option<f64>, decimals: usize) -> String {
    share.map_or_else(String::new, |share| format!("{:.decimals$}", 100.0 * share))
}

const COLUMNS: [&str; 13] = [
    "protocol",
    "group",
    "trials",
    "recognised_percent",
    "recognised_low_percent",
    "recognised_high_percent",
    "refused",
    "bias_percent",
    "rms_percent",
    "within_3_percent_percent",
    "coverage_percent",
    "coverage_low_percent",
    "coverage_high_percent",
];

fn row(table: &mut Csv, protocol: Protocol, group: &str, tally: &Tally) {
    let with_interval = |found: Option<(f64, (f64, f64))>| match found {
        Some((share, (low, high))) => [share, low, high].map(|share| percent(Some(share), 3)),
        None => [const { String::new() }; 3],
    };
    let [rate, low, high] = with_interval(tally.recognition());
    let [coverage, coverage_low, coverage_high] = with_interval(tally.coverage());
    table.row([
        protocol.name().to_owned(),
        group.to_owned(),
        tally.trials.to_string(),
        rate,
        low,
        high,
        // A shift alone is never asked for a stiffness.
        match protocol {
            Protocol::ShiftAlone => String::new(),
            _ => tally.refused().to_string(),
        },
        percent(tally.bias(), 3),
        percent(tally.rms(), 3),
        percent(tally.within_3_percent(), 2),
        coverage,
        coverage_low,
        coverage_high,
    ]);
}

fn samples_table(trials: &[(Protocol, Vec<Trial>)]) -> String {
    let mut table = Csv::new(&COLUMNS);
    for (protocol, trials) in trials {
        row(&mut table, *protocol, "all", &Tally::of(trials));
        for (sample, tally) in by_sample(trials) {
            row(&mut table, *protocol, &format!("sample {}", sample + 1), &tally);
        }
    }
    table.text().to_owned()
}

fn angles_table(trials: &[(Protocol, Vec<Trial>)]) -> String {
    let mut table = Csv::new(&COLUMNS);
    for (protocol, trials) in trials {
        for (middle_deg, tally) in by_angle(trials) {
            row(&mut table, *protocol, &format!("{middle_deg} deg"), &tally);
        }
    }
    table.text().to_owned()
}

fn by_sample(trials: &[Trial]) -> impl Iterator<Item = (usize, Tally)> {
    (0..SAMPLES_MPA.len()).map(move |sample| {
        (sample, Tally::of(trials.iter().filter(|trial| trial.sample == sample)))
    })
}

/// Groups of five degrees, by their middles.
fn by_angle(trials: &[Trial]) -> impl Iterator<Item = (f64, Tally)> {
    const WIDTH_DEG: f64 = 5.0;
    (0..9_u32).map(move |group| {
        let from = f64::from(group) * WIDTH_DEG;
        let range = from..from + WIDTH_DEG;
        let inside = trials.iter().filter(|trial| range.contains(&trial.angle_rad.to_degrees()));
        (from + 0.5 * WIDTH_DEG, Tally::of(inside))
    })
}

fn recognition_chart(trials: &[(Protocol, Vec<Trial>)]) -> Chart {
    let mut chart = Chart::new(
        "Blind touches recognised",
        "Share of the trials of each protocol whose sample is recognised, against the contact \
         angle.",
        Axis::linear("contact angle (°)").including(0.0).including(45.0),
        Axis::linear("recognised (%)").including(100.0),
    );
    for (colour, (protocol, trials)) in trials.iter().enumerate() {
        let point =
            |(middle_deg, tally): (f64, Tally)| Some((middle_deg, 100.0 * tally.recognition()?.0));
        chart.series.push(Series::joined(
            protocol.name(),
            colour,
            by_angle(trials).filter_map(point),
        ));
    }
    chart
}

fn error_chart(trials: &[(Protocol, Vec<Trial>)]) -> Chart {
    let mut chart = Chart::new(
        "Error of the stiffness",
        "Root mean square of the relative error of the stiffness by each protocol, against the \
         contact angle.",
        Axis::linear("contact angle (°)").including(0.0).including(45.0),
        Axis::log("error (% rms)"),
    );
    for (colour, (protocol, trials)) in trials.iter().enumerate() {
        let point = |(middle_deg, tally): (f64, Tally)| Some((middle_deg, 100.0 * tally.rms()?));
        let points: Vec<(f64, f64)> = by_angle(trials).filter_map(point).collect();
        if !points.is_empty() {
            chart.series.push(Series::joined(protocol.name(), colour, points));
        }
    }
    chart
}

fn coverage_chart(trials: &[(Protocol, Vec<Trial>)]) -> Chart {
    let mut chart = Chart::new(
        "Coverage of the 95 % intervals",
        "Share of the stated 95 % intervals that hold the true stiffness, for each sample and \
         protocol.",
        Axis::linear("sample").with_ticks(&[1.0, 2.0, 3.0, 4.0, 5.0]),
        Axis::linear("coverage (%)"),
    );
    let edges = [0.8, 5.2].map(|x| BandEdge { x, low: 93.0, high: 97.0 }).to_vec();
    chart.bands.push(Band { name: Some("93 % to 97 %".to_owned()), edges, colour: 6 });
    for (colour, (protocol, trials)) in trials.iter().enumerate() {
        let point = |(sample, tally): (usize, Tally)| {
            let (coverage, (low, high)) = tally.coverage()?;
            Some(Point {
                x: (sample + 1) as f64,
                y: 100.0 * coverage,
                error: Some(50.0 * (high - low)),
                note: None,
            })
        };
        let points: Vec<Point> = by_sample(trials).filter_map(point).collect();
        if !points.is_empty() {
            chart.series.push(Series::joined(protocol.name(), colour, points));
        }
    }
    chart
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trials(protocol: Protocol, count: u64) -> Vec<Trial> {
        let (bench, reader) = (Bench::new(), Reader::new());
        let trial = |trial| protocol.trial(&bench, &reader, &mut Stream::of_trial(1, 0, trial));
        (0..count).map(trial).collect()
    }

    /// Fewer trials than the document has; the bounds are four of their standard deviations wide.
    #[test]
    fn a_known_angle_is_compensated_and_its_intervals_hold_what_they_say() {
        let tally = Tally::of(&trials(Protocol::KnownAngle, 1000));
        assert!(tally.recognition().unwrap().0 >= 0.99, "{tally:?}");
        let (coverage, _) = tally.coverage().unwrap();
        assert!((coverage - 0.95).abs() < 0.028, "{tally:?}");
        assert!(tally.bias().unwrap().abs() < 0.004, "{tally:?}");
        let stiffer = trials(Protocol::KnownAngle, 1000);
        let stiffer = Tally::of(stiffer.iter().filter(|trial| trial.sample > 0));
        assert!(stiffer.rms().unwrap() < 0.03, "{stiffer:?}");
    }

    #[test]
    fn spins_find_the_stiffness_at_an_angle_that_nobody_knows() {
        let tally = Tally::of(&trials(Protocol::Spins, 200));
        assert!(tally.recognition().unwrap().0 >= 0.97, "{tally:?}");
        let (coverage, _) = tally.coverage().unwrap();
        assert!((coverage - 0.95).abs() < 0.065, "{tally:?}");
        let one = Tally::of(&trials(Protocol::OneReading, 200));
        assert!(tally.rms().unwrap() < 0.7 * one.rms().unwrap(), "{tally:?} {one:?}");
    }
}
