//! The list of runs, as the writer keeps it: epochs, entries, stretches, seals.

use std::{fs, path::Path, sync::LazyLock};

use rig_record::{DigestPart, ListEntry, Stretch, seal};
use rusqlite::{Connection, OptionalExtension, Row, params};

use super::{LastRecord, Writer, encode};
use crate::{
    Digest, Ending, FORMAT, Record, Run, RunFinished, RunId, RunKind, StoreError, schema, sql,
};

impl Writer {
    /// Notes that the journal was opened, when, and on which boot of which computer.
    pub(super) fn begin_epoch(&mut self) -> Result<(), StoreError> {
        /// Linux names each boot here.
        const BOOT_ID: &str = "/proc/sys/kernel/random/boot_id";
        /// Made by systemd-timesyncd once the clock is set.
        const SYNCHRONIZED: &str = "/run/systemd/timesync/synchronized";
        static BOOT: LazyLock<Option<String>> =
            LazyLock::new(|| Some(fs::read_to_string(BOOT_ID).ok()?.trim().to_owned()));
        let is_synced = Path::new(SYNCHRONIZED).exists().then_some(1);
        self.begin()?;
        sql::execute(
            &self.connection,
            "INSERT INTO epochs (opened_at, boot_id, software, is_clock_synced)
             VALUES (strftime('%Y-%m-%dT%H:%M:%fZ', 'now'), ?1, ?2, ?3)",
            params![*BOOT, concat!("rigd ", env!("CARGO_PKG_VERSION")), is_synced],
        )?;
        self.epoch = self.connection.last_insert_rowid();
        self.commit()
    }

    pub(super) fn insert_run(
        &mut self,
        id: RunId,
        kind: RunKind,
        name: &str,
    ) -> Result<LastRecord, StoreError> {
        self.begin()?;
        let started_at = sql::row(
            &self.connection,
            "SELECT strftime('%Y-%m-%dT%H:%M:%fZ', 'now')",
            [],
            |row| row.get(0),
        )?;
        let entry = ListEntry {
            bench: self.bench.clone(),
            journal: self.journal.clone(),
            run: id.to_string(),
            kind: kind.name().to_owned(),
            name: name.to_owned(),
            format: u64::from(FORMAT),
            epoch: self.epoch.cast_unsigned(),
            started_at,
        };
        let run = insert_entry(&self.connection, &entry)?;
        let epoch = self.epoch;
        Ok(LastRecord { run, seq: 0, digest: Digest::START, epoch, has_stretch: false })
    }

    pub(super) fn reopen_run(&mut self, run: &Run) -> Result<LastRecord, StoreError> {
        self.begin()?;
        let key = sql::row(
            &self.connection,
            "UPDATE runs SET status = 'running' WHERE id = ?1 RETURNING key",
            [run.id.to_string()],
            |row| row.get(0),
        )?;
        let (last, _) = self.last(key)?;
        let has_stretch = last.has_stretch && last.epoch == self.epoch;
        Ok(LastRecord { epoch: self.epoch, has_stretch, ..last })
    }

    /// Begins a stretch of a run: now by the wall clock, but not before its last record.
    pub(super) fn insert_stretch(&self, last: LastRecord, rig_us: u64) -> Result<(), StoreError> {
        let before = schema::TIME_OF_RECORD;
        let (run, started_at) = sql::row(
            &self.connection,
            &format!(
                "SELECT id, iif(?2 = 0, started_at, max(
                     strftime('%Y-%m-%dT%H:%M:%fZ', 'now'),
                     coalesce((SELECT {before} FROM records WHERE run = key AND seq = ?2), '')))
                 FROM runs WHERE key = ?1"
            ),
            params![last.run, last.seq.cast_signed()],
            |row| Ok((row.get::<_, String>(0)?, row.get(1)?)),
        )?;
        let stretch = Stretch { epoch: last.epoch.cast_unsigned(), started_at, rig_us };
        insert_stretch(&self.connection, last.run, &run, &stretch)
    }

    /// Seals a run whose end has been written down.
    pub(super) fn seal(&self, last: LastRecord) -> Result<(), StoreError> {
        let (entry, finished_at, status) = sql::row(
            &self.connection,
            &format!("SELECT {ENTRY}, finished_at, status FROM runs WHERE key = ?1"),
            [last.run],
            |row| Ok((entry_from(row)?, row.get::<_, String>(8)?, row.get::<_, String>(9)?)),
        )?;
        let stretches = stretches(&self.connection, last.run)?;
        let seal = seal(&entry, &stretches, &finished_at, &status, last.seq, last.digest);
        sql::execute(
            &self.connection,
            "INSERT INTO seals (run, records, head, seal) VALUES (?1, ?2, ?3, ?4)",
            params![last.run, last.seq.cast_signed(), last.digest.as_bytes(), seal.as_bytes()],
        )?;
        Ok(())
    }

    /// Ends the sessions and amendments that their program did not end, at the time of their last
    /// record. Also returns the runs that were not ended.
    pub(super) fn mark_interrupted(&mut self) -> Result<Vec<RunId>, StoreError> {
        let unended = self
            .connection
            .prepare_cached("SELECT key, id, kind FROM runs WHERE status = 'running' ORDER BY key")?
            .query_map([], |row| {
                Ok((row.get(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?))
            })?
            .collect::<Result<Vec<(i64, String, String)>, _>>()?;
        let mut runs = Vec::new();
        for (run, id, kind) in unended {
            // Nothing is added to a run whose entry in the list is damaged.
            let (Ok(id), Some(_)) = (id.parse(), RunKind::from_name(&kind)) else { continue };
            runs.push(id);
            if kind == RunKind::Run.name() {
                continue;
            }
            // Nothing is added behind a record that cannot be read.
            let Ok((last, rig_us)) = self.last(run) else { continue };
            let record = Record::RunFinished(RunFinished { status: Ending::Interrupted });
            let payload = encode::payload(&record)?;
            let (_, last) = self.insert_record(last, rig_us, record.kind(), &payload)?;
            sql::execute(
                &self.connection,
                "UPDATE runs SET status = ?2, finished_at = coalesce(finished_at, started_at)
                 WHERE key = ?1",
                params![run, Ending::Interrupted.name()],
            )?;
            self.seal(last)?;
        }
        self.commit()?;
        Ok(runs)
    }

    /// The last record of a run, and its time on the rig's clock in µs.
    pub(super) fn last(&self, run: i64) -> Result<(LastRecord, u64), StoreError> {
        let last = sql::row(
            &self.connection,
            "SELECT seq, digest, rig_us, epoch FROM records WHERE run = ?1
             ORDER BY seq DESC LIMIT 1",
            [run],
            |row| Ok((row.get::<_, i64>(0)?, row.get(1)?, row.get::<_, i64>(2)?, row.get(3)?)),
        )
        .optional()?;
        let Some((seq, digest, rig_us, epoch)) = last else {
            let of_run = "SELECT epoch FROM runs WHERE key = ?1";
            let epoch = sql::row(&self.connection, of_run, [run], |row| row.get(0))?;
            let digest = Digest::START;
            return Ok((LastRecord { run, seq: 0, digest, epoch, has_stretch: false }, 0));
        };
        let (seq, digest) = (seq.cast_unsigned(), Digest::from_bytes(digest));
        let last = LastRecord { run, seq, digest, epoch, has_stretch: true };
        Ok((last, rig_us.cast_unsigned()))
    }
}

