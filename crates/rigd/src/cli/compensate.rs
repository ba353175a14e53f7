//! `rigd compensate`: the corrections of the analyzer for cable and fixture, with their date and cable.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use jiff::Timestamp;
use rig_analyzer::Analyzer;
use rig_files::instrument::dialect::{Compensation, Correction};
use rig_store::make_directory;
use serde::{Deserialize, Serialize};

use super::{
    Failure,
    args::{DataArgs, OperatorArgs, OutputArgs, RigArgs},
    table::{print, print_json},
};
use crate::{
    durable::{self, FOR_ALL},
    local_time::local,
    rig::{DeviceError, analyzer_alone},
};

#[derive(Debug, Args)]
pub(super) struct CompensateArgs {
    /// What is between the terminals now; without it, the corrections are listed
    #[arg(value_enum, requires = "cable")]
    what: Option<Kind>,
    /// The cable and the fixture, as written on them; kept with the date
    #[arg(long, value_name = "TEXT", requires = "what")]
    cable: Option<String>,
    /// Length of the cable that the analyzer corrects for, m
    #[arg(long, value_name = "M", requires = "what")]
    length_m: Option<f64>,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    operator: OperatorArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// A correction, by what is between the terminals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    /// Nothing, with the terminals as far apart as in the measurement
    Open,
    /// A wire that joins them
    Short,
    /// A known impedance
    Load,
}

impl Kind {
    const ALL: [Self; 3] = [Self::Open, Self::Short, Self::Load];

    const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Short => "short",
            Self::Load => "load",
        }
    }

    const fn of(self, compensation: &Compensation) -> Option<&Correction> {
        match self {
            Self::Open => Some(&compensation.open),
            Self::Short => Some(&compensation.short),
            Self::Load => compensation.load.as_ref(),
        }
    }
}

/// A correction that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Made {
    what: Kind,
    /// When, UTC.
    at: String,
    cable: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    length_m: Option<f64>,
    /// The identity of the analyzer.
    analyzer: String,
    operator: String,
}

/// A correction of the analyzer, for a program.
#[derive(Debug, Serialize)]
struct StateView {
    what: Kind,
    is_on: bool,
    /// When it was made last, by the records of this data directory for this analyzer.
    #[serde(skip_serializing_if = "Option::is_none")]
    last: Option<Made>,
}

/// The corrections that were made, the latest last.
pub(super) const FILE: &str = "corrections.json";

pub(super) fn compensate(args: &CompensateArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let path = args.data.dir().join(FILE);
    let dialect = rig.instruments.analyzer;
    let Some(compensation) = &dialect.compensation else {
        return Err(Failure::NoCorrection { analyzer: &dialect.name, what: "corrections" });
    };
    let mut made = read(&path)?;
    if let (Some(what), Some(cable)) = (args.what, &args.cable) {
        let name = &dialect.name;
        let correction = what
            .of(compensation)
            .ok_or(Failure::NoCorrection { analyzer: name, what: what.name() })?;
        let length = check_length(args.length_m, compensation, name)?;
        let identity = analyzer_alone(rig, async |analyzer: &mut Analyzer| {
            let identity = analyzer.identify().await?;
            if let (Some(length_m), Some(cable)) = (length, &compensation.cable) {
                analyzer.set_cable(cable, length_m).await?;
            }
            analyzer.correct(correction).await?;
            Ok::<_, DeviceError>(identity.to_string())
        })?;
        let now = Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string();
        let done = Made {
            what,
            at: now,
            cable: cable.clone(),
            length_m: length,
            analyzer: identity,
            operator: args.operator.name().to_string(),
        };
        made.push(done);
        let failed = |source| Failure::File { path: path.clone(), source };
        make_directory(&args.data.dir()).map_err(failed)?;
        durable::replace(&path, &made, FOR_ALL).map_err(failed)?;
        return print(&format!("{}: measured, and on, for {cable}", what.name()));
    }
    list(args, rig, compensation, &made)
}

/// The corrections that are on in the analyzer, each with the last time at which it was made here.
fn list(
    args: &CompensateArgs,
    rig: crate::loaded_rig::LoadedRig,
    compensation: &'static Compensation,
    made: &[Made],
) -> Result<(), Failure> {
    let (identity, states) = analyzer_alone(rig, async |analyzer: &mut Analyzer| {
        let identity = analyzer.identify().await?.to_string();
        let mut states = Vec::new();
        for what in Kind::ALL {
            if let Some(correction) = what.of(compensation) {
                states.push((what, analyzer.has_correction(correction).await?));
            }
        }
        Ok::<_, DeviceError>((identity, states))
    })?;
    let view = |(what, is_on)| {
        let is_it = |made: &&Made| made.what == what && made.analyzer == identity;
        let last = made.iter().rfind(is_it).cloned();
        StateView { what, is_on, last }
    };
    let states: Vec<_> = states.into_iter().map(view).collect();
    if args.output.json {
        return print_json(&states);
    }
    let line = |StateView { what, is_on, last }: &StateView| {
        let state = if *is_on { "on " } else { "off" };
        let last = last.as_ref().map_or_else(
            || "never made for this analyzer, by the records of this data directory".to_owned(),
            |last| format!("made {} by {} for {}", local(&last.at), last.operator, last.cable),
        );
        format!("{:<5}  {state}  {last}", what.name())
    };
    print(&states.iter().map(line).collect::<Vec<_>>().join("\n"))
}

/// The length, if the analyzer corrects for it.
fn check_length(
    length_m: Option<f64>,
    compensation: &Compensation,
    analyzer: &'static str,
) -> Result<Option<f64>, Failure> {
    let Some(wanted) = length_m else { return Ok(None) };
    let Some(cable) = &compensation.cable else {
        return Err(Failure::NoCorrection { analyzer, what: "length of the cable" });
    };
    if cable.lengths_m.contains(&wanted) {
        return Ok(Some(wanted));
    }
    let known: Vec<_> = cable.lengths_m.iter().map(f64::to_string).collect();
    Err(Failure::CableLength { wanted, known: known.join(", ") })
}

fn read(path: &Path) -> Result<Vec<Made>, Failure> {
    let failed = |source| Failure::File { path: PathBuf::from(path), source };
    match std::fs::read(path) {
        Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| failed(error.into())),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(failed(error)),
    }
}
