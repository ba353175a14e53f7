//! The tables, and how a database is opened.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::Duration,
};

use rusqlite::{Connection, OpenFlags};
use uuid::Uuid;

use crate::{PathAct, StoreError, sql};

/// The version of the records and tables. A journal of another version is refused.
pub const FORMAT: u32 = 4;

/// `records.id` is the id of the event and is never reused; `(run, seq)` counts without gaps.
/// During a run, `finished_at` is the time of its last record. docs/data.md describes every column
/// and digest.
pub(crate) const TABLES: &str = "
CREATE TABLE meta (
    journal TEXT NOT NULL,
    bench TEXT NOT NULL,
    created_at TEXT NOT NULL
) STRICT;
CREATE TABLE epochs (
    n INTEGER PRIMARY KEY,
    opened_at TEXT NOT NULL,
    boot_id TEXT,
    software TEXT NOT NULL,
    is_clock_synced INTEGER
) STRICT;
CREATE TABLE runs (
    key INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    kind TEXT NOT NULL,
    name TEXT NOT NULL,
    journal TEXT NOT NULL,
    bench TEXT NOT NULL,
    format INTEGER NOT NULL,
    epoch INTEGER NOT NULL,
    started_at TEXT NOT NULL,
    digest BLOB NOT NULL,
    link BLOB NOT NULL,
    finished_at TEXT,
    status TEXT NOT NULL
) STRICT;
CREATE TABLE stretches (
    run INTEGER NOT NULL REFERENCES runs (key),
    epoch INTEGER NOT NULL REFERENCES epochs (n),
    started_at TEXT NOT NULL,
    rig_us INTEGER NOT NULL,
    digest BLOB NOT NULL,
    PRIMARY KEY (run, epoch)
) STRICT;
CREATE TABLE records (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    run INTEGER NOT NULL REFERENCES runs (key),
    seq INTEGER NOT NULL,
    epoch INTEGER NOT NULL REFERENCES epochs (n),
    rig_us INTEGER NOT NULL,
    kind TEXT NOT NULL,
    payload TEXT NOT NULL,
    digest BLOB NOT NULL,
    UNIQUE (run, seq)
) STRICT;
CREATE TABLE seals (
    run INTEGER PRIMARY KEY REFERENCES runs (key),
    records INTEGER NOT NULL,
    head BLOB NOT NULL,
    seal BLOB NOT NULL,
    signature BLOB
) STRICT;
";

/// When a row of `records` was made: the beginning of its stretch by the wall clock, and from there
/// on
/// by the rig's clock.
pub(crate) const TIME_OF_RECORD: &str = "(
    SELECT strftime('%Y-%m-%dT%H:%M:%fZ', stretches.started_at,
                    printf('%.3f seconds', (records.rig_us - stretches.rig_us) / 1e6))
    FROM stretches WHERE stretches.run = records.run AND stretches.epoch = records.epoch)";

/// The file of the database in a data directory.
pub(crate) fn database(directory: &Path) -> PathBuf {
    directory.join("rigd.db")
}

/// Opens the database to write, and makes its tables where they are missing.
pub(crate) fn open_to_write(path: &Path) -> Result<Connection, StoreError> {
    with_log(set_up(Connection::open(path)?)?)
}

/// The connection, if it has a write-ahead log: SQLite keeps another mode without an error where it cannot have
/// one.
pub(crate) fn with_log(connection: Connection) -> Result<Connection, StoreError> {
    let mode: String = connection.pragma_query_value(None, "journal_mode", |row| row.get(0))?;
    if mode == "wal" { Ok(connection) } else { Err(StoreError::NoLog { mode }) }
}

/// Prepares a database for writing, and makes its tables where they are missing.
pub(crate) fn set_up(mut connection: Connection) -> Result<Connection, StoreError> {
    connection.busy_timeout(BUSY)?;
    sql::keep_statements(&connection)?;
    // Readers work while the writer appends, and a commit is one fsync of the log.
    connection.pragma_update(None, "journal_mode", "WAL")?;
    // Without FULL the last commits may be lost with the power.
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    let found = check_format(&connection)?;
    if found == 0 {
        let transaction = connection.transaction()?;
        transaction.execute_batch(TABLES)?;
        give_ids(&transaction)?;
        transaction.pragma_update(None, "user_version", FORMAT)?;
        transaction.commit()?;
    }
    Ok(connection)
}

/// Gives ids to a journal and its bench.
fn give_ids(connection: &Connection) -> rusqlite::Result<()> {
    connection.execute(
        "INSERT INTO meta VALUES (?1, ?2, strftime('%Y-%m-%dT%H:%M:%fZ', 'now'))",
        [Uuid::now_v7().to_string(), Uuid::now_v7().to_string()],
    )?;
    Ok(())
}

