//! Notifications: what happens on the rig is told to people who are not there.
//!
//! ```text
//!   journal ──▶ outbox (a file) ──▶ one task for each target ──▶ webhook, ntfy, sendmail
//! ```
//!
//! All of it runs on a thread of its own, with a runtime of its own. It reads the journal as any other reader,
//! so that the rig thread does nothing for it, and a target that is slow or gone delays neither the rig nor HTTP
//! nor another target.

mod mail;
mod outbox;
mod rate;
mod target;
mod words;

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use jiff::{Timestamp, tz::TimeZone};
use rig_files::service_file::{EventKind, NotificationsFile};
use rig_model::with_causes;
use rig_store::{Reader, Record, StoreError, StoredRecord};
use tokio::{
    sync::watch,
    time::{Instant, sleep},
};
use tokio_util::sync::CancellationToken;

use self::{
    outbox::{Attempts, Fate, Message, Note, Outbox, Turn},
    rate::Rate,
    target::{SendError, Target},
    words::RunName,
};
use crate::{loaded_rig::RigFacts, rig::Status};
pub(crate) use target::TargetError;

/// Records read at a time.
const PAGE: u32 = 512;
/// What is recorded within this time is read together; a question that is answered within it is not sent.
const TOGETHER: Duration = Duration::from_millis(200);
/// The quiet hours begin and end with this delay at most.
const QUIET_LOOK: Duration = Duration::from_secs(30);

/// Tells people what happens, for as long as it is kept.
#[derive(Debug)]
pub(crate) struct Notifier {
    post: Arc<Post>,
    ending: CancellationToken,
    thread: Option<thread::JoinHandle<()>>,
}

/// Those who are told what happens, with secrets that can be read.
#[derive(Debug)]
pub(crate) struct Targets {
    all: Vec<Target>,
    file: NotificationsFile,
}

impl Targets {
    /// # Errors
    /// [`TargetError`] for a target whose files cannot be used.
    pub(crate) fn new(file: &NotificationsFile) -> Result<Self, TargetError> {
        Ok(Self { all: target::all(file)?, file: file.clone() })
    }
}

/// Why nothing can be told.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NotifyError {
    /// The outbox cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// Its file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The thread cannot be started.
    #[error("the thread of the notifications")]
    Thread(#[source] io::Error),
}

/// Figures of one target since the daemon was started.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Figures {
    /// Messages that wait.
    pub(crate) waiting: usize,
    pub(crate) sent: u64,
    /// Attempts that failed.
    pub(crate) failed: u64,
    /// Messages that were tried often enough, or for which there was no room.
    pub(crate) given_up: u64,
}

/// The outbox and its targets.
#[derive(Debug)]
pub(crate) struct Post {
    data: PathBuf,
    rig: RigFacts,
    targets: Vec<Target>,
    quiet: Option<[u32; 2]>,
    bounds: Attempts,
    outbox: Mutex<Outbox>,
    counts: Mutex<BTreeMap<String, Figures>>,
    /// Something was put into the outbox or taken out.
    changed: watch::Sender<()>,
}

impl Notifier {
    /// Opens the outbox of a data directory and begins to read the journal after the last record that was looked
    /// at; in a new outbox, after this event. `None` without targets: the outbox is removed then, because what
    /// happens while nobody is told is no news later.
    ///
    /// # Errors
    /// [`NotifyError`] for an outbox that cannot be written.
    pub(crate) fn start(
        targets: Option<Targets>,
        data: &Path,
        rig: &RigFacts,
        status: watch::Receiver<Status>,
        after_event: u64,
    ) -> Result<Option<Self>, NotifyError> {
        let Some(Targets { all: targets, file }) =
            targets.filter(|targets| !targets.all.is_empty())
        else {
            let path = data.join(outbox::FILE);
            return match fs::remove_file(&path) {
                Err(source) if source.kind() != io::ErrorKind::NotFound => {
                    Err(NotifyError::File { path, source })
                }
                _ => Ok(None),
            };
        };
        let outbox = open(data, &targets, after_event)?;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the service file limits it to an hour"
        )]
        let retry_after_ms = (file.retry_after_s * 1e3) as u64;
        let bounds = Attempts { retry_after_ms, attempts: file.attempts };
        let post = Arc::new(Post {
            data: data.to_path_buf(),
            rig: rig.clone(),
            targets,
            quiet: file.quiet,
            bounds,
            outbox: Mutex::new(outbox),
            counts: Mutex::default(),
            changed: watch::Sender::default(),
        });
        let ending = CancellationToken::new();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(NotifyError::Thread)?;
        let (working, end) = (Arc::clone(&post), ending.clone());
        let work = move || {
            runtime.block_on(working.work(status, end));
            // A name that is being looked up cannot be interrupted; the program does not wait for it.
            runtime.shutdown_background();
        };
        let thread = thread::Builder::new().name("notify".to_owned()).spawn(work);
        let thread = Some(thread.map_err(NotifyError::Thread)?);
        Ok(Some(Self { post, ending, thread }))
    }

    /// For the figures of the service.
    pub(crate) fn post(&self) -> Arc<Post> {
        Arc::clone(&self.post)
    }
}

