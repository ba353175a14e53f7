//! Readers.

mod amendments;
mod archive;
mod ended;
mod interruption;
mod list;
mod sealed;
mod shipment;
mod size;
#[cfg(test)]
mod tests;
mod walk;

use std::{path::Path, str};

use rusqlite::{OptionalExtension, Params, Row, params};

pub(crate) use archive::has_no_content;
pub use interruption::{HOMING, Interruption, Jump, PREPARE, ProbeWord};
pub(crate) use list::unread;
pub use shipment::{RunEnd, Shipment};
pub use walk::Pages;

use crate::{
    Archived, Chain, ChainCheck, Digest, MemoryDisk, Record, Run, RunId, RunKind, RunStatus,
    StoreError, StoredRecord, excerpt,
    journal::quoted,
    memory::{Lent, Medium},
    schema,
};

/// A connection that reads the committed records. Each thread needs its own.
#[derive(Debug)]
pub struct Reader {
    // Closed before the copy that it may read is removed.
    connection: Lent,
    medium: Medium,
    /// Whether the journal has one run and what moved the axes before it.
    is_excerpt: bool,
    _copy: Option<schema::Copied>,
}

impl Reader {
    /// Opens the journal in `directory`.
    ///
    /// # Errors
    /// [`StoreError::NoJournal`] if the directory has none, [`StoreError::OtherFormat`], or an error of
    /// the system or of SQLite.
    pub fn open(directory: &Path) -> Result<Self, StoreError> {
        Self::on(Medium::Directory(directory.to_path_buf()))
    }

    /// Opens the journal on a simulated disk.
    ///
    /// # Errors
    /// As for [`Reader::open`].
    pub fn open_in_memory(disk: &MemoryDisk) -> Result<Self, StoreError> {
        Self::on(Medium::Memory(disk.clone()))
    }

    pub(crate) fn on(medium: Medium) -> Result<Self, StoreError> {
        let (connection, copy) = medium.open_to_read()?;
        let is_excerpt = excerpt::is_excerpt(&connection)?;
        Ok(Self { connection, medium, is_excerpt, _copy: copy })
    }

    /// Whether a directory has a journal.
    pub fn exists(directory: &Path) -> bool {
        schema::database(directory).exists()
    }

    /// Whether a program has the journal open to write.
    pub fn has_writer(&self) -> bool {
        self.medium.has_writer()
    }

    /// Whether no real device took part in a run. No, where its first record cannot be read.
    pub fn is_simulated(&self, run: RunId) -> bool {
        let first = self.first_record(run);
        matches!(first, Ok(Some(Record::RunStarted(started))) if started.is_simulated)
    }

    /// All runs and sessions, the latest first, without those of [`Reader::damaged_entries`].
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn runs(&self) -> Result<Vec<Run>, StoreError> {
        self.select_readable("ORDER BY key DESC", [], usize::MAX)
    }

    /// All runs and sessions, the latest first, for decisions in which none may be missing.
    ///
    /// # Errors
    /// [`StoreError::Damaged`] if an entry of the list cannot be read, or an error of the system or of SQLite.
    pub fn every_run(&self) -> Result<Vec<Run>, StoreError> {
        self.select_runs("ORDER BY key DESC", [])
    }

