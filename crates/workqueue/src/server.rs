//! The connection to the server, and the filling of the queue.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    path::Path,
    time::{Duration, Instant},
};

use async_nats::{
    ConnectOptions, ServerAddr,
    jetstream::{
        self, Context, ErrorCode,
        consumer::{AckPolicy, Info, PullConsumer, pull},
        context::{ConsumerInfoErrorKind, GetStreamErrorKind, PublishErrorKind, RequestErrorKind},
        message::{PublishMessage, StreamMessage},
        stream::{Config, RawMessageErrorKind, RetentionPolicy, Stream},
    },
};
use futures_util::TryStreamExt;
use serde::Deserialize;
use tokio::{
    runtime::{Builder, Runtime},
    time::{sleep, timeout},
};

use crate::{
    chunk::{Chunk, Kind, Work},
    error::QueueError,
};

/// Time limit of a connection.
const CONNECT_TIME: Duration = Duration::from_secs(10);
/// A server that has not answered twice in this time is gone, and is connected to again.
const PING_EVERY: Duration = Duration::from_secs(10);
/// Time in which a server that was there must answer again: it may be started anew.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time to the second attempt, and the longest time between two. It doubles in between.
const WAITS: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(4)];
/// Time that the server keeps what nobody has asked for, so that work that was forgotten leaves nothing.
const KEPT: Duration = Duration::from_secs(30 * 24 * 3600);
/// Of a new queue: time after which the chunk of a silent worker goes to another one, and number of workers that get it.
const SILENT: Duration = Duration::from_secs(60);
const DELIVERIES: i64 = 3;
/// Largest number of attempts to fill a queue that others fill too.
const FILLS_MAX: usize = 20;

/// A queue, for one work and one program.
#[derive(Debug)]
pub struct Queue {
    pub(super) context: Context,
    /// Host and port.
    pub(super) address: String,
    pub(super) work: Work,
    pub(super) patience: Duration,
    /// Its only thread also says that chunks are in progress while others compute.
    pub(super) runtime: Runtime,
}

/// When a chunk goes to another worker. What is left out is as in the queue, or 60 s and 3 workers in a new one.
#[derive(Debug, Clone, Copy, Default)]
pub struct Redelivery {
    /// Time since the worker has said something.
    pub after: Option<Duration>,
    /// Number of workers that get it, one after the other.
    pub deliveries: Option<i64>,
}

/// What became of the chunks of a call of `--fill`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Filled {
    /// Put into the queue.
    pub added: u64,
    /// In the queue already, or with a worker.
    pub queued: u64,
    /// Computed already.
    pub computed: u64,
}

impl fmt::Display for Filled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { added, queued, computed } = self;
        let all = added + queued + computed;
        write!(
            f,
            "{all} chunks: {added} added, {queued} were in the queue, {computed} were computed"
        )
    }
}

/// What is in the queue of a work before it is filled.
#[derive(Debug)]
pub(super) struct Known {
    queued: Stream,
    /// The number of the last message that was ever added to the stream.
    last: u64,
    /// Chunks that no worker has finished, with the numbers of their messages.
    waiting: BTreeMap<Chunk, u64>,
    /// Those that were given up, if no worker has another one.
    given_up: BTreeMap<Chunk, u64>,
    computed: BTreeSet<Chunk>,
    /// What this call has added.
    own: BTreeSet<Chunk>,
}

impl Known {
    fn all(&self) -> BTreeSet<Chunk> {
        self.waiting.keys().chain(&self.computed).copied().collect()
    }
}

