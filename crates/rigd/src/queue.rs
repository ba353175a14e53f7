//! The queue: protocols that wait for the rig, in order.
//!
//! ```text
//!            released by a person
//!   held ─────────────────────────▶ released ── idle rig ──▶ the first entry begins
//!    ▲                                  │
//!    └── a person, a fault, a restart, ─┘
//!        a run that was not completed, the end of the last entry
//! ```
//!
//! This module decides and keeps the file `queue.json` of the data directory. `http/queue.rs` asks the
//! rig and answers clients.

#[cfg(test)]
mod tests;

use std::{fs, io, path::Path, time::Duration};

use rig_engine::RigState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{durable, tokens::fingerprint};

/// Its file in the data directory.
pub(crate) const FILE: &str = "queue.json";
/// Version of the file. Those before are read too: version 1 has no keys, version 2 no late runs.
const FORMAT: u32 = 3;
/// Idempotency keys that are remembered. A client repeats a request within minutes.
const KEYS_MAX: usize = 200;
/// Late runs that are shown: more than a night has.
const LATE_MAX: usize = 20;
/// Entries at most. A weekend has room for fewer runs, and the whole file is written at each change.
pub(crate) const ENTRIES_MAX: usize = 50;
/// As long as the note about a run, characters.
pub(crate) const NOTE_MAX: usize = 2000;

/// What waits for the rig.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Queue {
    format: u32,
    /// The number of the next entry. Numbers are never used again.
    next: u64,
    entries: Vec<Entry>,
    /// While it is there, nothing begins.
    hold: Option<Hold>,
    /// The run of the queue that is under way.
    run: Option<String>,
    /// The requests with an idempotency key that have added an entry, the oldest first. They outlive their
    /// entries: a request that is repeated after its run has begun adds nothing.
    #[serde(default)]
    keys: Vec<UsedKey>,
    /// What the run under way must keep, if it has a deadline.
    #[serde(default)]
    due: Option<Due>,
    /// Runs that ended after their deadlines, the latest first.
    #[serde(default)]
    late: Vec<LateRun>,
}

/// The deadline of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Due {
    /// The entry.
    number: u64,
    protocol: String,
    deadline_unix_ms: u64,
}

/// A run of the queue that ended after its deadline.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct LateRun {
    pub(crate) run: String,
    /// The entry that it was.
    pub(crate) number: u64,
    pub(crate) protocol: String,
    pub(crate) deadline_unix_ms: u64,
    pub(crate) ended_unix_ms: u64,
}

/// A request that has added an entry.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct UsedKey {
    key: String,
    /// Of what was asked for.
    digest: String,
    /// The entry.
    number: u64,
}

/// A protocol that waits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Entry {
    pub(crate) number: u64,
    /// Name of the protocol.
    pub(crate) protocol: String,
    pub(crate) toml: String,
    pub(crate) note: String,
    /// The run must have ended by this time, ms since 1970.
    pub(crate) deadline_unix_ms: Option<u64>,
    /// The operator who added it.
    pub(crate) by: String,
    pub(crate) added_unix_ms: u64,
    /// It could no longer end in time when its turn came.
    pub(crate) is_missed: bool,
}

/// Why nothing begins.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Hold {
    pub(crate) kind: HoldKind,
    /// The reason, for a person.
    pub(crate) reason: String,
    pub(crate) since_unix_ms: u64,
}

/// The kind of a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum HoldKind {
    /// A person holds it.
    Person,
    /// A fault of the rig or the journal, or a run that was not completed or could not begin.
    Fault,
    /// Nothing waits.
    Empty,
    /// The daemon was started.
    Start,
}

/// A change that is not made.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum QueueRefusal {
    #[error("the queue has no entry {0}")]
    NoEntry(u64),
    #[error("the queue has {ENTRIES_MAX} entries already; cancel one first")]
    Full,
    #[error("a note has at most {NOTE_MAX} characters")]
    LongNote,
    #[error("the queue has {entries} entries; place {place} is not one of 1 to {entries}")]
    NoPlace { place: usize, entries: usize },
    #[error("the queue is empty; add a protocol before you release it")]
    Empty,
    #[error(
        "Idempotency-Key {key} was used for entry {number} with another request; take another key"
    )]
    OtherRequest { key: String, number: u64 },
}

/// The rig as far as the queue must know it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub(crate) state: RigState,
    /// Why the rig is latched.
    pub(crate) fault: Option<&'a str>,
    /// Why the journal cannot be written.
    pub(crate) journal_error: Option<&'a str>,
    /// It gives no sign of life.
    pub(crate) is_silent: bool,
}

/// What is to be done next.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Nothing, until something changes.
    Wait,
    /// To hold the queue.
    Hold(HoldKind, String),
    /// The entry can begin, if it can still end in time.
    Begin(Entry),
}

