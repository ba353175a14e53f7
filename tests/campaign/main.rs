//! Campaigns of many runs of the whole daemon in virtual time.
//!
//! `cargo run -p rig-tests --release --bin campaign -- --first-seed K --seeds N --jobs 2` draws for each
//! seed a bench with a protocol of a touch or two, and one to four faults of the menu: devices and
//! wires, the disk, a kill of the daemon, persons and clients. It judges safety by the truth of the
//! simulated bench, journals by the checker, and results by the undisturbed run of the same bench; at
//! last the faults end and the run must be completed. With `--protocol` or `--vary` it plays whole
//! protocols without faults. With `--engine` it plays the engine alone in an ideal world.
//!
//! With `--queue`, many computers play the parts of a campaign, which they get from a NATS server.
//!
//! It prints each seed that fails with the command that plays it again. The last line has the counts.
//! The exit code is 0 only if nothing failed.

#![expect(clippy::print_stdout, reason = "what it prints is what it is for")]

mod bench;
mod campaign;
mod case;
mod counts;
#[path = "../../crates/engine/tests/histories/drive.rs"]
mod drive;
mod engine;
mod faults;
mod judge;
#[cfg(test)]
mod known;
mod ledger;
mod life;
mod page;
mod queue;
mod run;
#[expect(dead_code, reason = "it is a part of the tests of the engine")]
#[path = "../../crates/engine/tests/histories/streams.rs"]
mod streams;
mod tally;
#[expect(clippy::unwrap_used, dead_code, reason = "it is a part of the tests of the engine")]
#[path = "../../crates/engine/tests/histories/world.rs"]
mod world;

use std::{
    fs,
    ops::Range,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread,
    time::Instant,
};

use campaign::{Campaign, Counts};
use case::Case;
use clap::Parser;
use ledger::{Ledger, LedgerError, Piece};
use mimalloc::MiMalloc;
use page::Page;
use rig_workqueue::QueueArguments;
use rigd::program;
use tally::{Steps, Tally};

/// The allocator of the system plays a tenth fewer runs.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Largest number of empty cells that are named.
const CELLS_NAMED: usize = 40;

/// Plays runs on simulated benches with one seed after another.
#[derive(Debug, Clone, Parser)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of the command line")]
struct Arguments {
    /// The first seed.
    #[arg(long, value_name = "K", default_value_t = 1, conflicts_with = "worker")]
    first_seed: u64,
    /// Number of seeds.
    #[arg(long, value_name = "N", default_value_t = 100, conflicts_with = "worker")]
    seeds: u64,
    /// Runs at a time.
    #[arg(long, value_name = "J", default_value_t = 1)]
    jobs: usize,
    /// Play this whole protocol without faults. The path is relative to the root of the repository.
    #[arg(long, value_name = "FILE", conflicts_with = "queue")]
    protocol: Option<String>,
    /// Draw also what else is on the bench (noise, quality, coupling, capacitance, probe radius, drift)
    /// and the windows of the protocol, which is smoke.toml if none is named. Such a run may end with
    /// a fault.
    #[arg(long, conflicts_with = "queue")]
    vary: bool,
    /// Print the records of each faulted run, shortened.
    #[arg(long)]
    records: bool,
    /// Add the faulted runs to the ledger beside this file, and write it as the page of the ledger.
    #[arg(long, value_name = "FILE", conflicts_with = "worker", required_if_eq("gather", "true"))]
    page: Option<PathBuf>,
    /// If the ledger is of another menu, keep its sums, and begin it anew.
    #[arg(long, requires = "page", conflicts_with_all = ["merge", "queue"])]
    begin_anew: bool,
    /// Play nothing, and put the pieces of these ledgers into that of the page. In any order, and each as often as you
    /// like: the page is the same.
    #[arg(long, value_name = "LEDGER", num_args = 1.., requires = "page", conflicts_with = "queue")]
    merge: Vec<PathBuf>,
    /// Print how often each fault began in each phase.
    #[arg(long)]
    table: bool,
    /// End at the first seed that fails.
    #[arg(long, conflicts_with_all = ["page", "worker"])]
    until_failed: bool,
    /// Play the engine alone, with two troubles in each run.
    #[arg(long, conflicts_with = "queue")]
    engine: bool,
    #[command(flatten)]
    queue: QueueArguments,
    /// Seeds of a chunk. A worker that ends in the middle has played them for nothing.
    #[arg(
        long,
        value_name = "N",
        help_heading = "From a queue of NATS JetStream",
        requires = "fill",
        conflicts_with_all = ["worker", "gather"],
        default_value_t = 5000,
        value_parser = clap::value_parser!(u64).range(1..)
    )]
    chunk: u64,
}

