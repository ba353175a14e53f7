//! A campaign from a work queue of NATS `JetStream`, for workers on many computers.

mod chunk;
mod error;
mod gather;
mod server;
#[cfg(test)]
mod tests;
mod work;

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use async_nats::ServerAddr;
use chunk::{CHUNKS_MAX, Chunk, Player, cut};
use clap::Args;
pub(crate) use error::QueueError;
use rigd::program;
use server::{Filled, Queue, Redelivery};
use work::{Next, Taken};

use crate::{
    Arguments,
    campaign::{Campaign, Counts},
    ledger::{self, Ledger, LedgerError, Piece},
    write_page,
};

/// A queue, and what is done with it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "From a queue of NATS JetStream")]
pub(crate) struct QueueArguments {
    /// The server: `nats://HOST[:PORT]`, or `tls://HOST[:PORT]`.
    #[arg(
        long, value_name = "URL", requires = "deed", conflicts_with_all = ["engine", "protocol", "vary", "merge"]
    )]
    queue: Option<ServerAddr>,
    /// Put the seeds into the queue, in chunks. What is there already or was played is not added twice.
    #[arg(long, group = "deed", requires = "queue")]
    fill: bool,
    /// Play chunks of the queue until none is left.
    #[arg(
        long, group = "deed", requires = "queue",
        conflicts_with_all = ["first_seed", "seeds", "page", "until_failed"]
    )]
    worker: bool,
    /// Merge what the workers have played of the seeds into the ledger of the page, when all of it is there.
    #[arg(long, group = "deed", requires_all = ["queue", "page"])]
    gather: bool,
    /// Directory with `ca.pem`, the certificate of the authority of the server, and, if the server asks for one,
    /// `worker.pem` and `worker.key`.
    #[arg(long, value_name = "DIR", requires = "queue")]
    queue_files: Option<PathBuf>,
    /// Seeds of a chunk. A worker that ends in the middle has played them for nothing.
    #[arg(long, value_name = "N", requires = "fill", conflicts_with_all = ["worker", "gather"], default_value_t = 5000, value_parser = clap::value_parser!(u64).range(1..))]
    chunk: u64,
    /// A chunk goes to another worker if its own has said nothing for this time.
    #[arg(long, value_name = "S", requires = "fill", conflicts_with_all = ["worker", "gather"], default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..))]
    silent_s: u64,
    /// Workers that get a chunk, one after the other, before it is given up.
    #[arg(long, value_name = "N", requires = "fill", conflicts_with_all = ["worker", "gather"], default_value_t = 3, value_parser = clap::value_parser!(i64).range(1..))]
    deliveries: i64,
    /// Longest time that a worker waits while others have the last chunks, and that pieces are waited for.
    #[arg(
        long,
        value_name = "S",
        requires = "deed",
        conflicts_with = "fill",
        default_value_t = 3600
    )]
    within_s: u64,
}

/// Does what is asked for with the queue. `play` plays the seeds of the arguments.
///
/// # Errors
/// [`QueueError`].
pub(crate) fn run(
    server: &ServerAddr,
    arguments: &Arguments,
    play: impl Fn(&Arguments, &Campaign) -> Counts,
) -> Result<(), QueueError> {
    let asked = &arguments.queue;
    let player =
        Player { menu: ledger::menu(), program: program::digest().map_err(LedgerError::from)? };
    let queue = Queue::connect(server, asked.queue_files.as_deref(), player.clone())?;
    let within = Duration::from_secs(asked.within_s);
    if asked.fill {
        return fill(&queue, arguments);
    }
    if let (true, Some(page)) = (asked.gather, &arguments.page) {
        return gather(&queue, arguments, page, within);
    }
    let campaign = Campaign::default();
    work(&queue, within, |chunk| {
        let Chunk { first_seed, seeds } = chunk;
        let begun = Instant::now();
        let counts = play(&Arguments { first_seed, seeds, ..arguments.clone() }, &campaign);
        let (seconds, jobs) = (begun.elapsed().as_secs_f64(), arguments.jobs);
        let (software, program) = (rigd::rig::SOFTWARE.to_owned(), player.program.clone());
        Piece { first_seed, seeds, jobs, seconds, software, program, counts }
    })
}

impl QueueArguments {
    /// The server, if a queue is asked for.
    pub(crate) const fn server(&self) -> Option<&ServerAddr> {
        self.queue.as_ref()
    }
}

fn fill(queue: &Queue, arguments: &Arguments) -> Result<(), QueueError> {
    let QueueArguments { chunk, silent_s, deliveries, .. } = arguments.queue;
    let seeds = arguments.range();
    let chunks = arguments.seeds.div_ceil(chunk);
    if chunks > CHUNKS_MAX {
        return Err(QueueError::Many { seeds, chunks, most: CHUNKS_MAX });
    }
    let cut: Vec<_> = cut(seeds, chunk).collect();
    let redelivery = Redelivery { after: Duration::from_secs(silent_s), deliveries };
    let Filled { added, queued, played } = queue.fill(&cut, redelivery)?;
    println!("{chunks} chunks: {added} added, {queued} were in the queue, {played} were played");
    Ok(())
}

/// Plays chunks until none is left.
fn work(queue: &Queue, within: Duration, play: impl Fn(Chunk) -> Piece) -> Result<(), QueueError> {
    let mut count = 0;
    loop {
        let taken = match queue.take(within)? {
            Next::Taken(taken) => taken,
            Next::Empty => {
                println!("{count} chunks played; none is left");
                return Ok(());
            }
            Next::WithOthers(others) => {
                println!("{count} chunks played; other workers have {others}");
                return Ok(());
            }
        };
        let Taken { chunk, delivery, deliveries, .. } = *taken;
        let seeds = chunk.range();
        println!(
            "seeds {} to {}, worker {delivery} of at most {deliveries}",
            seeds.start,
            seeds.end.saturating_sub(1)
        );
        let piece = play(chunk);
        queue.finish(&taken, &piece)?;
        println!("  {}", piece.counts);
        count += 1;
    }
}

/// Merges the pieces into the ledger of the page.
fn gather(
    queue: &Queue,
    arguments: &Arguments,
    page: &Path,
    within: Duration,
) -> Result<(), QueueError> {
    // A ledger that cannot take them is noticed before they are waited for.
    let mut all = Ledger::read(page)?;
    all.admits(page, &arguments.range())?;
    let pieces = queue.gather(&arguments.range(), within)?;
    println!("{} pieces", pieces.len());
    all.merge(page, Ledger { pieces, ..Ledger::new(ledger::menu()) })?;
    all.write(page)?;
    println!("{}", all.counts());
    Ok(write_page(page, &all)?)
}
