//! What comes behind an event of the journal, as a hub takes it.

use std::collections::BTreeMap;

use rusqlite::{OptionalExtension, params};

use super::{Reader, record_from, select_records};
use crate::{
    Digest, ListEntry, RunId, StoreError, StoredRecord, Stretch,
    journal::{ENTRY, entry_from, stretches},
};

/// Records behind an event, and what the list of runs has of their runs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Shipment {
    /// The records of all runs in the order of their events, also readings that were archived, which have no payload.
    pub records: Vec<StoredRecord>,
    /// The entry of each run with a record among them.
    pub entries: Vec<ListEntry>,
    /// The stretches that these records are in, with the id of their run.
    pub stretches: Vec<(String, Stretch)>,
    /// The ends of the runs whose last record is among them.
    pub ends: Vec<RunEnd>,
}

/// The end of a run, or of a part of one that can be resumed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunEnd {
    /// Id of the run.
    pub run: RunId,
    /// Number of its records.
    pub records: u64,
    /// Digest of the last one.
    pub head: Digest,
    /// When it ended: UTC, RFC 3339 with milliseconds.
    pub finished_at: String,
    /// How it ended.
    pub status: String,
    /// Its seal; none if it can be resumed.
    pub seal: Option<Digest>,
    /// The signature of the seal.
    pub signature: Option<Vec<u8>>,
}

impl Reader {
    /// The ids of this journal and of its bench. They differ from those of a run that was begun in another journal.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn identity(&self) -> Result<(String, String), StoreError> {
        let mut statement = self.connection.prepare_cached("SELECT journal, bench FROM meta")?;
        Ok(statement.query_row([], |row| Ok((row.get(0)?, row.get(1)?)))?)
    }

    /// The digest of the record with this event; `None` if the journal has no such event.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn digest_of_event(&self, event: u64) -> Result<Option<Digest>, StoreError> {
        let Ok(event) = i64::try_from(event) else { return Ok(None) };
        let mut statement =
            self.connection.prepare_cached("SELECT digest FROM records WHERE id = ?1")?;
        let digest = statement.query_row([event], |row| row.get(0)).optional()?;
        Ok(digest.map(Digest::from_bytes))
    }

    /// What comes behind an event, in one view of the journal: up to `records_max` records, and no more once they
    /// have `bytes_max` bytes of payload.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn shipment(
        &self,
        after_event: u64,
        records_max: u32,
        bytes_max: usize,
    ) -> Result<Shipment, StoreError> {
        let _view = self.connection.unchecked_transaction()?;
        let records = self.page_after(after_event, records_max, bytes_max)?;
        let mut last = BTreeMap::new();
        for record in &records {
            last.insert(record.run, (record.seq, record.digest));
        }
        let mut shipment = Shipment::default();
        for (run, (seq, digest)) in last {
            let (entry, key) = self.entry(run)?;
            let epochs: Vec<_> = records
                .iter()
                .filter(|record| record.run == run)
                .map(|record| record.epoch)
                .collect();
            let all = stretches(&self.connection, key)?.into_iter();
            let in_these = all.filter(|stretch| epochs.contains(&stretch.epoch));
            shipment.stretches.extend(in_these.map(|stretch| (entry.run.clone(), stretch)));
            shipment.entries.push(entry);
            shipment.ends.extend(self.end_of(run, key, seq, digest)?);
        }
        Ok(Shipment { records, ..shipment })
    }

    fn page_after(
        &self,
        event: u64,
        records_max: u32,
        bytes_max: usize,
    ) -> Result<Vec<StoredRecord>, StoreError> {
        let mut statement = self.connection.prepare_cached(&select_records(
            "WHERE records.id > ?1 ORDER BY records.id LIMIT ?2",
        ))?;
        let event = i64::try_from(event).unwrap_or(i64::MAX);
        let mut rows = statement.query(params![event, records_max])?;
        let (mut records, mut bytes) = (Vec::new(), 0);
        while bytes < bytes_max
            && let Some(row) = rows.next()?
        {
            let record = record_from(row)?;
            bytes += record.payload.len();
            records.push(record);
        }
        Ok(records)
    }

    /// The entry of a run in the list of runs, and its key.
    fn entry(&self, run: RunId) -> Result<(ListEntry, i64), StoreError> {
        let mut statement = self
            .connection
            .prepare_cached(&format!("SELECT {ENTRY}, key FROM runs WHERE id = ?1"))?;
        let found = statement
            .query_row([run.to_string()], |row| Ok((entry_from(row)?, row.get(8)?)))
            .optional()?;
        found.ok_or_else(|| StoreError::NoSuchRun { wanted: run.to_string() })
    }

    /// The end of a run if it has ended with the record `seq`.
    fn end_of(
        &self,
        run: RunId,
        key: i64,
        seq: u64,
        head: Digest,
    ) -> Result<Option<RunEnd>, StoreError> {
        let mut statement = self.connection.prepare_cached(
            "SELECT finished_at, status, seal, signature
             FROM runs LEFT JOIN seals ON seals.run = key
             WHERE key = ?1 AND status <> 'running'
               AND ?2 = (SELECT max(seq) FROM records WHERE records.run = key)",
        )?;
        let end = statement.query_row(params![key, seq.cast_signed()], |row| {
            let seal: Option<[u8; 32]> = row.get(2)?;
            Ok(RunEnd {
                run,
                records: seq,
                head,
                finished_at: row.get(0)?,
                status: row.get(1)?,
                seal: seal.map(Digest::from_bytes),
                signature: row.get(3)?,
            })
        });
        Ok(end.optional()?)
    }
}
