//! Runs whose readings were moved to an archive.

use rusqlite::OptionalExtension;

use super::{Reader, record_from, select_records};
use crate::{Archived, ChainCheck, Digest, Record, RunId, StoreError, StoredRecord};

/// The key of the sealed note about a run.
const NOTE: &str = "SELECT min(key) FROM runs JOIN seals ON seals.run = key
                    WHERE kind = 'archive' AND name = ?1";

impl Reader {
    /// The note that the readings of a run were moved to an archive. A note that cannot be read counts as
    /// none: the run then has records that do not match their digests.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn archive_of(&self, id: RunId) -> Result<Option<Archived>, StoreError> {
        let mut statement = self
            .connection
            .prepare_cached(&select_records(&format!("WHERE run = ({NOTE}) AND seq = 1")))?;
        let found = statement.query_row([id.to_string()], record_from).optional()?;
        Ok(match found.map(|found| found.record()) {
            Some(Ok(Record::Archived(note))) => Some(note),
            _ => None,
        })
    }

    /// Whether the journal has one run of an archive, and what moved the axes before it.
    pub fn is_excerpt(&self) -> bool {
        self.is_excerpt
    }

    /// Whether a note is itself whole, and about a run with this end.
    pub(super) fn is_note_right(
        &self,
        note: &Archived,
        records: u64,
        head: Digest,
    ) -> Result<bool, StoreError> {
        let id: String = self.connection.query_row(
            &format!("SELECT id FROM runs WHERE key = ({NOTE})"),
            [&note.run],
            |row| row.get(0),
        )?;
        let is_whole = matches!(
            self.follow(id.parse()?, None, &mut drop)?.0,
            ChainCheck::Intact { records: 2, .. }
        );
        Ok(is_whole && note.records == records && note.head == head.to_string())
    }
}

/// Whether a record is a reading without its content.
pub(super) fn is_taken_out(record: &StoredRecord) -> bool {
    has_no_content(&record.kind, &record.payload)
}

/// Whether a record of this kind is a reading without its content.
pub(crate) fn has_no_content(kind: &str, payload: &str) -> bool {
    payload.is_empty() && Record::ARCHIVED_KINDS.contains(&kind)
}
