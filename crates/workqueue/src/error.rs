//! Why a queue is of no use.

use std::{io, time::Duration};

use crate::chunk::{Numbers, Work};

/// Why a queue is of no use.
#[derive(Debug, thiserror::Error)]
pub enum QueueError {
    /// The threads of the connection cannot be started.
    #[error("runtime")]
    Runtime(#[source] io::Error),
    /// No connection.
    #[error("the NATS server {address} cannot be reached, or refuses: {cause}")]
    Connect {
        /// Host and port.
        address: String,
        /// The error of the library, whose text has those behind it.
        cause: async_nats::ConnectError,
    },
    /// No answer in time.
    #[error("the NATS server {address} has not answered within {} s", within.as_secs())]
    Silent {
        /// Host and port.
        address: String,
        /// The time limit.
        within: Duration,
    },
    /// The account has no `JetStream`.
    #[error(
        "the NATS server {address} has no JetStream: start it with -js, or with jetstream {{ store_dir: … }} in its configuration"
    )]
    NoJetStream {
        /// Host and port.
        address: String,
    },
    /// The server refuses, or stays away.
    #[error("the NATS server {address}: {what}: {cause}")]
    Server {
        /// Host and port.
        address: String,
        /// What was attempted.
        what: &'static str,
        /// The error of the library, whose text has those behind it.
        cause: async_nats::Error,
    },
    /// There are no chunks of this work and this program.
    #[error("the queue at {address} was not filled for {work}{}", of_others(others))]
    NotFilled {
        /// Host and port.
        address: String,
        /// The work.
        work: Box<Work>,
        /// The works for which there are chunks.
        others: Vec<String>,
    },
    /// A chunk would be in part one that is there.
    #[error(
        "the chunk of {asked} is in part that of {known}, which is there already: fill with the first {} and the chunks of \
         before, or with other {0}s", asked.noun
    )]
    Overlap {
        /// What was asked for.
        asked: Numbers,
        /// The chunk that is there.
        known: Numbers,
    },
    /// The queue has other limits, and chunks.
    #[error(
        "the queue at {address} has chunks that go to another worker after {} s, at most {} times, and workers rely on it; asked for \
         were {} s and {} times: --fill without --silent-s and --deliveries, or when all chunks are computed or given up",
        known.0.as_secs_f64(), known.1, wanted.0.as_secs_f64(), wanted.1
    )]
    Lease {
        /// Host and port.
        address: String,
        /// Time and number of workers of the queue.
        known: (Duration, i64),
        /// Those that were asked for.
        wanted: (Duration, i64),
    },
    /// Others fill the queue all the time.
    #[error(
        "the queue at {address} was filled by another program at the same time, {attempts} times: --fill again when that one has ended"
    )]
    Contended {
        /// Host and port.
        address: String,
        /// How often it was attempted.
        attempts: usize,
    },
    /// Numbers begin or end within a chunk.
    #[error(
        "the chunk of {chunk} is in part outside of {asked}: --gather the {}s with which the queue was filled, or others that begin \
         and end with a chunk", asked.noun
    )]
    Cut {
        /// What was asked for.
        asked: Numbers,
        /// The chunk.
        chunk: Numbers,
    },
    /// A piece does not fit into a message.
    #[error(
        "the piece of {numbers} has {bytes} bytes, and the NATS server {address} takes messages of at most {most} bytes: --fill with \
         smaller chunks, or let the server take more, by max_payload in its configuration"
    )]
    TooLarge {
        /// The numbers.
        numbers: Numbers,
        /// Size of the piece.
        bytes: usize,
        /// Host and port.
        address: String,
        /// Largest size of a message.
        most: usize,
    },
    /// What is stored is no piece of this kind, or cannot be stored.
    #[error("the piece of {numbers} in the queue cannot be read")]
    Piece {
        /// The numbers.
        numbers: Numbers,
        /// The error of the format.
        source: serde_json::Error,
    },
    /// Chunks were given up.
    #[error(
        "the server has given up {numbers} after {deliveries} workers each, of which none has finished: {alone} to see why, and \
         --fill the queue again"
    )]
    GivenUp {
        /// The numbers.
        numbers: Numbers,
        /// How many workers have had each.
        deliveries: i64,
        /// How a chunk is computed without a queue.
        alone: &'static str,
    },
    /// Numbers are nowhere in the queue.
    #[error("the queue has neither a chunk nor a piece of {numbers}: --fill it again")]
    Lost {
        /// The numbers.
        numbers: Numbers,
    },
    /// Pieces have not come in time.
    #[error(
        "there is no piece of {numbers} after {} s; {waiting} chunks wait for a worker, and {with_workers} were taken by one: \
         start workers, or wait longer with --within-s", within.as_secs()
    )]
    Late {
        /// The numbers.
        numbers: Numbers,
        /// The time limit.
        within: Duration,
        /// Chunks that wait for a worker.
        waiting: u64,
        /// Chunks that a worker has.
        with_workers: usize,
    },
}

fn of_others(others: &[String]) -> String {
    if others.is_empty() {
        return ": --fill it".to_owned();
    }
    format!(
        ": it has chunks for {}; all computers need the same file of the program, and the arguments of --fill",
        others.join("; for ")
    )
}
