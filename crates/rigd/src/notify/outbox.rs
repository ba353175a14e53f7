//! What is still to be told, and when: decided here, kept in `outbox.json` of the data directory.
//!
//! ```text
//!   journal ──▶ note ──▶ message for each target ──▶ sent: taken out
//!                            ▲            │
//!                            └─ later ────┤ failed, and attempts are left
//!                                         └──────▶ given up: taken out, and counted
//! ```
//!
//! A message is taken out after it was sent: a daemon that is killed in between sends it again. Its id is the
//! same then.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use rig_files::service_file::EventKind;
use serde::{Deserialize, Serialize};

use crate::durable;

/// Its file in the data directory.
pub(super) const FILE: &str = "outbox.json";
/// Version of the file.
const FORMAT: u32 = 1;
/// Messages at most. A target that is away for a day during a run with refusals fills it.
pub(super) const MESSAGES_MAX: usize = 500;
/// Longest time between two attempts, ms.
const WAIT_MAX_MS: u64 = 3_600_000;

/// What happened, for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Note {
    /// The word of its [`EventKind`].
    pub(super) event: String,
    /// Place of its record in the journal.
    pub(super) journal_event: u64,
    /// The run or session.
    pub(super) run_id: String,
    /// Name of the run, such as `smoke-3`; `None` between runs.
    pub(super) run: Option<String>,
    /// Address of the step, if it asks a person something.
    pub(super) asked_at: Option<String>,
    pub(super) rig: String,
    pub(super) is_simulated: bool,
    pub(super) title: String,
    pub(super) text: String,
    /// When the daemon read it in the journal, ms since 1970.
    pub(super) unix_ms: u64,
}

/// A note on its way to one target.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Message {
    /// Numbers are never used again.
    pub(super) number: u64,
    /// Name of the target.
    pub(super) target: String,
    pub(super) note: Note,
    /// Attempts that failed.
    pub(super) failed: u32,
    /// The next attempt is not earlier, ms since 1970.
    pub(super) due_unix_ms: u64,
}

/// All that is still to be told.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Outbox {
    format: u32,
    next: u64,
    /// The last record of the journal that was looked at.
    pub(super) last_event: u64,
    /// Run and step of the refused touch about which a person was asked last.
    asked: Option<(String, String)>,
    messages: Vec<Message>,
}

/// Bounds of the attempts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attempts {
    /// Time to the second attempt, ms.
    pub(super) retry_after_ms: u64,
    pub(super) attempts: u32,
}

/// What a target does next.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// To send this message.
    Send(Box<Message>),
    /// To wait this long, ms, or until something changes.
    Wait(Option<u64>),
}

/// What becomes of a message after a failed attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    /// It is tried again after this time, ms.
    Later(u64),
    /// It was tried often enough.
    GivenUp,
    /// It is not needed any more.
    Gone,
}

impl Outbox {
    /// An empty one that begins after a record of the journal.
    pub(super) const fn after(last_event: u64) -> Self {
        Self { format: FORMAT, next: 1, last_event, asked: None, messages: Vec::new() }
    }

