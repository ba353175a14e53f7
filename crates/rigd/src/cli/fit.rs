//! `rigd fit`: the resonance in a sweep that somebody has in a file.

use std::{
    fs,
    io::{self, Read},
    num::ParseFloatError,
    path::PathBuf,
};

use clap::Args;
use rig_model::{SweepRequestError, Window};
use rig_resonance::{FitOptions, Timing, fit};
use rig_settings::Faults;
use serde::Serialize;

use super::{
    Failure, OutputArgs,
    check::FaultView,
    table::{facts, print, print_json},
    verdict::VerdictView,
};
use crate::{loaded_rig::FileError, sweep_file::SweepFile};

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
    #[command(flatten)]
    output: OutputArgs,
}

/// Why an argument is not a window.
#[derive(Debug, thiserror::Error)]
enum NoWindow {
    #[error("two frequencies in Hz with `..` between them are needed, like 120..165")]
    NoDots,
    #[error("{0}")]
    NotANumber(#[from] ParseFloatError),
    #[error("{0}")]
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
}

pub(super) fn fit_file(args: &FitArgs) -> Result<(), Failure> {
    let file = read(args).inspect_err(|error| {
        if let (FileError::Faults(faults), true) = (error, args.output.json) {
            // The faults go to stderr as well, whatever becomes of stdout.
            _ = show_faults(faults);
        }
    })?;
    let timing = if file.has_dwell { Timing::Waited } else { Timing::Unknown };
    let options = FitOptions { window: args.window, timing, ..FitOptions::default() };
    let verdict = VerdictView::from(&fit(&file.readings, &options));
    let refusal = verdict.refusal();
    let readings = file.readings.len();
    if args.output.json {
        print_json(&FileFitView { verdict, readings })?;
    } else {
        let mut rows = verdict.rows();
        rows.push(("readings", readings.to_string()));
        print(&facts(&rows))?;
    }
    refusal.map_or(Ok(()), Err)
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
