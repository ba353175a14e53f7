//! The command line.
//!
//! Data goes to stdout, messages go to stderr. Exit codes:
//!
//! | code | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | a file, a directory or a device failed |
//! | 2 | a bad command line or file, a target beyond the limits, or a change that nobody confirmed |
//! | 3 | no such run, or no resonance |
//! | 4 | the rig is latched after a fault |
//! | 5 | a run, a move or a sweep was aborted |
//! | 6 | a run ended, and some of its touches were refused |
//! | 7 | the journal of a run is not sound |
//! | 130 | interrupted before any action |

mod check;
mod doctor;
mod fit;
mod identify;
mod measure;
mod moves;
mod outcome;
mod ports;
mod prompt;
mod rehearse;
mod run;
mod runs;
mod safe;
mod screen;
mod serve;
mod session;
mod signals;
mod table;
mod verify;

use std::{
    io::{self, IsTerminal},
    net::SocketAddr,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{Args, Parser, Subcommand, ValueEnum};
use rig_engine::{CommandRefusal, RigState};
use rig_model::{Clearance, Mm, Position, with_causes};
use rig_report::export::ExportError;
use rig_store::{Reader, StoreError};
use rig_verify::JournalError;
use tracing::level_filters::LevelFilter;

use crate::{
    doctor::advice,
    faults,
    http::access::TokenError,
    loaded_rig::{FileError, LoadedRig},
    operator::Operator,
    rehearse::RehearseError,
    rig::{OpenError, RequestRefusal, ResumeRefusal, TouchOrder},
    run_files::RunFilesError,
    sweep_form::SweepFaults,
};

const EXIT_CODES: &str = "\
Exit codes:
  0  done
  1  something failed: a file, a directory, a device
  2  a bad command line, protocol, rig or sweep file, a target beyond the limits, or a change
     since a run that nobody confirmed
  3  no such run, or no resonance
  4  the rig is latched after a fault
  5  a run, a move or a sweep was aborted
  6  a run came to its end, and some of its touches were refused
  7  the journal of a run is not sound";

/// Drives the bench rig of the tilted-contact tactile sensor.
#[derive(Debug, Parser)]
#[command(name = "rigd", version, about, max_term_width = 100, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: CliCommand,
}

#[derive(Debug, Subcommand)]
enum CliCommand {
    /// Replay a protocol or resume a run, and write the report
    Run(RunArgs),
    /// Measure one touch of a run again; the old outcome is kept beside the new one
    Redo(RedoArgs),
    /// Leave one touch of a run out; its readings are kept
    Skip(TouchArgs),
    /// Seal a run that was not completed, so that it cannot be resumed
    GiveUp(GiveUpArgs),
    /// Say whether a protocol can run on a rig, without moving anything
    Check(CheckArgs),
    /// Say what the faults of a bench would do to a protocol, on a simulated copy of the rig
    Rehearse(rehearse::RehearseArgs),
    /// Serve the rig over HTTP, with a protocol loaded
    Serve(serve::ServeArgs),
    /// List the runs
    Runs(RunsArgs),
    /// Show the results of a run
    Show(ShowArgs),
    /// Write the data of a run to stdout
    Export(ExportArgs),
    /// Copy what verifies of a damaged journal to a new directory
    Salvage(SalvageArgs),
    /// Write the report of a run again
    Report(ReportArgs),
    /// Check the journal of a run: chain, moves, labels, results
    Verify(VerifyArgs),
    /// List the serial ports of this computer and who has them open
    Ports(ports::PortsArgs),
    /// Ask every device of a rig who it is
    Identify(identify::IdentifyArgs),
    /// Check a rig and advise on each problem
    Doctor(doctor::DoctorArgs),
    /// Home each lost axis, retract the probe, level the sample
    Home(moves::HomeArgs),
    /// Retract the probe without the rest of the rig, as a stop hook; nothing is lowered or turned
    Safe(safe::SafeArgs),
    /// Move one axis, as far as any touch may go
    Move(moves::MoveArgs),
    /// Measure one resonance, with the probe clear or lowered
    Measure(measure::MeasureArgs),
    /// Print the faults of a bench: what rigd does, what a person sees and does
    Faults,
    /// Find the resonance in a sweep from a file
    Fit(fit::FitArgs),
}

/// The rig file that is meant where none is given: the shipped one, below the current directory.
const DEFAULT_RIG: &str = "config/rigs/simulated.toml";

