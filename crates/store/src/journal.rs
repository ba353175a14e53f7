//! The writer of the journal: one in each data directory.

mod encode;

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use rusqlite::{Connection, OptionalExtension, params};
use uuid::Uuid;

use crate::{
    Digest, Ending, Reader, Record, RunFinished, RunId, RunKind, StoreError, lock::DirectoryLock,
    schema,
};

/// The journal of a data directory, open for writing. There is one at a time.
#[derive(Debug)]
pub struct Store {
    writer: Arc<Mutex<Writer>>,
    interrupted: Vec<RunId>,
    directory: PathBuf,
}

/// The journal of one run. Several may be open at a time; they share one transaction.
///
/// Appended records are on disk when [`Journal::commit`] has returned, and not before. After a
/// failure nothing more can be appended to any journal of the store: the contents of the disk are
/// only known
/// when it is opened again.
#[derive(Debug)]
pub struct Journal {
    writer: Arc<Mutex<Writer>>,
    id: RunId,
    last: LastRecord,
    has_ended: bool,
}

/// The last record of a run.
#[derive(Debug, Clone, Copy)]
struct LastRecord {
    run: i64,
    seq: u64,
    digest: Digest,
}

#[derive(Debug)]
struct Writer {
    connection: Connection,
    // Invariant: true exactly when a transaction is open.
    has_uncommitted: bool,
    /// The runs with records in it.
    touched: BTreeSet<i64>,
    has_failed: bool,
    // Behind the connection, so that it is released after that is closed.
    _lock: DirectoryLock,
}

impl Store {
    /// Opens the journal in `directory`, which is made where it is missing.
    ///
    /// A run that had not ended is marked as interrupted, with a last record in its journal.
    ///
    /// # Errors
    /// [`StoreError::InUse`] while another store is open on the directory, in this program or
    /// another; [`StoreError::OtherFormat`]; or what the system or SQLite reports.
    pub fn open(directory: &Path) -> Result<Self, StoreError> {
        let lock = DirectoryLock::take(directory)?;
        let connection = schema::open_to_write(&schema::database(directory))?;
        let mut writer = Writer {
            connection,
            has_uncommitted: false,
            touched: BTreeSet::new(),
            has_failed: false,
            _lock: lock,
        };
        let interrupted = writer.mark_interrupted()?;
        let writer = Arc::new(Mutex::new(writer));
        Ok(Self { writer, interrupted, directory: directory.to_path_buf() })
    }

    /// The runs that were found unended when the store was opened, oldest first.
    pub fn interrupted(&self) -> &[RunId] {
        &self.interrupted
    }

    /// A reader of the same journal.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn reader(&self) -> Result<Reader, StoreError> {
        Reader::open(&self.directory)
    }

    /// Begins a run. It is on disk with the first commit.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, or [`StoreError::Closed`].
    pub fn begin(&self, kind: RunKind, name: &str) -> Result<Journal, StoreError> {
        let id = RunId::new(Uuid::now_v7());
        let run = locked(&self.writer, |writer| writer.insert_run(id, kind, name))?;
        let last = LastRecord { run, seq: 0, digest: Digest::START };
        Ok(Journal { writer: Arc::clone(&self.writer), id, last, has_ended: false })
    }
}

#[cfg(test)]
impl Store {
    /// Lets the database grow no further, as if the disk were full.
    pub(crate) fn limit_pages(&self, pages: u32) {
        let writer = self.writer.lock().unwrap();
        writer.connection.pragma_update(None, "max_page_count", pages).unwrap();
    }
}

impl Journal {
    /// The id of the run.
    pub const fn id(&self) -> RunId {
        self.id
    }

    /// The digest of the last record.
    pub const fn digest(&self) -> Digest {
        self.last.digest
    }

    /// Appends a record, `rig_us` microseconds after the rig was opened, and returns the id of its
    /// event. It is not on disk yet. [`Record::RunFinished`] ends the run.
    ///
    /// # Errors
    /// [`StoreError::Unwritable`] and [`StoreError::Ended`] leave the journal as it was. After any
    /// other error it is closed.
    pub fn append(&mut self, rig_us: u64, record: &Record) -> Result<u64, StoreError> {
        let kind = record.kind();
        if self.has_ended {
            return Err(StoreError::Ended { run: self.id, kind });
        }
        let payload = encode::payload(record)?;
        let (id, last) = locked(&self.writer, |writer| {
            let appended = writer.insert_record(self.last, rig_us, kind, &payload)?;
            if let Record::RunFinished(finished) = record {
                writer.end_run(self.last.run, finished.status)?;
            }
            Ok(appended)
        })?;
        self.last = last;
        self.has_ended = matches!(record, Record::RunFinished(_));
        Ok(id)
    }

    /// Puts everything that was appended to any journal of the store on disk.
    ///
    /// # Errors
    /// [`StoreError::DiskFull`], [`StoreError::Io`], or [`StoreError::Closed`] after an earlier
    /// failure. A failed commit is not tried again, because what an fsync left behind when it
    /// failed is not known.
    pub fn commit(&mut self) -> Result<(), StoreError> {
        locked(&self.writer, Writer::commit)
    }
}

