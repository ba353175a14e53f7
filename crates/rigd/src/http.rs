//! The HTTP interface: JSON in and out, errors as `application/problem+json`.
//!
//! `route.rs` has the table of the routes, from which the router and the `OpenAPI` document are made.
//! `GET /` links to the rest. Every request passes the guard first, which checks host, site, token
//! and size.
//!
//! A handler sends a request to the rig thread and waits for the answer; the rig thread never waits
//! for a handler.

pub mod access;
mod block_runs;
mod changes;
mod checks;
mod commission;
mod events;
mod expiry;
mod export;
mod frames;
mod guard;
mod guesses;
mod health;
mod hub;
mod index;
mod lease;
mod limits;
mod live;
mod metrics;
mod moves;
mod notes;
mod object;
pub mod openapi;
mod page;
mod places;
mod plan;
mod problem;
mod progress;
mod queue;
mod reload;
mod results;
mod resume;
mod rig;
pub(crate) mod room;
mod route;
mod runs;
mod sensor_check;
mod server;
mod session;
mod span;
mod sweeps;
mod tag;
pub mod tls;
mod token_file;

use std::{
    panic::AssertUnwindSafe,
    path::PathBuf,
    sync::{Arc, OnceLock, PoisonError, RwLock, atomic::AtomicUsize},
    time::Duration,
};

use axum::{
    Router,
    extract::Request,
    http::{Method, Uri},
    middleware::{Next, from_fn, from_fn_with_state},
    response::{IntoResponse, Response},
    routing::get,
};
use futures_util::FutureExt;
use rig_files::Faults;
use rig_hub::{Standing, live::LiveStanding};
use rig_model::{panic_message, with_causes};
use rig_store::{Reader, RunId, RunKind, RunStatus};
use tokio::{
    runtime::Handle,
    sync::{Mutex, Semaphore, mpsc, watch},
    task::JoinHandle,
    time::timeout,
};
use tokio_util::sync::CancellationToken;

use crate::{
    commissioning::Commissioning,
    loaded_rig::RigFacts,
    notify::{Notifier, Post},
    protocol_file::LoadedProtocol,
    rig::{RigHandle, Status},
    run_files::{self, RunFiles, RunFilesError},
    sensor_check::SensorWatch,
};
use access::Access;
pub(crate) use guard::FOREIGN_PAGE;
use lease::Lease;
use metrics::{Happened, Verdicts};
use places::Places;
use problem::Problem;
pub(crate) use reload::{Changed, Kept, ReloadRefusal, ReloadRequest, Reloaded};
use results::ResultsCache;
use room::Room;
pub use server::serve;
use tls::Tls;

/// Interval at which the last uses of tokens are written. A crash loses those since.
const USES_KEPT: Duration = Duration::from_secs(60);

/// The state shared by the handlers.
#[derive(Debug, Clone)]
pub struct Shared {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    rig: RigHandle,
    facts: RigFacts,
    loaded: Option<LoadedProtocol>,
    data: PathBuf,
    access: Access,
    lease: Lease,
    queue: queue::Keeper,
    /// Who is told what happens on the rig, if anybody.
    notifications: RwLock<Option<Arc<Post>>>,
    /// How the shipping of the journal to a hub stands, if there is one.
    shipping: OnceLock<watch::Receiver<Standing>>,
    /// How the messages to viewers stand, if the hub has a nats-server.
    live: OnceLock<watch::Receiver<LiveStanding>>,
    /// The TLS of the listener, if clients must speak it.
    tls: OnceLock<Tls>,
    /// To the task that reads the configuration again.
    reloads: OnceLock<mpsc::Sender<ReloadRequest>>,
    /// The commissioning of the rig by clients.
    commissioning: OnceLock<Commissioning>,
    /// The check of its free sensor by clients.
    sensor: OnceLock<SensorWatch>,
    results: ResultsCache,
    /// Its blocking threads build the documents of runs.
    builders: Handle,
    /// What the figures of the service say of the journal.
    happened: Mutex<Happened>,
    /// What the models of ended runs were found to be.
    verdicts: Verdicts,
    /// Where event streams get the events from.
    hub: hub::Hub,
    /// The event streams with the live rig.
    watching: Arc<AtomicUsize>,
    /// The places of event streams.
    streams: Arc<Places>,
    /// The exports that may still begin.
    exports: Arc<Semaphore>,
    /// Held from the search for a key in the journal until the run that it belongs to has begun, so
    /// that asking twice at once begins one.
    keyed: Mutex<()>,
    /// Held while a note is written.
    noted: Arc<Mutex<()>>,
    /// Ends the event streams, which would otherwise keep the server from ending.
    closing: CancellationToken,
}

