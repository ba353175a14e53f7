//! `rigd fit`: the resonance in a sweep that somebody has in a file.

use std::{
    fs,
    io::{self, Read as _},
    num::ParseFloatError,
    path::PathBuf,
};

use clap::{Args, ValueEnum, builder::PossibleValuesParser};
use rig_model::{Reading, SweepRequestError, Window};
use rig_resonance::{Estimator, FitOptions, NoisePrior, Past, Timing, Verdict, fit};
use rig_settings::Faults;
use serde::Serialize;

use super::{
    Failure, OutputArgs,
    check::FaultView,
    table::{columns, facts, print, print_json},
    verdict::VerdictView,
};
use crate::{loaded_rig::FileError, sweep_file::SweepFile};

/// How many independent errors the noise that somebody states is taken to come from.
const NOISE_DEGREES: f64 = 100.0;

#[derive(Debug, Args)]
pub(super) struct FitArgs {
    /// CSV or Touchstone file; `-` reads stdin
    sweep_file: PathBuf,
    /// Where the resonance must be; all of the sweep when left out
    #[arg(long, value_name = "HZ..HZ", value_parser = window)]
    window: Option<Window>,
    /// Which sweep, of a file that numbers them
    #[arg(long, value_name = "N")]
    sweep: Option<u64>,
    /// What the times in the file mean; guessed from its columns when left out
    #[arg(long, value_enum)]
    timing: Option<FileTiming>,
    /// Standard deviation of the relative error of a reading of ten cycles, where it is known:
    /// readings that have not settled then count for less, and are no fault
    #[arg(long, value_name = "PART")]
    noise: Option<f64>,
    /// Show beside it what another estimator makes of the sweep; `all` for every one
    #[arg(long = "estimator", value_name = "NAME", value_parser = estimators())]
    estimators: Vec<String>,
    #[command(flatten)]
    output: OutputArgs,
}

/// What is known of the times of the readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FileTiming {
    /// Nothing: no reading may be relied on to have settled
    Unknown,
    /// Each point was waited for and integrated as long as `settle_s` and `integration_s` say
    Waited,
    /// `time_s` is exact too, and the drive went on from point to point: nothing has to have settled
    Exact,
    /// The same, and the sensor was at rest when the drive began with the first point
    ExactFromRest,
}

impl FileTiming {
    /// What the fit is told.
    fn of(asked: Option<Self>, file: &SweepFile) -> Result<Timing, Failure> {
        let lacks = |missing| Failure::NoTimes { missing };
        match asked {
            None if file.has_dwell => Ok(Timing::Waited),
            None | Some(Self::Unknown) => Ok(Timing::Unknown),
            Some(_) if !file.has_dwell => Err(lacks("settle_s and integration_s")),
            Some(Self::Waited) => Ok(Timing::Waited),
            Some(_) if !file.has_time => Err(lacks("time_s")),
            Some(Self::Exact) => Ok(Timing::Exact(Past::Unknown)),
            Some(Self::ExactFromRest) => Ok(Timing::Exact(Past::Rest)),
        }
    }
}

/// Why an argument is not a window.
#[derive(Debug, thiserror::Error)]
enum NoWindow {
    #[error("two frequencies in Hz with `..` between them are needed, like 120..165")]
    NoDots,
    #[error(transparent)]
    NotANumber(#[from] ParseFloatError),
    #[error(transparent)]
    NotRising(SweepRequestError),
}

fn window(text: &str) -> Result<Window, NoWindow> {
    let (min, max) = text.split_once("..").ok_or(NoWindow::NoDots)?;
    let (min_hz, max_hz) = (min.trim().parse()?, max.trim().parse::<f64>()?);
    if min_hz > 0.0 && max_hz > min_hz && max_hz.is_finite() {
        Ok(Window { min_hz, max_hz })
    } else {
        Err(NoWindow::NotRising(SweepRequestError::Window { min_hz, max_hz }))
    }
}

fn estimators() -> PossibleValuesParser {
    PossibleValuesParser::new(Estimator::ALL.map(Estimator::name).into_iter().chain(["all"]))
}

/// A file that could not be read, for a program.
#[derive(Debug, Serialize)]
struct BadFileView {
    status: &'static str,
    faults: Vec<FaultView>,
}

/// A fit for a program.
#[derive(Debug, Serialize)]
struct FileFitView {
    #[serde(flatten)]
    verdict: VerdictView,
    readings: usize,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    estimators: Vec<EstimatorView>,
}

/// What another estimator makes of the readings.
#[derive(Debug, Serialize)]
struct EstimatorView {
    name: &'static str,
    /// What its frequency means.
    definition: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    frequency_hz: Option<f64>,
    /// How far that meaning lies above the series resonance in the circuit that was fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    bias_hz: Option<f64>,
    /// Why it gives no frequency.
    #[serde(skip_serializing_if = "Option::is_none")]
    message: Option<String>,
}

impl EstimatorView {
    fn of(estimator: Estimator, readings: &[Reading], window: Window, verdict: &Verdict) -> Self {
        let circuit = match verdict {
            Verdict::Accepted(found) => Some(found.circuit()),
            Verdict::Refused(refusal) => refusal.estimate.map(|estimate| estimate.circuit()),
        };
        let found = estimator.estimate(readings, window);
        let definition = estimator.definition();
        Self {
            name: estimator.name(),
            definition: definition.name(),
            frequency_hz: found.ok(),
            bias_hz: circuit.and_then(|circuit| definition.bias_hz(&circuit)),
            message: found.err().map(|fault| fault.to_string()),
        }
    }

