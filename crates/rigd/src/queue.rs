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

use std::{fs, io, path::Path};

use rig_engine::RigState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::durable;

/// Its file in the data directory.
pub(crate) const FILE: &str = "queue.json";
/// Version of the file.
const FORMAT: u32 = 1;
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
        Self { format: FORMAT, next: 1, entries: Vec::new(), hold: None, run: None }
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
        if queue.format != FORMAT {
            let what = format!("its format is {}, and this rigd reads {FORMAT}", queue.format);
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
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

    /// Takes an entry out, whose run has begun.
    pub(crate) fn begin(&mut self, number: u64, run: String) {
        self.entries.retain(|entry| entry.number != number);
        self.run = Some(run);
    }

    /// The run that was begun has ended.
    pub(crate) fn end(&mut self) {
        self.run = None;
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

impl Entry {
    /// The idempotency key of its run: it begins once, even if the daemon is killed before the entry is
    /// taken out.
    pub(crate) fn key(&self) -> String {
        format!("queue-{}-{}", self.added_unix_ms, self.number)
    }

    /// Whether a run of this duration that begins now ends in time.
    pub(crate) fn is_in_time(&self, now_unix_ms: u64, duration_s: f64) -> bool {
        #[expect(clippy::cast_precision_loss, reason = "times of this age are exact to 1 ms")]
        let left_ms = |deadline: u64| deadline as f64 - now_unix_ms as f64;
        self.deadline_unix_ms.is_none_or(|deadline| left_ms(deadline) >= duration_s * 1e3)
    }
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;

    fn entry(protocol: &str) -> Entry {
        Entry {
            number: 0,
            protocol: protocol.to_owned(),
            toml: String::new(),
            note: String::new(),
            deadline_unix_ms: None,
            by: "ada".to_owned(),
            added_unix_ms: 7,
            is_missed: false,
        }
    }

    const IDLE: Seen<'static> =
        Seen { state: RigState::Idle, fault: None, journal_error: None, is_silent: false };

    fn queue_of(protocols: &[&str]) -> Queue {
        let mut queue = Queue::default();
        for protocol in protocols {
            queue.add(entry(protocol)).unwrap();
        }
        queue
    }

    fn names(queue: &Queue) -> Vec<&str> {
        queue.entries().iter().map(|entry| entry.protocol.as_str()).collect()
    }

    #[test]
    fn entries_are_moved_and_cancelled_by_numbers_that_are_not_used_again() {
        let mut queue = queue_of(&["a", "b", "c"]);
        queue.move_to(3, 1).unwrap();
        assert_eq!(names(&queue), ["c", "a", "b"]);
        queue.move_to(3, 3).unwrap();
        assert_eq!(names(&queue), ["a", "b", "c"]);
        assert_eq!(queue.move_to(1, 0), Err(QueueRefusal::NoPlace { place: 0, entries: 3 }));
        assert_eq!(queue.move_to(1, 4), Err(QueueRefusal::NoPlace { place: 4, entries: 3 }));
        assert_eq!(queue.take(3).unwrap().protocol, "c");
        assert_eq!(queue.take(3), Err(QueueRefusal::NoEntry(3)));
        assert_eq!(queue.add(entry("d")), Ok(4));
    }

    #[test]
    fn a_queue_and_a_note_have_a_largest_size() {
        let mut queue = Queue::default();
        for number in 1..=ENTRIES_MAX {
            assert_eq!(queue.add(entry("a")), Ok(number as u64));
        }
        assert_eq!(queue.add(entry("a")), Err(QueueRefusal::Full));
        let mut queue = Queue::default();
        let noted = |length| Entry { note: "é".repeat(length), ..entry("a") };
        assert_eq!(queue.add(noted(NOTE_MAX + 1)), Err(QueueRefusal::LongNote));
        assert!(queue.add(noted(NOTE_MAX)).is_ok());
    }

    #[test]
    fn only_a_released_queue_on_an_idle_rig_begins_its_first_entry() {
        let mut queue = queue_of(&["a", "b"]);
        let every = [
            RigState::Preparing,
            RigState::Idle,
            RigState::Running,
            RigState::WaitingForPerson,
            RigState::Paused,
            RigState::Retracting,
            RigState::Latched,
        ];
        for state in every {
            let seen = Seen { state, ..IDLE };
            let begins = matches!(queue.turn(seen), Turn::Begin(entry) if entry.number == 1);
            assert_eq!(begins, state == RigState::Idle, "{state:?}");
            let holds = matches!(queue.turn(seen), Turn::Hold(HoldKind::Fault, _));
            assert_eq!(holds, state == RigState::Latched, "{state:?}");
            assert_eq!(queue.turn(Seen { is_silent: true, ..seen }), Turn::Wait);
            let failed = Seen { journal_error: Some("disk"), ..seen };
            assert!(matches!(queue.turn(failed), Turn::Hold(HoldKind::Fault, _)));
        }
        queue.stop(HoldKind::Person, "held".to_owned(), 0);
        for state in every {
            assert_eq!(queue.turn(Seen { state, ..IDLE }), Turn::Wait);
        }
    }

    #[test]
    fn an_entry_that_cannot_end_in_time_lets_the_next_one_begin() {
        let late = Entry { deadline_unix_ms: Some(10_000), ..entry("a") };
        assert!(late.is_in_time(4_000, 6.0) && !late.is_in_time(4_001, 6.0));
        assert!(!late.is_in_time(20_000, 0.0) && entry("b").is_in_time(u64::MAX, 1e9));
        let mut queue = queue_of(&["a", "b"]);
        queue.miss(1);
        assert!(matches!(queue.turn(IDLE), Turn::Begin(entry) if entry.number == 2));
        queue.take(2).unwrap();
        assert!(matches!(queue.turn(IDLE), Turn::Hold(HoldKind::Empty, _)));
        assert_eq!(queue.release(), Err(QueueRefusal::Empty));
        queue.move_to(1, 1).unwrap();
        assert!(matches!(queue.turn(IDLE), Turn::Begin(entry) if entry.number == 1));
    }

    #[test]
    fn a_queue_is_held_after_a_start_unless_asked_otherwise() {
        let folder = TempDir::new().unwrap();
        let kind = |queue: &Queue| queue.hold().map(|hold| hold.kind);
        for (before, plain, released) in [
            (None, Some(HoldKind::Start), None),
            (Some(HoldKind::Start), Some(HoldKind::Start), None),
            (Some(HoldKind::Empty), Some(HoldKind::Start), None),
            (Some(HoldKind::Fault), Some(HoldKind::Fault), Some(HoldKind::Fault)),
            (Some(HoldKind::Person), Some(HoldKind::Person), Some(HoldKind::Person)),
        ] {
            let mut queue = queue_of(&["a"]);
            if let Some(before) = before {
                queue.stop(before, "before".to_owned(), 1);
            }
            queue.write(folder.path()).unwrap();
            let open = |is_released| Queue::open(folder.path(), is_released, 2).unwrap();
            assert_eq!(open(false).entries(), queue.entries());
            assert_eq!((kind(&open(false)), kind(&open(true))), (plain, released), "{before:?}");
        }
    }

    #[test]
    fn a_run_that_was_under_way_when_the_daemon_ended_holds_the_queue() {
        let folder = TempDir::new().unwrap();
        let mut queue = queue_of(&["a", "b"]);
        queue.begin(1, "run".to_owned());
        assert_eq!((names(&queue), queue.run()), (vec!["b"], Some("run")));
        queue.write(folder.path()).unwrap();
        let mut opened = Queue::open(folder.path(), true, 0).unwrap();
        assert_eq!(opened.hold().map(|hold| hold.kind), Some(HoldKind::Fault));
        opened.release().unwrap();
        assert!(opened.run().is_none() && matches!(opened.turn(IDLE), Turn::Begin(_)));
        queue.end();
        queue.write(folder.path()).unwrap();
        assert_eq!(Queue::open(folder.path(), true, 0).unwrap().hold(), None);
    }

    #[test]
    fn a_file_of_another_version_is_not_read() {
        let folder = TempDir::new().unwrap();
        let other = Queue { format: FORMAT + 1, ..queue_of(&["a"]) };
        other.write(folder.path()).unwrap();
        let error = Queue::open(folder.path(), false, 0).unwrap_err().to_string();
        assert_eq!(error, "its format is 2, and this rigd reads 1");
        fs::write(folder.path().join(FILE), "{").unwrap();
        assert!(Queue::open(folder.path(), false, 0).is_err());
    }
}
