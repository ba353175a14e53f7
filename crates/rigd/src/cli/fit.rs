//! `rigd fit`: the resonance in a sweep from a file.

use std::{num::ParseFloatError, path::PathBuf};

use clap::{Args, ValueEnum, builder::PossibleValuesParser};
use rig_files::{
    Faults, FileKind,
    sweep_file::{FileSweep, SweepFile},
};
use rig_model::{Reading, SweepRequestError, Window};
use rig_resonance::{Estimator, FitOutcome, Limit, NoisePrior, Past, Timing, fit};
use serde::Serialize;

use super::{
    Failure,
    args::OutputArgs,
    check::FaultView,
    outcome::OutcomeView,
    table::{columns, concluded, facts, note, print, print_json},
};
use crate::files::{FileError, read_bytes, read_stdin};

#[derive(Debug, Args)]
pub(super) struct FitArgs {
    /// CSV or Touchstone file; `-` reads stdin
    sweep_file: PathBuf,
    /// Window of the resonance; if left out, as the file says, or the whole sweep
    #[arg(long, value_name = "HZ..HZ", value_parser = window)]
    window: Option<Window>,
    /// Number of the sweep, in a file that numbers them; all if left out
    #[arg(long, value_name = "N")]
    sweep: Option<u64>,
    /// Meaning of the times in the file; if left out, as the file says, or inferred from its
    /// columns
    #[arg(long, value_enum)]
    timing: Option<FileTiming>,
    /// Standard deviation of the relative error of a reading of ten cycles, if it is known:
    /// unsettled readings then get smaller weights and are not a fault. If left out, as the file
    /// says
    #[arg(long, value_name = "PART", value_parser = noise)]
    noise: Option<f64>,
    /// Show the result of another estimator as well; `all` for every one
    #[arg(long = "estimator", value_name = "NAME", value_parser = estimators())]
    estimators: Vec<String>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Knowledge of the times of the readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FileTiming {
    /// Nothing: no reading may be relied on to have settled
    Unknown,
    /// The instrument waited and integrated at each point for `settle_s` and `integration_s`
    Waited,
    /// `time_s` is exact too, and the drive was continuous from point to point; readings need not
    /// settle
    Exact,
    /// As `exact`, and the sensor was at rest when the drive began with the first point
    ExactFromRest,
    /// `time_s` is known to a millisecond, and the drive had any phase after each change of
    /// frequency; readings need not settle
    AnyPhase,
}

impl FileTiming {
    const fn timing(self) -> Timing {
        match self {
            Self::Unknown => Timing::Unknown,
            Self::Waited => Timing::Waited,
            Self::Exact => Timing::Exact(Past::Unknown),
            Self::ExactFromRest => Timing::Exact(Past::Rest),
            Self::AnyPhase => Timing::AnyPhase,
        }
    }
}

/// Why an argument is not a window.
#[derive(Debug, thiserror::Error)]
enum NoWindow {
    #[error("two frequencies in Hz, separated by `..`, are expected, such as 120..165")]
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

/// Why an argument is not the noise of readings.
#[derive(Debug, thiserror::Error)]
enum NoNoise {
    #[error(transparent)]
    NotANumber(#[from] ParseFloatError),
    #[error("{found} is outside (0, {NOISE_MAX}]{}", hint.as_deref().map(|hint| format!("; \
             {hint}")).unwrap_or_default())]
    OutOfRange { found: f64, hint: Option<String> },
}

/// Above this, readings tell nothing.
const NOISE_MAX: f64 = 0.5;

fn noise(text: &str) -> Result<f64, NoNoise> {
    let found = text.trim().parse()?;
    let is_right = |noise: f64| 0.0 < noise && noise <= NOISE_MAX;
    if is_right(found) {
        return Ok(found);
    }
    Err(NoNoise::OutOfRange {
        found,
        hint: rig_files::settings::unit_hint("noise", found, is_right),
    })
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

/// The fits of a file that numbers its sweeps, for a program.
#[derive(Debug, Serialize)]
struct FileFitsView {
    sweeps: Vec<FileFitView>,
}

/// A fit for a program.
#[derive(Debug, Serialize)]
struct FileFitView {
    #[serde(skip_serializing_if = "Option::is_none")]
    sweep: Option<u64>,
    #[serde(flatten)]
    outcome: OutcomeView,
    readings: usize,
    /// Rows of the file that are not readings, as sentences.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    left_out: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    estimators: Vec<EstimatorView>,
}

impl FileFitView {
    /// Fits a sweep with the timing and noise of the file, unless options replace them.
    fn of(args: &FitArgs, sweep: &FileSweep) -> Result<Self, Failure> {
        let readings = &sweep.readings;
        let mut options = sweep.fit_options();
        if args.timing.is_some() || args.noise.is_some() {
            // Other timing or noise changes the weights of the readings.
            options.near = None;
        }
        options.window = args.window.or(options.window);
        options.timing = args.timing.map_or(options.timing, FileTiming::timing);
        let stated = args.noise.map(|at_ten_cycles| NoisePrior {
            at_ten_cycles,
            degrees_of_freedom: NoisePrior::STATED_DEGREES,
        });
        options.noise = stated.or(options.noise);
        let missing = match options.timing {
            Timing::Waited | Timing::Exact(_) | Timing::AnyPhase if !sweep.has_dwell => {
                Some("settle_s and integration_s")
            }
            Timing::Exact(_) | Timing::AnyPhase if !sweep.has_time => Some("time_s"),
            _ => None,
        };
        if let Some(missing) = missing {
            return Err(Failure::NoTimes { missing });
        }
        let outcome = match (&sweep.given_up, sweep.fit.target_hz) {
            (Some(refusal), _) => FitOutcome::Refused(refusal.clone()),
            (None, Some(target_hz)) => {
                let window = options.window.unwrap_or_else(|| span(readings));
                let ended = (window, Limit::Past);
                fit(readings, &options).held_to(target_hz, readings.len(), ended)
            }
            (None, None) => fit(readings, &options),
        };
        let is_asked = |estimator: &Estimator| {
            args.estimators.iter().any(|name| name == "all" || name == estimator.name())
        };
        let window = options.window.unwrap_or_else(|| span(readings));
        let view = |estimator| EstimatorView::of(estimator, readings, window, &outcome);
        let estimators = Estimator::ALL.into_iter().filter(is_asked).map(view).collect();
        let effective_time_s =
            outcome.accepted().and_then(|found| found.effective_time_s(readings, &options));
        let outcome = OutcomeView::from(&outcome)
            .at(effective_time_s.map(|effective_time_s| sweep.begins_s + effective_time_s));
        let left_out = sweep.left_out.iter().map(ToString::to_string).collect();
        Ok(Self { sweep: sweep.number, outcome, readings: readings.len(), left_out, estimators })
    }

    /// For a person.
    fn text(&self) -> String {
        let mut rows = self.outcome.rows();
        rows.push(("readings", self.readings.to_string()));
        let text = facts(&rows);
        if self.estimators.is_empty() {
            return text;
        }
        let rows: Vec<_> = self.estimators.iter().map(EstimatorView::row).collect();
        let header = ["estimator", "found, Hz", "which is the", "off by, Hz"];
        format!("{text}\n\n{}", columns(&header, &rows))
    }
}

impl FileFitsView {
    /// For a person.
    fn text(&self) -> String {
        let estimators = self.sweeps.first().map_or(&[][..], |first| &first.estimators);
        let mut header = vec!["sweep", "resonance, Hz", "± Hz", "Q", "readings"];
        header.extend(estimators.iter().map(|estimator| estimator.name));
        header.push("refused for");
        let row = |fit: &FileFitView| {
            let mut row = vec![fit.sweep.map_or_else(String::new, |number| number.to_string())];
            row.extend(fit.outcome.cells());
            row.push(fit.readings.to_string());
            row.extend(fit.estimators.iter().map(EstimatorView::found));
            row.push(fit.outcome.reason().unwrap_or_default().to_owned());
            row
        };
        columns(&header, &self.sweeps.iter().map(row).collect::<Vec<_>>())
    }

    /// That some of the sweeps have no resonance, as the end of the command.
    fn refusal(&self) -> Option<Failure> {
        let refused = self.sweeps.iter().filter(|fit| fit.outcome.refusal().is_some()).count();
        let sweeps = self.sweeps.len();
        (refused > 0).then_some(Failure::NoResonances { refused, sweeps })
    }
}

/// The result of another estimator.
#[derive(Debug, Serialize)]
struct EstimatorView {
    name: &'static str,
    /// The definition of its frequency.
    definition: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    frequency_hz: Option<f64>,
    /// Difference between that definition and the series resonance in the fitted circuit, Hz.
    #[serde(skip_serializing_if = "Option::is_none")]
    bias_hz: Option<f64>,
    /// Why it gives no frequency.
    #[serde(skip_serializing_if = "Option::is_none")]
    message: Option<String>,
}

impl EstimatorView {
    fn of(
        estimator: Estimator,
        readings: &[Reading],
        window: Window,
        outcome: &FitOutcome,
    ) -> Self {
        let circuit = match outcome {
            FitOutcome::Accepted(found) => Some(found.circuit()),
            FitOutcome::Refused(refusal) => refusal.estimate.map(|estimate| estimate.circuit()),
        };
        let found = match (estimator, outcome) {
            // That of the command, with its timing and noise.
            (Estimator::MaximumLikelihood, FitOutcome::Accepted(found)) => Ok(found.resonance_hz),
            (Estimator::MaximumLikelihood, FitOutcome::Refused(refusal)) => {
                Err(refusal.reason.to_string())
            }
            _ => estimator.estimate(readings, window).map_err(|fault| fault.to_string()),
        };
        let definition = estimator.definition();
        Self {
            name: estimator.name(),
            definition: definition.name(),
            frequency_hz: found.as_ref().ok().copied(),
            bias_hz: circuit.and_then(|circuit| definition.bias_hz(&circuit)),
            message: found.err(),
        }
    }

    fn row(&self) -> Vec<String> {
        let bias = self.bias_hz.map_or("none".into(), |hz| format!("{hz:+.4}"));
        vec![self.name.to_owned(), self.found(), self.definition.to_owned(), bias]
    }

    fn found(&self) -> String {
        self.frequency_hz.map_or("none".into(), |hz| format!("{hz:.4}"))
    }
}

pub(super) fn fit_file(args: &FitArgs) -> Result<(), Failure> {
    let file = read(args).inspect_err(|error| {
        if let (FileError::Faults(faults), true) = (error, args.output.json) {
            // The faults go to stderr as well, even if stdout is closed.
            _ = show_faults(faults);
        }
    })?;
    let fits = file.sweeps.iter().map(|sweep| FileFitView::of(args, sweep));
    let mut sweeps = fits.collect::<Result<Vec<_>, _>>()?;
    note_left_out(&sweeps);
    let is_numbered = sweeps.iter().any(|fit| fit.sweep.is_some());
    let (printed, refusal) = match sweeps.pop() {
        Some(fit) if args.sweep.is_some() || !is_numbered => {
            (show(&fit, &fit.text(), args), fit.outcome.refusal())
        }
        last => {
            sweeps.extend(last);
            let fits = FileFitsView { sweeps };
            (show(&fits, &fits.text(), args), fits.refusal())
        }
    };
    concluded(printed, refusal.map_or(Ok(()), Err))
}

/// Most rows that are named on stderr; JSON has all of them.
const LEFT_OUT_SHOWN: usize = 10;

/// Says on stderr which rows of the file are not readings.
fn note_left_out(fits: &[FileFitView]) {
    let all = || fits.iter().flat_map(|fit| &fit.left_out);
    for row in all().take(LEFT_OUT_SHOWN) {
        note(row);
    }
    match all().count().saturating_sub(LEFT_OUT_SHOWN) {
        0 => {}
        more => note(&format!("{more} more lines were left out; --json lists them")),
    }
}

fn show(view: &impl Serialize, text: &str, args: &FitArgs) -> Result<(), Failure> {
    if args.output.json { print_json(view) } else { print(text) }
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
    let kind = FileKind::Sweep;
    let (name, bytes) =
        if path.as_os_str() == "-" { read_stdin(kind)? } else { read_bytes(path, kind)? };
    let text = SweepFile::decode(&bytes);
    kind.expect(&name, &text).map_err(FileError::Faults)?;
    SweepFile::read(&name, &text, args.sweep).map_err(FileError::Faults)
}

fn show_faults(faults: &Faults) -> Result<(), Failure> {
    let faults = faults.iter().map(FaultView::of).collect();
    print_json(&BadFileView { status: "bad_file", faults })
}
