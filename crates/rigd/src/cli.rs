//! The command line.
//!
//! Data goes to stdout, messages go to stderr.

mod archive;
mod args;
mod bench_key;
mod check;
mod check_bench;
mod client;
mod commission;
mod compensate;
mod config;
mod daemon;
mod doctor;
mod door;
mod ended_runs;
mod export;
mod failure;
mod fit;
mod guard;
mod hub;
mod identify;
mod instrument;
mod live;
mod log;
#[cfg(target_os = "linux")]
mod manager;
#[cfg(not(target_os = "linux"))]
#[path = "cli/no_manager.rs"]
mod manager;
mod manual;
mod measure;
mod moves;
mod outcome;
mod output_file;
mod ports;
mod prompt;
mod queue;
#[cfg(feature = "simulator")]
mod rehearse;
mod reload;
mod run;
mod runs;
mod safe;
mod schema;
mod screen;
mod selftest;
mod serve;
mod session;
mod settings;
mod ship;
mod signals;
mod table;
mod token;
mod verify;
mod watch;

use std::{io, process::ExitCode};

use clap::{Parser, Subcommand};
use rig_model::with_causes;
use rig_report::export::ExportError;
use tracing::level_filters::LevelFilter;

pub(crate) use self::failure::SALVAGE;
use self::{
    daemon::Order,
    failure::{EXIT_CODES, Failure},
};
use crate::{faults, loaded_rig::FileError};

/// Drives the bench rig of the tilted-contact tactile sensor.
#[derive(Debug, Parser)]
#[command(name = "rigd", version, max_term_width = 80, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: CliCommand,
}

#[derive(Debug, Subcommand)]
enum CliCommand {
    /// Replay a protocol or resume a run, and write the report
    Run(run::RunArgs),
    /// Measure one touch of a run again; the old outcome is kept
    Redo(run::RedoArgs),
    /// Leave one touch of a run out; its readings are kept
    Skip(args::TouchArgs),
    /// Seal a run that was not completed, so that it cannot be resumed
    GiveUp(runs::GiveUpArgs),
    /// Say whether a protocol can run on a rig, without moving anything
    Check(check::CheckArgs),
    #[cfg(feature = "simulator")]
    /// Try the faults of a bench on a protocol, in simulation
    Rehearse(rehearse::RehearseArgs),
    /// Serve the rig over HTTP, with a protocol loaded
    Serve(serve::ServeArgs),
    /// Show the settings in force, or have a daemon read them again
    Config(config::ConfigArgs),
    /// Show the rig of a running daemon, and what it asks for
    Status(daemon::StatusArgs),
    /// Follow a run of a daemon to its end
    Watch(daemon::DaemonArgs),
    /// Pause the run of a daemon before its next step
    Pause(daemon::DaemonArgs),
    /// Go on with a paused run of a daemon
    Resume(daemon::DaemonArgs),
    /// Retract and end the run of a daemon
    Abort(daemon::DaemonArgs),
    /// Stop both axes of a daemon's rig, retract, and latch
    Stop(daemon::DaemonArgs),
    /// Answer what a daemon asks for
    Answer(daemon::AnswerArgs),
    /// Leave the latch of a daemon: the rig is prepared again
    Acknowledge(daemon::AcknowledgeArgs),
    /// Open the page of a daemon in the browser, by a link that works once
    Open(token::OpenArgs),
    /// Show who operates a daemon's rig, take the lease over, or give it back
    Lease(token::LeaseArgs),
    /// Show and change the protocols that wait for a daemon's rig
    Queue(queue::QueueArgs),
    /// Make, list and revoke the tokens of persons and programs
    Token(token::TokenArgs),
    /// List the runs
    Runs(runs::RunsArgs),
    /// Show the results of a run
    Show(runs::ShowArgs),
    /// Write the data of a run to stdout
    Export(export::ExportArgs),
    /// Copy the journal to a new directory, also while a daemon writes it
    Backup(runs::BackupArgs),
    /// Put a backup in place of a lost journal, and read it there first
    Restore(runs::RestoreArgs),
    /// Move sealed runs to an archive, each checked there first
    Archive(archive::ArchiveArgs),
    /// Put sealed runs in an object store, each as one Parquet file
    Ship(ship::ShipArgs),
    /// Make and show the key that signs the seals of a bench
    BenchKey(bench_key::BenchKeyArgs),
    /// Copy what verifies of a damaged journal to a new directory
    Salvage(runs::SalvageArgs),
    /// Write the report of a run again
    Report(runs::ReportArgs),
    /// Check the journal of a run, or objects of an object store
    Verify(verify::VerifyArgs),
    /// List the serial ports of this computer and who has them open
    Ports(ports::PortsArgs),
    /// Ask every device of a rig who it is
    Identify(identify::IdentifyArgs),
    /// Write, record and check the files of instruments
    Instrument(instrument::InstrumentArgs),
    /// Correct the analyzer for cable and fixture, or list its corrections
    Compensate(compensate::CompensateArgs),
    /// Test a bench in levels, each check with its limit; up to `electric` nothing moves
    Selftest(selftest::SelftestArgs),
    /// Check that a bench is as it was, by touches on a block and references
    CheckBench(check_bench::CheckBenchArgs),
    /// Check a rig and advise on each problem
    Doctor(doctor::DoctorArgs),
    /// Show a new bench to be as its rig file says, step by step
    Commission(commission::CommissionArgs),
    /// Home each lost axis, retract the probe, level the sample
    Home(moves::HomeArgs),
    /// Retract the probe without the rest of the rig, as a stop hook
    Safe(safe::SafeArgs),
    /// Move one axis, as far as any touch may go
    Move(moves::MoveArgs),
    /// Measure one resonance, with the probe clear or lowered
    Measure(measure::MeasureArgs),
    /// Print what rigd does in each fault, and what a person does
    Faults,
    /// Find the resonance in a sweep from a file
    Fit(fit::FitArgs),
    /// Print the JSON Schema of a kind of file, for an editor
    Schema(schema::SchemaArgs),
    /// Write a file to start from
    New(schema::NewArgs),
    /// Print the completions of a shell
    Completions(manual::CompletionsArgs),
    /// Print the manual page, or write that of every command
    Man(manual::ManArgs),
}

