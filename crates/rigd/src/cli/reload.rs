//! Reads the configuration again while the daemon runs.
//!
//! ```text
//!   SIGHUP ─┐
//!           ├─▶ read and check all files ──▶ note in the journal ──▶ change what is safe to change
//!   HTTP ───┘        │ a fault                                          the rest needs a restart, and is told
//!                    └──▶ note; everything stays as it was
//! ```
//!
//! Nothing here touches what motion or results rest on: the rig file and its scene are read once, at the start.

use std::{collections::BTreeMap, future::pending, path::PathBuf};

use rig_files::service_file::NotificationsFile;
use rig_model::with_causes;
use tokio::{sync::watch, task::spawn_blocking};
use tokio_util::sync::CancellationToken;

use super::{
    args::BenchArgs,
    config::{self, Change, ConfigKey},
    manager,
    screen::say,
    settings::{ServiceArgs, Settings},
    signals::Hangups,
};
use crate::{
    files::FileError,
    http::{self, Changed, Kept, ReloadRefusal, ReloadRequest, Reloaded, access::Token},
    loaded_rig::{LoadedRig, RigFacts},
    notify::{Notifier, NotifyError, Targets},
    rig::Status,
    tokens::fingerprint,
};

/// The name in the journal of who sends a signal: the system does not say who did.
const SIGNAL: &str = "SIGHUP";
/// Settings that a record names.
const NAMED_MAX: usize = 12;

/// The flags of the daemon, with which its files are read again.
#[derive(Debug, Clone)]
pub(super) struct Flags {
    pub(super) bench: BenchArgs,
    pub(super) service: ServiceArgs,
}

/// The values in force, by their key.
#[derive(Debug)]
pub(super) struct InForce(BTreeMap<ConfigKey, Option<String>>);

/// What keeps the configuration of a daemon.
pub(super) struct Reloader {
    flags: Flags,
    in_force: InForce,
    shared: http::Shared,
    told: Told,
}

/// Who is told what happens on the rig.
pub(super) struct Told {
    notifier: Option<Notifier>,
    file: Option<NotificationsFile>,
    data: PathBuf,
    facts: RigFacts,
    status: watch::Receiver<Status>,
    /// The last event before the rig was opened.
    before: u64,
}

/// The files, read again and without faults.
struct Read {
    settings: Settings,
    values: InForce,
    token: Option<Token>,
    targets: Option<Targets>,
}

impl Reloader {
    /// Begins with what the files said at the start.
    pub(super) fn new(flags: Flags, in_force: InForce, shared: http::Shared, told: Told) -> Self {
        shared.show_notifications(told.notifier.as_ref());
        Self { flags, in_force, shared, told }
    }

    /// Carries out reloads until `ending`, and gives back who tells people what happens.
    pub(super) async fn serve(
        mut self,
        mut hangups: Option<Hangups>,
        ending: CancellationToken,
    ) -> Option<Notifier> {
        let mut requests = self.shared.take_reloads();
        loop {
            let hung_up = async {
                match &mut hangups {
                    Some(hangups) => hangups.recv().await,
                    None => pending().await,
                }
            };
            let (by, reply) = tokio::select! {
                () = ending.cancelled() => return self.told.notifier,
                request = requests.recv() => match request {
                    Some(ReloadRequest { by, reply }) => (by, Some(reply)),
                    None => return self.told.notifier,
                },
                _ = hung_up => (SIGNAL.to_owned(), None),
            };
            manager::reloading();
            let done = self.reload(&by).await;
            manager::ready();
            say(&format!("rigd: {by}: {}", sentence(done.as_ref())));
            if let Some(reply) = reply {
                // A client that has gone needs no answer.
                _ = reply.send(done);
            }
        }
    }

    async fn reload(&mut self, by: &str) -> Result<Reloaded, ReloadRefusal> {
        let flags = self.flags.clone();
        let reading = spawn_blocking(move || Read::all(&flags));
        let panicked = |_| ReloadRefusal::Files("the reader of the files has panicked".to_owned());
        let read = reading.await.map_err(panicked).flatten();
        let read =
            read.and_then(|read| self.shared.check_access(read.token.as_ref()).map(|()| read));
        let read = match read {
            Ok(read) => read,
            Err(refusal) => {
                let what = sentence(Err(&refusal));
                self.shared.note_reload(what, by).await?;
                return Err(refusal);
            }
        };
        let mut done = self.compare(&read);
        let has_token = self.shared.has_token(read.token.as_ref());
        if !has_token && !done.changed.iter().any(|changed| changed.name == TOKEN_FILE) {
            let path = read.settings.token_file.value.as_ref();
            let path = path.map(|path| path.display().to_string());
            let name = TOKEN_FILE.to_owned();
            done.changed.push(Changed { name, from: path.clone(), to: path });
        }
        self.shared.note_reload(sentence(Ok(&done)), by).await?;
        let is_of_notifications = |changed: &Changed| changed.name.starts_with(NOTIFICATIONS);
        if done.changed.iter().any(is_of_notifications) {
            let told = self.told.change(read.settings.notifications, read.targets).await;
            self.shared.show_notifications(self.told.notifier.as_ref());
            if let Err(refusal) = told {
                self.shared.note_reload(sentence(Err(&refusal)), by).await?;
                return Err(refusal);
            }
        }
        self.shared.change_access(read.settings.allow_hosts.value, read.token);
        self.in_force.take(read.values);
        Ok(done)
    }

