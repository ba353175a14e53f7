//! Offline studies: the paper's figures, charts of speed against accuracy, failure maps.
//!
//! Each subcommand is a module with its arguments and a `run`. Results go to standard output or to
//! a folder, messages to standard error.

mod analyse;
mod analyzer;
mod bench_run;
mod bound;
mod chunk;
mod compensation;
mod contact_args;
mod design;
mod failures;
mod files;
mod inverses;
mod invert;
mod model;
mod models;
mod outcome;
mod page;
mod paper;
mod paper_bench;
mod planned;
mod progress;
mod simulate;
mod speed_accuracy;
mod touch;
mod truths;

use std::{io, process::ExitCode};

use clap::{Parser, Subcommand};

/// Studies of sensor, contact and analysis, from the same models that the daemon runs.
#[derive(Debug, Parser)]
#[command(name = "rig-study", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Paper(paper::Args),
    Models(models::Args),
    Design(design::Args),
    Inverses(inverses::Args),
    Model(model::Args),
    Invert(invert::Args),
    Compensation(compensation::Args),
    SpeedAccuracy(speed_accuracy::Args),
    Truths(truths::Args),
    Analyse(analyse::Args),
    Failures(failures::Args),
    Touch(touch::Args),
}

fn main() -> ExitCode {
    let mut out = io::stdout().lock();
    let result = match Cli::parse().command {
        Command::Paper(args) => paper::run(&args, &mut out),
        Command::Design(args) => design::run(&args, &mut out),
        Command::Inverses(args) => inverses::run(&args, &mut out),
        Command::Models(args) => models::run(&args, &mut out),
        Command::Model(args) => model::run(&args, &mut out),
        Command::Invert(args) => invert::run(&args, &mut out),
        Command::Compensation(args) => compensation::run(&args, &mut out),
        Command::Failures(args) => failures::run(&args, &mut out),
        Command::Truths(args) => truths::run(&args, &mut out),
        Command::Analyse(args) => analyse::run(&args, &mut out),
        Command::Touch(args) => touch::run(&args, &mut out),
        Command::SpeedAccuracy(args) => speed_accuracy::run(&args, &mut out),
    };
    outcome::exit(result)
}
