//! `rigd commission`: shows a new bench to be as its rig file says, one step at a time.

mod blocks;
mod guide;
mod latency;
mod pin;
pub(super) mod sensor;
mod touches;

use std::{io, path::Path};

use clap::{Args, Subcommand, ValueEnum};
use rig_commission::{
    BenchChange, Finding, Jog, JogAxis, Kind, Standing, Step, Value, Verdict, procedure,
    sensor::NoSensor,
};
use rig_files::rig_file::RigFile;
use serde::Serialize;

use self::guide::{Guide, Records};
use super::{
    Failure,
    args::{BenchArgs, DataArgs, OutputArgs, RigArgs, temperature},
    screen::{indented, say, say_clearly},
    session::open_by,
    signals::Signals,
    table::{concluded, facts, print, print_json, wrapped},
};
use crate::{
    bench_check::CheckError,
    block_runs::BlockRunError,
    calibrations::{self, CalibrationsError, Witness},
    endpoint::{Endpoint, EndpointError},
    loaded_rig::LoadedRig,
    operator::Operator,
    rig::{self, NotMade},
    run_of_bench::NotOfBench,
    sensor_check::NoRecord,
};

/// Shows, step by step, that a bench is as its rig file says: the emergency stop, the sign and the scale of each
/// axis, the geometry, the limits, and that each axis is where it was after its power was off. Each step has a picture, the limit of acceptance and what to do when it fails; its record
/// is a file in the data directory. The command begins at the first step that is missing, also after an
/// interruption. A wrong value ends with the key of the rig file to change, which rigd never writes.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct CommissionArgs {
    #[command(subcommand)]
    command: Option<CommissionCommand>,
    #[command(flatten)]
    walk: WalkArgs,
}

#[derive(Debug, Subcommand)]
enum CommissionCommand {
    /// Make one step again, although its record still fits
    Again(AgainArgs),
    /// Move one axis by one short step, without a sample
    Jog(JogArgs),
    /// Say which steps the rig has behind it, and which are missing
    Show(ShowArgs),
    /// Find the geometry by the touches of runs on hard blocks
    Blocks(blocks::BlocksArgs),
    /// Judge how well the touches of a run on a hard block repeat
    Touches(touches::TouchesArgs),
    /// Find the latency between stage and analyzer by touches at two speeds
    Latency(latency::LatencyArgs),
    /// Find the radius of the ball by the touches of a run on a pin
    Pin(pin::PinArgs),
    /// Measure the free sensor, and judge its drift, its linearity and its change since the last time
    Sensor(sensor::SensorArgs),
    /// Say that the bench was changed: what rests on it is asked for again
    Changed(ChangedArgs),
    /// List the changes of a bench, and what each one voids
    Changes,
}

#[derive(Debug, Args)]
struct ChangedArgs {
    /// Name of the change, from `rigd commission changes`
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(BenchChange::ALL.map(BenchChange::name)))]
    change: String,
    #[command(flatten)]
    bench: BenchArgs,
}