impl Queue {
    /// Connects. With `files`, the connection is by TLS: `ca.pem` is the certificate of the server's authority, and `worker.pem`
    /// with `worker.key`, if they are there, the certificate of this program.
    ///
    /// # Errors
    /// [`QueueError`].
    pub fn connect(
        server: &ServerAddr,
        files: Option<&Path>,
        work: Work,
    ) -> Result<Self, QueueError> {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.map_err(QueueError::Runtime)?;
        // Without the password that it may have.
        let address = format!("{}:{}", server.host(), server.port());
        let mut options = ConnectOptions::new()
            .name(format!("rigd {}", work.kind))
            .connection_timeout(CONNECT_TIME)
            .ping_interval(PING_EVERY);
        if let (Some(user), Some(password)) = (server.username(), server.password()) {
            options = options.user_and_password(user.to_owned(), password.to_owned());
        }
        if let Some(files) = files {
            options = options.require_tls(true).add_root_certificates(files.join("ca.pem"));
            let [certificate, key] = ["worker.pem", "worker.key"].map(|name| files.join(name));
            if certificate.exists() {
                options = options.add_client_certificate(certificate, key);
            }
        }
        let context = runtime.block_on(async {
            let within = CONNECT_TIME;
            match timeout(within, options.connect(server.clone())).await {
                Ok(Ok(client)) => Ok(jetstream::new(client)),
                Ok(Err(cause)) => Err(QueueError::Connect { address: address.clone(), cause }),
                Err(_) => Err(QueueError::Silent { address: address.clone(), within }),
            }
        })?;
        let queue = Self { context, address, work, patience: PATIENCE, runtime };
        queue.runtime.block_on(queue.check())?;
        Ok(queue)
    }

    /// Asks whether the account has `JetStream`.
    async fn check(&self) -> Result<(), QueueError> {
        // The library cannot read the other parts of what an older server answers.
        #[derive(Deserialize)]
        struct Account {
            error: Option<jetstream::Error>,
        }
        let without = || QueueError::NoJetStream { address: self.address.clone() };
        let answer: Result<Account, _> = self.context.request("INFO", &()).await;
        match answer {
            Ok(Account { error: None }) => Ok(()),
            Ok(Account { error: Some(error) }) if is_without(&error) => Err(without()),
            Ok(Account { error: Some(error) }) => Err(self.at("JetStream")(error)),
            Err(error) if error.kind() == RequestErrorKind::NoResponders => Err(without()),
            Err(error) => Err(self.at("JetStream")(error)),
        }
    }

    /// Puts chunks into the queue that are neither in it nor computed. A chunk that was given up is put into it again, if no
    /// worker has another one.
    ///
    /// # Errors
    /// [`QueueError`]. A chunk that is in part another one is not added.
    pub fn fill(&self, chunks: &[Chunk], redelivery: Redelivery) -> Result<Filled, QueueError> {
        self.runtime.block_on(async {
            let mut known = self.look(redelivery).await?;
            for _ in 0..FILLS_MAX {
                self.check_apart(chunks, &known.all())?;
                if let Some(filled) = self.add(chunks, &mut known).await? {
                    return Ok(filled);
                }
                let Known { given_up, own, .. } = known;
                known = Known { given_up, own, ..self.look(redelivery).await? };
            }
            Err(QueueError::Contended { address: self.address.clone(), attempts: FILLS_MAX })
        })
    }

    /// What is in the queue, which is made if it is not there.
    pub(super) async fn look(&self, redelivery: Redelivery) -> Result<Known, QueueError> {
        let [mut queued, pieces] = [self.make(Kind::Chunk).await?, self.make(Kind::Piece).await?];
        let consumer = self.provide(&queued, redelivery).await?;
        // Before the messages: who adds one after that is noticed.
        let info = queued.info().await.map_err(self.at("the queue"))?;
        let last = info.state.last_sequence;
        let waiting = self.messages(&queued, Kind::Chunk, &mut 0).await?.into_iter();
        let waiting: BTreeMap<_, _> =
            waiting.map(|(chunk, message)| (chunk, message.sequence)).collect();
        // After the chunks, or one that has come since would be taken for one that was given up; and before the pieces: a chunk
        // that is finished by then has its piece there.
        let info = consumer.get_info().await.map_err(self.at("the workers"))?;
        let computed = self.messages(&pieces, Kind::Piece, &mut 0).await?.into_iter();
        let given_up = if is_empty(&info) { waiting.clone() } else { BTreeMap::new() };
        let computed = computed.map(|(chunk, _)| chunk).collect();
        Ok(Known { queued, last, waiting, given_up, computed, own: BTreeSet::new() })
    }

    /// Adds the chunks that are not known. `None` if another program has added something since the look: that may have a part
    /// of the same numbers.
    pub(super) async fn add(
        &self,
        chunks: &[Chunk],
        known: &mut Known,
    ) -> Result<Option<Filled>, QueueError> {
        let mut filled = Filled::default();
        for chunk in chunks {
            let waiting = known.waiting.get(chunk).copied();
            let given_up = known.given_up.get(chunk).copied();
            if known.own.contains(chunk) {
                filled.added += 1;
            } else if known.computed.contains(chunk) {
                filled.computed += 1;
            } else if waiting.is_some() && waiting != given_up {
                filled.queued += 1;
            } else if self.publish_chunk(*chunk, waiting, known).await? {
                known.own.insert(*chunk);
                filled.added += 1;
            } else {
                return Ok(None);
            }
        }
        Ok(Some(filled))
    }

