//! The journal as a file: its tables. Its records are in [`crate::record`].

mod amendments;
mod before;
#[cfg(test)]
mod tests;

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    process,
    sync::atomic::{AtomicU64, Ordering},
};

use rusqlite::{
    Connection, ErrorCode, OpenFlags, OptionalExtension, Row, config::DbConfig, params,
};
use sha2::{Digest, Sha256};

use crate::{
    record::{Cited, Record, RunStarted},
    seam::Stated,
};
use amendments::{done_elsewhere, head, left_out, settings_of};

pub(crate) use amendments::Head;
pub(crate) use before::before;

/// The format of the tables and records that this checker reads.
const FORMAT: u32 = 4;

/// The last time of each session in the epochs of a run. A session of months has many records, of which the last ones
/// are read.
const SESSIONS: &str = "
    SELECT epoch, max(last_us) FROM (
        SELECT epoch, (
            SELECT rig_us FROM records WHERE run = runs.key AND kind <> 'run_finished' ORDER BY seq DESC LIMIT 1
        ) AS last_us
        FROM runs
        WHERE kind = 'session' AND epoch IN (SELECT epoch FROM stretches WHERE run = ?1))
    WHERE last_us IS NOT NULL GROUP BY epoch";

/// The records of a run, and what moved the axes between them.
const ENTRIES: &str = "
    WITH own AS (SELECT min(id) AS first, max(id) AS last FROM records WHERE run = ?1)
    SELECT run, seq, records.epoch, rig_us, records.kind, payload, records.digest, runs.kind
    FROM own, records JOIN runs ON runs.key = records.run
    WHERE records.id BETWEEN own.first AND own.last
        AND (run = ?1 OR records.kind IN ('operator', 'intent', 'moved', 'fault', 'clock_jumped'))
    ORDER BY records.id";

