//! Why the journal could not be written or read.

use std::{io, path::PathBuf};

use rusqlite::ErrorCode;

use crate::{Flaw, Run, RunId};

/// Why the journal could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The data directory cannot be made or its lock file not opened.
    #[error("data directory {}: {source}", path.display())]
    Directory {
        /// The path.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is no journal in the directory.
    #[error("data directory {} holds no journal", path.display())]
    NoJournal {
        /// The path.
        path: PathBuf,
    },
    /// Another program writes to this directory.
    #[error("data directory {} is in use by another rigd", path.display())]
    InUse {
        /// The path.
        path: PathBuf,
    },
    /// The database was written by a newer program.
    #[error("journal format {found} is newer than {known}, the newest that this program knows")]
    Newer {
        /// The format found.
        found: u32,
        /// The newest format known.
        known: u32,
    },
    /// No space is left.
    #[error("journal: the disk is full")]
    DiskFull,
    /// The system failed to read or write.
    #[error("journal: input or output failed: {0}")]
    Io(#[source] rusqlite::Error),
    /// The database file is damaged.
    #[error("journal: the database is damaged: {0}")]
    Damaged(#[source] rusqlite::Error),
    /// SQLite refused for another reason.
    #[error("journal: {0}")]
    Sqlite(#[source] rusqlite::Error),
    /// An earlier write failed. What was not committed then is lost, and nothing can be added.
    #[error("journal: closed by an earlier failure")]
    Closed,
    /// The run has ended.
    #[error("journal: run {run} has ended; no {kind} can be added")]
    Ended {
        /// The run.
        run: RunId,
        /// The kind of record refused.
        kind: &'static str,
    },
    /// A record holds a number that is infinite or not a number.
    #[error("journal: {kind} record: {source}")]
    Unwritable {
        /// The kind of the record.
        kind: &'static str,
        /// Where it went wrong.
        source: serde_json::Error,
    },
    /// A stored record cannot be understood.
    #[error("journal: run {run}, record {seq}: {source}")]
    Unreadable {
        /// The run.
        run: RunId,
        /// The record's number in the run.
        seq: u64,
        /// Where it went wrong.
        source: serde_json::Error,
    },
    /// The chain of a run is broken. What stands before the flaw can still be read.
    #[error("journal: run {run}, record {seq}: {flaw}")]
    Broken {
        /// The run.
        run: RunId,
        /// The number of the first bad record in the run.
        seq: u64,
        /// What is wrong with it.
        flaw: Flaw,
    },
    /// There is no such run.
    #[error("journal: no run `{wanted}`")]
    NoSuchRun {
        /// What was asked for.
        wanted: String,
    },
    /// What was asked for fits more than one run.
    #[error(
        "journal: `{wanted}` fits {} runs: {}; give one of these names, or more of an id",
        candidates.len(),
        listed(candidates)
    )]
    Ambiguous {
        /// What was asked for.
        wanted: String,
        /// Which fit, the latest first.
        candidates: Vec<Run>,
    },
}

/// The first runs of a list, and how many more there are.
fn listed(runs: &[Run]) -> String {
    /// As many as a person looks through.
    const SHOWN: usize = 5;
    let mut listed: Vec<_> = runs.iter().take(SHOWN).map(ToString::to_string).collect();
    if runs.len() > SHOWN {
        listed.push(format!("and {} older ones", runs.len() - SHOWN));
    }
    listed.join(", ")
}

impl From<rusqlite::Error> for StoreError {
    fn from(error: rusqlite::Error) -> Self {
        match error.sqlite_error_code() {
            Some(ErrorCode::DiskFull) => Self::DiskFull,
            Some(ErrorCode::SystemIoFailure | ErrorCode::ReadOnly | ErrorCode::CannotOpen) => {
                Self::Io(error)
            }
            Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => Self::Damaged(error),
            _ => Self::Sqlite(error),
        }
    }
}
