//! The writer of the journal: one in each data directory.

mod archive;
mod encode;
mod list;

use std::{
    collections::BTreeSet,
    path::Path,
    sync::{Arc, Mutex},
};

use rusqlite::params;
use uuid::{ContextV7, Timestamp, Uuid};

use crate::{
    Digest, Ending, GivenUp, MemoryDisk, Reader, Record, RunFinished, RunId, RunKind, RunStatus,
    StoreError,
    memory::{Held, Lent, Medium},
    sql,
};
pub(crate) use archive::quoted;
pub(crate) use list::{ENTRY, entry_from, insert_entry, insert_stretch, link, stretches};

/// The journal of a data directory, open for writing. There is one at a time.
#[derive(Debug)]
pub struct Store {
    writer: Arc<Mutex<Writer>>,
    interrupted: Vec<RunId>,
    medium: Medium,
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
    kind: RunKind,
    last: LastRecord,
    has_ended: bool,
    is_given_up: bool,
}

/// The last record of a run.
#[derive(Debug, Clone, Copy)]
struct LastRecord {
    run: i64,
    seq: u64,
    digest: Digest,
    /// Number of the epoch of the next record.
    epoch: i64,
    /// Whether the stretch of that epoch is in the list of stretches.
    has_stretch: bool,
}

#[derive(Debug)]
struct Writer {
    connection: Lent,
    /// Ids of the journal and of its bench.
    journal: String,
    bench: String,
    /// Number of this opening.
    epoch: i64,
    // Invariant: true exactly when a transaction is open.
    has_uncommitted: bool,
    /// The runs with records in it.
    touched: BTreeSet<i64>,
    has_failed: bool,
    medium: Medium,
    // Behind the connection, so that it is released after that is closed.
    _lock: Held,
}

impl Store {
    /// Opens the journal in `directory`, which is created if it is missing.
    ///
    /// A session or an amendment that had not ended gets a last record with the end `interrupted`.
    /// A run that had not ended stays open, for [`Store::reopen`] or [`Store::give_up`].
    ///
    /// # Errors
    /// [`StoreError::InUse`] while another store is open on the directory, in this program or
    /// another; [`StoreError::OtherFormat`]; or what the system or SQLite reports.
    pub fn open(directory: &Path) -> Result<Self, StoreError> {
        Self::open_on(Medium::Directory(directory.to_path_buf()))
    }

    /// Opens the journal on a simulated disk, as [`Store::open`] does in a directory.
    ///
    /// # Errors
    /// As for [`Store::open`].
    pub fn open_in_memory(disk: &MemoryDisk) -> Result<Self, StoreError> {
        Self::open_on(Medium::Memory(disk.clone()))
    }

    fn open_on(medium: Medium) -> Result<Self, StoreError> {
        // Its files are not touched, not even by a lock.
        if medium.directory().is_some()
            && Reader::on(medium.clone()).is_ok_and(|reader| reader.is_excerpt())
        {
            return Err(StoreError::IsExcerpt);
        }
        let lock = medium.take()?;
        medium.call()?;
        let connection = medium.open_to_write()?;
        let (journal, bench) =
            connection.query_row("SELECT journal, bench FROM meta", [], |row| {
                Ok((row.get(0)?, row.get(1)?))
            })?;
        let mut writer = Writer {
            connection,
            journal,
            bench,
            epoch: 0,
            has_uncommitted: false,
            touched: BTreeSet::new(),
            has_failed: false,
            medium: medium.clone(),
            _lock: lock,
        };
        let interrupted = writer.mark_interrupted()?;
        writer.begin_epoch()?;
        let writer = Arc::new(Mutex::new(writer));
        Ok(Self { writer, interrupted, medium })
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
        Reader::on(self.medium.clone())
    }

    /// The directory of the journal; `None` on a simulated disk.
    pub fn directory(&self) -> Option<&Path> {
        self.medium.directory()
    }

    /// Begins a run. It is on disk with the first commit.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, or [`StoreError::Closed`].
    pub fn begin(&self, kind: RunKind, name: &str) -> Result<Journal, StoreError> {
        // To a fraction of a microsecond, for runs that begin in one millisecond. A context that is kept, as that of
        // `now_v7`, would keep the ids in order too: after the wall clock was set back, it goes on from the time before.
        let context = ContextV7::new().with_additional_precision();
        let id = RunId::new(Uuid::new_v7(Timestamp::now(context)));
        let last = locked(&self.writer, |writer| writer.insert_run(id, kind, name))?;
        Ok(self.journal(id, kind, last))
    }