    /// Adds a chunk in the place of the message with a number, and says whether nothing else was added since the look.
    async fn publish_chunk(
        &self,
        chunk: Chunk,
        instead_of: Option<u64>,
        known: &mut Known,
    ) -> Result<bool, QueueError> {
        let message = PublishMessage::build().expected_last_sequence(known.last);
        let subject = self.work.subject(Kind::Chunk, chunk);
        let sent = async { self.context.send_publish(subject, message).await?.await }.await;
        let number = match sent {
            Ok(taken) => taken.sequence,
            Err(error) if error.kind() == PublishErrorKind::WrongLastSequence => return Ok(false),
            Err(error) => return Err(self.at("a chunk cannot be added")(error)),
        };
        let is_next = number == known.last + 1;
        known.last = number;
        // An older server does not compare the number 0, which is that of a new stream: the other program was first.
        let removed = if is_next { instead_of } else { Some(number) };
        if let Some(removed) = removed {
            let deleted = known.queued.delete_message(removed).await;
            deleted.map_err(self.at("a chunk cannot be removed from the queue"))?;
        }
        Ok(is_next)
    }

    /// The stream of these messages, which is made if it is not there.
    async fn make(&self, kind: Kind) -> Result<Stream, QueueError> {
        let retention = match kind {
            Kind::Chunk => RetentionPolicy::WorkQueue,
            Kind::Piece => RetentionPolicy::Limits,
        };
        let config = Config {
            name: self.work.stream(kind),
            subjects: vec![self.work.stream_subjects(kind)],
            retention,
            max_age: KEPT,
            ..Config::default()
        };
        let made = self.context.get_or_create_stream(config).await;
        made.map_err(self.at("the queue cannot be made"))
    }

    /// The stream of these messages.
    pub(super) async fn open(&self, kind: Kind) -> Result<Stream, QueueError> {
        let opened = self.patiently("the queue cannot be opened", async || {
            match self.context.get_stream(self.work.stream(kind)).await {
                Ok(stream) => Ok(Some(stream)),
                Err(error) if is_unknown(&error.kind()) => Ok(None),
                Err(error) => Err(error.into()),
            }
        });
        opened.await?.ok_or_else(|| self.not_filled(Vec::new()))
    }

    /// What the workers of this work share.
    pub(super) async fn workers(&self) -> Result<PullConsumer, QueueError> {
        let stream = self.open(Kind::Chunk).await?;
        let name = self.work.consumer();
        let all = self.patiently("the workers cannot be listed", async || {
            Ok(stream.consumers().try_collect::<Vec<_>>().await?)
        });
        let (own, others): (Vec<_>, Vec<_>) =
            all.await?.into_iter().partition(|info| info.name == name);
        if own.is_empty() {
            let others = others.into_iter().filter(|info| !is_empty(info));
            let title = |info: Info| info.config.description.unwrap_or(info.name);
            return Err(self.not_filled(others.map(title).collect()));
        }
        let found = self
            .patiently("the workers cannot be found", async || stream.get_consumer(&name).await);
        found.await
    }

    /// What the workers of this work share, which is made if it is not there. It is changed only while it has no chunks: a worker
    /// says that it is at work as often as the queue had it when the chunk was taken.
    async fn provide(
        &self,
        queued: &Stream,
        redelivery: Redelivery,
    ) -> Result<PullConsumer, QueueError> {
        let what = "the workers cannot be provided for";
        let held = match queued.consumer_info(self.work.consumer()).await {
            Ok(info) => Some(info),
            Err(error) if error.kind() == ConsumerInfoErrorKind::NotFound => None,
            Err(error) => return Err(self.at(what)(error)),
        };
        let known = held.as_ref().map_or((SILENT, DELIVERIES), lease);
        let wanted =
            (redelivery.after.unwrap_or(known.0), redelivery.deliveries.unwrap_or(known.1));
        match held {
            Some(info) if wanted != known && !is_empty(&info) => {
                let address = self.address.clone();
                return Err(QueueError::Lease { address, known, wanted });
            }
            Some(_) if wanted == known => {
                return queued.get_consumer(&self.work.consumer()).await.map_err(self.at(what));
            }
            _ => {}
        }
        let config = pull::Config {
            durable_name: Some(self.work.consumer()),
            description: Some(self.work.to_string()),
            ack_policy: AckPolicy::Explicit,
            ack_wait: wanted.0,
            max_deliver: wanted.1,
            filter_subject: self.work.subjects(Kind::Chunk),
            ..pull::Config::default()
        };
        queued.create_consumer(config).await.map_err(self.at(what))
    }

