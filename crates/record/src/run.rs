//! Runs and their ids.

use std::{fmt, str::FromStr};

use uuid::Uuid;

use crate::Ending;

/// The id of a run: a UUID whose first part is the time at which it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RunId(Uuid);

impl RunId {
    /// The id that is this UUID.
    pub const fn new(uuid: Uuid) -> Self {
        Self(uuid)
    }
}

impl fmt::Display for RunId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A text that is not the id of a run.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is not the id of a run")]
pub struct NotARunId {
    /// The text that is not an id.
    pub text: String,
}

impl FromStr for RunId {
    type Err = NotARunId;

    fn from_str(text: &str) -> Result<Self, NotARunId> {
        Uuid::parse_str(text).map(Self).map_err(|_| NotARunId { text: text.to_owned() })
    }
}

/// The kind of a journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunKind {
    /// The run of a protocol.
    Run,
    /// A session: single sweeps, manual moves and faults between runs.
    Session,
    /// One touch of a run, measured again or left out.
    Amendment,
    /// The note of a run whose readings were moved to an archive.
    Archive,
}

impl RunKind {
    /// The word in the database, in results and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Session => "session",
            Self::Amendment => "amendment",
            Self::Archive => "archive",
        }
    }

    /// The value with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Run, Self::Session, Self::Amendment, Self::Archive]
            .into_iter()
            .find(|kind| kind.name() == name)
    }
}

/// The status of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunStatus {
    /// Not ended yet.
    Running,
    /// Not ended, and its program has ended. A run can be resumed; a session ends as
    /// [`Ending::Interrupted`] when the journal is next opened to write.
    Interrupted,
    /// Ended by its program or by a person.
    Ended(Ending),
}

impl RunStatus {
    /// The word in the database, in results and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Interrupted => Ending::Interrupted.name(),
            Self::Ended(ending) => ending.name(),
        }
    }

    /// Whether the program ended during the run.
    pub const fn is_interrupted(self) -> bool {
        matches!(self, Self::Interrupted | Self::Ended(Ending::Interrupted))
    }

    /// The status in messages.
    pub fn describe(self) -> String {
        self.name().replace('_', " ")
    }

    /// The value with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let endings = Ending::ALL.into_iter().map(Self::Ended);
        endings.chain([Self::Running]).find(|status| status.name() == name)
    }
}

/// An entry of the list of runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Id of the run.
    pub id: RunId,
    /// Kind of the journal.
    pub kind: RunKind,
    /// Its name: that of the protocol, for a run; the id of the amended or archived run, for an amendment
    /// or a note of an archive.
    pub name: String,
    /// Number among the runs of this kind and name, from 1.
    pub number: u64,
    /// When it began: wall clock, UTC, RFC 3339 with milliseconds.
    pub started_at: String,
    /// When it ended, UTC, RFC 3339; of an interrupted run, the time of its last record.
    pub finished_at: Option<String>,
    /// Duration by the wall clock, s.
    pub wall_s: Option<f64>,
    /// Status of the run.
    pub status: RunStatus,
    /// Number of records.
    pub records: u64,
    /// Number of the epoch in which it was begun, or resumed last: the opening of the journal.
    pub epoch: u64,
    /// Number of its amendments that have ended.
    pub amendments: u64,
    /// Whether it has ended for good and has a seal.
    pub is_sealed: bool,
}

impl Run {
    /// Whether it can be resumed or given up: a run of a protocol that is not running, completed or
    /// given up.
    pub fn is_resumable(&self) -> bool {
        self.kind == RunKind::Run && self.status != RunStatus::Running && !self.is_sealed
    }

    /// Short name: the name of the protocol and the number, such as `smoke-7`.
    pub fn short_name(&self) -> String {
        format!("{}-{}", self.name, self.number)
    }
}

/// The short name, the id and the time of the beginning, which distinguish runs.
impl fmt::Display for Run {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {})", self.short_name(), self.id, self.started_at)
    }
}