    fn row(&self) -> Vec<String> {
        let hertz = |value: Option<f64>| value.map_or("none".into(), |hz| format!("{hz:.4}"));
        let signed = |value: Option<f64>| value.map_or("none".into(), |hz| format!("{hz:+.4}"));
        let (found, bias) = (hertz(self.frequency_hz), signed(self.bias_hz));
        vec![self.name.to_owned(), found, self.definition.to_owned(), bias]
    }
}

pub(super) fn fit_file(args: &FitArgs) -> Result<(), Failure> {
    let file = read(args).inspect_err(|error| {
        if let (FileError::Faults(faults), true) = (error, args.output.json) {
            // The faults go to stderr as well, whatever becomes of stdout.
            _ = show_faults(faults);
        }
    })?;
    let timing = FileTiming::of(args.timing, &file)?;
    let noise = args
        .noise
        .map(|at_ten_cycles| NoisePrior { at_ten_cycles, degrees_of_freedom: NOISE_DEGREES });
    let options = FitOptions { window: args.window, timing, noise, ..FitOptions::default() };
    let verdict = fit(&file.readings, &options);
    let is_asked = |estimator: &Estimator| {
        args.estimators.iter().any(|name| name == "all" || name == estimator.name())
    };
    let window = args.window.unwrap_or_else(|| span(&file.readings));
    let view = |estimator| EstimatorView::of(estimator, &file.readings, window, &verdict);
    let estimators: Vec<_> = Estimator::ALL.into_iter().filter(is_asked).map(view).collect();
    let moment_s = verdict.accepted().and_then(|found| found.moment_s(&file.readings, &options));
    let verdict = VerdictView::from(&verdict).at(moment_s);
    let refusal = verdict.refusal();
    let readings = file.readings.len();
    if args.output.json {
        print_json(&FileFitView { verdict, readings, estimators })?;
    } else {
        let mut rows = verdict.rows();
        rows.push(("readings", readings.to_string()));
        let mut text = facts(&rows);
        if !estimators.is_empty() {
            let rows: Vec<_> = estimators.iter().map(EstimatorView::row).collect();
            let header = ["estimator", "found, Hz", "which is the", "off by, Hz"];
            text = format!("{text}\n\n{}", columns(&header, &rows));
        }
        print(&text)?;
    }
    refusal.map_or(Ok(()), Err)
}

/// From the lowest to the highest frequency.
fn span(readings: &[Reading]) -> Window {
    let nothing = Window { min_hz: f64::INFINITY, max_hz: 0.0 };
    readings.iter().fold(nothing, |window, reading| Window {
        min_hz: window.min_hz.min(reading.frequency_hz),
        max_hz: window.max_hz.max(reading.frequency_hz),
    })
}

fn read(args: &FitArgs) -> Result<SweepFile, FileError> {
    let path = &args.sweep_file;
    let (name, bytes) = if path.as_os_str() == "-" {
        let mut bytes = Vec::new();
        ("stdin".to_owned(), io::stdin().lock().read_to_end(&mut bytes).map(|_| bytes))
    } else {
        (path.display().to_string(), fs::read(path))
    };
    let bytes = bytes.map_err(|source| FileError::Unreadable { path: path.clone(), source })?;
    SweepFile::read(&name, &SweepFile::decode(&bytes), args.sweep).map_err(FileError::Faults)
}

fn show_faults(faults: &Faults) -> Result<(), Failure> {
    let faults = faults.iter().map(FaultView::of).collect();
    print_json(&BadFileView { status: "bad_file", faults })
}