/// Why a journal cannot be checked at all.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// SQLite cannot read the database.
    #[error("the journal cannot be read")]
    Sqlite(#[from] rusqlite::Error),
    /// A journal that cannot be written to could not be copied to the directory for temporary files.
    #[error("the journal cannot be copied to the directory for temporary files")]
    Copy(#[from] io::Error),
    /// The journal has another format.
    #[error("journal format {found} is not {FORMAT}, which this checker reads")]
    OtherFormat {
        /// The format found.
        found: u32,
    },
    /// There is no such run.
    #[error("no run {run}")]
    NoSuchRun {
        /// The id asked for.
        run: String,
    },
}

/// A run with its records. [`before::before`] reads what moved the axes before it.
#[derive(Debug)]
pub(crate) struct Journal {
    pub(crate) run: Listed,
    /// Whether it is read without the journal that it was in.
    pub(crate) is_alone: bool,
    /// The link of the entry before that of the run, if the links up to there hold.
    pub(crate) links: Result<(), Broken>,
    pub(crate) stretches: Vec<Stretch>,
    pub(crate) seal: Option<Seal>,
    /// The records from the first of the run to its last that may concern it, in the order in which they were
    /// written.
    pub(crate) entries: Vec<Entry>,
    /// Addresses of the touches that were left out before the run had ended. Those in [`Self::done_elsewhere`] need not be made
    /// either.
    pub(crate) left_out: Vec<String>,
    /// Whether the run has an amendment.
    pub(crate) is_amended: bool,
    /// Records of sweeps, and the largest number of a sweep of the amendments of the run, or of the run and
    /// its other amendments, before each: all of them are numbered together.
    pub(crate) numbered: BTreeMap<u64, u64>,
    /// Records at which the run goes on, and the touches that have an outcome in an ended amendment before each, with
    /// whether that is a refusal.
    pub(crate) done_elsewhere: BTreeMap<u64, BTreeMap<String, bool>>,
    /// The settings of the run that an amendment amends, and what its last part states.
    pub(crate) amended: Option<(Box<RunStarted>, Stated)>,
    /// The end of that run when it was amended.
    pub(crate) head: Option<Head>,
    /// The last record of a session, µs, in each epoch of the run. The end of a killed one is written later.
    pub(crate) sessions: BTreeMap<u64, u64>,
    /// The note that the readings of the run were moved to an archive.
    pub(crate) note: Option<Box<Journal>>,
    /// Why reading stopped early.
    pub(crate) damage: Option<String>,
}

impl Journal {
    /// The addresses of the touches that need no outcome in the run itself.
    pub(crate) fn elsewhere(&self) -> impl Iterator<Item = &String> {
        let done = self.done_elsewhere.values().flat_map(BTreeMap::keys);
        self.left_out.iter().chain(done)
    }

    /// The calibrations that the run or the amendment cites, at its beginning and where it goes on.
    pub(crate) fn cited(&self) -> Vec<Cited> {
        let own = self.entries.iter().filter(|entry| entry.is_own);
        let begins = ["run_started", "resumed", "amended"];
        let begun = own.filter(|entry| begins.contains(&entry.kind.as_str()));
        let cited = begun.flat_map(|entry| match serde_json::from_str(&entry.payload) {
            Ok(Record::RunStarted(started)) => started.calibrations,
            Ok(Record::Resumed(resumed)) => resumed.calibrations.unwrap_or_default(),
            Ok(Record::Amended(amended)) => amended.calibrations.unwrap_or_default(),
            _ => Vec::new(),
        });
        let mut all: Vec<Cited> = Vec::new();
        for cited in cited {
            if all.iter().all(|known| known.sha256 != cited.sha256) {
                all.push(cited);
            }
        }
        all
    }

    /// A sealed run without the journal that it was in.
    pub(crate) fn alone(
        run: Listed,
        stretches: Vec<Stretch>,
        seal: Seal,
        entries: Vec<Entry>,
    ) -> Self {
        Self {
            run,
            is_alone: true,
            links: Ok(()),
            stretches,
            seal: Some(seal),
            entries,
            left_out: Vec::new(),
            is_amended: false,
            numbered: BTreeMap::new(),
            done_elsewhere: BTreeMap::new(),
            amended: None,
            head: None,
            sessions: BTreeMap::new(),
            note: None,
            damage: None,
        }
    }
}

/// An entry of the list of runs.
#[derive(Debug, Clone)]
pub(crate) struct Listed {
    pub(crate) key: i64,
    pub(crate) id: String,
    pub(crate) kind: String,
    pub(crate) name: String,
    pub(crate) journal: String,
    pub(crate) bench: String,
    pub(crate) format: u64,
    pub(crate) epoch: u64,
    pub(crate) started_at: String,
    pub(crate) digest: Vec<u8>,
    pub(crate) link: Vec<u8>,
    pub(crate) finished_at: Option<String>,
    pub(crate) status: String,
}

impl Listed {
    /// The fields under the digest of the entry, in their order.
    pub(crate) fn parts(&self) -> [Part<'_>; 8] {
        [
            Part::Text(&self.bench),
            Part::Text(&self.journal),
            Part::Text(&self.id),
            Part::Text(&self.kind),
            Part::Text(&self.name),
            Part::Number(self.format),
            Part::Number(self.epoch),
            Part::Text(&self.started_at),
        ]
    }
}

/// An entry whose link does not follow from the one before it.
#[derive(Debug, Clone)]
pub(crate) struct Broken {
    pub(crate) run: String,
}

/// A part of a run on one clock.
#[derive(Debug, Clone)]
pub(crate) struct Stretch {
    pub(crate) epoch: u64,
    pub(crate) started_at: String,
    pub(crate) rig_us: u64,
    pub(crate) digest: Vec<u8>,
}

/// The seal of a run that has ended for good.
#[derive(Debug, Clone)]
pub(crate) struct Seal {
    pub(crate) records: u64,
    pub(crate) head: Vec<u8>,
    pub(crate) digest: Vec<u8>,
}

/// A stored record.
#[derive(Debug)]
pub(crate) struct Entry {
    /// Key of the run or session that it belongs to.
    pub(crate) key: i64,
    /// Whether it belongs to the run that is checked.
    pub(crate) is_own: bool,
    /// Whether it belongs to a session.
    pub(crate) is_of_session: bool,
    pub(crate) seq: u64,
    pub(crate) epoch: u64,
    pub(crate) rig_us: u64,
    pub(crate) kind: String,
    pub(crate) payload: String,
    pub(crate) digest: Vec<u8>,
}

/// A part of the input of a digest.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Part<'a> {
    /// 32 bytes.
    Digest(&'a [u8]),
    /// Eight bytes, the highest first.
    Number(u64),
    /// UTF-8 behind its length.
    Text(&'a str),
}

/// SHA-256 of the parts.
pub(crate) fn digest<'a>(parts: impl IntoIterator<Item = Part<'a>>) -> [u8; 32] {
    let mut hash = Sha256::new();
    for part in parts {
        match part {
            Part::Digest(bytes) => hash.update(bytes),
            Part::Number(number) => hash.update(number.to_be_bytes()),
            Part::Text(text) => {
                hash.update((text.len() as u64).to_be_bytes());
                hash.update(text);
            }
        }
    }
    hash.finalize().into()
}

/// Reads a run. Of other runs and sessions between its records only what moves the axes is read.
pub(crate) fn read(connection: &Connection, run: &str) -> Result<Journal, JournalError> {
    let found: u32 = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    if found != FORMAT {
        return Err(JournalError::OtherFormat { found });
    }
    let (run, links) = listed(connection, run)?;
    let (left_out, is_amended) = left_out(connection, &run)?;
    let mut journal = Journal {
        stretches: stretches(connection, run.key)?,
        seal: seal(connection, run.key)?,
        left_out,
        is_amended,
        numbered: numbered(connection, &run)?,
        done_elsewhere: done_elsewhere(connection, &run)?,
        links,
        entries: Vec::new(),
        amended: None,
        head: None,
        sessions: sessions(connection, run.key)?,
        is_alone: false,
        note: if run.kind == "archive" { None } else { note(connection, &run.id)? },
        run,
        damage: None,
    };
    if let Err(error) = entries(connection, journal.run.key, &mut journal.entries) {
        journal.damage = Some(error.to_string());
    }
    let first = journal.entries.iter().find(|entry| entry.is_own);
    if let Some(Ok(Record::Amended(amended))) = first.map(|e| serde_json::from_str(&e.payload)) {
        journal.amended = settings_of(connection, &amended, &journal.run)?;
        journal.head = head(connection, &amended, &journal.run)?;
    }
    Ok(journal)
}

/// Opens a database to read. One on a medium that cannot be written to has no writer; if it has a log, a
/// copy of both is read, because the log must be recovered first.
pub(crate) fn open(path: &Path) -> Result<Connection, JournalError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    connection.busy_timeout(std::time::Duration::from_secs(10))?;
    let probe = connection.query_row("SELECT count(*) FROM runs", [], |row| row.get::<_, i64>(0));
    let Err(error) = probe else { return Ok(connection) };
    let is_closed_to_writers = matches!(
        error.sqlite_error_code(),
        Some(ErrorCode::CannotOpen | ErrorCode::ReadOnly | ErrorCode::SystemIoFailure)
    );
    if !is_closed_to_writers {
        return Err(error.into());
    }
    let log = with_ending(path, "-wal");
    if fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
        return open_copy(path, &log);
    }
    let name = path.to_string_lossy().replace('%', "%25").replace('?', "%3f").replace('#', "%23");
    let uri = format!("file:{name}?immutable=1");
    Ok(Connection::open_with_flags(uri, flags | OpenFlags::SQLITE_OPEN_URI)?)
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