impl Drop for Notifier {
    fn drop(&mut self) {
        self.ending.cancel();
        if let Some(thread) = self.thread.take() {
            _ = thread.join();
        }
    }
}

/// The outbox that is there, or one that begins after an event.
fn open(data: &Path, targets: &[Target], after_event: u64) -> Result<Outbox, NotifyError> {
    let failed = |source| NotifyError::File { path: data.join(outbox::FILE), source };
    let names: Vec<_> = targets.iter().map(|target| target.name.as_str()).collect();
    let new = || Outbox::after(after_event);
    let opened = match Outbox::open(data, &names) {
        Ok(left) => left.unwrap_or_else(new),
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => return Err(failed(error)),
        Err(error) => {
            let aside = Outbox::put_aside(data).map_err(failed)?;
            let aside = aside.display();
            tracing::warn!(%error, %aside, "the outbox cannot be read, and a new one is begun");
            new()
        }
    };
    opened.write(data).map_err(failed)?;
    Ok(opened)
}

impl Post {
    async fn work(self: Arc<Self>, status: watch::Receiver<Status>, ending: CancellationToken) {
        let sending = (0..self.targets.len()).map(|index| {
            let (post, ending) = (Arc::clone(&self), ending.clone());
            async move {
                let deliver = post.deliver(&post.targets[index]);
                tokio::select! {
                    () = ending.cancelled() => {}
                    () = deliver => {}
                }
            }
        });
        let sending = futures_util::future::join_all(sending);
        futures_util::future::join(self.read_journal(status, &ending), sending).await;
    }

    /// Notes what the journal has, until the rig has closed.
    async fn read_journal(&self, mut status: watch::Receiver<Status>, ending: &CancellationToken) {
        loop {
            let last_event = status.borrow_and_update().last_event;
            while self.lock().last_event < last_event {
                match self.read_page() {
                    Ok(true) => tokio::task::yield_now().await,
                    Ok(false) => break,
                    Err(error) => {
                        let error = with_causes(&error);
                        tracing::warn!(error, "the journal cannot be read for notifications");
                        break;
                    }
                }
            }
            let is_ending = ending.is_cancelled();
            tokio::select! {
                () = ending.cancelled(), if !is_ending => continue,
                changed = status.changed(), if !is_ending => if changed.is_err() { return },
                else => return,
            }
            tokio::select! {
                () = ending.cancelled() => {}
                () = sleep(TOGETHER) => {}
            }
        }
    }

    /// Reads the next records. Returns whether there may be more.
    fn read_page(&self) -> Result<bool, StoreError> {
        let reader = Reader::open(&self.data)?;
        // Only this thread changes the outbox, and it does nothing else meanwhile.
        let before = self.lock().clone();
        let mut outbox = before.clone();
        let page = reader.events_after(outbox.last_event, PAGE)?;
        for stored in &page {
            outbox.last_event = stored.event;
            if words::KINDS.contains(&stored.kind.as_str()) {
                self.take(&reader, stored, &mut outbox)?;
            }
        }
        let is_news = !outbox.has_messages_of(&before);
        *self.lock() = outbox;
        if is_news {
            self.keep();
        }
        Ok(page.len() == PAGE as usize)
    }

    /// Puts what a record says into the outbox, or takes out what it answers.
    fn take(
        &self,
        reader: &Reader,
        stored: &StoredRecord,
        outbox: &mut Outbox,
    ) -> Result<(), StoreError> {
        let run = stored.run.to_string();
        let name = || RunName::read(reader, stored.run, &self.rig);
        let (kind, note) = match stored.record()? {
            Record::PromptAsked(asked) => {
                (EventKind::Prompt, name()?.prompt(&asked.step, &asked.prompt))
            }
            Record::PromptAnswered(answered) => {
                outbox.answered(&run, Some(&answered.step));
                return Ok(());
            }
            Record::RefusalAsked(asked) => {
                outbox.ask(&run, &asked.step);
                (EventKind::Refused, name()?.refused(&asked.step, &asked.reason, true))
            }
            Record::RefusalAnswered(answered) => {
                outbox.answered(&run, Some(&answered.step));
                return Ok(());
            }
            Record::TouchRefused(refused) => {
                let step = &refused.touch.step;
                if outbox.take_asked(&run, step) {
                    return Ok(());
                }
                (EventKind::Refused, name()?.refused(step, &refused.reason, false))
            }
            Record::Fault(fault) => (EventKind::Fault, name()?.fault(&fault)),
            Record::RunFinished(finished) => {
                outbox.answered(&run, None);
                let name = name()?;
                if !name.is_run() {
                    return Ok(());
                }
                (EventKind::End, name.end(reader, finished.status)?)
            }
            _ => return Ok(()),
        };
        let note = Note { journal_event: stored.event, unix_ms: unix_ms(), ..note };
        let wanting = self.targets.iter().filter(|target| target.wants(kind));
        for target in outbox.add(&note, wanting.map(|target| target.name.clone())) {
            self.count(&target, |figures| figures.given_up += 1);
            tracing::warn!(target, "the outbox is full, and an old message is left out");
        }
        Ok(())
    }

