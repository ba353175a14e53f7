//! A run with the touches that were measured again or left out afterwards.

use super::{Reader, parsed};
use crate::{Run, RunId, RunKind, StoreError, StoredRecord};

impl Reader {
    /// The records of a run, and behind them those of its ended amendments, in the order in which
    /// they were made. All are checked against their digests.
    ///
    /// # Errors
    /// As for [`Reader::records`].
    pub fn amended(&self, id: RunId) -> Result<Vec<StoredRecord>, StoreError> {
        self.amend(id, self.records(id)?)
    }

    /// Appends the records of the ended amendments of a run to its own.
    ///
    /// # Errors
    /// As for [`Reader::records`].
    pub fn amend(
        &self,
        id: RunId,
        mut records: Vec<StoredRecord>,
    ) -> Result<Vec<StoredRecord>, StoreError> {
        for amendment in self.amendments(id)? {
            records.extend(self.records(amendment)?);
        }
        Ok(records)
    }

    /// This run or, for an amendment, the one that it amends.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, or [`StoreError::NoSuchRun`].
    pub fn amended_run(&self, run: Run) -> Result<Run, StoreError> {
        if run.kind != RunKind::Amendment {
            return Ok(run);
        }
        self.run(run.name.parse()?)
    }

    /// The ended amendments of a run, oldest first. The name of an amendment is the id of its run.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn amendments(&self, id: RunId) -> Result<Vec<RunId>, StoreError> {
        let mut statement = self.connection.prepare_cached(
            "SELECT id FROM runs
             WHERE kind = 'amendment' AND name = ?1 AND status != 'running' ORDER BY key",
        )?;
        let ids = statement.query_map([id.to_string()], |row| parsed(row, 0, |id| id.parse().ok()));
        Ok(ids?.collect::<Result<_, _>>()?)
    }
}
