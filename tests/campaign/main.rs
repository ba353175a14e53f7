//! Many runs of the whole daemon in virtual time, each on a simulated bench with a seed of its own.
//!
//! `cargo run -p rig-tests --release --bin campaign -- --first-seed K --seeds N --jobs 2` says for each
//! seed whose run does not end as it must how it did end, and the command that replays it; the last
//! line has the counts. The exit code is 0 only if every run ended as it must.

#![expect(clippy::print_stdout, reason = "what it prints is what it is for")]

mod case;
mod run;
mod tally;

use std::{
    process::ExitCode,
    sync::{
        Mutex,
        atomic::{AtomicU64, Ordering},
    },
    thread,
};

use case::Case;
use clap::Parser;
use tally::{Steps, Tally};

/// Runs the whole daemon on simulated benches with one seed after another.
#[derive(Debug, Clone, Parser)]
struct Arguments {
    /// The first seed.
    #[arg(long, value_name = "K", default_value_t = 1)]
    first_seed: u64,
    /// Number of seeds.
    #[arg(long, value_name = "N", default_value_t = 100)]
    seeds: u64,
    /// Runs at a time.
    #[arg(long, value_name = "J", default_value_t = 1)]
    jobs: usize,
    /// The protocol, relative to the root of the repository.
    #[arg(long, value_name = "FILE", default_value = "config/protocols/smoke.toml")]
    protocol: String,
    /// Draw also what else is on the bench (noise, quality, coupling, capacitance, probe radius, drift)
    /// and the windows of the protocol. Such a run may end with a fault.
    #[arg(long)]
    vary: bool,
    /// Draw also a fault of the simulator's menu, an abort or a stop, at one of the steps.
    #[arg(long)]
    trouble: bool,
}

impl Arguments {
    /// Whether a run may end with a fault or be aborted.
    const fn may_fault(&self) -> bool {
        self.vary || self.trouble
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let steps = Steps::collect();
    let tally = Mutex::new(Tally::default());
    let next = AtomicU64::new(arguments.first_seed);
    let end = arguments.first_seed.saturating_add(arguments.seeds);
    thread::scope(|scope| {
        for _ in 0..arguments.jobs.max(1) {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= end {
                        break;
                    }
                    let outcome = run::play(Case::draw(
                        seed,
                        &arguments.protocol,
                        arguments.vary,
                        arguments.trouble,
                    ));
                    if let Some(why) = outcome.failure(arguments.may_fault()) {
                        println!("seed {seed}: {why}\n  {}", replay(seed, &arguments));
                    }
                    if let Ok(mut tally) = tally.lock() {
                        tally.count(&outcome, arguments.may_fault());
                    }
                }
            });
        }
    });
    let Ok(tally) = tally.into_inner() else { return ExitCode::FAILURE };
    tally.print_reasons();
    println!("{tally}; {steps}");
    // A run without an end is still at it on a thread of its own.
    if tally.is_clean() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The command that runs one seed again.
fn replay(seed: u64, arguments: &Arguments) -> String {
    let vary = if arguments.vary { " --vary" } else { "" };
    let trouble = if arguments.trouble { " --trouble" } else { "" };
    let protocol = &arguments.protocol;
    format!(
        "cargo run -p rig-tests --release --bin campaign -- --first-seed {seed} --seeds 1 \
         --protocol {protocol}{vary}{trouble}"
    )
}