/// Opens a copy of a database and its log. The files of the copy have no names as soon as they are open.
fn open_copy(path: &Path, log: &Path) -> Result<Connection, JournalError> {
    static COPIES: AtomicU64 = AtomicU64::new(0);
    let number = COPIES.fetch_add(1, Ordering::Relaxed);
    let directory = std::env::temp_dir().join(format!("rigd-verify-{}-{number}", process::id()));
    let copied = || -> Result<Connection, JournalError> {
        fs::create_dir(&directory)?;
        let copy = directory.join("rigd.db");
        fs::copy(path, &copy)?;
        fs::copy(log, with_ending(&copy, "-wal"))?;
        let connection = Connection::open(&copy)?;
        connection.query_row("SELECT count(*) FROM runs", [], |row| row.get::<_, i64>(0))?;
        Ok(connection)
    };
    let opened = copied();
    // Where it cannot be removed, it can be read all the same.
    _ = fs::remove_dir_all(&directory);
    opened
}

/// Opens a database of this program in memory.
pub(crate) fn open_in_memory(address: &str) -> Result<Connection, rusqlite::Error> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(address, flags | OpenFlags::SQLITE_OPEN_URI)?;
    // A plan holds for all values, so that it is made once.
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_QPSG, true)?;
    Ok(connection)
}

/// The entry of a run, and whether the links of the list hold up to it.
fn listed(
    connection: &Connection,
    run: &str,
) -> Result<(Listed, Result<(), Broken>), JournalError> {
    let mut statement = connection.prepare_cached(
        "SELECT key, id, kind, name, journal, bench, format, epoch, started_at, digest, link,
                finished_at, status FROM runs ORDER BY key",
    )?;
    let mut rows = statement.query([])?;
    let (mut before, mut links) = (vec![0; 32], Ok(()));
    while let Some(row) = rows.next()? {
        let listed = Listed {
            key: row.get(0)?,
            id: row.get(1)?,
            kind: row.get(2)?,
            name: row.get(3)?,
            journal: row.get(4)?,
            bench: row.get(5)?,
            format: row.get::<_, i64>(6)?.cast_unsigned(),
            epoch: row.get::<_, i64>(7)?.cast_unsigned(),
            started_at: row.get(8)?,
            digest: row.get(9)?,
            link: row.get(10)?,
            finished_at: row.get(11)?,
            status: row.get(12)?,
        };
        if links.is_ok()
            && digest([Part::Digest(&before), Part::Digest(&listed.digest)])[..] != listed.link[..]
        {
            links = Err(Broken { run: listed.id.clone() });
        }
        if listed.id == run {
            return Ok((listed, links));
        }
        before = listed.link;
    }
    Err(JournalError::NoSuchRun { run: run.to_owned() })
}