    /// Reads that of a data directory. Messages to targets that are no longer there are taken out.
    ///
    /// # Errors
    /// [`io::Error`] for a file that cannot be read, or is of another version.
    pub(super) fn open(data: &Path, targets: &[&str]) -> io::Result<Option<Self>> {
        let mut outbox: Self = match fs::read(data.join(FILE)) {
            Ok(text) => serde_json::from_slice(&text)?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(error),
        };
        if outbox.format != FORMAT {
            let what = format!("its format is {}, and this rigd reads {FORMAT}", outbox.format);
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        outbox.messages.retain(|message| targets.contains(&message.target.as_str()));
        Ok(Some(outbox))
    }

    /// Puts a file that cannot be read aside, and gives its new name.
    ///
    /// # Errors
    /// [`io::Error`] of the renaming.
    pub(super) fn put_aside(data: &Path) -> io::Result<PathBuf> {
        let aside = data.join(format!("{FILE}.unread"));
        fs::rename(data.join(FILE), &aside)?;
        Ok(aside)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`io::Error`]; the file is then the old one or the new one.
    pub(super) fn write(&self, data: &Path) -> io::Result<()> {
        durable::replace(&data.join(FILE), self, durable::FOR_ALL)
    }

    /// Whether it has the same messages.
    pub(super) fn has_messages_of(&self, other: &Self) -> bool {
        (&self.messages, &self.asked) == (&other.messages, &other.asked)
    }

    /// Number of messages to a target.
    pub(super) fn waiting(&self, target: &str) -> usize {
        self.messages.iter().filter(|message| message.target == target).count()
    }

    /// Adds a message for each target. Returns the targets whose oldest message had to be left out.
    pub(super) fn add(
        &mut self,
        note: &Note,
        targets: impl Iterator<Item = String>,
    ) -> Vec<String> {
        let mut left_out = Vec::new();
        for target in targets {
            if self.messages.len() >= MESSAGES_MAX {
                // Faults stay longest.
                let is_fault = |message: &Message| message.note.event == EventKind::Fault.name();
                let at = self.messages.iter().position(|message| !is_fault(message)).unwrap_or(0);
                left_out.push(self.messages.remove(at).target);
            }
            let number = self.next;
            self.next += 1;
            let due_unix_ms = note.unix_ms;
            let note = note.clone();
            self.messages.push(Message { number, target, note, failed: 0, due_unix_ms });
        }
        left_out
    }

    /// A person was asked about a refused touch: its refusal is no news later.
    pub(super) fn ask(&mut self, run: &str, step: &str) {
        self.asked = Some((run.to_owned(), step.to_owned()));
    }

    /// Whether a person was asked about this refused touch.
    pub(super) fn take_asked(&mut self, run: &str, step: &str) -> bool {
        let is_it = |(asked_run, asked): &mut (String, String)| asked_run == run && asked == step;
        self.asked.take_if(is_it).is_some()
    }

    /// A person has answered, or the run has ended: what asked for it need not be sent any more. Without a step
    /// it is all that the run asked.
    pub(super) fn answered(&mut self, run: &str, step: Option<&str>) {
        let is_asked = |note: &Note| {
            let asked_at = note.asked_at.as_deref();
            note.run_id == run && asked_at.is_some() && (step.is_none() || asked_at == step)
        };
        self.messages.retain(|message| !is_asked(&message.note));
    }

    /// What a target does next: faults come first. While it is quiet, only faults are sent.
    pub(super) fn turn(&self, target: &str, now_unix_ms: u64, is_quiet: bool) -> Turn {
        let is_fault = |message: &&Message| message.note.event == EventKind::Fault.name();
        let mine = self.messages.iter().filter(|message| message.target == target);
        let first = mine.filter(|message| !is_quiet || is_fault(message)).min_by_key(|message| {
            let is_due = message.due_unix_ms <= now_unix_ms;
            (!(is_due && is_fault(message)), message.due_unix_ms, message.number)
        });
        match first {
            None => Turn::Wait(None),
            Some(message) if message.due_unix_ms <= now_unix_ms => {
                Turn::Send(Box::new(message.clone()))
            }
            // A wall clock that was set back does not make a message wait longer than ever meant.
            Some(message) => Turn::Wait(Some((message.due_unix_ms - now_unix_ms).min(WAIT_MAX_MS))),
        }
    }

    /// A message was sent.
    pub(super) fn sent(&mut self, number: u64) {
        self.messages.retain(|message| message.number != number);
    }

    /// An attempt has failed: the message is tried again later, each time after twice the time.
    pub(super) fn failed(&mut self, number: u64, now_unix_ms: u64, bounds: Attempts) -> Fate {
        let found = self.messages.iter().position(|message| message.number == number);
        let Some(at) = found else { return Fate::Gone };
        let message = &mut self.messages[at];
        message.failed += 1;
        if message.failed >= bounds.attempts {
            self.messages.remove(at);
            return Fate::GivenUp;
        }
        let doubled = 1_u64.checked_shl(message.failed - 1).unwrap_or(u64::MAX);
        let wait_ms = bounds.retry_after_ms.saturating_mul(doubled).min(WAIT_MAX_MS);
        message.due_unix_ms = now_unix_ms.saturating_add(wait_ms);
        Fate::Later(wait_ms)
    }
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;

    fn note(kind: EventKind) -> Note {
        Note {
            event: kind.name().to_owned(),
            journal_event: 7,
            run_id: "run".to_owned(),
            run: None,
            asked_at: (kind == EventKind::Prompt).then(|| "main/1".to_owned()),
            rig: "bench".to_owned(),
            is_simulated: true,
            title: String::new(),
            text: String::new(),
            unix_ms: 1000,
        }
    }

    fn add(outbox: &mut Outbox, kind: EventKind, targets: &[&str]) -> Vec<String> {
        outbox.add(&note(kind), targets.iter().map(|&target| target.to_owned()))
    }

    #[track_caller]
    fn number(turn: Turn) -> u64 {
        match turn {
            Turn::Send(message) => message.number,
            Turn::Wait(_) => panic!("{turn:?}"),
        }
    }

    const BOUNDS: Attempts = Attempts { retry_after_ms: 1000, attempts: 20 };

    #[test]
    fn attempts_come_after_twice_the_time_up_to_an_hour_and_end() {
        let mut outbox = Outbox::after(0);
        add(&mut outbox, EventKind::End, &["a"]);
        let (mut now, mut waits) = (1000, Vec::new());
        loop {
            let number = number(outbox.turn("a", now, false));
            match outbox.failed(number, now, BOUNDS) {
                Fate::Later(wait_ms) => {
                    assert_eq!(outbox.turn("a", now, false), Turn::Wait(Some(wait_ms)));
                    now += wait_ms;
                    waits.push(wait_ms);
                }
                fate => {
                    assert_eq!(fate, Fate::GivenUp);
                    break;
                }
            }
        }
        assert_eq!(waits.len(), 19);
        assert_eq!((&waits[..4], waits[18]), (&[1000, 2000, 4000, 8000][..], WAIT_MAX_MS));
        assert_eq!((outbox.waiting("a"), outbox.turn("a", now, false)), (0, Turn::Wait(None)));
    }

    #[test]
    fn a_target_that_fails_delays_no_other_and_a_message_that_fails_no_other_message() {
        let mut outbox = Outbox::after(0);
        add(&mut outbox, EventKind::End, &["a", "b"]);
        add(&mut outbox, EventKind::Refused, &["a"]);
        assert_eq!(number(outbox.turn("a", 1000, false)), 1);
        outbox.failed(1, 1000, BOUNDS);
        assert_eq!(number(outbox.turn("a", 1000, false)), 3);
        assert_eq!(number(outbox.turn("b", 1000, false)), 2);
        outbox.sent(3);
        assert_eq!(outbox.turn("a", 1000, false), Turn::Wait(Some(1000)));
        assert_eq!((outbox.waiting("a"), outbox.waiting("b")), (1, 1));
    }

    #[test]
    fn in_quiet_hours_faults_pass_and_the_rest_waits() {
        let mut outbox = Outbox::after(0);
        for kind in [EventKind::Prompt, EventKind::Refused, EventKind::End] {
            add(&mut outbox, kind, &["a"]);
            assert_eq!(outbox.turn("a", 1000, true), Turn::Wait(None));
        }
        add(&mut outbox, EventKind::Fault, &["a"]);
        assert_eq!(number(outbox.turn("a", 1000, true)), 4);
        assert_eq!(number(outbox.turn("a", 1000, false)), 4, "faults come first");
        outbox.sent(4);
        assert_eq!(number(outbox.turn("a", 1000, false)), 1);
    }

    #[test]
    fn what_a_person_has_answered_is_not_sent_any_more() {
        let mut outbox = Outbox::after(0);
        add(&mut outbox, EventKind::Prompt, &["a", "b"]);
        add(&mut outbox, EventKind::Fault, &["a"]);
        for (run, step, left) in [
            ("other", Some("main/1"), 3),
            ("other", None, 3),
            ("run", Some("main/2"), 3),
            ("run", Some("main/1"), 1),
        ] {
            outbox.answered(run, step);
            assert_eq!(outbox.waiting("a") + outbox.waiting("b"), left);
        }
        // A run that has ended asks for nothing.
        add(&mut outbox, EventKind::Prompt, &["a"]);
        outbox.answered("run", None);
        assert_eq!(outbox.waiting("a"), 1);
        // An attempt that was under way meanwhile.
        assert_eq!(outbox.failed(1, 1000, BOUNDS), Fate::Gone);
        outbox.ask("run", "main/3");
        assert!(!outbox.take_asked("run", "main/4") && !outbox.take_asked("other", "main/3"));
        assert!(outbox.take_asked("run", "main/3") && !outbox.take_asked("run", "main/3"));
    }

    #[test]
    fn a_full_outbox_leaves_out_the_oldest_and_faults_last() {
        let mut outbox = Outbox::after(0);
        add(&mut outbox, EventKind::Fault, &["a"]);
        add(&mut outbox, EventKind::End, &["b"]);
        for _ in 2..MESSAGES_MAX {
            assert!(add(&mut outbox, EventKind::Fault, &["a"]).is_empty());
        }
        assert_eq!(add(&mut outbox, EventKind::End, &["a"]), ["b"]);
        assert_eq!(add(&mut outbox, EventKind::Fault, &["a"]), ["a"]);
        assert_eq!(number(outbox.turn("a", 1000, false)), 1);
        assert_eq!(add(&mut outbox, EventKind::Fault, &["a"]), ["a"]);
        assert_eq!(number(outbox.turn("a", 1000, false)), 3);
        assert_eq!(outbox.waiting("a"), MESSAGES_MAX);
    }

    #[test]
    fn an_outbox_goes_on_after_a_restart_without_targets_that_are_gone() {
        let folder = TempDir::new().unwrap();
        assert!(Outbox::open(folder.path(), &["a"]).unwrap().is_none());
        let mut outbox = Outbox::after(41);
        add(&mut outbox, EventKind::End, &["a", "b"]);
        outbox.failed(1, 1000, BOUNDS);
        outbox.write(folder.path()).unwrap();
        assert_eq!(Outbox::open(folder.path(), &["a", "b"]).unwrap(), Some(outbox));
        let mut opened = Outbox::open(folder.path(), &["b"]).unwrap().unwrap();
        assert_eq!((opened.waiting("a"), opened.waiting("b"), opened.last_event), (0, 1, 41));
        add(&mut opened, EventKind::End, &["b"]);
        opened.sent(2);
        assert_eq!(number(opened.turn("b", 1000, false)), 3);
        for text in ["{", r#"{"format":2,"next":1,"last_event":0,"asked":null,"messages":[]}"#] {
            fs::write(folder.path().join(FILE), text).unwrap();
            assert!(Outbox::open(folder.path(), &[]).is_err());
        }
        let aside = Outbox::put_aside(folder.path()).unwrap();
        assert!(aside.exists() && Outbox::open(folder.path(), &[]).unwrap().is_none());
    }
}
