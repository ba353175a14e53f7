//! A journal in memory, for simulated computers: the tables and statements of a journal on disk,
//! without files and fsync, and with a disk that fails when it is told to.

use std::{
    ops::Deref,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use rusqlite::{Connection, OpenFlags, ffi};
use uuid::Uuid;

use crate::{
    StoreError,
    lock::{self, DirectoryLock},
    schema,
};

/// The disk of a simulated computer, with at most one journal. The journal survives the program that
/// writes it, and is lost with the last clone of the disk.
#[derive(Debug, Clone)]
pub struct MemoryDisk(Arc<Disk>);

#[derive(Debug)]
struct Disk {
    /// The address of the database for SQLite.
    uri: String,
    /// Keeps the database while no program has it open.
    keeper: Mutex<Connection>,
    /// Connections that were closed, of readers and of writers, with their statements.
    idle: [Mutex<Vec<Connection>>; 2],
    is_locked: AtomicBool,
    failure: Mutex<Option<Failing>>,
}

/// A failure that waits for its call.
#[derive(Debug, Clone, Copy)]
struct Failing {
    failure: DiskFailure,
    calls_left: u64,
}

/// A failure of a disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DiskFailure {
    /// No space is left.
    Full,
    /// Writing fails.
    Io,
    /// Nothing may be written.
    ReadOnly,
}

impl DiskFailure {
    /// The error that SQLite reports.
    fn error(self) -> rusqlite::Error {
        let code = match self {
            Self::Full => ffi::SQLITE_FULL,
            Self::Io => ffi::SQLITE_IOERR_WRITE,
            Self::ReadOnly => ffi::SQLITE_READONLY,
        };
        rusqlite::Error::SqliteFailure(ffi::Error::new(code), None)
    }
}

impl MemoryDisk {
    /// An empty disk.
    ///
    /// # Errors
    /// [`StoreError`] of SQLite.
    pub fn new() -> Result<Self, StoreError> {
        let uri = format!("file:/rigd-{}?vfs=memdb", Uuid::now_v7());
        let keeper = Mutex::new(connect(&uri)?);
        let (is_locked, failure) = (AtomicBool::new(false), Mutex::new(None));
        Ok(Self(Arc::new(Disk { uri, keeper, idle: Default::default(), is_locked, failure })))
    }

    /// Makes it a new and empty disk.
    ///
    /// # Errors
    /// [`StoreError::InUse`] while a store is open on it, or [`StoreError`] of SQLite.
    pub fn wipe(&self) -> Result<(), StoreError> {
        let _lock = Medium::Memory(self.clone()).take()?;
        self.mend();
        let mut keeper = self.0.keeper.lock().unwrap_or_else(PoisonError::into_inner);
        if schema::check_format(&keeper)? != 0 {
            schema::empty(&mut keeper)?;
        }
        Ok(())
    }

    /// The address of the database for SQLite, in this program.
    pub fn uri(&self) -> &str {
        &self.0.uri
    }

    /// Lets every call of a writer fail, from the n-th call from now on. The next one is the first.
    pub fn fail_from(&self, nth: u64, failure: DiskFailure) {
        *self.failure() = Some(Failing { failure, calls_left: nth });
    }

    /// Ends a failure.
    pub fn mend(&self) {
        *self.failure() = None;
    }

    fn idle(&self, user: User) -> MutexGuard<'_, Vec<Connection>> {
        self.0.idle[user as usize].lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn failure(&self) -> MutexGuard<'_, Option<Failing>> {
        self.0.failure.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a call of a writer.
    fn call(&self) -> Result<(), StoreError> {
        let Some(failing) = &mut *self.failure() else { return Ok(()) };
        failing.calls_left = failing.calls_left.saturating_sub(1);
        if failing.calls_left == 0 { Err(failing.failure.error().into()) } else { Ok(()) }
    }
}

fn connect(uri: &str) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
        | OpenFlags::SQLITE_OPEN_CREATE
        | OpenFlags::SQLITE_OPEN_URI
        | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    Connection::open_with_flags(uri, flags)
}

/// Who uses a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum User {
    Reader,
    Writer,
}

