//! `rigd compensate`: the corrections of the analyzer for cable and fixture, with their date and cable.

use clap::Args;
use jiff::Timestamp;
use rig_analyzer::Analyzer;
use rig_files::instrument::dialect::{Compensation, Correction as Messages};
use rig_store::make_directory;
use serde::Serialize;

use super::{
    Failure,
    args::{DataArgs, OperatorArgs, OutputArgs, RigArgs},
    table::{note, print, print_json},
};
use crate::{
    corrections::{self, Correction, CorrectionKind, FILE, last_of},
    durable::{self, FOR_ALL},
    local_time::local,
    rig::{DeviceError, analyzer_alone},
};

#[derive(Debug, Args)]
pub(super) struct CompensateArgs {
    /// What is between the terminals now; without it, the corrections are listed
    #[arg(value_enum, requires = "cable")]
    what: Option<CorrectionKind>,
    /// The cable and the fixture, as written on them; kept with the date
    #[arg(long, value_name = "TEXT", requires = "what", value_parser = cable)]
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

/// A cable without a name.
#[derive(Debug, thiserror::Error)]
#[error("the name of the cable is empty; write what is written on cable and fixture")]
struct NoCable;

fn cable(text: &str) -> Result<String, NoCable> {
    let cable = text.trim();
    if cable.is_empty() { Err(NoCable) } else { Ok(cable.to_owned()) }
}

/// The messages of a correction, if the analyzer has it.
const fn of(kind: CorrectionKind, compensation: &Compensation) -> Option<&Messages> {
    match kind {
        CorrectionKind::Open => Some(&compensation.open),
        CorrectionKind::Short => Some(&compensation.short),
        CorrectionKind::Load => compensation.load.as_ref(),
    }
}

/// A correction of the analyzer, for a program.
#[derive(Debug, Serialize)]
struct StateView {
    what: CorrectionKind,
    is_on: bool,
    /// When it was made last, by the records of this data directory for this analyzer.
    #[serde(skip_serializing_if = "Option::is_none")]
    last: Option<Correction>,
}

pub(super) fn compensate(args: &CompensateArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let path = args.data.dir().join(FILE);
    let dialect = rig.instruments.analyzer;
    let Some(compensation) = &dialect.compensation else {
        return Err(Failure::NoCorrection { analyzer: &dialect.name, what: "corrections" });
    };
    let failed = |source| Failure::File { path: path.clone(), source };
    let mut made = corrections::read(&args.data.dir()).map_err(failed)?;
    if let (Some(what), Some(cable)) = (args.what, &args.cable) {
        let name = &dialect.name;
        let correction = of(what, compensation)
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
        let done = Correction {
            what,
            at: now,
            cable: cable.clone(),
            length_m: length,
            analyzer: identity,
            operator: args.operator.name().to_string(),
        };
        for other in others(&made, &done) {
            note(&format!(
                "{} was made for {} {}, and {what} now for {cable}: the corrections of one analyzer are for one cable; make \
                 {} again with this one",
                other.what.name(),
                other.cable,
                local(&other.at),
                other.what.name(),
                what = what.name()
            ));
        }
        made.push(done);
        make_directory(&args.data.dir()).map_err(failed)?;
        durable::replace(&path, &made, FOR_ALL).map_err(failed)?;
        return print(&format!("{}: measured, and on, for {cable}", what.name()));
    }
    list(args, rig, compensation, &made)
}

/// The last corrections of the other kinds that were made for this analyzer with another cable.
fn others(made: &[Correction], done: &Correction) -> Vec<Correction> {
    let is_other =
        |other: &Correction| (&other.cable, other.length_m) != (&done.cable, done.length_m);
    let kinds = CorrectionKind::ALL.into_iter().filter(|kind| *kind != done.what);
    kinds.filter_map(|kind| last_of(made, kind, &done.analyzer)).filter(is_other).collect()
}

/// The corrections that are on in the analyzer, each with the last time at which it was made here.
fn list(
    args: &CompensateArgs,
    rig: crate::loaded_rig::LoadedRig,
    compensation: &'static Compensation,
    made: &[Correction],
) -> Result<(), Failure> {
    let (identity, states) = analyzer_alone(rig, async |analyzer: &mut Analyzer| {
        let identity = analyzer.identify().await?.to_string();
        let mut states = Vec::new();
        for what in CorrectionKind::ALL {
            if let Some(correction) = of(what, compensation) {
                states.push((what, analyzer.has_correction(correction).await?));
            }
        }
        Ok::<_, DeviceError>((identity, states))
    })?;
    let view = |(what, is_on)| StateView { what, is_on, last: last_of(made, what, &identity) };
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
