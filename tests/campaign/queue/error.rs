//! Why a queue is of no use.

use std::{io, ops::Range, time::Duration};

use super::chunk::Player;
use crate::ledger::LedgerError;

/// Why a queue is of no use.
#[derive(Debug, thiserror::Error)]
pub(crate) enum QueueError {
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    #[error("seeds {} to {} are {chunks} chunks, and {most} are allowed: take a larger --chunk", seeds.start, seeds.end - 1)]
    Many { seeds: Range<u64>, chunks: u64, most: u64 },
    #[error("runtime")]
    Runtime(#[source] io::Error),
    /// The texts of the library have those of the errors behind them.
    #[error("the NATS server {address} cannot be reached, or refuses: {cause}")]
    Connect { address: String, cause: async_nats::ConnectError },
    #[error("the NATS server {address} has not answered within {} s", within.as_secs())]
    Silent { address: String, within: Duration },
    #[error(
        "the NATS server {address} has no JetStream: start it with -js, or with jetstream {{ store_dir: … }} in its configuration"
    )]
    NoJetStream { address: String },
    #[error("the NATS server {address}: {what}: {cause}")]
    Server { address: String, what: &'static str, cause: async_nats::Error },
    #[error(
        "the queue at {address} was not filled for the program {} with the menu {}{}", player.program, player.menu, of_others(others)
    )]
    NotFilled { address: String, player: Player, others: Vec<String> },
    #[error(
        "the chunk of seeds {} to {} is in part that of seeds {} to {}, which is there already: fill with the first seed and the \
         chunks of before, or with other seeds", asked.start, asked.end - 1, known.start, known.end - 1
    )]
    Overlap { asked: Range<u64>, known: Range<u64> },
    #[error(
        "the queue at {address} was filled by another program at the same time, {attempts} times: --fill again when that one has ended"
    )]
    Contended { address: String, attempts: usize },
    #[error(
        "seeds {} to {} begin or end within the chunk of seeds {} to {}: --gather the seeds with which the queue was filled, or others \
         that begin and end with a chunk", asked.start, asked.end - 1, chunk.start, chunk.end - 1
    )]
    Cut { asked: Range<u64>, chunk: Range<u64> },
    #[error("the piece of seeds {} to {} in the queue cannot be read", seeds.start, seeds.end - 1)]
    Piece { seeds: Range<u64>, source: serde_json::Error },
    #[error("the piece of seeds {} to {} in the queue is one of others, of the program {program}", seeds.start, seeds.end - 1)]
    Foreign { seeds: Range<u64>, program: String },
    #[error(
        "seeds {} were given up after {deliveries} workers each: none of them has finished. Play them alone to see why, with \
         --first-seed and --seeds, and --fill the queue again",
        list(seeds)
    )]
    GivenUp { seeds: Vec<Range<u64>>, deliveries: i64 },
    #[error("seeds {} are not in the queue, and have no piece: --fill it again", list(seeds))]
    Lost { seeds: Vec<Range<u64>> },
    #[error(
        "seeds {} have no piece after {} s; {waiting} chunks wait for a worker, and {with_workers} were taken by one: \
         start workers, or wait longer with --within-s", list(seeds), within.as_secs()
    )]
    Late { seeds: Vec<Range<u64>>, within: Duration, waiting: u64, with_workers: usize },
}

/// Largest number of ranges of seeds that are named.
const RANGES_NAMED: usize = 20;

fn list(ranges: &[Range<u64>]) -> String {
    let named = ranges.iter().take(RANGES_NAMED);
    let named: Vec<_> =
        named.map(|seeds| format!("{} to {}", seeds.start, seeds.end - 1)).collect();
    let more = ranges.len().saturating_sub(RANGES_NAMED);
    let more = if more > 0 { format!(" and {more} ranges more") } else { String::new() };
    named.join(", ") + &more
}

fn of_others(others: &[String]) -> String {
    if others.is_empty() {
        return ": --fill it".to_owned();
    }
    format!(
        ": it has chunks for {} (MENU-PROGRAM), and all computers need the same file",
        others.join(", ")
    )
}
