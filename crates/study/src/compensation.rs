//! `rig-study compensation`: the benefit of compensating the contact angle.
//!
//! Every protocol touches the paper's samples at random angles, many times. The truth is the
//! reference model with noise, scatter, slope and an uncertain depth; the inference is that of a
//! run. The classes are the samples' nominal stiffnesses.

mod document;
mod protocol;
mod summary;
mod truth;

use std::{io::Write, path::PathBuf};

use rayon::prelude::*;
use rig_chart::{Axis, Band, BandEdge, Chart, Point, Series};

use crate::{
    files::{Csv, Folder},
    outcome::StudyError,
    paper_bench::SAMPLES_MPA,
    progress,
};
use protocol::{Analysis, TouchProtocol, Trial};
use rig_model::random::Stream;
use summary::{Share, TrialSummary};
use truth::TruthModel;

/// Recognition, error and coverage of compensated stiffness on the simulated bench.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Trials of each protocol.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    trials: u32,
    /// Random seed.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Folder for `compensation.md` and, in `compensation/`, the tables and charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    document::page(args, &try_all(args)).write(&folder, "compensation", out)
}

/// The trials of one protocol.
struct ProtocolTrials {
    protocol: TouchProtocol,
    trials: Vec<Trial>,
}

/// Every trial of every protocol, in order.
fn try_all(args: &Args) -> Vec<ProtocolTrials> {
    let (truth, analysis) = (TruthModel::new(), Analysis::new());
    let all = args.trials as usize * TouchProtocol::ALL.len();
    let bar = progress::bar(all, "trials");
    let trials = TouchProtocol::ALL.into_iter().zip(0_u64..).map(|(protocol, number)| {
        let trial = |trial: u32| {
            let mut random = Stream::of_trial(args.seed, number, u64::from(trial));
            let found = protocol.trial(&truth, &analysis, &mut random);
            bar.inc(1);
            found
        };
        let trials = (0..args.trials).into_par_iter().map(trial).collect();
        ProtocolTrials { protocol, trials }
    });
    let trials = trials.collect();
    bar.finish_and_clear();
    trials
}

/// A share in percent, empty for `None`.
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

fn row(table: &mut Csv, protocol: TouchProtocol, group: &str, summary: &TrialSummary) {
    let with_interval = |found: Option<Share>| match found {
        Some(Share { value, low, high }) => [value, low, high].map(|part| percent(Some(part), 3)),
        None => [const { String::new() }; 3],
    };
    let [rate, low, high] = with_interval(summary.recognition());
    let [coverage, coverage_low, coverage_high] = with_interval(summary.coverage());
    table.row([
        protocol.name().to_owned(),
        group.to_owned(),
        summary.trials.to_string(),
        rate,
        low,
        high,
        // A shift alone gives no stiffness.
        match protocol {
            TouchProtocol::ShiftAlone => String::new(),
            _ => summary.refused().to_string(),
        },
        percent(summary.bias(), 3),
        percent(summary.rms(), 3),
        percent(summary.within_3_percent(), 2),
        coverage,
        coverage_low,
        coverage_high,
    ]);
}

fn samples_table(all: &[ProtocolTrials]) -> String {
    let mut table = Csv::new(&COLUMNS);
    for ProtocolTrials { protocol, trials } in all {
        row(&mut table, *protocol, "all", &TrialSummary::of(trials));
        for (sample, summary) in by_sample(trials) {
            row(&mut table, *protocol, &format!("sample {}", sample + 1), &summary);
        }
    }
    table.text().to_owned()
}

fn angles_table(all: &[ProtocolTrials]) -> String {
    let mut table = Csv::new(&COLUMNS);
    for ProtocolTrials { protocol, trials } in all {
        for (middle_deg, summary) in by_angle(trials) {
            row(&mut table, *protocol, &format!("{middle_deg} deg"), &summary);
        }
    }
    table.text().to_owned()
}

fn by_sample(trials: &[Trial]) -> impl Iterator<Item = (usize, TrialSummary)> {
    (0..SAMPLES_MPA.len()).map(move |sample| {
        (sample, TrialSummary::of(trials.iter().filter(|trial| trial.sample == sample)))
    })
}

/// The trials in groups of five degrees, by the middle of each group.
fn by_angle(trials: &[Trial]) -> impl Iterator<Item = (f64, TrialSummary)> {
    const WIDTH_DEG: f64 = 5.0;
    (0..9_u32).map(move |group| {
        let from = f64::from(group) * WIDTH_DEG;
        let range = from..from + WIDTH_DEG;
        let inside = trials.iter().filter(|trial| range.contains(&trial.angle_rad.to_degrees()));
        (from + 0.5 * WIDTH_DEG, TrialSummary::of(inside))
    })
}

