//! Records as they are stored, each chained to the one before it by its digest.

use std::fmt;

use crate::{Digest, Record, RunId};

/// A stored record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredRecord {
    /// The id of the event, rising over all runs of the data directory.
    pub event: u64,
    /// Id of the run.
    pub run: RunId,
    /// Its number in the run, from 1.
    pub seq: u64,
    /// Microseconds since the rig was opened.
    pub rig_us: u64,
    /// Number of the epoch: the opening of the journal from which `rig_us` counts.
    pub epoch: u64,
    /// Microseconds since the run began: by the rig's clock within an epoch, by the wall clock
    /// between two. 0 when the beginning of the run or of this part is missing.
    pub run_us: u64,
    /// When: the beginning of the run by the wall clock, and from there on by the rig's clock. UTC,
    /// RFC 3339 with milliseconds. None when the first record of the run is missing.
    pub at: Option<String>,
    /// The kind of record.
    pub kind: String,
    /// The record as JSON.
    pub payload: String,
    /// Digest of the record and of the ones before it.
    pub digest: Digest,
}

impl StoredRecord {
    /// The record itself.
    ///
    /// # Errors
    /// [`UnreadableRecord`] when its JSON is not that of a known kind of record.
    pub fn record(&self) -> Result<Record, UnreadableRecord> {
        serde_json::from_str(&self.payload).map_err(|source| UnreadableRecord {
            run: self.run,
            seq: self.seq,
            source,
        })
    }

    /// Whether the record may be the first one of another epoch.
    pub fn opens_epoch(&self) -> bool {
        match self.record() {
            Ok(Record::Resumed(resumed)) => resumed.epoch == self.epoch,
            Ok(Record::GivenUp(given_up)) => given_up.epoch == self.epoch,
            _ => false,
        }
    }

    /// Whether this is record `seq` of its run, unaltered, behind one with the digest `before`.
    pub fn follows(&self, seq: u64, before: &Digest) -> bool {
        self.seq == seq && self.digest == before.next(seq, self.rig_us, &self.kind, &self.payload)
    }
}

/// A stored record that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("run {run}, record {seq}")]
pub struct UnreadableRecord {
    /// Id of the run.
    pub run: RunId,
    /// The record's number in the run.
    pub seq: u64,
    /// The error of the JSON.
    source: serde_json::Error,
}

/// The records of a run up to the first flaw.
#[derive(Debug)]
pub struct Chain {
    /// Records whose digests are right.
    pub records: Vec<StoredRecord>,
    /// Whether the chain is complete.
    pub check: ChainCheck,
}

/// Whether the chain of a run holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChainCheck {
    /// All records are there, as they were written.
    Intact {
        /// Number of records.
        records: u64,
        /// The digest of the last one.
        digest: Digest,
    },
    /// They are not.
    Broken {
        /// The number of the first bad record in the run.
        seq: u64,
        /// Kind of the first flaw.
        flaw: Flaw,
    },
}

/// A flaw of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Flaw {
    /// The record is missing.
    Missing,
    /// The record differs from the one that was written.
    Altered,
    /// The database is damaged at the record.
    Unreadable {
        /// Message of SQLite.
        reason: String,
    },
    /// The last record and the list of runs have different ends of the run.
    EndDiffers,
    /// The entry of the run in the list of runs does not match its digest.
    ListDiffers,
    /// The seal of the run is missing, or does not fit its records and its entry in the list of
    /// runs.
    SealDiffers,
    /// The readings of the run were archived, and the note of it does not fit the run.
    NoteDiffers,
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => f.write_str("the record is missing"),
            Self::Altered => f.write_str("the record does not match its digest"),
            Self::Unreadable { reason } => write!(f, "the record cannot be read: {reason}"),
            Self::EndDiffers => f.write_str("the list of runs has another end of the run"),
            Self::ListDiffers => {
                f.write_str("the entry in the list of runs does not match its digest")
            }
            Self::NoteDiffers => f.write_str("the note of its archive does not fit the run"),
            Self::SealDiffers => {
                f.write_str("the seal is missing, or does not fit the records and the list of runs")
            }
        }
    }
}