    /// Opens a run again that was neither completed nor given up. The next record has the changes
    /// since: [`Record::Resumed`] or [`Record::GivenUp`].
    ///
    /// # Errors
    /// [`StoreError::Sealed`], [`StoreError::UnderWay`], [`StoreError::Broken`] when its records are
    /// damaged, or an error of the system or of SQLite.
    pub fn reopen(&self, id: RunId) -> Result<Journal, StoreError> {
        let reader = self.reader()?;
        let run = reader.run(id)?;
        if run.status == RunStatus::Running {
            return Err(StoreError::UnderWay { run: run.to_string() });
        }
        if !run.is_resumable() {
            return Err(StoreError::Sealed { run: run.to_string(), status: run.status.describe() });
        }
        reader.records(id)?;
        let last = locked(&self.writer, |writer| writer.reopen_run(&run))?;
        Ok(self.journal(id, run.kind, last))
    }

    /// Gives up a run that was neither completed nor given up before, and seals it.
    ///
    /// # Errors
    /// As for [`Store::reopen`].
    pub fn give_up(&self, id: RunId, rig_us: u64, who: &str) -> Result<(), StoreError> {
        let status = match self.reader()?.run(id)?.status {
            RunStatus::Ended(ending) => ending,
            RunStatus::Running | RunStatus::Interrupted => Ending::Interrupted,
        };
        let mut journal = self.reopen(id)?;
        let epoch = self.epoch()?;
        journal.append(rig_us, &Record::GivenUp(GivenUp { epoch, who: who.to_owned() }))?;
        journal.append(rig_us, &Record::RunFinished(RunFinished { status }))?;
        journal.commit()
    }

    /// The id of the newest event that is committed; 0 in an empty journal.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn newest_event(&self) -> Result<u64, StoreError> {
        self.reader()?.last_event()
    }

    /// Number of this opening of the journal, from 1.
    ///
    /// # Errors
    /// [`StoreError::Closed`].
    pub fn epoch(&self) -> Result<u64, StoreError> {
        locked(&self.writer, |writer| Ok(writer.epoch.cast_unsigned()))
    }

    fn journal(&self, id: RunId, kind: RunKind, last: LastRecord) -> Journal {
        let writer = Arc::clone(&self.writer);
        Journal { writer, id, kind, last, has_ended: false, is_given_up: false }
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
    /// [`StoreError::Unwritable`] and [`StoreError::Ended`] leave the journal unchanged. After any
    /// other error it is closed.
    pub fn append(&mut self, rig_us: u64, record: &Record) -> Result<u64, StoreError> {
        let kind = record.kind();
        if self.has_ended {
            return Err(StoreError::Ended { run: self.id, kind });
        }
        let payload = encode::payload(record)?;
        self.is_given_up |= matches!(record, Record::GivenUp(_));
        let (id, last) = locked(&self.writer, |writer| {
            let (id, last) = writer.insert_record(self.last, rig_us, kind, &payload)?;
            if let Record::RunFinished(RunFinished { status }) = record {
                writer.end_run(last.run, *status)?;
                if self.kind != RunKind::Run || status.is_complete() || self.is_given_up {
                    writer.seal(last)?;
                }
            }
            Ok((id, last))
        })?;
        self.last = last;
        self.has_ended = matches!(record, Record::RunFinished(_));
        Ok(id)
    }

    /// Puts everything that was appended to any journal of the store on disk.
    ///
    /// # Errors
    /// [`StoreError::DiskFull`], [`StoreError::Io`], or [`StoreError::Closed`] after an earlier
    /// failure. A failed commit is not tried again, because the state of the file after a failed
    /// fsync is unknown.
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
    let done = writer.medium.call().and_then(|()| work(&mut writer));
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
            sql::execute(&self.connection, "BEGIN IMMEDIATE", [])?;
            self.has_uncommitted = true;
        }
        Ok(())
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        if self.has_uncommitted {
            // For a run that never ends, this is the last time of activity.
            let mut alive = self.connection.prepare_cached(
                "UPDATE runs SET finished_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now')
                 WHERE key = ?1 AND status = 'running'",
            )?;
            for run in std::mem::take(&mut self.touched) {
                alive.execute([run])?;
            }
            drop(alive);
            sql::execute(&self.connection, "COMMIT", [])?;
            self.has_uncommitted = false;
        }
        Ok(())
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
        if !last.has_stretch {
            self.insert_stretch(last, rig_us)?;
        }
        let seq = last.seq + 1;
        let digest = last.digest.next(seq, rig_us, kind, payload);
        sql::execute(
            &self.connection,
            "INSERT INTO records (run, seq, epoch, rig_us, kind, payload, digest)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
            params![
                last.run,
                seq.cast_signed(),
                last.epoch,
                rig_us.cast_signed(),
                kind,
                payload,
                digest.as_bytes(),
            ],
        )?;
        let id = self.connection.last_insert_rowid().cast_unsigned();
        Ok((id, LastRecord { seq, digest, has_stretch: true, ..last }))
    }

    fn end_run(&mut self, run: i64, ending: Ending) -> Result<(), StoreError> {
        sql::execute(
            &self.connection,
            "UPDATE runs SET status = ?2, finished_at = strftime('%Y-%m-%dT%H:%M:%fZ', 'now')
             WHERE key = ?1",
            params![run, ending.name()],
        )?;
        Ok(())
    }
}