/// Removes everything from a database with tables, which is another journal then.
pub(crate) fn empty(connection: &mut Connection) -> rusqlite::Result<()> {
    // Rows are removed all at once where no other row may need them.
    connection.pragma_update(None, "foreign_keys", false)?;
    let transaction = connection.transaction()?;
    transaction.execute_batch(
        "DELETE FROM seals; DELETE FROM records; DELETE FROM stretches; DELETE FROM runs;
         DELETE FROM epochs; DELETE FROM meta; DELETE FROM sqlite_sequence;",
    )?;
    give_ids(&transaction)?;
    transaction.commit()
}

/// Opens the database to read.
///
/// The file is opened for writing if that is allowed, because the log of a crashed program must be
/// recovered before it can be read. Otherwise a database without a log is read directly, and one
/// with a log is copied to the directory for temporary files first; the copy is returned too.
pub(crate) fn open_to_read(path: &Path) -> Result<(Connection, Option<Copied>), StoreError> {
    open_by(path, |opened| reading(opened, BUSY))
}

/// Opens the database to read what is left of it, as [`open_to_read`] does. One that was cut is read up to the cut.
pub(crate) fn open_to_salvage(path: &Path) -> Result<(Connection, Option<Copied>), StoreError> {
    open_by(path, |opened| {
        let connection = opened?;
        // SQLite refuses a file that is shorter than its head says, unless this is set. Nothing is written.
        connection.pragma_update(None, "writable_schema", true)?;
        reading(Ok(connection), BUSY)
    })
}

/// Opens the database with what prepares it for reading.
fn open_by(
    path: &Path,
    prepare: impl Fn(rusqlite::Result<Connection>) -> Result<Connection, StoreError>,
) -> Result<(Connection, Option<Copied>), StoreError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    match prepare(Connection::open_with_flags(path, flags)) {
        Err(StoreError::Io(_)) => {}
        opened => return Ok((opened?, None)),
    }
    let log = log_of(path);
    if fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
        let copy = Copied::of(path, &log).map_err(PathAct::Copy.failed(path))?;
        let connection = prepare(Connection::open_with_flags(database(&copy.0), flags))?;
        return Ok((connection, Some(copy)));
    }
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
        | OpenFlags::SQLITE_OPEN_NO_MUTEX
        | OpenFlags::SQLITE_OPEN_URI;
    // The path is the only part of the address; these characters have a meaning there.
    let escaped =
        path.to_string_lossy().replace('%', "%25").replace('?', "%3f").replace('#', "%23");
    let uri = format!("file:{escaped}?immutable=1");
    Ok((prepare(Connection::open_with_flags(uri, flags))?, None))
}

/// Pages that a reader keeps, kB. A daemon has some readers, and each would keep 2 MB of what it has read in weeks.
const READER_CACHE_KB: i64 = 512;

/// Prepares a database for reading, with this patience for a writer.
pub(crate) fn reading(
    opened: rusqlite::Result<Connection>,
    patience: Duration,
) -> Result<Connection, StoreError> {
    let connection = opened?;
    connection.busy_timeout(patience)?;
    sql::keep_statements(&connection)?;
    connection.pragma_update(None, "query_only", true)?;
    connection.pragma_update(None, "cache_size", -READER_CACHE_KB)?;
    // Its program ended before it had made the tables.
    if check_format(&connection)? == 0 {
        return Err(StoreError::NoJournal);
    }
    // The first reading of a table needs the log.
    connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get::<_, i64>(0))?;
    Ok(connection)
}

fn log_of(path: &Path) -> PathBuf {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    log.into()
}

/// A copy of a database and its log, removed with the value.
#[derive(Debug)]
pub(crate) struct Copied(PathBuf);

impl Copied {
    fn of(path: &Path, log: &Path) -> io::Result<Self> {
        let directory = std::env::temp_dir().join(format!("rigd-{}", Uuid::now_v7()));
        fs::create_dir(&directory)?;
        let copied = Self(directory);
        fs::copy(path, database(&copied.0))?;
        fs::copy(log, log_of(&database(&copied.0)))?;
        Ok(copied)
    }
}

impl Drop for Copied {
    fn drop(&mut self) {
        // Best effort: the system tidies its temporary files too.
        _ = fs::remove_dir_all(&self.0);
    }
}

/// Longer than any checkpoint takes.
const BUSY: Duration = Duration::from_secs(10);

/// The format of a database, 0 if it has no tables yet.
pub(crate) fn check_format(connection: &Connection) -> Result<u32, StoreError> {
    let found = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    if [0, FORMAT].contains(&found) {
        Ok(found)
    } else {
        Err(StoreError::OtherFormat { found, known: FORMAT })
    }
}
