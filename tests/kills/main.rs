//! Kills of the daemon at drawn moments of a run, by the thousand, and the resumed run beside one that was
//! not killed.
//!
//! `cargo run -p rig-tests --release --bin kills -- --kills 3000 --jobs 2` kills the daemon up to eight
//! times in a run on a simulated bench in virtual time, with its journal in memory. The bench goes on
//! while nobody drives it. The run must end with the same touches as the whole one: none twice, none
//! missing, none refused, each shift within 6 standard deviations; the probe must never turn or press
//! too deep in contact, and must be clear at the end; the checker must find nothing. It prints each run
//! that fails with its number. The exit code is 0 only if none does.

#![expect(clippy::print_stdout, reason = "what it prints is what it is for")]

mod life;

use std::{
    process::ExitCode,
    sync::atomic::{AtomicBool, AtomicU64, Ordering},
    thread,
    time::Instant,
};

use clap::Parser;

use life::{Bench, Counts};

/// Kills the daemon at drawn moments and compares the resumed runs with a whole one.
#[derive(Debug, Clone, Parser)]
struct Arguments {
    /// Number of kills, at least.
    #[arg(long, default_value_t = 1000)]
    kills: u64,
    /// The number of the first run, which decides its kills.
    #[arg(long, default_value_t = 1)]
    first_run: u64,
    /// Runs at a time.
    #[arg(long, default_value_t = 1)]
    jobs: usize,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let bench = Bench::new();
    let whole = bench.play(0, 0);
    if let Err(error) = &whole {
        println!("the run without a kill: {error}");
        return ExitCode::FAILURE;
    }
    let Ok(whole) = whole else { return ExitCode::FAILURE };
    let (next, kills, failed) =
        (AtomicU64::new(arguments.first_run), AtomicU64::new(0), AtomicBool::new(false));
    let began = Instant::now();
    let work = || {
        let mut counts = Counts::default();
        while kills.load(Ordering::Relaxed) < arguments.kills {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let judged = bench.play(number, whole.events).and_then(|played| {
                kills.fetch_add(played.counts.kills, Ordering::Relaxed);
                counts.add(&played.counts);
                played.compare(&whole)
            });
            if let Err(error) = judged {
                println!("run {number}: {error}; again with --first-run {number} --kills 1");
                failed.store(true, Ordering::Relaxed);
                kills.fetch_add(1, Ordering::Relaxed);
            }
        }
        counts
    };
    let mut counts = Counts::default();
    thread::scope(|scope| {
        let workers: Vec<_> = (0..arguments.jobs.max(1)).map(|_| scope.spawn(work)).collect();
        for worker in workers {
            match worker.join() {
                Ok(some) => counts.add(&some),
                Err(_) => failed.store(true, Ordering::Relaxed),
            }
        }
    });
    let Counts { runs, kills, in_contact, in_resumed, touches } = counts;
    println!(
        "{runs} runs, {kills} kills: {in_contact} with the probe in contact, {in_resumed} after a \
         resumption; {touches} touches compared, in {:.0} s",
        began.elapsed().as_secs_f64()
    );
    // A campaign that never killed in contact would show nothing.
    let is_telling = in_contact > 0 && in_resumed > 0;
    if failed.into_inner() || !is_telling { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