impl Default for Queue {
    fn default() -> Self {
        Self {
            format: FORMAT,
            next: 1,
            entries: Vec::new(),
            hold: None,
            run: None,
            keys: Vec::new(),
            due: None,
            late: Vec::new(),
        }
    }
}

impl Queue {
    /// Reads the queue of a data directory at the start of the daemon. Unless `is_released`, nothing begins
    /// before a person releases it.
    ///
    /// # Errors
    /// [`io::Error`] for a file that cannot be read, or is of another version.
    pub(crate) fn open(data: &Path, is_released: bool, now_unix_ms: u64) -> io::Result<Self> {
        let mut queue = match fs::read(data.join(FILE)) {
            Ok(text) => serde_json::from_slice::<Self>(&text)?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Self::default(),
            Err(error) => return Err(error),
        };
        if !(1..=FORMAT).contains(&queue.format) {
            let what = format!("its format is {}, and this rigd reads 1 to {FORMAT}", queue.format);
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        queue.format = FORMAT;
        queue.due = None;
        if queue.run.take().is_some() {
            let reason = "rigd was ended during a run of the queue".to_owned();
            queue.stop(HoldKind::Fault, reason, now_unix_ms);
        }
        let is_firm = |hold: &Hold| matches!(hold.kind, HoldKind::Person | HoldKind::Fault);
        if !queue.hold.as_ref().is_some_and(is_firm) {
            queue.hold = None;
            if !is_released {
                queue.stop(HoldKind::Start, "rigd was started".to_owned(), now_unix_ms);
            }
        }
        Ok(queue)
    }

    /// Writes the file, and waits for the disk.
    ///
    /// # Errors
    /// [`io::Error`] of the file or its directory; the file is then the old one or the new one.
    pub(crate) fn write(&self, data: &Path) -> io::Result<()> {
        durable::replace(&data.join(FILE), self, durable::FOR_ALL)
    }

    pub(crate) fn entries(&self) -> &[Entry] {
        &self.entries
    }

    pub(crate) const fn hold(&self) -> Option<&Hold> {
        self.hold.as_ref()
    }

    pub(crate) fn run(&self) -> Option<&str> {
        self.run.as_deref()
    }

    /// The last runs that ended after their deadlines, the latest first.
    pub(crate) fn late(&self) -> &[LateRun] {
        &self.late
    }

    /// Takes an entry out, whose run has begun.
    pub(crate) fn begin(&mut self, entry: &Entry, run: String) {
        self.entries.retain(|other| other.number != entry.number);
        self.run = Some(run);
        let (number, protocol) = (entry.number, entry.protocol.clone());
        let due = |deadline_unix_ms| Due { number, protocol, deadline_unix_ms };
        self.due = entry.deadline_unix_ms.map(due);
    }

    /// The run that was begun has ended. Returns it if that was after its deadline.
    pub(crate) fn end(&mut self, now_unix_ms: u64) -> Option<&LateRun> {
        let (run, due) = (self.run.take(), self.due.take());
        let (run, due) = run.zip(due.filter(|due| due.deadline_unix_ms < now_unix_ms))?;
        let Due { number, protocol, deadline_unix_ms } = due;
        let late = LateRun { run, number, protocol, deadline_unix_ms, ended_unix_ms: now_unix_ms };
        self.late.insert(0, late);
        self.late.truncate(LATE_MAX);
        self.late.first()
    }

    /// Puts an entry at the end and gives its number, which replaces the one it had.
    ///
    /// # Errors
    /// [`QueueRefusal`] for a full queue or a long note.
    pub(crate) fn add(&mut self, entry: Entry) -> Result<u64, QueueRefusal> {
        if self.entries.len() >= ENTRIES_MAX {
            return Err(QueueRefusal::Full);
        }
        if entry.note.chars().count() > NOTE_MAX {
            return Err(QueueRefusal::LongNote);
        }
        let number = self.next;
        self.next += 1;
        self.entries.push(Entry { number, ..entry });
        Ok(number)
    }

    /// The entry that a request with this key has added; `None` for a new key.
    ///
    /// # Errors
    /// [`QueueRefusal::OtherRequest`] if the key was used for another request.
    pub(crate) fn keyed(&self, key: &str, entry: &Entry) -> Result<Option<u64>, QueueRefusal> {
        match self.keys.iter().find(|used| used.key == key) {
            Some(used) if used.digest == entry.digest() => Ok(Some(used.number)),
            Some(UsedKey { key, number, .. }) => {
                Err(QueueRefusal::OtherRequest { key: key.clone(), number: *number })
            }
            None => Ok(None),
        }
    }

    /// Remembers the key of the request that has added an entry.
    pub(crate) fn remember(&mut self, key: String, digest: String, number: u64) {
        self.keys.push(UsedKey { key, digest, number });
        let forgotten = self.keys.len().saturating_sub(KEYS_MAX);
        self.keys.drain(..forgotten);
    }

    /// Takes an entry out.
    ///
    /// # Errors
    /// [`QueueRefusal::NoEntry`].
    pub(crate) fn take(&mut self, number: u64) -> Result<Entry, QueueRefusal> {
        let at = self.at(number)?;
        Ok(self.entries.remove(at))
    }

    /// Moves an entry to a place, counted from 1. One that has missed its deadline gets another chance.
    ///
    /// # Errors
    /// [`QueueRefusal`] for an entry or a place that is not there.
    pub(crate) fn move_to(&mut self, number: u64, place: usize) -> Result<(), QueueRefusal> {
        let (at, entries) = (self.at(number)?, self.entries.len());
        if !(1..=entries).contains(&place) {
            return Err(QueueRefusal::NoPlace { place, entries });
        }
        let entry = self.entries.remove(at);
        self.entries.insert(place - 1, Entry { is_missed: false, ..entry });
        Ok(())
    }

    /// Marks an entry that cannot end in time. It stays, and the next one has its turn.
    pub(crate) fn miss(&mut self, number: u64) {
        if let Some(entry) = self.entries.iter_mut().find(|entry| entry.number == number) {
            entry.is_missed = true;
        }
    }

    /// Holds the queue. An earlier reason stays, unless a person gives this one.
    pub(crate) fn stop(&mut self, kind: HoldKind, reason: String, since_unix_ms: u64) {
        if self.hold.is_none() || kind == HoldKind::Person {
            self.hold = Some(Hold { kind, reason, since_unix_ms });
        }
    }

    /// Lets the entries begin.
    ///
    /// # Errors
    /// [`QueueRefusal::Empty`] if nothing waits: a protocol that is added later would begin at once.
    pub(crate) fn release(&mut self) -> Result<(), QueueRefusal> {
        if self.entries.iter().all(|entry| entry.is_missed) {
            return Err(QueueRefusal::Empty);
        }
        self.hold = None;
        Ok(())
    }

    /// What is to be done on a rig that is as `seen`, while no run of the queue is under way.
    pub(crate) fn turn(&self, seen: Seen<'_>) -> Turn {
        if self.hold.is_some() || seen.is_silent {
            return Turn::Wait;
        }
        if let Some(error) = seen.journal_error {
            let reason = format!("the journal cannot be written: {error}");
            return Turn::Hold(HoldKind::Fault, reason);
        }
        match seen.state {
            RigState::Latched => {
                let cause = seen.fault.unwrap_or("a fault");
                Turn::Hold(HoldKind::Fault, format!("the rig is latched: {cause}"))
            }
            RigState::Idle => match self.entries.iter().find(|entry| !entry.is_missed) {
                Some(entry) => Turn::Begin(entry.clone()),
                None => Turn::Hold(HoldKind::Empty, "no entry waits".to_owned()),
            },
            RigState::Preparing
            | RigState::Running
            | RigState::WaitingForPerson
            | RigState::Paused
            | RigState::Retracting => Turn::Wait,
        }
    }

    fn at(&self, number: u64) -> Result<usize, QueueRefusal> {
        let at = self.entries.iter().position(|entry| entry.number == number);
        at.ok_or(QueueRefusal::NoEntry(number))
    }
}

impl LateRun {
    /// For the journal.
    pub(crate) fn sentence(&self) -> String {
        let Self { run, number, protocol, deadline_unix_ms, ended_unix_ms } = self;
        let late_s = Duration::from_millis(ended_unix_ms - deadline_unix_ms).as_secs_f64();
        format!("run {run} of entry {number}, {protocol}, ended {late_s:.1} s after its deadline")
    }
}

impl Entry {
    /// The idempotency key of its run: it begins once, even if the daemon is killed before the entry is
    /// taken out.
    pub(crate) fn key(&self) -> String {
        format!("queue-{}-{}", self.added_unix_ms, self.number)
    }

    /// Digest of what was asked for.
    pub(crate) fn digest(&self) -> String {
        let Self { toml, note, deadline_unix_ms, .. } = self;
        fingerprint(&format!("{deadline_unix_ms:?}\n{}\n{note}\n{toml}", note.len()))
    }

    /// By how much a run that ends after this time from now misses the deadline, s; `None` if it is in time.
    pub(crate) fn late_s(&self, now_unix_ms: u64, ends_in_s: f64) -> Option<f64> {
        #[expect(clippy::cast_precision_loss, reason = "times of this age are exact to 1 ms")]
        let left_ms = |deadline: u64| deadline as f64 - now_unix_ms as f64;
        let late_s = ends_in_s - left_ms(self.deadline_unix_ms?) / 1e3;
        (late_s > 0.0).then_some(late_s)
    }

    /// Whether a run of this duration that begins now ends in time.
    pub(crate) fn is_in_time(&self, now_unix_ms: u64, duration_s: f64) -> bool {
        self.late_s(now_unix_ms, duration_s).is_none()
    }
}
