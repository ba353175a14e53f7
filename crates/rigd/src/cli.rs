//! The command line.
//!
//! Data goes to stdout, messages go to stderr.

mod args;
mod check;
mod doctor;
mod export;
mod failure;
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
    process::ExitCode,
};

use clap::{Parser, Subcommand};
use rig_model::with_causes;
use rig_report::export::ExportError;
use tracing::level_filters::LevelFilter;

pub(crate) use self::failure::SALVAGE;
use self::failure::{EXIT_CODES, Failure};
use crate::{faults, loaded_rig::FileError};

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
    Run(run::RunArgs),
    /// Measure one touch of a run again; the old outcome is kept beside the new one
    Redo(run::RedoArgs),
    /// Leave one touch of a run out; its readings are kept
    Skip(args::TouchArgs),
    /// Seal a run that was not completed, so that it cannot be resumed
    GiveUp(runs::GiveUpArgs),
    /// Say whether a protocol can run on a rig, without moving anything
    Check(check::CheckArgs),
    /// Say what the faults of a bench would do to a protocol, on a simulated copy of the rig
    Rehearse(rehearse::RehearseArgs),
    /// Serve the rig over HTTP, with a protocol loaded
    Serve(serve::ServeArgs),
    /// List the runs
    Runs(runs::RunsArgs),
    /// Show the results of a run
    Show(runs::ShowArgs),
    /// Write the data of a run to stdout
    Export(export::ExportArgs),
    /// Copy what verifies of a damaged journal to a new directory
    Salvage(runs::SalvageArgs),
    /// Write the report of a run again
    Report(runs::ReportArgs),
    /// Check the journal of a run: chain, moves, labels, results
    Verify(verify::VerifyArgs),
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
        CliCommand::Export(args) => export::export(&args),
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