    /// Sends the messages to one target, one after the other, for ever.
    async fn deliver(&self, target: &Target) {
        let mut changed = self.changed.subscribe();
        let mut rate = Rate::new(target.per_minute);
        loop {
            if let Some(wait) = rate.wait(Instant::now()) {
                sleep(wait).await;
            }
            changed.mark_unchanged();
            let now = unix_ms();
            let turn = self.lock().turn(&target.name, now, self.is_quiet(now));
            match turn {
                Turn::Send(message) => {
                    rate.begin(Instant::now());
                    let sent = target.send(&message).await;
                    self.settle(target, &message, sent);
                }
                Turn::Wait(wait_ms) => {
                    let wait = wait_ms.map_or(QUIET_LOOK, Duration::from_millis);
                    tokio::select! {
                        _ = changed.changed() => {}
                        () = sleep(wait.min(QUIET_LOOK)) => {}
                    }
                }
            }
        }
    }

    /// Takes a message out that was sent, and notes when another one is tried again.
    fn settle(&self, target: &Target, message: &Message, sent: Result<(), SendError>) {
        let (name, event) = (&target.name, &message.note.event);
        match sent {
            Ok(()) => {
                self.lock().sent(message.number);
                self.count(name, |figures| figures.sent += 1);
            }
            Err(error) => {
                let fate = self.lock().failed(message.number, unix_ms(), self.bounds);
                self.count(name, |figures| {
                    figures.failed += 1;
                    figures.given_up += u64::from(fate == Fate::GivenUp);
                });
                let error = with_causes(&error);
                if fate == Fate::GivenUp {
                    tracing::warn!(target = name, event, error, "a message is given up");
                } else {
                    tracing::info!(target = name, event, error, ?fate, "a message was not sent");
                }
            }
        }
        self.keep();
    }

    /// Writes the file. Without it the outbox goes on in memory.
    fn keep(&self) {
        let outbox = self.lock().clone();
        if let Err(error) = outbox.write(&self.data) {
            tracing::warn!(%error, "the outbox cannot be written");
        }
        _ = self.changed.send(());
    }

    fn is_quiet(&self, now_unix_ms: u64) -> bool {
        let at =
            i64::try_from(now_unix_ms).ok().and_then(|ms| Timestamp::from_millisecond(ms).ok());
        let (Some(quiet), Some(at)) = (self.quiet, at) else { return false };
        let time = at.to_zoned(TimeZone::system()).time();
        is_within(
            quiet,
            u32::from(time.hour().unsigned_abs()) * 60 + u32::from(time.minute().unsigned_abs()),
        )
    }

    fn count(&self, target: &str, change: impl FnOnce(&mut Figures)) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        change(counts.entry(target.to_owned()).or_default());
    }

    fn lock(&self) -> MutexGuard<'_, Outbox> {
        // It is replaced as a whole, so that it is complete even after a panic.
        self.outbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The figures of each target.
    pub(crate) fn figures(&self) -> Vec<(String, Figures)> {
        let counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let outbox = self.lock();
        let of = |target: &Target| {
            let counted = counts.get(&target.name).copied().unwrap_or_default();
            (target.name.clone(), Figures { waiting: outbox.waiting(&target.name), ..counted })
        };
        self.targets.iter().map(of).collect()
    }
}

/// Whether a minute of the day lies in an interval, which may pass midnight.
const fn is_within([from, until]: [u32; 2], minute: u32) -> bool {
    if from < until { from <= minute && minute < until } else { from <= minute || minute < until }
}

fn unix_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quiet_hours_may_pass_midnight_and_end_before_their_last_minute() {
        let night = [22 * 60, 6 * 60 + 30];
        for (minute, is_quiet) in
            [(0, true), (389, true), (390, false), (1319, false), (1320, true), (1439, true)]
        {
            assert_eq!(is_within(night, minute), is_quiet, "{minute}");
        }
        for (minute, is_quiet) in [(59, false), (60, true), (119, true), (120, false)] {
            assert_eq!(is_within([60, 120], minute), is_quiet, "{minute}");
        }
    }
}
