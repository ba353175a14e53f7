//! The queue over HTTP, and the task that begins its entries.
//!
//! Every change is noted in the journal, with who asked, before the file of the queue has it.

mod view;

use std::{io, time::SystemTime};

use axum::{
    Extension, Json,
    body::Bytes,
    extract::{Path, State},
    http::{HeaderMap, StatusCode},
};
use rig_engine::{CommandRefusal, RunStatus as Ended};
use rig_model::with_causes;
use rig_store::{Ending, RunId, RunStatus};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::sync::{Mutex, Notify};
use tokio_util::sync::CancellationToken;

pub(super) use self::view::QueueView;
use self::view::{first, wall_s};
use super::{
    Problem, Purpose, Shared,
    object::{Object, ObjectBody, object_or_default},
    progress::unix_ms,
    runs::idempotency_key,
};
use crate::{
    operator::Operator,
    queue::{Entry, HoldKind, LateRun, Queue, QueueRefusal, Seen, Turn},
    rig::{RequestRefusal, Status},
};

/// The name in the journal of what the daemon does by itself.
const DAEMON: &str = "rigd";

/// The queue of the daemon.
#[derive(Debug, Default)]
pub(super) struct Keeper {
    kept: Mutex<Kept>,
    /// A client has changed it.
    changed: Notify,
}

#[derive(Debug, Default)]
struct Kept {
    queue: Queue,
    /// Its run that is under way.
    run: Option<RunId>,
}

impl Keeper {
    /// Number of entries, number of those that have missed their deadline, and whether the queue is held.
    pub(super) async fn figures(&self) -> (usize, usize, bool) {
        let kept = self.kept.lock().await;
        let entries = kept.queue.entries();
        let missed = entries.iter().filter(|entry| entry.is_missed).count();
        (entries.len(), missed, kept.queue.hold().is_some())
    }
}

/// A protocol for the queue.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct QueueForm {
    /// Its text; without it, the loaded one.
    protocol_toml: Option<String>,
    /// For people, at most 2000 characters.
    note: String,
    /// The run must have ended by this time; otherwise it does not begin.
    deadline_unix_ms: Option<u64>,
}

/// The new place of an entry.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct PlaceForm {
    /// From 1 for the next one.
    #[schemars(range(min = 1))]
    place: usize,
}

type Answer = Result<Json<QueueView>, Problem>;

pub(super) async fn show(State(shared): State<Shared>) -> Answer {
    shared.queue_view().await
}

pub(super) async fn add(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    headers: HeaderMap,
    body: Bytes,
) -> Result<(StatusCode, Json<QueueView>), Problem> {
    let key = idempotency_key(&headers)?;
    let form: QueueForm = object_or_default(&body)?;
    let facts = &shared.inner.facts;
    let protocol = if let Some(text) = form.protocol_toml {
        let laid_out = shared.laid_out("protocol", text, Purpose::Run).await?;
        laid_out.map_err(|faults| Problem::protocol(&faults))?
    } else {
        shared.inner.loaded.clone().ok_or_else(|| {
            let detail = "no protocol was loaded when the daemon was started; send `protocol_toml`";
            Problem::unprocessable(detail.to_owned())
        })?
    };
    let now_unix_ms = unix_ms(SystemTime::now());
    let entry = Entry {
        number: 0,
        protocol: protocol.source.name,
        toml: protocol.source.toml,
        note: form.note,
        deadline_unix_ms: form.deadline_unix_ms,
        by: operator.as_str().to_owned(),
        added_unix_ms: now_unix_ms,
        is_missed: false,
    };
    if let Some(key) = &key
        && shared.inner.queue.kept.lock().await.queue.keyed(key, &entry)?.is_some()
    {
        return Ok((StatusCode::OK, shared.queue_view().await?));
    }
    if !entry.is_in_time(now_unix_ms, wall_s(facts, protocol.summary.duration_s)) {
        let detail = "a run of this protocol that began now would end after the deadline";
        return Err(Problem::unprocessable(detail.to_owned()));
    }
    let add = move |queue: &mut Queue| {
        // Two requests with one key can come at once.
        if let Some(key) = &key
            && queue.keyed(key, &entry)?.is_some()
        {
            return Ok(None);
        }
        let (name, digest) = (entry.protocol.clone(), entry.digest());
        let number = queue.add(entry)?;
        if let Some(key) = key {
            queue.remember(key, digest, number);
        }
        Ok(Some(format!("add entry {number} of the queue, {name}")))
    };
    Ok((StatusCode::CREATED, changed(shared, &operator, add).await?))
}

pub(super) async fn cancel(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(number): Path<String>,
) -> Answer {
    let number = entry_number(&number)?;
    let cancel = move |queue: &mut Queue| {
        let entry = queue.take(number)?;
        Ok(Some(format!("cancel entry {number} of the queue, {}", entry.protocol)))
    };
    changed(shared, &operator, cancel).await
}