/// The columns of a [`ListEntry`].
pub(crate) const ENTRY: &str = "bench, journal, id, kind, name, format, epoch, started_at";

/// The entry in the first columns of a row of [`ENTRY`].
pub(crate) fn entry_from(row: &Row<'_>) -> rusqlite::Result<ListEntry> {
    Ok(ListEntry {
        bench: row.get(0)?,
        journal: row.get(1)?,
        run: row.get(2)?,
        kind: row.get(3)?,
        name: row.get(4)?,
        format: row.get::<_, i64>(5)?.cast_unsigned(),
        epoch: row.get::<_, i64>(6)?.cast_unsigned(),
        started_at: row.get(7)?,
    })
}

/// Adds an entry to the list of runs, linked to the one before it, and returns its key.
pub(crate) fn insert_entry(connection: &Connection, entry: &ListEntry) -> Result<i64, StoreError> {
    let last = "SELECT link FROM runs ORDER BY key DESC LIMIT 1";
    let before = sql::row(connection, last, [], |row| row.get(0))
        .optional()?
        .map_or(Digest::START, Digest::from_bytes);
    let digest = entry.digest();
    let link = link(before, digest);
    sql::execute(
        connection,
        &format!(
            "INSERT INTO runs ({ENTRY}, digest, link, status)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, 'running')"
        ),
        params![
            entry.bench,
            entry.journal,
            entry.run,
            entry.kind,
            entry.name,
            entry.format.cast_signed(),
            entry.epoch.cast_signed(),
            entry.started_at,
            digest.as_bytes(),
            link.as_bytes(),
        ],
    )?;
    Ok(connection.last_insert_rowid())
}

/// The link of an entry with this digest behind one with the link `before`.
pub(crate) fn link(before: Digest, digest: Digest) -> Digest {
    Digest::of([DigestPart::Digest(before), DigestPart::Digest(digest)])
}

/// Adds a stretch of the run with this key and id.
pub(crate) fn insert_stretch(
    connection: &Connection,
    key: i64,
    run: &str,
    stretch: &Stretch,
) -> Result<(), StoreError> {
    sql::execute(
        connection,
        "INSERT INTO stretches (run, epoch, started_at, rig_us, digest) VALUES (?1, ?2, ?3, ?4, ?5)",
        params![
            key,
            stretch.epoch.cast_signed(),
            stretch.started_at,
            stretch.rig_us.cast_signed(),
            stretch.digest(run).as_bytes(),
        ],
    )?;
    Ok(())
}

/// The stretches of a run, in order.
pub(crate) fn stretches(connection: &Connection, run: i64) -> rusqlite::Result<Vec<Stretch>> {
    connection
        .prepare_cached(
            "SELECT epoch, started_at, rig_us FROM stretches WHERE run = ?1 ORDER BY epoch",
        )?
        .query_map([run], |row| {
            Ok(Stretch {
                epoch: row.get::<_, i64>(0)?.cast_unsigned(),
                started_at: row.get(1)?,
                rig_us: row.get::<_, i64>(2)?.cast_unsigned(),
            })
        })?
        .collect()
}