    /// The messages of this work in a stream behind the one with a number, which is changed to that of the last.
    pub(super) async fn messages(
        &self,
        stream: &Stream,
        kind: Kind,
        behind: &mut u64,
    ) -> Result<Vec<(Chunk, StreamMessage)>, QueueError> {
        let subjects = self.work.subjects(kind);
        let mut messages = Vec::new();
        loop {
            let next = self.patiently("the messages cannot be read", async || {
                let next = stream
                    .raw_message_builder()
                    .sequence(*behind + 1)
                    .next_by_subject(subjects.clone());
                match next.send().await {
                    Ok(message) => Ok(Some(message)),
                    Err(error) if error.kind() == RawMessageErrorKind::NoMessageFound => Ok(None),
                    Err(error) => Err(error.into()),
                }
            });
            let Some(message) = next.await? else { return Ok(messages) };
            *behind = message.sequence;
            if let Some(chunk) = self.work.chunk(kind, &message.subject) {
                messages.push((chunk, message));
            }
        }
    }

    /// Tries until it succeeds or the patience is over.
    pub(super) async fn patiently<T>(
        &self,
        what: &'static str,
        attempt: impl AsyncFn() -> Result<T, async_nats::Error>,
    ) -> Result<T, QueueError> {
        let until = Instant::now() + self.patience;
        let [mut wait, longest] = WAITS;
        loop {
            match attempt().await {
                Ok(value) => return Ok(value),
                Err(error) if Instant::now() + wait > until => return Err(self.error(what, error)),
                Err(_) => sleep(wait).await,
            }
            wait = (wait * 2).min(longest);
        }
    }

    fn at<E: Into<async_nats::Error>>(&self, what: &'static str) -> impl Fn(E) -> QueueError {
        move |error| self.error(what, error.into())
    }

    pub(super) fn error(&self, what: &'static str, cause: async_nats::Error) -> QueueError {
        QueueError::Server { address: self.address.clone(), what, cause }
    }

    fn not_filled(&self, others: Vec<String>) -> QueueError {
        let (address, work) = (self.address.clone(), Box::new(self.work.clone()));
        QueueError::NotFilled { address, work, others }
    }

    /// Refuses a chunk that is in part a known one.
    fn check_apart(&self, chunks: &[Chunk], known: &BTreeSet<Chunk>) -> Result<(), QueueError> {
        for chunk in chunks {
            // The known ones are apart from each other.
            let neighbours = [known.range(..chunk).next_back(), known.range(chunk..).next()];
            let mut neighbours = neighbours.into_iter().flatten();
            if let Some(known) = neighbours.find(|known| known.is_partly(*chunk)) {
                let [asked, known] = [chunk, known].map(|chunk| self.work.numbers(&chunk.range()));
                return Err(QueueError::Overlap { asked, known });
            }
        }
        Ok(())
    }
}

/// After which time the chunk of a silent worker goes to another one, and how many workers get it.
const fn lease(info: &Info) -> (Duration, i64) {
    (info.config.ack_wait, info.config.max_deliver)
}

/// Whether no chunk waits and none is with a worker. Those that are in the stream then were given up.
pub(super) const fn is_empty(info: &Info) -> bool {
    info.num_pending == 0 && info.num_ack_pending == 0
}

/// Whether there is no such stream.
fn is_unknown(error: &GetStreamErrorKind) -> bool {
    let GetStreamErrorKind::JetStream(error) = error else { return false };
    error.error_code() == ErrorCode::STREAM_NOT_FOUND
}

/// Whether the server or the account has no `JetStream`.
fn is_without(error: &jetstream::Error) -> bool {
    let code = error.error_code();
    [ErrorCode::JETSTREAM_NOT_ENABLED, ErrorCode::JETSTREAM_NOT_ENABLED_FOR_ACCOUNT].contains(&code)
}