/// What a protocol is laid out for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Purpose {
    /// A client looks at its plan.
    Look,
    /// It is run, now or from the queue.
    Run,
}

impl Shared {
    /// State for the handlers: the rig, the protocol for a run without a body, the directory of the
    /// journal, and the rules of access. Documents of runs are built on the blocking threads of
    /// `builders`.
    pub fn new(
        rig: RigHandle,
        facts: RigFacts,
        loaded: Option<LoadedProtocol>,
        data: PathBuf,
        access: Access,
        builders: Handle,
        closing: CancellationToken,
    ) -> Self {
        let room = Room::now();
        let hub = hub::Hub::new(&rig.status().borrow());
        let streams = Places::new(room.streams, room.streams_of_token);
        let exports = Arc::new(Semaphore::new(export::EXPORTS_MAX));
        let (keyed, noted) = (Mutex::new(()), Arc::default());
        let (happened, queue) = (Mutex::default(), queue::Keeper::default());
        let (results, lease) = (ResultsCache::default(), Lease::default());
        let inner = Inner {
            rig,
            facts,
            loaded,
            data,
            access,
            lease,
            queue,
            notifications: RwLock::default(),
            shipping: OnceLock::new(),
            live: OnceLock::new(),
            tls: OnceLock::new(),
            reloads: OnceLock::new(),
            commissioning: OnceLock::new(),
            sensor: OnceLock::new(),
            results,
            builders,
            happened,
            verdicts: Verdicts::default(),
            hub,
            watching: Arc::default(),
            streams,
            exports,
            keyed,
            noted,
            closing,
        };
        Self { inner: Arc::new(inner) }
    }

    /// The rig as it is now.
    pub(crate) fn status(&self) -> Status {
        self.inner.rig.status().borrow().clone()
    }

    /// Tells of each change of the rig.
    pub(crate) fn watch_status(&self) -> watch::Receiver<Status> {
        self.inner.rig.status()
    }

    /// Shows when the certificate of the daemon expires among the figures of the service.
    pub(crate) fn show_certificate(&self, tls: &Tls) {
        _ = self.inner.tls.set(tls.clone());
    }

    /// Shows how the shipping of the journal stands among the figures of the service.
    pub(crate) fn show_hub(&self, standing: watch::Receiver<Standing>) {
        _ = self.inner.shipping.set(standing);
    }

    /// Shows how the messages to viewers stand among the figures of the service.
    pub(crate) fn show_live(&self, standing: watch::Receiver<LiveStanding>) {
        _ = self.inner.live.set(standing);
    }

    /// The rig in this state, as `GET /api/v1/rig` describes it.
    pub(crate) fn document(&self, status: &Status) -> String {
        // A view has no map whose keys are not texts, which is all that JSON refuses.
        serde_json::to_string(&rig::view(self, status)).unwrap_or_default()
    }

    /// Shows the notifications among the figures of the service.
    pub(crate) fn show_notifications(&self, notifier: Option<&Notifier>) {
        let post = notifier.map(Notifier::post);
        *self.inner.notifications.write().unwrap_or_else(PoisonError::into_inner) = post;
    }