#[derive(Debug, Args)]
struct WalkArgs {
    #[command(flatten)]
    bench: BenchArgs,
    /// Answer to the next question, in their order; repeat it. The terminal is asked for the others
    #[arg(long, value_name = "ANSWER", allow_hyphen_values = true)]
    answer: Vec<String>,
    /// Make each step of an axis without asking for Enter. Whether a drive may find its zero is asked all the same
    #[arg(long)]
    yes: bool,
    /// Temperature at the bench, for the records
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

#[derive(Debug, Args)]
struct AgainArgs {
    /// Step to make
    #[arg(value_enum)]
    step: StepName,
    #[command(flatten)]
    walk: WalkArgs,
}

#[derive(Debug, Args)]
struct JogArgs {
    /// Axis to move
    #[arg(value_enum)]
    axis: AxisName,
    /// Step from where it stands, mm or degrees by the rig file: at most 0.2 mm or 1°; up to 10 mm or 31° once stop, signs and
    /// scale are shown, if the drive knows where the axis is
    #[arg(value_name = "MM|DEG", allow_negative_numbers = true)]
    by: f64,
    /// States that sample and dish are away and a hand is at the stop, without asking for Enter
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    bench: BenchArgs,
}

#[derive(Debug, Args)]
struct ShowArgs {
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum StepName {
    Stop,
    Signs,
    Geometry,
    Scale,
    Limits,
    Homing,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum AxisName {
    /// The vertical stage that carries the probe
    Linear,
    /// The stage that tilts the sample
    Rotary,
}

/// Why a bench is not commissioned.
#[derive(Debug, thiserror::Error)]
pub(super) enum CommissionFailure {
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
    #[error(transparent)]
    NotAnAnswer(#[from] rig_commission::NotAnAnswer),
    #[error("the input ended before this was answered: {question}")]
    Unanswered { question: &'static str },
    #[error("the input could not be read before this was answered: {question}")]
    Unread { question: &'static str, source: io::Error },
    #[error("step {} failed: {why}", kind.name())]
    Failed { kind: Kind, why: String },
    #[error(transparent)]
    NoSensor(#[from] NoSensor),
    #[error(transparent)]
    Check(#[from] CheckError),
    #[error("the bench is not as the rig file says: {changes}")]
    RigFile { kind: Option<Kind>, changes: String },
    #[error(transparent)]
    Block(#[from] BlockRunError),
    #[error("{axis}: {trouble}")]
    NoStep { axis: &'static str, trouble: NotMade },
    #[error("{axis}: its drive was not let find its zero, so that nothing is recorded of it")]
    NotLet { axis: &'static str },
}

impl From<NoRecord> for CommissionFailure {
    fn from(error: NoRecord) -> Self {
        match error {
            NoRecord::Calibrations(error) => error.into(),
            NoRecord::NoSensor(error) => error.into(),
        }
    }
}

impl CommissionFailure {
    pub(super) const fn exit_code(&self) -> u8 {
        match self {
            Self::RigFile { .. }
            | Self::NotAnAnswer(_)
            | Self::Block(
                BlockRunError::NoPin { .. }
                | BlockRunError::OtherPin { .. }
                | BlockRunError::InPieces(_),
            )
            | Self::NoStep { trouble: NotMade::Refused(_), .. }
            | Self::Check(
                CheckError::Samples { .. }
                | CheckError::InPieces(_)
                | CheckError::Used { .. }
                | CheckError::Apart { .. },
            ) => 2,
            Self::Block(BlockRunError::NotOfBench(trouble))
            | Self::Check(CheckError::NotOfBench(trouble))
                if trouble.is_other_run() =>
            {
                2
            }
            _ => 1,
        }
    }

    pub(super) const fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Failed { kind, .. } => Some(kind.remedy()),
            Self::NoSensor(_) => Some(Kind::Sensor.remedy()),
            Self::Block(BlockRunError::NoGeometry(_)) => Some(Kind::Blocks.remedy()),
            Self::Check(CheckError::Unmeasured(_)) => {
                Some("`rigd show RUN` says why the touches were refused; make the check again")
            }
            Self::Check(
                CheckError::Used { .. }
                | CheckError::Apart { .. }
                | CheckError::NotOfBench(NotOfBench::Changed { .. } | NotOfBench::Expired { .. }),
            ) => {
                Some("run both protocols of the check again, the block first, and judge these runs")
            }
            Self::Block(BlockRunError::NotOfBench(
                NotOfBench::OtherAxes { .. }
                | NotOfBench::Changed { .. }
                | NotOfBench::Expired { .. },
            )) => Some("run the protocol again, and evaluate that run"),
            Self::RigFile { kind: Some(Kind::Latency), .. } => {
                Some("change the rig file, and judge the same run again")
            }
            Self::Block(BlockRunError::NoLatency { .. }) => Some(
                "run `config/protocols/latency.toml`; where its fast touches were found by steps, state a larger \
                 analyzer.latency_sigma_s in the rig file first",
            ),
            Self::Block(BlockRunError::NoPin { .. }) => Some(
                "add pin_radius_mm to [geometry] in a copy of the rig file, and run config/protocols/pin.toml with --rig COPY",
            ),
            Self::Block(BlockRunError::NoRadius { .. }) => Some(Kind::Pin.remedy()),
            Self::RigFile { .. } => Some(
                "change the rig file, and begin `rigd commission` again: the steps that it changes are made again",
            ),
            _ => None,
        }
    }
}

pub(super) fn commission(args: &CommissionArgs) -> Result<(), Failure> {
    match &args.command {
        None => walk(&args.walk, None),
        Some(CommissionCommand::Again(again)) => walk(&again.walk, Some(again.step.into())),
        Some(CommissionCommand::Jog(args)) => jog(args),
        Some(CommissionCommand::Show(args)) => show(args),
        Some(CommissionCommand::Blocks(args)) => blocks::blocks(args),
        Some(CommissionCommand::Touches(args)) => touches::touches(args),
        Some(CommissionCommand::Latency(args)) => latency::latency(args),
        Some(CommissionCommand::Pin(args)) => pin::pin(args),
        Some(CommissionCommand::Sensor(args)) => sensor::sensor(args),
        Some(CommissionCommand::Changed(args)) => changed(args),
        Some(CommissionCommand::Changes) => print(&changes()),
    }
}

/// What follows the last step.
const COMMISSIONED: &str = "The rig is commissioned. `rigd home` brings it into service: it moves the probe to its clear position first.";

/// Makes the steps that are missing, or one step again.
fn walk(args: &WalkArgs, again: Option<Step>) -> Result<(), Failure> {
    let (data, operator) = (args.bench.data.dir(), args.bench.operator.name());
    let rig = args.bench.rig.load()?;
    let (file, basis) = (rig.file.clone(), rig.basis());
    let records =
        Records { basis: basis.clone(), data: data.clone(), temperature_c: args.temperature };
    with_bench(rig, records, &operator, (args.yes, &args.answer), async |guide| {
        guide.void_after_interrupted_homing().await?;
        if let Some(step) = again {
            return guide.step(step, &file).await;
        }
        loop {
            let standing =
                calibrations::standing(&basis, &data).map_err(CommissionFailure::from)?;
            let Some((step, why)) = standing.missing().next() else {
                match guide.read_calibrations().await? {
                    None => say(COMMISSIONED),
                    Some(missing) => {
                        say_clearly(&indented(&calibrations::not_in_service(&missing), 0));
                    }
                }
                return Ok(());
            };
            say_clearly(&format!("Missing: {} ({}).", step.name(), why.text()));
            guide.step(step, &file).await?;
        }
    })
}

fn jog(args: &JogArgs) -> Result<(), Failure> {
    let (data, operator) = (args.bench.data.dir(), args.bench.operator.name());
    let axis = match args.axis {
        AxisName::Linear => JogAxis::Linear,
        AxisName::Rotary => JogAxis::Rotary,
    };
    let rig = args.bench.rig.load()?;
    let records = Records { basis: rig.basis(), data, temperature_c: None };
    with_bench(rig, records, &operator, (args.yes, &[]), async |guide| {
        guide.void_after_interrupted_homing().await?;
        guide.single(Jog { axis, by: args.by }).await
    })
}

/// Opens a bench without bringing it into service, does `work` with it, and closes it.
fn with_bench(
    rig: LoadedRig,
    records: Records,
    operator: &Operator,
    given: (bool, &[String]),
    work: impl AsyncFnOnce(&mut Guide) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let outcome = runtime.block_on(async {
        let mut signals = Signals::new()?;
        let data = records.data.clone();
        let (handle, thread) = open_by(rig::open_to_commission, rig, data, &mut signals).await?;
        let mut guide = Guide::new(handle, operator.clone(), signals, records, given)?;
        let outcome = work(&mut guide).await;
        guide.close().await;
        thread.join();
        outcome
    });
    // Reading the terminal cannot be interrupted; the program does not wait for it.
    runtime.shutdown_background();
    outcome
}

/// A step, for a program.
#[derive(Debug, Serialize)]
struct StepView {
    step: &'static str,
    is_held: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    made: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    person: Option<String>,
}

fn show(args: &ShowArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let standing =
        calibrations::standing(&rig.basis(), &args.data.dir()).map_err(CommissionFailure::from)?;
    if args.output.json {
        return print_json(&views(&standing));
    }
    let missing = if rig.is_put_together_as_described() { "not needed" } else { "missing" };
    let text = |view: &StepView| match (&view.made, &view.person, view.why) {
        (Some(made), Some(person), _) => format!("{made}, {person}"),
        (_, _, why) => format!("{missing}: {}", why.unwrap_or_default()),
    };
    let views = views(&standing);
    print(&wrapped(&views.iter().map(|view| (view.step, text(view))).collect::<Vec<_>>()))?;
    if rig.is_put_together_as_described() {
        say("The simulated bench is put together as the rig file says: it needs no calibration.");
    }
    Ok(())
}

/// Writes down that the bench was changed.
fn changed(args: &ChangedArgs) -> Result<(), Failure> {
    let (data, basis) = (args.bench.data.dir(), args.bench.rig.load()?.basis());
    let change = BenchChange::ALL.into_iter().find(|change| change.name() == args.change);
    for (change, kind) in
        change.iter().flat_map(|change| change.voids().iter().map(move |kind| (*change, *kind)))
    {
        let person = args.bench.operator.name().as_str().to_owned();
        let witness = Witness { person, journal: Vec::new(), temperature_c: None };
        let path = calibrations::void(&basis, &data, (kind, change), witness)
            .map_err(CommissionFailure::from)?;
        say(&format!("Record: {}", path.display()));
    }
    if !matches!(Endpoint::find(&data), Err(EndpointError::None { .. })) {
        say(&indented(IN_SERVICE, 0));
    }
    Ok(())
}

/// A daemon looks at the calibrations when it starts.
const IN_SERVICE: &str = "A daemon serves this data directory. Its rig stays in service until it ends: end it now, and \
                          `rigd commission` asks for what is missing.";

/// What each change of a bench voids.
fn changes() -> String {
    let rows = BenchChange::ALL.map(|change| {
        let voids: Vec<_> = change.voids().iter().map(|kind| kind.name()).collect();
        (change.name(), format!("{}: {}", change.text(), voids.join(", ")))
    });
    wrapped(&rows)
}

fn views(standing: &Standing) -> Vec<StepView> {
    let view = |(step, found): &(Step, Result<rig_commission::Calibration, _>)| {
        let why = found.as_ref().err().map(|why: &rig_commission::Why| why.text());
        let record = found.as_ref().ok();
        StepView {
            step: step.name(),
            is_held: record.is_some(),
            why,
            made: record.map(|record| record.made().to_owned()),
            person: record.map(|record| record.person().to_owned()),
        }
    };
    standing.steps.iter().map(view).collect()
}

impl From<StepName> for Step {
    fn from(name: StepName) -> Self {
        match name {
            StepName::Stop => Self::Stop,
            StepName::Signs => Self::Signs,
            StepName::Scale => Self::Scale,
            StepName::Geometry => Self::Geometry,
            StepName::Limits => Self::Limits,
            StepName::Homing => Self::Homing,
        }
    }
}

/// Says what a run has shown, from what, and where its record is; then its verdict.
fn tell(
    (kind, finding): (Kind, Finding),
    from: Option<&str>,
    record: &Path,
) -> Result<(), Failure> {
    let printed = print(&facts(&rows(&finding)));
    if let Some(from) = from {
        say(from);
    }
    say(&format!("Record: {}", record.display()));
    concluded(printed, judged(kind, finding.verdict))
}

/// The values of a finding, for a person.
fn rows(finding: &Finding) -> Vec<(&'static str, String)> {
    let row = |value: &Value| {
        let Value { name, value, standard_uncertainty, unit } = value;
        // That of a ratio is 1.
        let unit = if *unit == "1" { String::new() } else { format!(" {unit}") };
        (*name, format!("{value:.4} ± {standard_uncertainty:.4}{unit}"))
    };
    finding.values.iter().map(row).collect()
}

/// The result of a step for a person, or the failure that ends the command.
fn judged(kind: Kind, verdict: Verdict) -> Result<(), Failure> {
    match verdict {
        Verdict::Accepted => Ok(()),
        Verdict::Failed(why) => Err(CommissionFailure::Failed { kind, why }.into()),
        Verdict::RigFile(changes) => {
            let changes: Vec<_> = changes.iter().map(ToString::to_string).collect();
            let changes = changes.join("; ");
            Err(CommissionFailure::RigFile { kind: Some(kind), changes }.into())
        }
    }
}

impl Guide {
    /// Makes a step and writes its record, also that of a step that failed.
    async fn step(&mut self, step: Step, file: &RigFile) -> Result<(), Failure> {
        let (name, shows) = (step.name(), step.shows());
        say_clearly("");
        say(&indented(&format!("Step {name}: {shows}. Accepted when {}.", step.limit()), 0));
        say(step.picture());
        let finding = procedure::carry_out(step, file, self).await?;
        let verdict = finding.verdict.clone();
        for value in &finding.values {
            let unit = if value.unit == "1" { String::new() } else { format!(" {}", value.unit) };
            let (name, value, sigma) = (value.name, value.value, value.standard_uncertainty);
            // A sign is exact.
            let number =
                if sigma == 0.0 { format!("{value}") } else { format!("{value:.4} ± {sigma:.4}") };
            say(&format!("{name} = {number}{unit}"));
        }
        let Records { basis, data, .. } = &self.records;
        let path = calibrations::write_step(basis, data, (step, finding), self.witness())
            .map_err(CommissionFailure::from)?;
        say(&format!("Record: {}", path.display()));
        self.read_calibrations().await?;
        judged(step.into(), verdict)
    }
}