/// Runs the program.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    // Until it is dropped, spans go to a collector if one is named.
    let _exported = log::start(match cli.command {
        // The warnings of a rehearsal are about faults that it has made.
        #[cfg(feature = "simulator")]
        CliCommand::Rehearse(_) => LevelFilter::OFF,
        _ => LevelFilter::WARN,
    });
    let result = carry_out(cli.command);
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
                Failure::TouchesRefused | Failure::NotSound | Failure::NotAccepted { .. } => {}
                failure => table::note(&format!("rigd: {}", with_causes(failure))),
            }
            if let Some(advice) = failure.advice() {
                table::note(&format!("→ {advice}"));
            }
            ExitCode::from(failure.exit_code())
        }
    }
}

/// Carries out a command.
fn carry_out(command: CliCommand) -> Result<(), Failure> {
    match command {
        CliCommand::Run(args) => run::run(&args),
        CliCommand::Redo(args) => run::redo(&args),
        CliCommand::Skip(args) => runs::skip(&args),
        CliCommand::GiveUp(args) => runs::give_up(&args),
        CliCommand::Check(args) => check::check(&args),
        #[cfg(feature = "simulator")]
        CliCommand::Rehearse(args) => rehearse::rehearse_protocol(&args),
        CliCommand::Serve(args) => serve::serve(&args),
        CliCommand::Config(args) => config::config(&args),
        CliCommand::Status(args) => daemon::status(&args),
        CliCommand::Watch(args) => watch::watch(&args),
        CliCommand::Pause(args) => daemon::order(&args, Order::Pause),
        CliCommand::Resume(args) => daemon::order(&args, Order::Resume),
        CliCommand::Abort(args) => daemon::order(&args, Order::Abort),
        CliCommand::Stop(args) => daemon::order(&args, Order::Stop),
        CliCommand::Answer(args) => daemon::answer(&args),
        CliCommand::Acknowledge(args) => daemon::acknowledge(&args),
        CliCommand::Open(args) => token::open(&args),
        CliCommand::Lease(args) => token::lease(&args),
        CliCommand::Queue(args) => queue::queue(&args),
        CliCommand::Token(args) => token::token(&args),
        CliCommand::Runs(args) => runs::list(&args),
        CliCommand::Show(args) => runs::show(&args),
        CliCommand::Export(args) => export::export(&args),
        CliCommand::Backup(args) => runs::back_up(&args),
        CliCommand::Restore(args) => runs::restore(&args),
        CliCommand::Archive(args) => archive::archive(&args),
        CliCommand::Ship(args) => ship::ship(&args),
        CliCommand::BenchKey(args) => bench_key::bench_key(&args),
        CliCommand::Salvage(args) => runs::salvage(&args),
        CliCommand::Report(args) => runs::report(&args),
        CliCommand::Verify(args) => verify::verify(&args),
        CliCommand::Ports(args) => ports::ports(&args),
        CliCommand::Identify(args) => identify::identify(&args),
        CliCommand::Instrument(args) => instrument::instrument(&args),
        CliCommand::Compensate(args) => compensate::compensate(&args),
        CliCommand::Selftest(args) => selftest::run(&args),
        CliCommand::CheckBench(args) => check_bench::check_bench(&args),
        CliCommand::Doctor(args) => doctor::doctor(&args),
        CliCommand::Commission(args) => commission::commission(&args),
        CliCommand::Home(args) => moves::home(&args),
        CliCommand::Safe(args) => safe::safe(&args),
        CliCommand::Move(args) => moves::to(&args),
        CliCommand::Measure(args) => measure::measure(&args),
        CliCommand::Schema(args) => schema::schema(&args),
        CliCommand::New(args) => schema::new(&args),
        CliCommand::Faults => table::print(faults::page().trim_end()),
        CliCommand::Fit(args) => fit::fit_file(&args),
        CliCommand::Completions(args) => manual::completions(&args),
        CliCommand::Man(args) => manual::man(&args),
    }
}