impl Arguments {
    /// The seeds.
    const fn range(&self) -> Range<u64> {
        self.first_seed..self.first_seed.saturating_add(self.seeds)
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if let Some(asked) = arguments.queue.asked() {
        return match queue::run(&asked, &arguments, play) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => failed(&error),
        };
    }
    if let (Some(page), [_, ..]) = (&arguments.page, &*arguments.merge) {
        return match merge(page, &arguments.merge) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => failed(&error),
        };
    }
    if arguments.engine {
        return alone(&arguments);
    }
    if arguments.protocol.is_some() || arguments.vary {
        whole(&arguments)
    } else {
        faulted(&arguments)
    }
}

/// Plays each seed on one of the jobs. `play` says whether all was well.
fn each_seed(arguments: &Arguments, play: impl Fn(u64) -> bool + Sync) {
    let Range { start, end } = arguments.range();
    let next = AtomicU64::new(start);
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| {
        for _ in 0..arguments.jobs.max(1) {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= end || is_over.load(Ordering::Relaxed) {
                        break;
                    }
                    if !play(seed) && arguments.until_failed {
                        is_over.store(true, Ordering::Relaxed);
                    }
                }
            });
        }
    });
}

/// Touches under faults.
fn faulted(arguments: &Arguments) -> ExitCode {
    // A ledger that cannot take the seeds is noticed before they are played.
    let ledger = arguments.page.as_deref().map(|page| {
        let ledger = Ledger::read(page)?;
        let ledger = if arguments.begin_anew { ledger.begun_anew() } else { ledger };
        ledger.admits(page, &arguments.range())?;
        Ok::<_, LedgerError>((page, ledger))
    });
    let ledger = match ledger.transpose() {
        Ok(ledger) => ledger,
        Err(error) => return failed(&error),
    };
    let begun = Instant::now();
    let counts = play(arguments, &Campaign::default());
    for (reason, count) in &counts.reasons {
        println!("{count:8} {reason}");
    }
    let empty = counts.table.empty();
    let named = if empty.len() <= CELLS_NAMED { &empty[..] } else { &[] };
    let colon = if named.is_empty() { "" } else { ": " };
    println!("{} of the table's cells are empty{colon}{}", empty.len(), named.join(", "));
    if arguments.table {
        print!("{}", counts.table);
    }
    let seconds = begun.elapsed().as_secs_f64();
    println!("{counts}; {:.1} runs a second", counts.runs as f64 / seconds);
    let is_sound = counts.failed == 0;
    if let Some((page, ledger)) = ledger
        && let Err(error) = gather(arguments, page, ledger, counts, seconds)
    {
        return failed(&error);
    }
    if is_sound { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Plays the seeds, and prints those that fail.
fn play(arguments: &Arguments, campaign: &Campaign) -> Counts {
    let counts = Mutex::new(Counts::default());
    each_seed(arguments, |seed| {
        let ended = campaign.play(seed, arguments.records);
        for record in ended.played.iter().flat_map(|played| &played.records) {
            println!("{record}");
        }
        if !ended.failures.is_empty() || arguments.seeds == 1 {
            println!("seed {seed}: {}", ended.story);
            for failure in &ended.failures {
                println!("  {failure}");
            }
            println!("  {}", replay(seed, ""));
        }
        counts.lock().unwrap_or_else(PoisonError::into_inner).add(seed, &ended);
        ended.failures.is_empty()
    });
    counts.into_inner().unwrap_or_else(PoisonError::into_inner)
}

fn failed(error: &(dyn std::error::Error + 'static)) -> ExitCode {
    println!("{}", rig_model::with_causes(error));
    ExitCode::FAILURE
}

/// Puts the pieces of other ledgers into that of a page.
fn merge(page: &Path, ledgers: &[PathBuf]) -> Result<(), LedgerError> {
    let mut ledger = Ledger::read(page)?;
    for path in ledgers {
        // Only the ledger of the page may be missing.
        fs::metadata(path).map_err(|source| LedgerError::File { path: path.clone(), source })?;
        ledger.merge(page, Ledger::read(path)?)?;
    }
    ledger.write(page)?;
    write_page(page, &ledger)
}

/// Adds the runs to the ledger, and writes it and its page.
fn gather(
    arguments: &Arguments,
    page: &Path,
    mut ledger: Ledger,
    counts: Counts,
    seconds: f64,
) -> Result<(), LedgerError> {
    let Arguments { first_seed, seeds, jobs, .. } = *arguments;
    if seeds > 0 {
        let (software, program) = (rigd::rig::SOFTWARE.to_owned(), program::digest()?);
        ledger.add(Piece { first_seed, seeds, jobs, seconds, software, program, counts });
    }
    if seeds > 0 || arguments.begin_anew {
        ledger.write(page)?;
    }
    write_page(page, &ledger)
}

fn write_page(page: &Path, ledger: &Ledger) -> Result<(), LedgerError> {
    fs::write(page, Page(ledger).to_string())
        .map_err(|source| LedgerError::File { path: page.to_owned(), source })
}

/// The engine alone.
fn alone(arguments: &Arguments) -> ExitCode {
    let begun = Instant::now();
    let (failed, operations) = (AtomicU64::new(0), AtomicU64::new(0));
    // A broken rule of the ideal world is a panic, which is printed with its seed.
    std::panic::set_hook(Box::new(|_| {}));
    each_seed(arguments, |seed| {
        let history = engine::play(seed);
        operations.fetch_add(history.operations as u64, Ordering::Relaxed);
        if let Some(failure) = &history.failure {
            failed.fetch_add(1, Ordering::Relaxed);
            println!("seed {seed}: {failure}\n  {}", replay(seed, " --engine"));
        }
        history.failure.is_none()
    });
    let (failed, operations) = (failed.into_inner(), operations.into_inner());
    let seconds = begun.elapsed().as_secs_f64();
    println!(
        "{} runs of the engine alone with {operations} operations, {failed} failed; {:.0} runs a second",
        arguments.seeds,
        arguments.seeds as f64 / seconds
    );
    if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Whole protocols without faults.
fn whole(arguments: &Arguments) -> ExitCode {
    let protocol = arguments.protocol.as_deref().unwrap_or("config/protocols/smoke.toml");
    let steps = Steps::collect();
    let tally = Mutex::new(Tally::default());
    each_seed(arguments, |seed| {
        let outcome = run::play(Case::draw(seed, protocol, arguments.vary));
        if let Some(why) = outcome.failure(arguments.vary) {
            let vary = if arguments.vary { " --vary" } else { "" };
            println!(
                "seed {seed}: {why}\n  {}",
                replay(seed, &format!(" --protocol {protocol}{vary}"))
            );
        }
        let mut tally = tally.lock().unwrap_or_else(PoisonError::into_inner);
        tally.count(&outcome, arguments.vary);
        outcome.failure(arguments.vary).is_none()
    });
    let tally = tally.into_inner().unwrap_or_else(PoisonError::into_inner);
    tally.print_reasons();
    println!("{tally}; {steps}");
    // A run without an end is still at it on a thread of its own.
    if tally.is_clean() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The command that plays one seed again.
fn replay(seed: u64, options: &str) -> String {
    format!(
        "cargo run -p rig-tests --release --bin campaign -- --first-seed {seed} --seeds 1{options}"
    )
}
