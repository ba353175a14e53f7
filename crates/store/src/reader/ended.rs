//! The runs that have ended lately.

use super::{Reader, parsed};
use crate::{RunId, StoreError};

impl Reader {
    /// The runs and amendments that have ended behind an event, in the order of their endings, each with the
    /// event of its ending. A run that was resumed and ended again is there once for each ending.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn ended_after(&self, event: u64) -> Result<Vec<(u64, RunId)>, StoreError> {
        let mut statement = self.connection.prepare_cached(
            "SELECT records.id, runs.id FROM records JOIN runs ON runs.key = records.run
             WHERE records.id > ?1 AND records.kind = 'run_finished' AND runs.kind IN ('run', 'amendment')
             ORDER BY records.id",
        )?;
        // No event has a greater id than SQLite can count.
        let event = i64::try_from(event).unwrap_or(i64::MAX);
        let ended = statement.query_map([event], |row| {
            let run = parsed(row, 1, |id| id.parse().ok())?;
            Ok((row.get::<_, i64>(0)?.cast_unsigned(), run))
        })?;
        Ok(ended.collect::<Result<_, _>>()?)
    }
}
