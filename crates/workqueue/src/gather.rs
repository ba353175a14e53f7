//! What is computed, back in one place.

use std::{
    ops::Range,
    time::{Duration, Instant},
};

use serde::de::DeserializeOwned;
use tokio::time::sleep;

use crate::{
    chunk::{Chunk, Kind, is_within, missing},
    error::QueueError,
    server::{Queue, is_empty},
};

/// Time between two looks at the pieces.
const LOOK_EVERY: Duration = Duration::from_millis(500);

impl Queue {
    /// The pieces of these numbers, which are waited for, with their chunks. A chunk that was computed twice has two.
    ///
    /// # Errors
    /// [`QueueError`] says which are missing.
    pub fn gather<P: DeserializeOwned>(
        &self,
        numbers: &Range<u64>,
        within: Duration,
    ) -> Result<Vec<(Chunk, P)>, QueueError> {
        let until = Instant::now() + within;
        let mut pieces = Vec::new();
        let mut seen = 0;
        self.runtime.block_on(async {
            let consumer = self.workers().await?;
            let [chunks, stored] = [self.open(Kind::Chunk).await?, self.open(Kind::Piece).await?];
            let waiting = self.messages(&chunks, Kind::Chunk, &mut 0).await?;
            self.check_whole(numbers, waiting.iter().map(|(chunk, _)| *chunk))?;
            loop {
                // Before the pieces: a chunk that is acknowledged by then has its piece there.
                let info = self.patiently("the workers", async || Ok(consumer.get_info().await?));
                let info = info.await?;
                for (chunk, message) in self.messages(&stored, Kind::Piece, &mut seen).await? {
                    pieces.push((chunk, self.piece(chunk, &message.payload)?));
                }
                self.check_whole(numbers, pieces.iter().map(|(chunk, _)| *chunk))?;
                let missing = missing(numbers.clone(), pieces.iter().map(|(chunk, _)| *chunk));
                if missing.is_empty() {
                    break;
                }
                if is_empty(&info) {
                    let left = self.messages(&chunks, Kind::Chunk, &mut 0).await?;
                    let left = left.into_iter().map(|(chunk, _)| chunk.range());
                    let is_missing =
                        |chunk: &Range<u64>| missing.iter().any(|range| is_within(chunk, range));
                    let given_up: Vec<_> = left.filter(is_missing).collect();
                    if given_up.is_empty() {
                        return Err(QueueError::Lost { numbers: self.work.all_numbers(missing) });
                    }
                    let (numbers, alone) = (self.work.all_numbers(given_up), self.work.alone);
                    let deliveries = info.config.max_deliver;
                    return Err(QueueError::GivenUp { numbers, deliveries, alone });
                }
                if Instant::now() >= until {
                    let numbers = self.work.all_numbers(missing);
                    let (waiting, with_workers) = (info.num_pending, info.num_ack_pending);
                    return Err(QueueError::Late { numbers, within, waiting, with_workers });
                }
                sleep(LOOK_EVERY.min(until.saturating_duration_since(Instant::now()))).await;
            }
            pieces.retain(|(chunk, _)| is_within(&chunk.range(), numbers));
            Ok(pieces)
        })
    }

    fn piece<P: DeserializeOwned>(&self, chunk: Chunk, text: &[u8]) -> Result<P, QueueError> {
        serde_json::from_slice(text).map_err(|source| {
            let numbers = self.work.numbers(&chunk.range());
            QueueError::Piece { numbers, source }
        })
    }

    /// Refuses numbers that begin or end within a chunk: a piece is merged as a whole or not at all.
    fn check_whole(
        &self,
        numbers: &Range<u64>,
        mut chunks: impl Iterator<Item = Chunk>,
    ) -> Result<(), QueueError> {
        let cut = chunks.find(|chunk| chunk.is_cut_by(numbers));
        cut.map_or(Ok(()), |chunk| {
            let [asked, chunk] = [numbers, &chunk.range()].map(|range| self.work.numbers(range));
            Err(QueueError::Cut { asked, chunk })
        })
    }
}