    /// The latest runs of protocols, the latest first: at most so many, and only those that were begun before another one.
    /// Those of [`Reader::damaged_entries`] are left out.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn latest_runs(
        &self,
        limit: Option<usize>,
        before: Option<RunId>,
    ) -> Result<Vec<Run>, StoreError> {
        let before = before.map(|before| before.to_string());
        self.select_readable(
            "WHERE kind = 'run' AND (?1 IS NULL OR key < (SELECT key FROM runs WHERE id = ?1))
             ORDER BY key DESC",
            params![before],
            limit.unwrap_or(usize::MAX),
        )
    }

    /// One run.
    ///
    /// # Errors
    /// [`StoreError::NoSuchRun`], or an error of the system or of SQLite.
    pub fn run(&self, id: RunId) -> Result<Run, StoreError> {
        let id = id.to_string();
        let found = self.select_runs("WHERE id = ?1", [&id])?.pop();
        found.ok_or(StoreError::NoSuchRun { wanted: id })
    }

    /// The ids of the journal in which a run was begun, and of its bench.
    ///
    /// # Errors
    /// [`StoreError::NoSuchRun`], or an error of the system or of SQLite.
    pub fn origin(&self, id: RunId) -> Result<(String, String), StoreError> {
        let id = id.to_string();
        let mut statement =
            self.connection.prepare_cached("SELECT journal, bench FROM runs WHERE id = ?1")?;
        let found = statement.query_row([&id], |row| Ok((row.get(0)?, row.get(1)?))).optional()?;
        found.ok_or(StoreError::NoSuchRun { wanted: id })
    }

    /// The selected runs, all of which can be read.
    fn select_runs(&self, tail: &str, values: impl Params + Copy) -> Result<Vec<Run>, StoreError> {
        self.select(tail, values, usize::MAX, |_| true)
    }

    /// The selected runs whose entries can be read, at most so many.
    fn select_readable(
        &self,
        tail: &str,
        values: impl Params + Copy,
        limit: usize,
    ) -> Result<Vec<Run>, StoreError> {
        self.select(tail, values, limit, |error| !is_of_entry(error))
    }

    /// The selected runs, at most so many. An error of one entry ends the selection if it `counts`.
    fn select(
        &self,
        tail: &str,
        values: impl Params + Copy,
        limit: usize,
        counts: impl Fn(&rusqlite::Error) -> bool,
    ) -> Result<Vec<Run>, StoreError> {
        let mut statement = self.connection.prepare_cached(&self.list(tail))?;
        let mut select = || {
            let rows = statement.query_map(values, |row| Ok((run_from(row)?, row.get(10)?)))?;
            let rows = rows.filter(|row| row.as_ref().map_or_else(&counts, |_| true));
            rows.take(limit).collect::<Result<Vec<(Run, Option<i64>)>, _>>()
        };
        let mut runs = select()?;
        let is_unended = |(run, _): &(Run, _)| run.status == RunStatus::Running;
        let mut has_writer = false;
        if runs.iter().any(is_unended) {
            has_writer = self.has_writer();
            if !has_writer {
                // The writer of these runs has ended. It may have ended them properly since they
                // were read, so they are read again.
                runs = select()?;
            }
        }
        let mut count = self.connection.prepare_cached(
            "SELECT max(seq) FROM records WHERE run = (SELECT key FROM runs WHERE id = ?1)",
        )?;
        let settled = runs.into_iter().map(|(mut run, present)| {
            let last = count.query_row([run.id.to_string()], |row| row.get::<_, Option<i64>>(0));
            run.records = last.ok().flatten().unwrap_or(0).cast_unsigned();
            let is_present = present.map(i64::cast_unsigned) == Some(run.epoch);
            match (run.status, has_writer && is_present) {
                (RunStatus::Running, true) => (run.finished_at, run.wall_s) = (None, None),
                (RunStatus::Running, false) => run.status = RunStatus::Interrupted,
                _ => {}
            }
            run
        });
        Ok(settled.collect())
    }

    /// The statement that lists runs.
    fn list(&self, tail: &str) -> String {
        select_runs(if self.is_excerpt { excerpt::RUNS } else { RUNS }, tail)
    }

    /// The first record of the run that was requested with this idempotency key, if it is one of the last 200.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn keyed_run(&self, key: &str) -> Result<Option<StoredRecord>, StoreError> {
        // Only the first records are looked at, and only one that has the key somewhere is parsed.
        let mut statement = self.connection.prepare_cached(&select_records(KEYED))?;
        let in_json = serde_json::Value::from(key).to_string();
        Ok(statement.query_row(params![key, &in_json, KEYS], record_from).optional()?)
    }

    /// The run that a person means: `latest`, a short name such as `smoke-7`, the name of a protocol
    /// that was run once, an id, or enough of the beginning or the end of one.
    ///
    /// # Errors
    /// [`StoreError::NoSuchRun`] or [`StoreError::Ambiguous`]; [`StoreError::Damaged`] if the entry of a run that fits cannot be read.
    pub fn find(&self, wanted: &str) -> Result<Run, StoreError> {
        let mut runs = if wanted == "latest" {
            self.select_runs("WHERE kind = 'run' ORDER BY key DESC LIMIT 1", [])?
        } else {
            self.select_runs(
                "WHERE substr(id, 1, length(?1)) = ?1 OR substr(id, -length(?1)) = ?1
                     OR kind = 'run' AND (name = ?1 OR name || '-' || number = ?1)
                 ORDER BY key DESC",
                [wanted],
            )?
        };
        match runs.len() {
            0 => Err(StoreError::NoSuchRun { wanted: wanted.to_owned() }),
            1 => Ok(runs.remove(0)),
            _ => Err(StoreError::Ambiguous { wanted: wanted.to_owned(), candidates: runs }),
        }
    }

    /// All records of a run, each checked against its digest.
    ///
    /// # Errors
    /// [`StoreError::Broken`] at the first flaw; [`Reader::chain`] returns the records before it.
    /// [`StoreError::NoSuchRun`], or an error of the system or of SQLite.
    pub fn records(&self, id: RunId) -> Result<Vec<StoredRecord>, StoreError> {
        let chain = self.chain(id)?;
        intact(id, &chain.check)?;
        Ok(chain.records)
    }

    /// The records of these kinds of a run, not checked against their digests: for estimates, which may
    /// be made of many runs at once. Readings that were archived are left out.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn unchecked(&self, id: RunId, kinds: &[&str]) -> Result<Vec<StoredRecord>, StoreError> {
        let wanted = quoted(kinds);
        let mut statement = self.connection.prepare_cached(&select_records(&format!(
            "WHERE run = (SELECT key FROM runs WHERE id = ?1) AND kind IN ({wanted})
               AND payload <> '' ORDER BY seq"
        )))?;
        let rows = statement.query_map([id.to_string()], record_from)?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// The digest of the last record of a run; `None` for a run without records.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn last_digest(&self, id: RunId) -> Result<Option<Digest>, StoreError> {
        let mut statement = self.connection.prepare_cached(
            "SELECT digest FROM records WHERE run = (SELECT key FROM runs WHERE id = ?1)
             ORDER BY seq DESC LIMIT 1",
        )?;
        let digest = statement.query_row([id.to_string()], |row| row.get(0)).optional()?;
        Ok(digest.map(Digest::from_bytes))
    }

    /// Checks the chain of a run.
    ///
    /// During the run, records lost from its end cannot be detected. Afterwards they can, because
    /// the last record marks the end. Readings that were archived are known by their digests.
    ///
    /// # Errors
    /// [`StoreError::NoSuchRun`], or an error of the system or of SQLite about the list of runs.
    pub fn verify(&self, id: RunId) -> Result<ChainCheck, StoreError> {
        let _view = self.connection.unchecked_transaction()?;
        let archived = self.archive_of(id)?;
        self.follow(id, archived.as_ref(), &mut drop).map(|(check, _)| check)
    }

    /// The records of a run up to the first flaw, and the flaw.
    ///
    /// # Errors
    /// [`StoreError::NoSuchRun`]; [`StoreError::Archived`]; or an error of the system or of SQLite about the
    /// list of runs.
    pub fn chain(&self, id: RunId) -> Result<Chain, StoreError> {
        // One view of all tables: the run may end, or be archived, between two statements.
        let _view = self.connection.unchecked_transaction()?;
        match self.archive_of(id)? {
            Some(Archived { place, .. }) => Err(StoreError::Archived { run: id, place }),
            None => self.walk(id, None),
        }
    }

    /// The last event of all runs; 0 without one.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn last_event(&self) -> Result<u64, StoreError> {
        let mut statement =
            self.connection.prepare_cached("SELECT coalesce(max(id), 0) FROM records")?;
        Ok(statement.query_row([], |row| row.get::<_, i64>(0))?.cast_unsigned())
    }

    /// Up to `limit` records of all runs behind the event with this id, in order, without readings that
    /// were archived.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn events_after(&self, event: u64, limit: u32) -> Result<Vec<StoredRecord>, StoreError> {
        let mut statement = self.connection.prepare_cached(&select_records(
            "WHERE records.id > ?1 AND payload <> '' ORDER BY records.id LIMIT ?2",
        ))?;
        // No event has a greater id than SQLite can count.
        let event = i64::try_from(event).unwrap_or(i64::MAX);
        let mut rows = statement.query(params![event, limit])?;
        let mut records = Vec::new();
        while let Some(row) = rows.next()? {
            records.push(record_from(row)?);
        }
        Ok(records)
    }
}