    /// Those who are told what happens on the rig. Nothing that holds them panics.
    fn notifications(&self) -> Option<Arc<Post>> {
        self.inner.notifications.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Keeps the times at which tokens were last used, until the daemon closes.
    pub async fn keep_uses(self) {
        while timeout(USES_KEPT, self.inner.closing.cancelled()).await.is_err() {
            self.inner.access.keep_uses();
        }
        self.inner.access.keep_uses();
    }

    /// The run or amendment that a path names: by its whole id, the short name of a run, or `latest`.
    async fn run(&self, wanted: &str) -> Result<RunId, Problem> {
        let wanted = wanted.to_owned();
        self.read(move |reader| {
            let found = if let Ok(id) = wanted.parse() {
                Some(reader.run(id)?).filter(|run| run.kind != RunKind::Session)
            } else {
                let limit = (wanted == "latest").then_some(1);
                let mut runs = reader.latest_runs(limit, None)?.into_iter();
                runs.find(|run| limit.is_some() || run.short_name() == wanted)
            };
            found.map(|run| run.id).ok_or_else(|| Problem::not_found(format!("no run {wanted}")))
        })
        .await
    }

    /// Reads from the journal, away from the threads that serve requests.
    async fn read<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Reader) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        self.read_on(&Handle::current(), work).await
    }

    /// Reads all records of a run and makes a document of them. A short question never waits for it.
    async fn build<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Reader) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        self.read_on(&self.inner.builders, work).await
    }

    async fn read_on<T: Send + 'static>(
        &self,
        threads: &Handle,
        work: impl FnOnce(&Reader) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let data = self.inner.data.clone();
        threads
            .spawn_blocking(move || work(&Reader::open(&data)?))
            .await
            .map_err(|_| Problem::internal("the reader of the journal has panicked"))?
    }

    /// Work for a processor. A stop, and whatever else is asked, does not wait for it.
    async fn work<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Inner) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let inner = Arc::clone(&self.inner);
        let working = self.inner.builders.spawn_blocking(move || work(&inner));
        working.await.map_err(|_| Problem::internal("the work for this request has panicked"))
    }

    /// The text of a protocol, laid out for this rig, or its faults. What begins a run does not wait for documents.
    async fn laid_out(
        &self,
        name: &str,
        text: String,
        purpose: Purpose,
    ) -> Result<Result<LoadedProtocol, Faults>, Problem> {
        let (inner, name) = (Arc::clone(&self.inner), name.to_owned());
        let threads = match purpose {
            Purpose::Look => self.inner.builders.clone(),
            Purpose::Run => Handle::current(),
        };
        let check = move || LoadedProtocol::check(&name, &text, &inner.facts);
        let laid_out = threads.spawn_blocking(check).await;
        laid_out.map_err(|_| Problem::internal("the check of the protocol has panicked"))
    }

    /// Begins to write the folder of a run.
    pub(crate) fn start_writing_files(
        &self,
        run: RunId,
    ) -> JoinHandle<Result<RunFiles, RunFilesError>> {
        let data = self.inner.data.clone();
        self.inner.builders.spawn_blocking(move || run_files::write(&data, run))
    }

    /// Writes the folder of a run again, unless the run is under way: then it is written at its end. The
    /// journal has the change already, so that a failure is no answer to the request.
    async fn write_files(&self, run: RunId) {
        let write = self.read(move |reader| Ok(reader.run(run)?.status));
        if !matches!(write.await, Ok(status) if status != RunStatus::Running) {
            return;
        }
        if let Ok(Err(error)) = self.start_writing_files(run).await {
            let error = with_causes(&error);
            tracing::warn!(%run, error, "the folder of the run cannot be written");
        }
    }
}

/// The routes of the daemon.
pub fn router(shared: Shared) -> Router {
    Router::new()
        .route("/", get(index::show))
        .route("/docs/http", get(index::documentation))
        .route("/openapi.json", get(openapi::show))
        .route("/reference", get(openapi::reference))
        .route("/open/{secret}", get(session::open))
        .route("/healthz", get(health::live))
        .route("/readyz", get(health::ready))
        .route("/metrics", get(metrics::show))
        .route("/api/v1", get(index::show))
        .route("/api/v1/", get(index::show))
        .merge(page::routes())
        .nest("/api/v1", route::router())
        .fallback(not_found)
        .method_not_allowed_fallback(method_not_allowed)
        .layer(from_fn_with_state(shared.clone(), guard::check))
        .layer(from_fn(span::of_request))
        .layer(from_fn(caught))
        .with_state(shared)
}

/// Answers a request whose handler panics. All other requests and the rig go on.
async fn caught(request: Request, next: Next) -> Response {
    let path = request.uri().path().to_owned();
    let answered = AssertUnwindSafe(next.run(request)).catch_unwind().await;
    answered.unwrap_or_else(|panic| {
        let what = panic_message(&*panic);
        tracing::error!(path, what, "the handler of a request has panicked");
        Problem::internal("the handler of this request has panicked").into_response()
    })
}

async fn not_found(uri: Uri) -> Problem {
    Problem::not_found(format!("there is nothing at {uri}"))
}

async fn method_not_allowed(method: Method, uri: Uri) -> Problem {
    Problem::method_not_allowed(format!("{uri} does not take {method}"))
}

#[cfg(test)]
mod tests {
    use axum::{body::Body, http::StatusCode};
    use tower::ServiceExt;

    use super::*;

    async fn panics() -> StatusCode {
        panic!("injected")
    }

    #[tokio::test]
    async fn a_handler_that_panics_answers_with_a_problem_and_the_next_request_is_served() {
        let router = Router::new()
            .route("/panics", get(panics))
            .route("/works", get(|| async { "ok" }))
            .layer(from_fn(caught));
        for (path, status) in
            [("/panics", StatusCode::INTERNAL_SERVER_ERROR), ("/works", StatusCode::OK)]
        {
            let request = Request::get(path).body(Body::empty()).unwrap();
            assert_eq!(router.clone().oneshot(request).await.unwrap().status(), status);
        }
    }
}
