//! The side of a worker.

use std::{
    io::{self, Write},
    time::{Duration, Instant},
};

use async_nats::jetstream::{
    AckKind, Message,
    consumer::{Config, PullConsumer},
};
use futures_util::StreamExt;
use serde::Serialize;
use tokio::{task::JoinHandle, time::sleep};

use crate::{
    chunk::{Chunk, Kind},
    error::QueueError,
    server::{Queue, is_empty},
};

/// Longest time that a worker asks for a chunk before it looks whether there will be one.
const PULL_TIME: Duration = Duration::from_secs(1);
/// A chunk is said to be in progress this often in the time after which it would go to another worker.
const SIGNS: u32 = 3;
/// Longest time that a worker says so: a chunk that takes longer is given to others too.
const HOLD_MAX: Duration = Duration::from_secs(24 * 3600);

/// What a worker gets.
#[derive(Debug)]
pub(crate) enum Next {
    Taken(Box<Taken>),
    /// No chunk is left, and none is with another worker.
    Empty,
    /// Other workers still have this number of chunks, and the time is over.
    WithOthers(usize),
}

/// A chunk in the hands of this worker. If it is dropped before it is finished, it goes to another one.
#[derive(Debug)]
pub(crate) struct Taken {
    pub(crate) chunk: Chunk,
    /// Which delivery of the chunk this is, from 1.
    pub(crate) delivery: i64,
    /// The number of deliveries after which it is given up.
    pub(crate) deliveries: i64,
    message: Message,
    signs: JoinHandle<()>,
}

impl Queue {
    /// Computes chunks until none is left, and says so. `compute` also returns what is said of its piece.
    ///
    /// # Errors
    /// [`QueueError`], and those of `compute` and `out`.
    pub fn work<P: Serialize, E: From<QueueError> + From<io::Error>>(
        &self,
        within: Duration,
        out: &mut impl Write,
        mut compute: impl FnMut(Chunk) -> Result<(P, String), E>,
    ) -> Result<(), E> {
        let mut count = 0;
        loop {
            let taken = match self.take(within)? {
                Next::Taken(taken) => taken,
                Next::Empty => return Ok(writeln!(out, "{count} chunks computed; none is left")?),
                Next::WithOthers(others) => {
                    let others = format_args!("other workers have {others}");
                    return Ok(writeln!(out, "{count} chunks computed; {others}")?);
                }
            };
            let Taken { chunk, delivery, deliveries, .. } = *taken;
            let numbers = self.work.numbers(&chunk.range());
            writeln!(out, "{numbers}, worker {delivery} of at most {deliveries}")?;
            let (piece, summary) = compute(chunk)?;
            self.finish(&taken, &piece)?;
            writeln!(out, "  {summary}")?;
            count += 1;
        }
    }

    /// The next chunk, within a time. A server that is started anew meanwhile is waited for.
    ///
    /// # Errors
    /// [`QueueError`].
    pub(crate) fn take(&self, within: Duration) -> Result<Next, QueueError> {
        let until = Instant::now() + within;
        self.runtime.block_on(async {
            let consumer = self.workers().await?;
            loop {
                let info = self.patiently("the workers", async || Ok(consumer.get_info().await?));
                let info = info.await?;
                if is_empty(&info) {
                    return Ok(Next::Empty);
                }
                let left = until.saturating_duration_since(Instant::now());
                let ask = "a chunk cannot be asked for";
                let message = self.patiently(ask, || pull_one(&consumer, left.min(PULL_TIME)));
                if let Some(message) = message.await? {
                    return self.taken(message, &info.config).await;
                }
                if left.is_zero() {
                    return Ok(Next::WithOthers(info.num_ack_pending));
                }
            }
        })
    }

    /// Begins to say that a chunk is in progress.
    async fn taken(&self, message: Message, config: &Config) -> Result<Next, QueueError> {
        let delivery = message.info().map(|info| info.delivered);
        let delivery = delivery.map_err(|error| self.error("what came is no chunk", error))?;
        let Some(chunk) = self.work.chunk(Kind::Chunk, &message.subject) else {
            let error = format!("the subject {}", message.subject).into();
            _ = message.ack_with(AckKind::Term).await;
            return Err(self.error("what came is no chunk, and was removed", error));
        };
        let (every, sign) = (config.ack_wait / SIGNS, message.clone());
        let signs = self.runtime.spawn(async move {
            let end = Instant::now() + HOLD_MAX;
            while Instant::now() < end {
                sleep(every).await;
                // One that is lost is followed by others.
                _ = sign.ack_with(AckKind::Progress).await;
            }
        });
        Ok(Next::Taken(Box::new(Taken {
            chunk,
            delivery,
            deliveries: config.max_deliver,
            message,
            signs,
        })))
    }

    /// Stores the piece of a chunk, and then acknowledges the chunk.
    ///
    /// # Errors
    /// [`QueueError`]. The chunk goes to another worker.
    pub(crate) fn finish<P: Serialize>(&self, taken: &Taken, piece: &P) -> Result<(), QueueError> {
        let subject = self.work.subject(Kind::Piece, taken.chunk);
        let numbers = self.work.numbers(&taken.chunk.range());
        let text = match serde_json::to_vec(piece) {
            Ok(text) => text,
            Err(source) => return Err(QueueError::Piece { numbers, source }),
        };
        // It would not be taken later either.
        let (bytes, most) = (text.len(), self.context.client().server_info().max_payload);
        if bytes > most {
            let address = self.address.clone();
            return Err(QueueError::TooLarge { numbers, bytes, address, most });
        }
        self.runtime.block_on(async {
            let stored = self.patiently("a piece cannot be stored", async || {
                let sent = self.context.publish(subject.clone(), text.clone().into());
                Ok(sent.await?.await?)
            });
            stored.await?;
            let acknowledged =
                self.patiently("a chunk cannot be acknowledged", || taken.message.double_ack());
            acknowledged.await
        })
    }
}

impl Drop for Taken {
    fn drop(&mut self) {
        self.signs.abort();
    }
}

/// Asks for one chunk.
async fn pull_one(
    consumer: &PullConsumer,
    within: Duration,
) -> Result<Option<Message>, async_nats::Error> {
    // The server takes a time of zero for one without end.
    let within = within.max(Duration::from_millis(10));
    let mut batch = consumer.batch().max_messages(1).expires(within).messages().await?;
    batch.next().await.transpose()
}