/// Checks that the chain of a run has no flaw.
///
/// # Errors
/// [`StoreError::Broken`] at the first flaw.
pub fn intact(run: RunId, check: &ChainCheck) -> Result<(), StoreError> {
    match check {
        ChainCheck::Intact { .. } => Ok(()),
        &ChainCheck::Broken { seq, ref flaw } => {
            Err(StoreError::Broken { run, seq, flaw: flaw.clone() })
        }
    }
}

/// The latest first record with this key among those of the latest runs; `?2` is the key as JSON.
const KEYED: &str = "WHERE records.id = (
    SELECT first.id FROM (SELECT key FROM runs WHERE kind = 'run' ORDER BY key DESC LIMIT ?3) AS latest
    CROSS JOIN records AS first ON first.run = latest.key AND first.seq = 1
    WHERE instr(first.payload, ?2) AND json_valid(first.payload)
        AND json_extract(first.payload, '$.idempotency_key') = ?1
    ORDER BY latest.key DESC LIMIT 1)";

/// The keys of so many runs are known. Each that is looked at is read.
const KEYS: u32 = 200;

/// All runs, each with its number among those of its kind and name. The runs are counted apart, so that SQLite does not
/// sort all that is known of each of them.
const RUNS: &str = "
    SELECT * FROM runs JOIN (
        SELECT key, row_number() OVER (PARTITION BY kind, name ORDER BY key) AS number FROM runs
    ) USING (key)";