/// Does `work` with the writer, and closes it for good when that fails.
fn locked<T>(
    writer: &Mutex<Writer>,
    work: impl FnOnce(&mut Writer) -> Result<T, StoreError>,
) -> Result<T, StoreError> {
    // A panic under the lock left the transaction in an unknown state.
    let mut writer = writer.lock().map_err(|_| StoreError::Closed)?;
    if writer.has_failed {
        return Err(StoreError::Closed);
    }
    let done = work(&mut writer);
    if done.is_err() {
        writer.has_failed = true;
        // Best effort: the transaction ends with the connection in any case.
        _ = writer.connection.execute_batch("ROLLBACK");
    }
    done
}

impl Writer {
    fn begin(&mut self) -> Result<(), StoreError> {
        if !self.has_uncommitted {
            self.connection.execute_batch("BEGIN IMMEDIATE")?;
            self.has_uncommitted = true;
        }
        Ok(())
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        if self.has_uncommitted {
            // Of a run that is never ended, this tells until when it was alive.
            let mut alive = self.connection.prepare_cached(
                "UPDATE runs SET finished_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now')
                 WHERE key = ?1 AND status = 'running'",
            )?;
            for run in std::mem::take(&mut self.touched) {
                alive.execute([run])?;
            }
            drop(alive);
            self.connection.execute_batch("COMMIT")?;
            self.has_uncommitted = false;
        }
        Ok(())
    }

    fn insert_run(&mut self, id: RunId, kind: RunKind, name: &str) -> Result<i64, StoreError> {
        self.begin()?;
        self.connection.execute(
            "INSERT INTO runs (id, kind, name, started_at, status)
             VALUES (?1, ?2, ?3, strftime('%Y-%m-%dT%H:%M:%fZ', 'now'), 'running')",
            params![id.to_string(), kind.name(), name],
        )?;
        Ok(self.connection.last_insert_rowid())
    }

    fn insert_record(
        &mut self,
        last: LastRecord,
        rig_us: u64,
        kind: &str,
        payload: &str,
    ) -> Result<(u64, LastRecord), StoreError> {
        self.begin()?;
        self.touched.insert(last.run);
        let seq = last.seq + 1;
        let digest = last.digest.next(seq, rig_us, kind, payload);
        self.connection
            .prepare_cached(
                "INSERT INTO records (run, seq, rig_us, kind, payload, digest)
                 VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
            )?
            .execute(params![
                last.run,
                seq.cast_signed(),
                rig_us.cast_signed(),
                kind,
                payload,
                digest.as_bytes(),
            ])?;
        let id = self.connection.last_insert_rowid().cast_unsigned();
        Ok((id, LastRecord { seq, digest, ..last }))
    }

    fn end_run(&mut self, run: i64, ending: Ending) -> Result<(), StoreError> {
        self.connection.execute(
            "UPDATE runs SET status = ?2, finished_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now')
             WHERE key = ?1",
            params![run, ending.name()],
        )?;
        Ok(())
    }

    /// Ends a run whose program is gone. It ended when something was last written to it.
    fn end_interrupted(&mut self, run: i64) -> Result<(), StoreError> {
        self.connection.execute(
            "UPDATE runs SET status = ?2, finished_at = coalesce(finished_at, started_at)
             WHERE key = ?1",
            params![run, Ending::Interrupted.name()],
        )?;
        Ok(())
    }

    fn mark_interrupted(&mut self) -> Result<Vec<RunId>, StoreError> {
        let unended = self
            .connection
            .prepare("SELECT key, id FROM runs WHERE status = 'running' ORDER BY key")?
            .query_map([], |row| Ok((row.get(0)?, row.get::<_, String>(1)?)))?
            .collect::<Result<Vec<(i64, String)>, _>>()?;
        let mut runs = Vec::new();
        for (run, id) in unended {
            let (last, rig_us) = self.last(run)?;
            let record = Record::RunFinished(RunFinished { status: Ending::Interrupted });
            self.insert_record(last, rig_us, record.kind(), &encode::payload(&record)?)?;
            self.end_interrupted(run)?;
            runs.push(id.parse()?);
        }
        self.commit()?;
        Ok(runs)
    }

    /// The last record of a run, and its time on the rig's clock in µs.
    fn last(&self, run: i64) -> Result<(LastRecord, u64), StoreError> {
        let last = self
            .connection
            .query_row(
                "SELECT seq, digest, rig_us FROM records WHERE run = ?1 ORDER BY seq DESC LIMIT 1",
                [run],
                |row| Ok((row.get::<_, i64>(0)?, row.get(1)?, row.get::<_, i64>(2)?)),
            )
            .optional()?;
        Ok(match last {
            Some((seq, digest, rig_us)) => {
                let digest = Digest::from_bytes(digest);
                (LastRecord { run, seq: seq.cast_unsigned(), digest }, rig_us.cast_unsigned())
            }
            None => (LastRecord { run, seq: 0, digest: Digest::START }, 0),
        })
    }
}