pub(super) async fn place(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(number): Path<String>,
    form: ObjectBody<PlaceForm>,
) -> Answer {
    let (number, Json(Object(PlaceForm { place }))) = (entry_number(&number)?, form?);
    let place = move |queue: &mut Queue| {
        queue.move_to(number, place)?;
        Ok(Some(format!("move entry {number} of the queue to place {place}")))
    };
    changed(shared, &operator, place).await
}

pub(super) async fn hold(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Answer {
    let reason = format!("{operator} holds it");
    let hold = move |queue: &mut Queue| {
        queue.stop(HoldKind::Person, reason, unix_ms(SystemTime::now()));
        Ok(Some("hold the queue".to_owned()))
    };
    changed(shared, &operator, hold).await
}

pub(super) async fn release(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Answer {
    let release =
        |queue: &mut Queue| queue.release().map(|()| Some("release the queue".to_owned()));
    changed(shared, &operator, release).await
}

fn entry_number(text: &str) -> Result<u64, Problem> {
    text.parse().map_err(|_| Problem::not_found(format!("the queue has no entry {text}")))
}

/// Changes the queue for a client, unless there is nothing to change. A client that goes away does not leave
/// the change half made.
async fn changed(
    shared: Shared,
    operator: &Operator,
    change: impl FnOnce(&mut Queue) -> Result<Option<String>, QueueRefusal> + Send + 'static,
) -> Answer {
    let by = operator.clone();
    let making = tokio::spawn(async move {
        let mut kept = shared.inner.queue.kept.lock().await;
        let mut queue = kept.queue.clone();
        if let Some(action) = change(&mut queue)? {
            shared.inner.rig.note(action, by.as_str()).await?;
            kept.queue = shared.written(queue).await?;
            shared.inner.queue.changed.notify_one();
        }
        drop(kept);
        shared.queue_view().await
    });
    making.await.map_err(|_| Problem::internal("the change of the queue has panicked"))?
}

impl Shared {
    async fn queue_view(&self) -> Answer {
        let kept = self.inner.queue.kept.lock().await;
        let queue = kept.queue.clone();
        drop(kept);
        let status = self.status();
        self.work(move |inner| QueueView::new(&queue, &status, &inner.facts)).await.map(Json)
    }

    /// Writes the file of the queue, and gives the queue back.
    async fn written(&self, queue: Queue) -> Result<Queue, Problem> {
        let data = self.inner.data.clone();
        let writing = tokio::task::spawn_blocking(move || queue.write(&data).map(|()| queue));
        let written =
            writing.await.map_err(|_| Problem::internal("the writer of the queue has panicked"))?;
        written.map_err(|error| {
            tracing::warn!(%error, "the queue cannot be written");
            Problem::internal(&format!("the queue cannot be written: {error}"))
        })
    }

    /// Reads the queue that the last daemon left. Unless `is_released`, nothing begins before a person
    /// releases it.
    ///
    /// # Errors
    /// [`io::Error`] for a file that cannot be read, or is of another version.
    pub async fn open_queue(&self, is_released: bool) -> io::Result<()> {
        let queue = Queue::open(&self.inner.data, is_released, unix_ms(SystemTime::now()))?;
        self.inner.queue.kept.lock().await.queue = queue;
        Ok(())
    }

    /// Begins the entries of the queue, one after the other, until the daemon is about to close.
    pub async fn run_queue(self, ending: CancellationToken) {
        let mut status = self.inner.rig.status();
        loop {
            let seen = status.borrow_and_update().clone();
            self.take_turn(&seen).await;
            tokio::select! {
                () = ending.cancelled() => return,
                () = self.inner.queue.changed.notified() => {}
                changed = status.changed() => if changed.is_err() { return },
            }
        }
    }

    /// Looks what has become of the run under way, and begins the next one if its turn has come.
    async fn take_turn(&self, status: &Status) {
        let mut kept = self.inner.queue.kept.lock().await;
        if let Some(run) = kept.run {
            let Some(ended) = self.ended(run, status).await else { return };
            kept.run = None;
            let mut queue = kept.queue.clone();
            let late = queue.end(unix_ms(SystemTime::now())).map(LateRun::sentence);
            if let Some(sentence) = late {
                self.note_by_daemon(sentence).await;
            }
            self.keep(&mut kept, queue).await;
            if let Err(trouble) = ended {
                self.hold_queue(&mut kept, HoldKind::Fault, trouble).await;
                return;
            }
        }
        let snapshot = &status.snapshot;
        let fault = snapshot.fault.as_ref().map(ToString::to_string);
        let seen = Seen {
            state: snapshot.state,
            fault: fault.as_deref(),
            journal_error: status.journal_error.as_deref(),
            is_silent: status.silence.is_some(),
        };
        match kept.queue.turn(seen) {
            Turn::Wait => {}
            Turn::Hold(kind, reason) => self.hold_queue(&mut kept, kind, reason).await,
            Turn::Begin(entry) => self.begin_entry(&mut kept, &entry).await,
        }
    }
    /// How a run of the queue has ended; `None` while it is under way.
    async fn ended(&self, run: RunId, status: &Status) -> Option<Result<(), String>> {
        let is = |how: &str| Some(Err(format!("the last run of the queue is {how}")));
        if let Some(shown) = status.run.as_ref().filter(|shown| shown.id == run) {
            return match shown.ending? {
                Ended::Completed | Ended::CompletedWithRefusals => Some(Ok(())),
                ending @ (Ended::Aborted | Ended::Faulted) => is(ending.name()),
            };
        }
        // The status does not show it yet, or shows one that has begun since.
        match self.read(move |reader| Ok(reader.run(run)?.status)).await {
            Ok(RunStatus::Running) => None,
            Ok(RunStatus::Ended(Ending::Completed | Ending::CompletedWithRefusals)) => Some(Ok(())),
            Ok(other) => is(&other.describe()),
            Err(problem) => is(&format!("unknown: {}", problem.detail())),
        }
    }

    /// Begins the run of an entry, and takes the entry out.
    async fn begin_entry(&self, kept: &mut Kept, entry: &Entry) {
        let (number, name) = (entry.number, &entry.protocol);
        let facts = &self.inner.facts;
        let laid_out = match self.laid_out(name, entry.toml.clone(), Purpose::Run).await {
            Ok(laid_out) => laid_out.map_err(|faults| first(&faults)),
            Err(problem) => Err(problem.detail().to_owned()),
        };
        let protocol = match laid_out {
            Ok(protocol) => protocol,
            Err(why) => {
                let reason = format!("entry {number} cannot run on this rig: {why}");
                return self.hold_queue(kept, HoldKind::Fault, reason).await;
            }
        };
        let duration_s = wall_s(facts, protocol.summary.duration_s);
        let mut queue = kept.queue.clone();
        if !entry.is_in_time(unix_ms(SystemTime::now()), duration_s) {
            let what = format!(
                "leave out entry {number} of the queue, {name}: it cannot end by its deadline"
            );
            self.note_by_daemon(what).await;
            queue.miss(number);
            return self.keep(kept, queue).await;
        }
        // An entry whose run began before the daemon was killed has begun.
        let key = entry.key();
        let wanted = key.clone();
        let begun = match self.read(move |reader| Ok(reader.keyed_run(&wanted)?)).await {
            Ok(Some(first)) => Ok(first.run),
            Ok(None) => {
                let begun = self.inner.rig.keyed_run(protocol, &entry.by, Some(key)).await;
                begun.map_err(|refusal| match refusal {
                    // A client was faster; the status will show it.
                    RequestRefusal::Command(CommandRefusal::State { .. }) => None,
                    other => Some(with_causes(&other)),
                })
            }
            Err(problem) => Err(Some(problem.detail().to_owned())),
        };
        match begun {
            Ok(run) => {
                kept.run = Some(run);
                queue.begin(entry, run.to_string());
                self.keep(kept, queue).await;
            }
            Err(None) => {}
            Err(Some(why)) => {
                let reason = format!("entry {number} could not begin: {why}");
                self.hold_queue(kept, HoldKind::Fault, reason).await;
            }
        }
    }

    /// Holds the queue, for a reason that no person has given.
    async fn hold_queue(&self, kept: &mut Kept, kind: HoldKind, reason: String) {
        if kept.queue.hold().is_some() {
            return;
        }
        let mut queue = kept.queue.clone();
        queue.stop(kind, reason.clone(), unix_ms(SystemTime::now()));
        self.note_by_daemon(format!("hold the queue: {reason}")).await;
        self.keep(kept, queue).await;
    }

    /// A journal that cannot be written holds the queue by itself.
    async fn note_by_daemon(&self, action: String) {
        if let Err(refusal) = self.inner.rig.note(action, DAEMON).await {
            tracing::warn!(%refusal, "the journal has no note of what the queue did");
        }
    }

    /// Goes on with this queue, even if its file cannot be written: then it is held.
    async fn keep(&self, kept: &mut Kept, queue: Queue) {
        kept.queue = queue.clone();
        if let Err(problem) = self.written(queue).await {
            let reason = problem.detail().to_owned();
            kept.queue.stop(HoldKind::Fault, reason, unix_ms(SystemTime::now()));
        }
    }
}

impl From<QueueRefusal> for Problem {
    fn from(refusal: QueueRefusal) -> Self {
        let detail = refusal.to_string();
        match refusal {
            QueueRefusal::NoEntry(_) => Self::not_found(detail),
            QueueRefusal::Full | QueueRefusal::Empty => Self::of(StatusCode::CONFLICT, detail),
            QueueRefusal::LongNote => Self::bad_request(detail),
            QueueRefusal::NoPlace { .. } | QueueRefusal::OtherRequest { .. } => {
                Self::unprocessable(detail)
            }
        }
    }
}