fn stretches(connection: &Connection, key: i64) -> Result<Vec<Stretch>, rusqlite::Error> {
    connection
        .prepare_cached(
            "SELECT epoch, started_at, rig_us, digest FROM stretches WHERE run = ?1 ORDER BY epoch",
        )?
        .query_map([key], |row| {
            Ok(Stretch {
                epoch: row.get::<_, i64>(0)?.cast_unsigned(),
                started_at: row.get(1)?,
                rig_us: row.get::<_, i64>(2)?.cast_unsigned(),
                digest: row.get(3)?,
            })
        })?
        .collect()
}

fn seal(connection: &Connection, key: i64) -> Result<Option<Seal>, rusqlite::Error> {
    let of_row = |row: &rusqlite::Row<'_>| {
        let records = row.get::<_, i64>(0)?.cast_unsigned();
        Ok(Seal { records, head: row.get(1)?, digest: row.get(2)? })
    };
    connection
        .prepare_cached("SELECT records, head, seal FROM seals WHERE run = ?1")?
        .query_row([key], of_row)
        .optional()
}

fn sessions(connection: &Connection, key: i64) -> Result<BTreeMap<u64, u64>, rusqlite::Error> {
    let of_row = |row: &rusqlite::Row<'_>| {
        Ok((row.get::<_, i64>(0)?.cast_unsigned(), row.get::<_, i64>(1)?.cast_unsigned()))
    };
    connection.prepare_cached(SESSIONS)?.query_map([key], of_row)?.collect()
}

/// The sealed note about a run with this id.
fn note(connection: &Connection, run: &str) -> Result<Option<Box<Journal>>, JournalError> {
    let note: Option<String> = connection
        .prepare_cached(
            "SELECT id FROM runs JOIN seals ON seals.run = key
             WHERE kind = 'archive' AND name = ?1 ORDER BY key LIMIT 1",
        )?
        .query_row([run], |row| row.get(0))
        .optional()?;
    // One that is damaged beyond reading is missed by the chain of the run.
    note.map(|note| read(connection, &note).map(Box::new)).transpose()
}

/// The largest number of a sweep in what belongs together with a run or an amendment, before each of its
/// own sweeps.
fn numbered(connection: &Connection, run: &Listed) -> Result<BTreeMap<u64, u64>, rusqlite::Error> {
    let of_row = |row: &rusqlite::Row<'_>| {
        let number = row.get::<_, Option<i64>>(1)?.unwrap_or_default();
        Ok((row.get::<_, i64>(0)?.cast_unsigned(), number.cast_unsigned()))
    };
    let amends = if run.kind == "amendment" { &run.name } else { &run.id };
    // An amendment that was cut off has no outcome, and its numbers are given again.
    connection
        .prepare_cached(
            "WITH others AS (
                 SELECT key FROM runs WHERE key <> ?1 AND
                     (id = ?2 OR kind = 'amendment' AND name = ?2 AND status <> 'running')),
             sweeps AS (
                 SELECT id, json_extract(payload, '$.number') AS number FROM records
                 WHERE run IN (SELECT key FROM others) AND kind = 'sweep' AND json_valid(payload))
             SELECT seq, (SELECT max(number) FROM sweeps WHERE sweeps.id < records.id) FROM records
             WHERE run = ?1 AND kind = 'sweep' AND EXISTS (SELECT 1 FROM others)",
        )?
        .query_map(params![run.key, amends], of_row)?
        .collect()
}

fn entries(
    connection: &Connection,
    key: i64,
    entries: &mut Vec<Entry>,
) -> Result<(), rusqlite::Error> {
    let mut statement = connection.prepare_cached(ENTRIES)?;
    let mut rows = statement.query([key])?;
    while let Some(row) = rows.next()? {
        entries.push(Entry::from_row(row, key)?);
    }
    Ok(())
}

impl Entry {
    fn from_row(row: &Row<'_>, own: i64) -> Result<Self, rusqlite::Error> {
        let key: i64 = row.get(0)?;
        Ok(Self {
            key,
            is_own: key == own,
            is_of_session: row.get::<_, String>(7)? == "session",
            seq: row.get::<_, i64>(1)?.cast_unsigned(),
            epoch: row.get::<_, i64>(2)?.cast_unsigned(),
            rig_us: row.get::<_, i64>(3)?.cast_unsigned(),
            kind: row.get(4)?,
            payload: row.get(5)?,
            digest: row.get(6)?,
        })
    }
}