fn select_runs(runs: &str, tail: &str) -> String {
    format!(
        "WITH amendments AS MATERIALIZED (
             SELECT name AS run, count(*) AS amendments FROM runs
             WHERE kind = 'amendment' AND status != 'running' GROUP BY name)
         SELECT id, kind, name, started_at, finished_at, status,
                round(unixepoch(finished_at, 'subsec') - unixepoch(started_at, 'subsec'), 3),
                number,
                EXISTS (SELECT 1 FROM seals WHERE run = key),
                coalesce((SELECT max(epoch) FROM stretches WHERE run = key), epoch),
                (SELECT max(n) FROM epochs),
                coalesce(amendments, 0),
                key
         FROM ({runs}) AS all_runs LEFT JOIN amendments ON amendments.run = id {tail}"
    )
}

fn run_from(row: &Row<'_>) -> rusqlite::Result<Run> {
    let word = |column, known: fn(&str) -> Option<_>| parsed(row, column, known);
    Ok(Run {
        id: parsed(row, 0, |id| id.parse().ok())?,
        kind: parsed(row, 1, RunKind::from_name)?,
        name: row.get(2)?,
        started_at: row.get(3)?,
        finished_at: row.get(4)?,
        status: word(5, RunStatus::from_name)?,
        wall_s: row.get(6)?,
        // Counted apart, so that a damaged record of one run does not hide the list of all.
        records: 0,
        number: row.get::<_, i64>(7)?.cast_unsigned(),
        epoch: row.get::<_, i64>(9)?.cast_unsigned(),
        amendments: row.get::<_, i64>(11)?.cast_unsigned(),
        is_sealed: row.get(8)?,
    })
}

/// Whether an error is that of one row, and the others can be read.
fn is_of_entry(error: &rusqlite::Error) -> bool {
    error.sqlite_error_code().is_none()
}

/// A column whose words are known.
pub(crate) fn parsed<T>(
    row: &Row<'_>,
    column: usize,
    known: impl FnOnce(&str) -> Option<T>,
) -> rusqlite::Result<T> {
    let value = row.get_ref(column)?;
    let unknown = || {
        let name = row.as_ref().column_name(column).unwrap_or("?").to_owned();
        rusqlite::Error::InvalidColumnType(column, name, value.data_type())
    };
    known(value.as_str().map_err(|_| unknown())?).ok_or_else(unknown)
}

fn select_records(tail: &str) -> String {
    let time = schema::TIME_OF_RECORD;
    format!(
        "SELECT records.id, seq, records.rig_us, records.kind, payload, records.digest,
                (SELECT id FROM runs WHERE key = records.run), {time}, records.epoch,
                coalesce((
                    SELECT records.rig_us - stretches.rig_us + CAST(round(1e6 * (
                        unixepoch(stretches.started_at, 'subsec')
                        - (SELECT unixepoch(started_at, 'subsec') FROM runs WHERE key = records.run)
                    )) AS INTEGER)
                    FROM stretches
                    WHERE stretches.run = records.run AND stretches.epoch = records.epoch), 0)
         FROM records {tail}"
    )
}

fn record_from(row: &Row<'_>) -> rusqlite::Result<StoredRecord> {
    let whole = |column| row.get::<_, i64>(column).map(i64::cast_unsigned);
    Ok(StoredRecord {
        event: whole(0)?,
        run: parsed(row, 6, |id| id.parse().ok())?,
        seq: whole(1)?,
        rig_us: whole(2)?,
        epoch: whole(8)?,
        run_us: whole(9)?,
        at: row.get(7)?,
        kind: row.get(3)?,
        payload: row.get(4)?,
        digest: Digest::from_bytes(row.get(5)?),
    })
}
