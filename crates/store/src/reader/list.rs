//! Checks of the list of runs: entries, stretches, seals, and the links between entries.

use rusqlite::OptionalExtension;

use super::{Reader, is_of_entry, run_from, walk::Followed};
use crate::{
    Digest, Flaw, Run, RunKind, RunStatus, StoreError,
    journal::{ENTRY, entry_from, link, stretches},
};

impl Reader {
    /// Faults of the entry of a run in the list of runs, of its stretches and of its seal.
    pub(super) fn flaw_of_entry(
        &self,
        run: &Run,
        followed: &Followed,
    ) -> Result<Option<Flaw>, StoreError> {
        let mut statement = self.connection.prepare_cached(&format!(
            "SELECT {ENTRY}, finished_at, status, key, digest FROM runs WHERE id = ?1"
        ))?;
        let row = statement.query_row([run.id.to_string()], |row| {
            let ended = (row.get::<_, Option<String>>(8)?, row.get::<_, String>(9)?);
            Ok((entry_from(row)?, ended, row.get::<_, i64>(10)?, row.get::<_, Vec<u8>>(11)?))
        });
        let Ok((entry, (finished_at, status), key, digest)) = row else {
            return Ok(Some(Flaw::ListDiffers));
        };
        let mut statement = self
            .connection
            .prepare_cached("SELECT digest FROM stretches WHERE run = ?1 ORDER BY epoch")?;
        let digests: Result<Vec<Vec<u8>>, _> =
            statement.query_map([key], |row| row.get(0))?.collect();
        let (Ok(stretches), Ok(digests)) = (stretches(&self.connection, key), digests) else {
            return Ok(Some(Flaw::ListDiffers));
        };
        let fits = stretches.iter().map(|stretch| stretch.digest(&entry.run).as_bytes().to_vec());
        let epochs = followed.epochs.iter().copied();
        let has_all = stretches.iter().map(|stretch| stretch.epoch).eq(epochs);
        if entry.digest().as_bytes() != &*digest || !fits.eq(digests) || !has_all {
            return Ok(Some(Flaw::ListDiffers));
        }
        let mut statement =
            self.connection.prepare_cached("SELECT seal FROM seals WHERE run = ?1")?;
        let found: Option<Vec<u8>> = statement.query_row([key], |row| row.get(0)).optional()?;
        let must_be_sealed = match run.status {
            RunStatus::Ended(ending) => {
                run.kind != RunKind::Run || ending.is_complete() || followed.is_given_up()
            }
            RunStatus::Running | RunStatus::Interrupted => false,
        };
        let is_right = match (found, finished_at) {
            (Some(found), Some(at)) => {
                let Followed { records, digest, .. } = *followed;
                rig_record::seal(&entry, &stretches, &at, &status, records, digest).as_bytes()
                    == &*found
            }
            (Some(_), None) => false,
            (None, _) => !must_be_sealed,
        };
        Ok((!is_right).then_some(Flaw::SealDiffers))
    }

    /// The entries of the list of runs that cannot be read, the oldest first: the id of each, which may be damaged itself, and what
    /// is wrong. [`Reader::runs`] leaves them out.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn damaged_entries(&self) -> Result<Vec<(String, Flaw)>, StoreError> {
        let mut statement = self.connection.prepare_cached(&self.list("ORDER BY key"))?;
        let mut rows = statement.query([])?;
        let mut damaged = Vec::new();
        while let Some(row) = rows.next()? {
            match run_from(row) {
                Err(error) if is_of_entry(&error) => {
                    let id = row.get_ref(0)?.as_bytes().unwrap_or_default();
                    let reason = unread(row.get(12)?, &error);
                    let id = String::from_utf8_lossy(id).into_owned();
                    damaged.push((id, Flaw::Unreadable { reason }));
                }
                read => _ = read?,
            }
        }
        Ok(damaged)
    }

    /// The first run whose entry is not linked to the one before it, as when an entry was removed or
    /// changed; `None` if the list is whole.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn broken_link(&self) -> Result<Option<String>, StoreError> {
        let mut statement =
            self.connection.prepare_cached("SELECT id, digest, link FROM runs ORDER BY key")?;
        let mut rows = statement.query([])?;
        let mut before = Digest::START;
        while let Some(row) = rows.next()? {
            let linked = link(before, Digest::from_bytes(row.get(1)?));
            if linked.as_bytes() != &row.get::<_, [u8; 32]>(2)? {
                return Ok(Some(row.get(0)?));
            }
            before = linked;
        }
        Ok(None)
    }
}

/// Why the entry with this key cannot be read.
pub(crate) fn unread(key: i64, error: &rusqlite::Error) -> String {
    match error {
        rusqlite::Error::InvalidColumnType(_, column, _) => {
            format!("entry {key} of the list of runs: its {column} is damaged")
        }
        error => format!("entry {key} of the list of runs: {error}"),
    }
}
