//! What is played, back in one place.

use std::{
    ops::Range,
    time::{Duration, Instant},
};

use async_nats::jetstream::message::StreamMessage;
use tokio::time::sleep;

use super::{
    chunk::{Chunk, Kind, is_within, missing},
    error::QueueError,
    server::{Queue, is_empty},
};
use crate::ledger::Piece;

/// Time between two looks at the pieces.
const LOOK_EVERY: Duration = Duration::from_millis(500);

impl Queue {
    /// The pieces of these seeds, which are waited for.
    ///
    /// # Errors
    /// [`QueueError`] says which are missing.
    pub(crate) fn gather(
        &self,
        seeds: &Range<u64>,
        within: Duration,
    ) -> Result<Vec<Piece>, QueueError> {
        let until = Instant::now() + within;
        let mut pieces = Vec::<(Chunk, Piece)>::new();
        let mut seen = 0;
        self.runtime.block_on(async {
            let consumer = self.workers().await?;
            let [chunks, stored] = [self.open(Kind::Chunk).await?, self.open(Kind::Piece).await?];
            let waiting = self.messages(&chunks, Kind::Chunk, &mut 0).await?;
            check_whole(seeds, waiting.iter().map(|(chunk, _)| *chunk))?;
            loop {
                // Before the pieces: a chunk that is acknowledged by then has its piece there.
                let info = self.patiently("the workers", async || Ok(consumer.get_info().await?));
                let info = info.await?;
                for (chunk, message) in self.messages(&stored, Kind::Piece, &mut seen).await? {
                    pieces.push((chunk, self.piece(chunk, &message)?));
                }
                check_whole(seeds, pieces.iter().map(|(chunk, _)| *chunk))?;
                let missing = missing(seeds.clone(), pieces.iter().map(|(chunk, _)| *chunk));
                if missing.is_empty() {
                    break;
                }
                if is_empty(&info) {
                    let left = self.messages(&chunks, Kind::Chunk, &mut 0).await?;
                    let left = left.into_iter().map(|(chunk, _)| chunk.range());
                    let is_missing =
                        |chunk: &Range<u64>| missing.iter().any(|seeds| is_within(chunk, seeds));
                    let given_up: Vec<_> = left.filter(is_missing).collect();
                    if given_up.is_empty() {
                        return Err(QueueError::Lost { seeds: missing });
                    }
                    let deliveries = info.config.max_deliver;
                    return Err(QueueError::GivenUp { seeds: given_up, deliveries });
                }
                if Instant::now() >= until {
                    let (waiting, with_workers) = (info.num_pending, info.num_ack_pending);
                    return Err(QueueError::Late { seeds: missing, within, waiting, with_workers });
                }
                sleep(LOOK_EVERY.min(until.saturating_duration_since(Instant::now()))).await;
            }
            let pieces = pieces.into_iter().map(|(_, piece)| piece);
            Ok(pieces.filter(|piece| is_within(&piece.range(), seeds)).collect())
        })
    }

    /// Reads a piece, and checks that it is what its subject says.
    fn piece(&self, chunk: Chunk, message: &StreamMessage) -> Result<Piece, QueueError> {
        let seeds = chunk.range();
        match serde_json::from_slice::<Piece>(&message.payload) {
            Ok(piece) if piece.range() == seeds && piece.program == self.player.program => {
                Ok(piece)
            }
            Ok(piece) => Err(QueueError::Foreign { seeds, program: piece.program }),
            Err(source) => Err(QueueError::Piece { seeds, source }),
        }
    }
}

/// Refuses seeds that begin or end within a chunk: a piece is merged as a whole or not at all.
fn check_whole(
    seeds: &Range<u64>,
    mut chunks: impl Iterator<Item = Chunk>,
) -> Result<(), QueueError> {
    let cut = chunks.find(|chunk| chunk.is_cut_by(seeds));
    cut.map_or(Ok(()), |chunk| Err(QueueError::Cut { asked: seeds.clone(), chunk: chunk.range() }))
}
