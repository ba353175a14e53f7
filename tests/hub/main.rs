//! Simulated rigs that ship to a hub and to an object store through kills, cuts and copies, and every byte compared.
//!
//! `cargo run -p rig-tests --release --bin hub-campaign -- --seeds 1000` lets each seed be a bench: a rig measures runs in
//! virtual time, and is killed in the middle of some; programs ship its journal and put its objects, and are killed at any
//! moment; lines are slow or cut; PostgreSQL crashes, ends connections, or has no space; journals are put back to a copy,
//! or two computers go on with one; clocks are a year off, and runs have a newer format. At the end the hub and the
//! objects must have each sealed run byte for byte, and a prefix of every other one, nothing was put aside, and the results
//! that the hub makes of its records are those of the reports. The first
//! run of a seed is also measured without a hub, and must be the same to the microsecond of the rig's clock. Rigs tell viewers what
//! they do by a nats-server that is dead, silent or killed: no cursor of the hub moves by it, and the run is the same.
//!
//! `hub-campaign figures` prints how fast the hub takes records, and how long answers take, on the computer at hand.
//!
//! `hub-campaign full-disk` lets the disks of PostgreSQL and of an object store be full.
//!
//! It prints each seed that fails. Its last line says how often each thing happened. The exit code is 0 only if no seed
//! fails, and each thing has happened. It needs the Debian packages `postgresql`, `nats-server`
//! and `faketime`.

#![expect(clippy::unwrap_used, reason = "a campaign may stop where it stands")]
#![expect(clippy::print_stdout, reason = "what it prints is what it is for")]

mod bench;
mod copies;
mod deed;
mod figures;
mod full_disk;
mod latency;
mod line;
mod newer;
mod objects;
mod restored;
mod results;
mod seed;
mod shipping;
#[expect(dead_code, reason = "the tests of the hub use more of it")]
#[path = "../../crates/hub/tests/hub/support.rs"]
mod support;
mod telling;
mod worker;

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    process::ExitCode,
    time::Instant,
};

use bench::{Counts, FAKETIME};
use clap::{Parser, Subcommand};
use deed::DEEDS;
use figures::FiguresArgs;
use full_disk::FullDiskArgs;
use support::Hub;
use telling::{MESSAGES, Nats};
use tokio::runtime::Runtime;
use worker::Worker;

/// Lets simulated rigs ship through faults, and compares the hub and the objects with their journals.
#[derive(Debug, Parser)]
struct Arguments {
    /// Number of seeds
    #[arg(long, default_value_t = 100)]
    seeds: u64,
    /// The first seed
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    #[command(subcommand)]
    task: Option<Task>,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Print how fast the hub takes records and answers questions
    Figures(FiguresArgs),
    /// Let the disks of PostgreSQL and of an object store be full, as `tests/hub/full_disk.sh` does
    FullDisk(FullDiskArgs),
    #[command(flatten)]
    Worker(Worker),
}

/// With as many seeds, everything has happened.
const SEEDS_FOR_ALL: u64 = 30;

fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap()
}

fn main() -> ExitCode {
    let Arguments { seeds, first_seed, task } = Arguments::parse();
    match task {
        Some(Task::Worker(worker)) => return worker.work(),
        Some(Task::Figures(args)) => {
            runtime().block_on(args.print());
            return ExitCode::SUCCESS;
        }
        Some(Task::FullDisk(args)) => {
            runtime().block_on(args.play());
            return ExitCode::SUCCESS;
        }
        None => {}
    }
    if !Path::new(FAKETIME).exists() {
        println!("there is no {FAKETIME}: install the Debian package `faketime`");
        return ExitCode::FAILURE;
    }
    let runtime = runtime();
    let mut hub = runtime.block_on(Hub::new());
    let nats = runtime.block_on(Nats::new(&hub));
    let (mut counts, mut failed, began) = (Counts::new(), 0, Instant::now());
    for seed in first_seed..first_seed + seeds {
        let played = catch_unwind(AssertUnwindSafe(|| {
            runtime.block_on(seed::play(seed, &mut hub, &nats, &mut counts));
        }));
        if played.is_err() {
            println!("seed {seed} failed; again with --first-seed {seed} --seeds 1");
            failed += 1;
        }
    }
    let restored = catch_unwind(AssertUnwindSafe(|| {
        runtime.block_on(restored::play(&mut hub, &mut counts));
    }));
    if restored.is_err() {
        println!("the hub that was put back to a backup failed");
        failed += 1;
    }
    let missing: Vec<_> =
        DEEDS.iter().filter(|(deed, _)| !counts.contains_key(&format!("{deed:?}"))).collect();
    let seconds = began.elapsed().as_secs();
    println!("{seeds} seeds from {first_seed}, {failed} failed, in {seconds} s: {counts:?}");
    let is_missing = seeds >= SEEDS_FOR_ALL && !missing.is_empty();
    if is_missing {
        println!("never happened: {missing:?}");
    }
    let is_silent = seeds >= SEEDS_FOR_ALL && counts.get(MESSAGES).is_none_or(|count| *count == 0);
    if is_silent {
        println!("viewers were told nothing");
    }
    if failed > 0 || is_missing || is_silent { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