fn charts(all: &[ProtocolTrials]) -> [(&'static str, Chart); 3] {
    [
        ("recognition.svg", recognition_chart(all)),
        ("error.svg", error_chart(all)),
        ("coverage.svg", coverage_chart(all)),
    ]
}

fn recognition_chart(all: &[ProtocolTrials]) -> Chart {
    let mut chart = Chart::new(
        "Blind touches recognised",
        "Share of the trials of each protocol whose sample is recognised, against the contact \
         angle.",
        Axis::linear("contact angle (°)").including(0.0).including(45.0),
        Axis::linear("recognised (%)").including(100.0),
    );
    for (colour, ProtocolTrials { protocol, trials }) in all.iter().enumerate() {
        let point = |(middle_deg, summary): (f64, TrialSummary)| {
            Some((middle_deg, 100.0 * summary.recognition()?.value))
        };
        chart.series.push(Series::joined(
            protocol.name(),
            colour,
            by_angle(trials).filter_map(point),
        ));
    }
    chart
}

fn error_chart(all: &[ProtocolTrials]) -> Chart {
    let mut chart = Chart::new(
        "Error of the stiffness",
        "Root mean square of the relative error of the stiffness by each protocol, against the \
         contact angle.",
        Axis::linear("contact angle (°)").including(0.0).including(45.0),
        Axis::log("error (% rms)"),
    );
    for (colour, ProtocolTrials { protocol, trials }) in all.iter().enumerate() {
        let point =
            |(middle_deg, summary): (f64, TrialSummary)| Some((middle_deg, 100.0 * summary.rms()?));
        let points: Vec<(f64, f64)> = by_angle(trials).filter_map(point).collect();
        if !points.is_empty() {
            chart.series.push(Series::joined(protocol.name(), colour, points));
        }
    }
    chart
}

fn coverage_chart(all: &[ProtocolTrials]) -> Chart {
    let mut chart = Chart::new(
        "Coverage of the 95 % intervals",
        "Share of the stated 95 % intervals that contain the true stiffness, for each sample \
         and protocol.",
        Axis::linear("sample").with_ticks(&[1.0, 2.0, 3.0, 4.0, 5.0]),
        Axis::linear("coverage (%)"),
    );
    let edges = [0.8, 5.2].map(|x| BandEdge { x, low: 93.0, high: 97.0 }).to_vec();
    chart.bands.push(Band { name: Some("93 % to 97 %".to_owned()), edges, colour: 6 });
    for (colour, ProtocolTrials { protocol, trials }) in all.iter().enumerate() {
        let point = |(sample, summary): (usize, TrialSummary)| {
            let Share { value, low, high } = summary.coverage()?;
            Some(Point {
                x: (sample + 1) as f64,
                y: 100.0 * value,
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

    fn trials(protocol: TouchProtocol, count: u64) -> Vec<Trial> {
        let (truth, analysis) = (TruthModel::new(), Analysis::new());
        let trial = |trial| protocol.trial(&truth, &analysis, &mut Stream::of_trial(1, 0, trial));
        (0..count).map(trial).collect()
    }

    /// Fewer trials than the page has; the bounds are four standard deviations wide.
    #[test]
    fn a_known_angle_is_compensated_with_the_stated_coverage() {
        let summary = TrialSummary::of(&trials(TouchProtocol::KnownAngle, 1000));
        assert!(summary.recognition().unwrap().value >= 0.99, "{summary:?}");
        let coverage = summary.coverage().unwrap().value;
        assert!((coverage - 0.95).abs() < 0.028, "{summary:?}");
        assert!(summary.bias().unwrap().abs() < 0.004, "{summary:?}");
        let stiffer = trials(TouchProtocol::KnownAngle, 1000);
        let stiffer = TrialSummary::of(stiffer.iter().filter(|trial| trial.sample > 0));
        assert!(stiffer.rms().unwrap() < 0.03, "{stiffer:?}");
    }

    #[test]
    fn spins_find_the_stiffness_at_an_unknown_angle() {
        let summary = TrialSummary::of(&trials(TouchProtocol::Spins, 200));
        assert!(summary.recognition().unwrap().value >= 0.97, "{summary:?}");
        let coverage = summary.coverage().unwrap().value;
        assert!((coverage - 0.95).abs() < 0.065, "{summary:?}");
        let one = TrialSummary::of(&trials(TouchProtocol::OneTouch, 200));
        assert!(summary.rms().unwrap() < 0.7 * one.rms().unwrap(), "{summary:?} {one:?}");
    }
}
