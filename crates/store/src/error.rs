//! Why the journal could not be written or read.

use std::{
    io,
    path::{Path, PathBuf},
};

use rusqlite::ErrorCode;

use rig_record::{Flaw, NotARunId, Run, RunId, UnreadableRecord};

/// Why the journal in a data directory could not be written or read. It does not name the
/// directory.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A directory or a file of a journal cannot be made, locked, moved or removed.
    #[error("{} cannot be {}", path.display(), act.name())]
    Path {
        /// What was to be done with it.
        act: PathAct,
        /// The directory or file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A file has the name of the directory.
    #[error("is a file; a journal needs a directory")]
    NotADirectory,
    /// There is no journal in the directory.
    #[error("holds no journal")]
    NoJournal,
    /// There is a journal in a directory that is to get a new one.
    #[error("holds a journal already")]
    NotEmpty,
    /// A directory that is to get a restored journal is not empty.
    #[error("is not empty: it has {entry}")]
    Occupied {
        /// The first entry found in it.
        entry: String,
    },
    /// Another program writes to this directory.
    #[error("in use by another rigd")]
    InUse,
    /// The database was written by another version of the program.
    #[error(
        "journal format {found} is not {known}, which this rigd reads and writes: use the rigd that \
         wrote it, or another data directory"
    )]
    OtherFormat {
        /// The format found.
        found: u32,
        /// The format of this program.
        known: u32,
    },
    /// No space is left.
    #[error("the disk is full")]
    DiskFull,
    /// The system failed to read or write.
    #[error("reading or writing the journal failed")]
    Io(#[source] SqliteError),
    /// There is no write-ahead log, so that readers would hold up the writer.
    #[error("SQLite keeps its journal in mode `{mode}`; rigd needs `wal`")]
    NoLog {
        /// The mode that it keeps.
        mode: String,
    },
    /// The database file is damaged.
    #[error("the database is damaged")]
    Damaged(#[source] SqliteError),
    /// SQLite refused for another reason.
    #[error("the database refused")]
    Sqlite(#[source] SqliteError),
    /// An earlier write failed. The records that were not committed then are lost, and nothing can
    /// be added.
    #[error("closed by an earlier failure")]
    Closed,
    /// The run has ended.
    #[error("run {run} has ended; no {kind} can be added")]
    Ended {
        /// Id of the run.
        run: RunId,
        /// The kind of record refused.
        kind: &'static str,
    },
    /// The run is sealed: it was completed or given up.
    #[error("run {run} is {status} and sealed; nothing can be added")]
    Sealed {
        /// Name and id of the run.
        run: String,
        /// How the run ended.
        status: String,
    },
    /// The run has no seal: it can go on.
    #[error("run {run} is {status} and not sealed")]
    NotSealed {
        /// Name and id of the run.
        run: String,
        /// Status of the run.
        status: String,
    },
    /// The readings of the run are in an archive.
    #[error("run {run} is archived; its readings are in {place}")]
    Archived {
        /// Id of the run.
        run: RunId,
        /// Path of its folder in the archive.
        place: String,
    },
    /// The journal is that of a run in an archive.
    #[error("holds a run of an archive, which is never written")]
    IsExcerpt,
    /// The run is under way.
    #[error("run {run} is under way")]
    UnderWay {
        /// Name and id of the run.
        run: String,
    },
    /// A record holds a number that is infinite or not a number.
    #[error("{kind} record")]
    Unwritable {
        /// The kind of the record.
        kind: &'static str,
        /// Step that failed.
        source: serde_json::Error,
    },
    /// A stored record cannot be understood.
    #[error(transparent)]
    Unreadable(#[from] UnreadableRecord),
    /// The chain of a run is broken. The records before the flaw can still be read.
    #[error("run {run}, record {seq}: {flaw}")]
    Broken {
        /// Id of the run.
        run: RunId,
        /// The number of the first bad record in the run.
        seq: u64,
        /// Kind of the first flaw.
        flaw: Flaw,
    },
    /// There is no such run.
    #[error("no run `{wanted}`")]
    NoSuchRun {
        /// The requested run.
        wanted: String,
    },
    /// The request fits more than one run.
    #[error(
        "`{wanted}` fits {} runs: {}; give one of these names, or more of an id",
        candidates.len(),
        listed(candidates)
    )]
    Ambiguous {
        /// The requested run.
        wanted: String,
        /// Runs that match, the latest first.
        candidates: Vec<Run>,
    },
}

impl StoreError {
    /// Whether the journal itself is damaged, so that a salvage helps.
    pub const fn is_damage(&self) -> bool {
        matches!(self, Self::Damaged(_) | Self::Broken { .. })
    }
}

/// What is done with a directory or a file of a journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathAct {
    /// It is made, if it is missing.
    Make,
    /// It is locked against other writers.
    Lock,
    /// Its entries are listed.
    List,
    /// It is copied to the directory for temporary files.
    Copy,
    /// It gets its place, and the disk has it.
    Place,
    /// It is removed.
    Remove,
}

impl PathAct {
    /// The error of this act, for `map_err`.
    pub(crate) fn failed(self, path: &Path) -> impl FnOnce(io::Error) -> StoreError {
        move |source| StoreError::Path { act: self, path: path.to_owned(), source }
    }

    /// The participle in messages.
    const fn name(self) -> &'static str {
        match self {
            Self::Make => "made",
            Self::Lock => "locked",
            Self::List => "listed",
            Self::Copy => "copied to the directory for temporary files",
            Self::Place => "put in its place",
            Self::Remove => "removed",
        }
    }
}

/// The error of SQLite, without its cause, which only repeats it as a code.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct SqliteError(rusqlite::Error);

/// The first runs of a list, and how many more there are.
fn listed(runs: &[Run]) -> String {
    /// The number of runs that a message lists.
    const SHOWN: usize = 5;
    let mut listed: Vec<_> = runs.iter().take(SHOWN).map(ToString::to_string).collect();
    if runs.len() > SHOWN {
        listed.push(format!("and {} older ones", runs.len() - SHOWN));
    }
    listed.join(", ")
}

impl From<NotARunId> for StoreError {
    fn from(NotARunId { text }: NotARunId) -> Self {
        Self::NoSuchRun { wanted: text }
    }
}

impl From<rusqlite::Error> for StoreError {
    fn from(error: rusqlite::Error) -> Self {
        match error.sqlite_error_code() {
            Some(ErrorCode::DiskFull) => Self::DiskFull,
            Some(ErrorCode::SystemIoFailure | ErrorCode::ReadOnly | ErrorCode::CannotOpen) => {
                Self::Io(SqliteError(error))
            }
            Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
                Self::Damaged(SqliteError(error))
            }
            None if is_of_value(&error) => Self::Damaged(SqliteError(error)),
            _ => Self::Sqlite(SqliteError(error)),
        }
    }
}

/// Whether a value in the database is none that is ever written to its column.
const fn is_of_value(error: &rusqlite::Error) -> bool {
    matches!(
        error,
        rusqlite::Error::InvalidColumnType(..)
            | rusqlite::Error::FromSqlConversionFailure(..)
            | rusqlite::Error::IntegralValueOutOfRange(..)
            | rusqlite::Error::Utf8Error(..)
    )
}