    /// What the files change.
    fn compare(&self, read: &Read) -> Reloaded {
        let mut done = Reloaded { changed: Vec::new(), kept: Vec::new() };
        let (old, new) = (&self.in_force, &read.values);
        let gone = old.0.keys().filter(|key| !new.0.contains_key(*key));
        for key in new.0.keys().chain(gone) {
            let (from, to) = (old.value(key), new.value(key));
            if from == to {
                continue;
            }
            let name = key.name.clone();
            match key.change() {
                Change::Live => done.changed.push(Changed { name, from, to }),
                Change::Restart(reason) => {
                    let reason = reason.to_owned();
                    done.kept.push(Kept { name, value: from, wanted: to, reason });
                }
            }
        }
        done
    }
}

/// Names of settings, as `rigd config show` prints them.
const TOKEN_FILE: &str = "token_file";
const NOTIFICATIONS: &str = "notifications.";
const SCENE: &str = "the scene file";

impl Read {
    /// Reads and checks every file.
    fn all(flags: &Flags) -> Result<Self, ReloadRefusal> {
        let settings = Settings::settle(&flags.bench, &flags.service).map_err(faults)?;
        let rig = LoadedRig::load(&settings.rig.value).map_err(faults)?;
        let values = InForce::new(flags, &settings, &rig).map_err(faults)?;
        let token = settings.token_file.value.as_deref().map(Token::read).transpose();
        let token = token.map_err(faults)?;
        let targets = settings.targets().map_err(faults)?;
        Ok(Self { settings, values, token, targets })
    }
}

fn faults(error: impl std::error::Error + 'static) -> ReloadRefusal {
    ReloadRefusal::Files(with_causes(&error))
}

impl InForce {
    /// Every value of the files and flags.
    ///
    /// # Errors
    /// [`FileError`] with the faults of the rig file.
    pub(super) fn new(
        flags: &Flags,
        settings: &Settings,
        rig: &LoadedRig,
    ) -> Result<Self, FileError> {
        let mut values: BTreeMap<_, _> = config::in_force(&flags.bench, settings)?.collect();
        if let Some(scene) = &rig.scene {
            let digest = fingerprint(&scene.source().toml);
            values.insert(ConfigKey::of_rig(SCENE), Some(format!("SHA-256 {digest}")));
        }
        Ok(Self(values))
    }

    fn value(&self, key: &ConfigKey) -> Option<String> {
        self.0.get(key).cloned().flatten()
    }

    /// Takes over what a reload changes.
    fn take(&mut self, other: Self) {
        self.0.retain(|key, _| key.change() != Change::Live);
        self.0.extend(other.0.into_iter().filter(|(key, _)| key.change() == Change::Live));
    }
}

impl Told {
    /// Tells these targets what happens after `before`, the last event before the rig was opened.
    ///
    /// # Errors
    /// [`NotifyError`] for an outbox that cannot be written.
    pub(super) fn start(
        targets: Option<Targets>,
        settings: &Settings,
        facts: &RigFacts,
        status: watch::Receiver<Status>,
        before: u64,
    ) -> Result<Self, NotifyError> {
        let (data, facts) = (settings.data.value.clone(), facts.clone());
        let notifier = Notifier::start(targets, &data, &facts, status.clone(), before)?;
        Ok(Self { notifier, file: settings.notifications.clone(), data, facts, status, before })
    }

    /// Tells others from now on. If that fails, those before are told on.
    async fn change(
        &mut self,
        file: Option<NotificationsFile>,
        targets: Option<Targets>,
    ) -> Result<(), ReloadRefusal> {
        // Its thread has written the outbox then, which the next one reads.
        let before = self.notifier.take();
        drop(spawn_blocking(move || drop(before)).await);
        match self.begin(targets) {
            Ok(notifier) => {
                (self.notifier, self.file) = (notifier, file);
                Ok(())
            }
            Err(refusal) => {
                let before = self.file.as_ref().map(Targets::new).transpose();
                self.notifier = before.ok().and_then(|before| self.begin(before).ok()).flatten();
                Err(refusal)
            }
        }
    }

    fn begin(&self, targets: Option<Targets>) -> Result<Option<Notifier>, ReloadRefusal> {
        // The status has none before the rig has noted something.
        let last_event = self.status.borrow().last_event.max(self.before);
        let started =
            Notifier::start(targets, &self.data, &self.facts, self.status.clone(), last_event);
        started.map_err(|error| ReloadRefusal::Notifications(with_causes(&error)))
    }
}

/// What was done, for the journal and for the person at the terminal: names of settings without their values,
/// which may be secrets.
fn sentence(done: Result<&Reloaded, &ReloadRefusal>) -> String {
    match done {
        Err(refusal) => {
            let refusal = refusal.to_string();
            let mut lines = refusal.lines();
            let (first, more) = (lines.next().unwrap_or_default(), lines.count());
            let more = if more > 0 { format!(" (and {more} more)") } else { String::new() };
            format!("reload the configuration: refused, {first}{more}")
        }
        Ok(Reloaded { changed, kept }) => {
            let changed = names(changed.iter().map(|changed| changed.name.as_str()));
            let kept = names(kept.iter().map(|kept| kept.name.as_str()));
            let changed = changed.unwrap_or_else(|| "nothing changes".to_owned());
            let kept = kept.map(|kept| format!("; only with a restart: {kept}"));
            format!("reload the configuration: {changed}{}", kept.unwrap_or_default())
        }
    }
}

/// Some names in a row; `None` without one.
fn names<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> Option<String> {
    let more = names.len().saturating_sub(NAMED_MAX);
    let named: Vec<_> = names.take(NAMED_MAX).collect();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!named.is_empty()).then(|| named.join(", ") + &more)
}