/// The rig to use.
#[derive(Debug, Args)]
struct RigArgs {
    /// Rig file of the bench
    #[arg(long, value_name = "RIG", default_value = DEFAULT_RIG)]
    rig: PathBuf,
}

/// Data directory with the journal.
#[derive(Debug, Args)]
struct DataArgs {
    /// Directory of the journal and the reports
    #[arg(long, value_name = "DIR", default_value = "data")]
    data: PathBuf,
}

/// The operator of a command.
#[derive(Debug, Args)]
struct OperatorArgs {
    /// Name that the journal keeps with the command [default: the login user]
    #[arg(long, value_name = "NAME")]
    operator: Option<Operator>,
}

impl OperatorArgs {
    fn name(&self) -> Operator {
        self.operator.clone().unwrap_or_else(Operator::login)
    }
}

/// The output format.
#[derive(Debug, Args)]
struct OutputArgs {
    /// Print JSON for a program instead of text for a person
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct RunArgs {
    /// Protocol file
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    protocol: Option<PathBuf>,
    /// Resume a run that was not completed, at its next touch without an outcome: its name such as
    /// `smoke-7`, its id or enough of it, or `latest`
    #[arg(long, value_name = "RUN")]
    resume: Option<String>,
    /// With --resume: confirm that the rig file, the scene, the software or a device has changed
    #[arg(long, requires = "resume")]
    accept_changes: bool,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    operator: OperatorArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
struct CheckArgs {
    /// Protocol file
    protocol: PathBuf,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
struct RunsArgs {
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// One touch of a run, and why it is amended.
#[derive(Debug, Args)]
struct TouchArgs {
    /// Run: its name such as `smoke-7`, its id or enough of it, or `latest`
    run: String,
    /// Address of the touch, such as `main/3/left/30/1`
    step: String,
    /// The reason, for the journal and the report
    #[arg(long, value_name = "TEXT")]
    why: String,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    operator: OperatorArgs,
}

impl TouchArgs {
    fn order(&self) -> Result<TouchOrder, Failure> {
        let run = self.data.journal()?.find(&self.run)?.id;
        Ok(TouchOrder { run, step: self.step.clone(), why: self.why.clone() })
    }
}

#[derive(Debug, Args)]
struct RedoArgs {
    #[command(flatten)]
    touch: TouchArgs,
    #[command(flatten)]
    rig: RigArgs,
    /// Confirm that the rig file, the scene, the software or a device has changed since the run
    #[arg(long)]
    accept_changes: bool,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
struct SalvageArgs {
    /// Directory of the new journal
    to: PathBuf,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
struct GiveUpArgs {
    /// Run: its name such as `smoke-7`, its id or enough of it, or `latest`
    run: String,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    operator: OperatorArgs,
}

#[derive(Debug, Args)]
struct ShowArgs {
    /// Run: its name such as `smoke-7`, its id or enough of it, or `latest`
    run: String,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
struct ExportArgs {
    /// Run: its name such as `smoke-7`, its id or enough of it, or `latest`
    run: String,
    #[command(flatten)]
    data: DataArgs,
    /// What to write
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// With `--format csv`: which table
    #[arg(long, value_enum, default_value_t = ExportTable::Touches)]
    table: ExportTable,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExportFormat {
    /// One table with units in its header
    Csv,
    /// Every record, one JSON object a line
    Jsonl,
    /// As `--format csv --table sweeps`
    Sweeps,
    /// As `--format csv --table readings`: every raw reading, which `rigd fit` takes
    Readings,
    /// As `--format csv --table searches`
    Searches,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExportTable {
    /// One row a touch
    Touches,
    /// One row a sweep, with its fit
    Sweeps,
    /// One row a reading: the raw impedance
    Readings,
    /// One row a place tried on the way to a surface
    Searches,
}

#[derive(Debug, Args)]
struct ReportArgs {
    /// Run: its name such as `smoke-7`, its id or enough of it, or `latest`
    run: String,
    #[command(flatten)]
    data: DataArgs,
    /// File to write instead of the one in the data directory
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct VerifyArgs {
    /// Run: its name such as `smoke-7`, its id or enough of it, or `latest`
    run: String,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Why a command failed, with its exit code.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    BadFile(#[from] FileError),
    #[error(transparent)]
    RunFiles(#[from] RunFilesError),
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Rehearse(#[from] RehearseError),
    #[error("data directory {}", data.display())]
    Data { data: PathBuf, source: StoreError },
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Export(#[from] ExportError),
    #[error(transparent)]
    Refused(#[from] RequestRefusal),
    #[error(transparent)]
    Sweep(#[from] SweepFaults),
    #[error("{reason}")]
    NoResonance { reason: String },
    #[error("{refused} of {sweeps} sweeps have no resonance")]
    NoResonances { refused: usize, sweeps: usize },
    #[error("this timing needs the columns {missing} in the file")]
    NoTimes { missing: &'static str },
    #[error("{silent} of 3 devices did not answer correctly")]
    Unidentified { silent: usize },
    #[error("{problems} {}", if *problems == 1 { "problem" } else { "problems" })]
    Unfit { problems: usize },
    #[error(
        "--listen {listen} lets every computer on that network move the rig; give --token-file \
         with a file that contains a secret (`openssl rand -hex 32`, mode 600), which clients then \
         send as `Authorization: Bearer`, or listen on 127.0.0.1"
    )]
    NoToken { listen: SocketAddr },
    #[error("{address} is not an address on which rigd can listen; {advice}")]
    Listen { address: SocketAddr, advice: &'static str, source: io::Error },
    #[error(transparent)]
    Token(#[from] TokenError),
    #[error("{what}")]
    System { what: &'static str, source: io::Error },
    /// It has been explained already.
    #[error("the rig is latched: {cause}")]
    Latched { cause: String },
    /// The faults have been listed.
    #[error("the probe is {}{hint}", probe.name())]
    NotClear { probe: Clearance, hint: String },
    #[error("aborted; the probe was retracted")]
    Aborted,
    /// The runs have been listed already.
    #[error("touches were refused")]
    TouchesRefused,
    #[error("interrupted")]
    Interrupted,
    #[error("data directory {}", data.display())]
    Unchecked { data: PathBuf, source: JournalError },
    /// The findings have been listed.
    #[error("the journal is not sound")]
    NotSound,
    #[error(
        "ended at once while the rig was {}; it is left as it is, and the probe is {}{}. The \
         drives may still carry out their last command. First check by eye where the probe is; \
         then `rigd home` retracts it",
        state.name(),
        probe.name(),
        linear.map_or_else(String::new, |at| format!(" (last read back at {at})"))
    )]
    Left { state: RigState, probe: Clearance, linear: Option<Position<Mm>> },
}

impl Failure {
    fn exit_code(&self) -> u8 {
        match self {
            Self::BadFile(_)
            | Self::Sweep(_)
            | Self::NoTimes { .. }
            | Self::NoToken { .. }
            | Self::Token(_) => 2,
            Self::Refused(RequestRefusal::Resume(refusal)) => match &**refusal {
                ResumeRefusal::Changed { .. }
                | ResumeRefusal::OtherKind { .. }
                | ResumeRefusal::Protocol(_) => 2,
                ResumeRefusal::Store(StoreError::NoSuchRun { .. })
                | ResumeRefusal::NoSuchTouch { .. } => 3,
                _ => 1,
            },
            Self::Refused(RequestRefusal::Command(
                CommandRefusal::LinearTarget(_)
                | CommandRefusal::RotaryTarget(_)
                | CommandRefusal::TooDeep { .. },
            )) => 2,
            Self::NoResonance { .. }
            | Self::NoResonances { .. }
            | Self::Store(StoreError::NoSuchRun { .. } | StoreError::Ambiguous { .. }) => 3,
            Self::Latched { .. } | Self::NotClear { .. } => 4,
            Self::Aborted => 5,
            Self::TouchesRefused => 6,
            Self::NotSound => 7,
            Self::Interrupted => 130,
            Self::RunFiles(_)
            | Self::Open(_)
            | Self::Rehearse(_)
            | Self::Data { .. }
            | Self::Store(_)
            | Self::Export(_)
            | Self::Refused(_)
            | Self::Unidentified { .. }
            | Self::Unfit { .. }
            | Self::Unchecked { .. }
            | Self::Left { .. }
            | Self::Listen { .. }
            | Self::System { .. } => 1,
        }
    }
}

/// Advice for a damaged journal.
pub(crate) const SALVAGE: &str =
    "keep the directory; `rigd salvage NEW --data DIR` copies what verifies to a new one";

impl Failure {
    /// Advice, if the message has none.
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Store(StoreError::NoSuchRun { .. }) => {
                Some("`rigd runs --data DIR` lists the runs of a data directory")
            }
            Self::Data { source: StoreError::Damaged(_), .. }
            | Self::Open(OpenError::Data { source: StoreError::Damaged(_), .. }) => {
                Some("`rigd salvage NEW --data DIR` copies the readable part to a new directory")
            }
            Self::Store(StoreError::Broken { .. })
            | Self::RunFiles(RunFilesError::Store(StoreError::Broken { .. })) => Some(SALVAGE),
            Self::Data { source: StoreError::NoJournal, .. } => {
                Some("name the directory of an earlier run with --data")
            }
            Self::Open(OpenError::Data { source: StoreError::InUse, .. }) => Some(
                "end the other rigd, use its HTTP interface, or name another directory with \
                      --data",
            ),
            Self::Refused(RequestRefusal::NoSpace { .. }) => {
                Some("move old runs elsewhere, or choose another directory with --data")
            }
            Self::Refused(RequestRefusal::Resume(refusal))
                if matches!(**refusal, ResumeRefusal::Changed { .. }) =>
            {
                Some(
                    "confirm the change with --accept-changes, or name the other rig file with \
                     --rig",
                )
            }
            Self::Open(error) => advice::on_rig(error),
            Self::BadFile(FileError::Missing { path, .. }) if path == Path::new(DEFAULT_RIG) => {
                Some(
                    "give a rig file with --rig; without --rig, rigd looks for the shipped one \
                      here",
                )
            }
            _ => None,
        }
    }
}

/// Runs the program.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    // The warnings of a rehearsal are about faults that it has made.
    let is_rehearsal = matches!(cli.command, CliCommand::Rehearse(_));
    start_log(if is_rehearsal { LevelFilter::OFF } else { LevelFilter::WARN });
    let result = match cli.command {
        CliCommand::Run(args) => run::run(&args),
        CliCommand::Redo(args) => run::redo(&args),
        CliCommand::Skip(args) => runs::skip(&args),
        CliCommand::GiveUp(args) => runs::give_up(&args),
        CliCommand::Check(args) => check::check(&args),
        CliCommand::Rehearse(args) => rehearse::rehearse_protocol(&args),
        CliCommand::Serve(args) => serve::serve(&args),
        CliCommand::Runs(args) => runs::list(&args),
        CliCommand::Show(args) => runs::show(&args),
        CliCommand::Export(args) => runs::export(&args),
        CliCommand::Salvage(args) => runs::salvage(&args),
        CliCommand::Report(args) => runs::report(&args),
        CliCommand::Verify(args) => verify::verify(&args),
        CliCommand::Ports(args) => ports::ports(&args),
        CliCommand::Identify(args) => identify::identify(&args),
        CliCommand::Doctor(args) => doctor::doctor(&args),
        CliCommand::Home(args) => moves::home(&args),
        CliCommand::Safe(args) => safe::safe(&args),
        CliCommand::Move(args) => moves::to(&args),
        CliCommand::Measure(args) => measure::measure(&args),
        CliCommand::Faults => table::print(faults::page().trim_end()),
        CliCommand::Fit(args) => fit::fit_file(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        // A reader that closes its pipe is not a failure.
        Err(Failure::System { source, .. } | Failure::Export(ExportError::Io(source)))
            if source.kind() == io::ErrorKind::BrokenPipe =>
        {
            ExitCode::SUCCESS
        }
        Err(failure) => {
            match &failure {
                // Each fault begins with its place, so that an editor can jump there.
                Failure::BadFile(FileError::Faults(faults)) => table::note(&faults.to_string()),
                // What was found has been listed.
                Failure::TouchesRefused | Failure::NotSound => {}
                failure => table::note(&format!("rigd: {}", with_causes(failure))),
            }
            if let Some(advice) = failure.advice() {
                table::note(&format!("→ {advice}"));
            }
            ExitCode::from(failure.exit_code())
        }
    }
}

/// The log goes to stderr; `RUST_LOG` selects its contents.
fn start_log(level: LevelFilter) {
    use tracing_subscriber::{EnvFilter, fmt};
    let filter = EnvFilter::builder().with_default_directive(level.into()).from_env_lossy();
    let is_terminal = io::stderr().is_terminal();
    fmt().with_env_filter(filter).with_writer(|| screen::Log).with_ansi(is_terminal).init();
}

impl DataArgs {
    /// Opens the journal to read.
    fn journal(&self) -> Result<Reader, Failure> {
        let data_error = |source| Failure::Data { data: self.data.clone(), source };
        Reader::open(&self.data).map_err(data_error)
    }
}

impl RigArgs {
    fn load(&self) -> Result<LoadedRig, Failure> {
        Ok(LoadedRig::load(&self.rig)?)
    }
}
