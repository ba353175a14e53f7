//! Sealed runs, whole: what an object in an object store is made of.

use super::Reader;
use crate::{
    Digest, Run, RunId, SealedRun, StoreError, StoredRecord,
    journal::{ENTRY, entry_from, stretches},
};

impl Reader {
    /// A sealed run of any kind with all of its records. Their digests, the entry in the list of runs and the
    /// seal have been checked.
    ///
    /// # Errors
    /// [`StoreError::NotSealed`]; otherwise as for [`Reader::records`].
    pub fn sealed(&self, id: RunId) -> Result<(SealedRun, Vec<StoredRecord>), StoreError> {
        let run = self.run(id)?;
        if !run.is_sealed {
            let status = run.status.describe();
            return Err(StoreError::NotSealed { run: run.to_string(), status });
        }
        let records = self.records(id)?;
        Ok((self.under_seal(&run)?, records))
    }

    fn under_seal(&self, run: &Run) -> Result<SealedRun, StoreError> {
        let mut statement = self.connection.prepare_cached(&format!(
            "SELECT {ENTRY}, finished_at, status, key, seals.records, head
             FROM runs JOIN seals ON seals.run = key WHERE id = ?1"
        ))?;
        let (sealed, key) = statement.query_row([run.id.to_string()], |row| {
            let sealed = SealedRun {
                entry: entry_from(row)?,
                stretches: Vec::new(),
                finished_at: row.get(8)?,
                status: row.get(9)?,
                records: row.get::<_, i64>(11)?.cast_unsigned(),
                head: Digest::from_bytes(row.get(12)?),
            };
            Ok((sealed, row.get::<_, i64>(10)?))
        })?;
        Ok(SealedRun { stretches: stretches(&self.connection, key)?, ..sealed })
    }
}