/// A connection. One to a simulated disk stays open for the next user of its kind.
#[derive(Debug)]
pub(crate) struct Lent {
    /// `None` only while it is dropped.
    connection: Option<Connection>,
    disk: Option<(MemoryDisk, User)>,
}

impl Lent {
    /// A connection to a simulated disk.
    fn of(
        disk: &MemoryDisk,
        user: User,
        open: impl FnOnce(rusqlite::Result<Connection>) -> Result<Connection, StoreError>,
    ) -> Result<Self, StoreError> {
        let idle = disk.idle(user).pop();
        let connection = idle.map_or_else(|| open(connect(disk.uri())), Ok)?;
        Ok(Self { connection: Some(connection), disk: Some((disk.clone(), user)) })
    }
}

impl From<Connection> for Lent {
    fn from(connection: Connection) -> Self {
        Self { connection: Some(connection), disk: None }
    }
}

impl Deref for Lent {
    type Target = Connection;

    fn deref(&self) -> &Connection {
        self.connection.as_ref().expect("it is there until it is dropped")
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        let (Some(connection), Some((disk, user))) = (self.connection.take(), &self.disk) else {
            return;
        };
        // A program that ends leaves what it has committed.
        if connection.is_autocommit() || connection.execute_batch("ROLLBACK").is_ok() {
            disk.idle(*user).push(connection);
        }
    }
}

/// Where a journal is.
#[derive(Debug, Clone)]
pub(crate) enum Medium {
    Directory(PathBuf),
    Memory(MemoryDisk),
}

/// Releases the disk when it is dropped.
#[derive(Debug)]
struct MemoryLock(MemoryDisk);

impl Drop for MemoryLock {
    fn drop(&mut self) {
        self.0.0.is_locked.store(false, Ordering::Release);
    }
}

/// Held while a store is open.
pub(crate) type Held = Box<dyn std::fmt::Debug + Send>;

impl Medium {
    /// Takes the place for one writer.
    pub(crate) fn take(&self) -> Result<Held, StoreError> {
        match self {
            Self::Directory(directory) => Ok(Box::new(DirectoryLock::take(directory)?)),
            Self::Memory(disk) if disk.0.is_locked.swap(true, Ordering::Acquire) => {
                Err(StoreError::InUse)
            }
            Self::Memory(disk) => Ok(Box::new(MemoryLock(disk.clone()))),
        }
    }

    /// Whether a program has it open to write.
    pub(crate) fn has_writer(&self) -> bool {
        match self {
            Self::Directory(directory) => lock::is_held(directory),
            Self::Memory(disk) => disk.0.is_locked.load(Ordering::Acquire),
        }
    }

    pub(crate) fn open_to_write(&self) -> Result<Lent, StoreError> {
        match self {
            Self::Directory(directory) => {
                Ok(schema::open_to_write(&schema::database(directory))?.into())
            }
            Self::Memory(disk) => Lent::of(disk, User::Writer, |opened| schema::set_up(opened?)),
        }
    }

    pub(crate) fn open_to_read(&self) -> Result<(Lent, Option<schema::Copied>), StoreError> {
        match self {
            Self::Directory(directory) => {
                let path = schema::database(directory);
                if !path.exists() {
                    return Err(StoreError::NoJournal);
                }
                let (connection, copy) = schema::open_to_read(&path)?;
                Ok((connection.into(), copy))
            }
            Self::Memory(disk) => {
                // Its writer is on the same thread: to wait for it would be to wait for ever.
                let open = |opened| schema::reading(opened, Duration::ZERO);
                Ok((Lent::of(disk, User::Reader, open)?, None))
            }
        }
    }

    /// Counts a call of a writer on a disk that may fail.
    pub(crate) fn call(&self) -> Result<(), StoreError> {
        match self {
            Self::Directory(_) => Ok(()),
            Self::Memory(disk) => disk.call(),
        }
    }

    pub(crate) fn directory(&self) -> Option<&Path> {
        match self {
            Self::Directory(directory) => Some(directory),
            Self::Memory(_) => None,
        }
    }
}
