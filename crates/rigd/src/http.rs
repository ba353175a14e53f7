//! The HTTP interface: JSON in and out, errors as `application/problem+json`.
//!
//! | method and path | does |
//! |---|---|
//! | `GET /api/v1/rig` | state, devices, whether the probe is clear |
//! | `POST /api/v1/sweeps` | one sweep now, at the present pose |
//! | `GET /api/v1/sweeps/{id}` | that sweep |
//! | `POST /api/v1/moves` | moves one axis by hand |
//! | `GET /` | the page |
//! | `POST /api/v1/protocols/check` | the plan of a protocol, or its faults |
//! | `POST /api/v1/runs` | replays the loaded protocol, or the one in the body |
//! | `GET /api/v1/runs`, `GET /api/v1/runs/{id}` | the runs; one run with its results |
//! | `GET /api/v1/runs/{id}/plan`, `protocol` | its plan, step by step; its protocol as TOML |
//! | `GET /api/v1/runs/{id}/changes` | what has changed since: rig file, software, devices |
//! | `GET /api/v1/frames` | the last frames of each port |
//! | `GET /api/v1/notes`, `PUT /api/v1/runs/{id}/note` | notes of people about runs |
//! | `GET /api/v1/runs/{id}/sweeps/{number}` | one of its sweeps |
//! | `GET /api/v1/runs/{id}/report` | its report as HTML |
//! | `GET /api/v1/runs/{id}/export?format=csv` | its touches; `sweeps` or `jsonl` for the rest |
//! | `POST /api/v1/runs/{id}/pause`, `resume`, `abort`, `answer` | a command to that run |
//! | `POST /api/v1/runs/{id}/continue`, `give-up` | goes on with a run that was not completed; seals it |
//! | `POST /api/v1/runs/{id}/redo`, `skip` | measures one touch again; leaves it out |
//! | `POST /api/v1/stop` | stops everything, retracts, latches |
//! | `POST /api/v1/acknowledge` | leaves the latch |
//! | `POST /api/v1/home` | the same, and homes a linear stage that has lost its position |
//! | `GET /api/v1/events` | every record of the journal, as server-sent events |
//!
//! `GET /` links to the rest. Every request passes the guard first, which checks host, site, token
//! and size.
//!
//! A handler sends a request to the rig thread and waits for the answer; the rig thread never waits
//! for a handler.

pub mod access;
mod changes;
mod events;
mod frames;
mod guard;
mod index;
mod limits;
mod live;
mod moves;
mod notes;
mod page;
mod plan;
mod problem;
mod progress;
mod results;
mod resume;
mod rig;
mod runs;
mod server;
mod sweeps;

use std::{panic::AssertUnwindSafe, path::PathBuf, sync::Arc};

use axum::{
    Router,
    extract::Request,
    http::{Method, Uri},
    middleware::{Next, from_fn, from_fn_with_state},
    response::{IntoResponse, Response},
    routing::{get, post, put},
};
use futures_util::FutureExt;
use rig_model::{panic_message, with_causes};
use rig_store::{Reader, RunId, RunStatus};
use tokio::sync::{Mutex, Semaphore};
use tokio_util::sync::CancellationToken;

use crate::{loaded_rig::RigFacts, protocol_file::LoadedProtocol, rig::RigHandle, run_files};
use access::Access;
pub(crate) use guard::FOREIGN_PAGE;
use problem::Problem;
use results::ResultsCache;
pub use server::serve;

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
    results: ResultsCache,
    /// The event streams that may still be opened.
    streams: Arc<Semaphore>,
    /// Held from the search for a key in the journal until the run that it belongs to has begun, so
    /// that asking twice at once begins one.
    keyed: Mutex<()>,
    /// Held while a note is written.
    noted: Mutex<()>,
    /// Ends the event streams, which would otherwise keep the server from ending.
    closing: CancellationToken,
}

impl Shared {
    /// State for the handlers: the rig, the protocol for a run without a body, the directory of the
    /// journal, and the rules of access.
    pub fn new(
        rig: RigHandle,
        facts: RigFacts,
        loaded: Option<LoadedProtocol>,
        data: PathBuf,
        access: Access,
        closing: CancellationToken,
    ) -> Self {
        let streams = Arc::new(Semaphore::new(events::STREAMS_MAX));
        let (keyed, noted) = (Mutex::new(()), Mutex::new(()));
        let results = ResultsCache::default();
        let inner =
            Inner { rig, facts, loaded, data, access, results, streams, keyed, noted, closing };
        Self { inner: Arc::new(inner) }
    }

    /// Reads from the journal, away from the threads that serve requests.
    async fn read<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Reader) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let data = self.inner.data.clone();
        tokio::task::spawn_blocking(move || work(&Reader::open(&data)?))
            .await
            .map_err(|_| Problem::internal("the reader of the journal has panicked"))?
    }
}

impl Shared {
    /// Writes the folder of a run anew, unless the run is under way: then it is written at its end. The
    /// journal has the change already, so that a failure is no answer to the request.
    async fn write_files(&self, run: RunId) {
        let write = self.read(move |reader| Ok(reader.run(run)?.status));
        if !matches!(write.await, Ok(status) if status != RunStatus::Running) {
            return;
        }
        let data = self.inner.data.clone();
        let written = tokio::task::spawn_blocking(move || run_files::write(&data, run)).await;
        if let Ok(Err(error)) = written {
            let error = with_causes(&error);
            tracing::warn!(%run, error, "the folder of the run cannot be written");
        }
    }
}

/// The routes of the daemon.
pub fn router(shared: Shared) -> Router {
    let api = Router::new()
        .route("/rig", get(rig::show))
        .route("/stop", post(rig::stop))
        .route("/acknowledge", post(rig::acknowledge))
        .route("/home", post(rig::home))
        .route("/moves", post(moves::begin))
        .route("/sweeps", post(sweeps::begin))
        .route("/sweeps/{id}", get(sweeps::show))
        .route("/runs", get(runs::list).post(runs::begin))
        .route("/runs/{id}", get(runs::show))
        .route("/runs/{id}/changes", get(changes::show))
        .route("/runs/{id}/note", put(notes::write))
        .route("/notes", get(notes::list))
        .route("/frames", get(frames::show))
        .route("/runs/{id}/plan", get(plan::of_run))
        .route("/runs/{id}/protocol", get(plan::protocol))
        .route("/runs/{id}/sweeps/{number}", get(plan::sweep))
        .route("/runs/{id}/report", get(runs::report))
        .route("/runs/{id}/export", get(runs::export))
        .route("/runs/{id}/pause", post(runs::pause))
        .route("/runs/{id}/resume", post(runs::resume))
        .route("/runs/{id}/abort", post(runs::abort))
        .route("/runs/{id}/answer", post(runs::answer))
        .route("/runs/{id}/continue", post(resume::resume))
        .route("/runs/{id}/redo", post(resume::redo))
        .route("/runs/{id}/skip", post(resume::skip))
        .route("/runs/{id}/give-up", post(resume::give_up))
        .route("/protocols/check", post(plan::check))
        .route("/events", get(events::stream));
    Router::new()
        .route("/", get(index::show))
        .route("/docs/http", get(index::documentation))
        .route("/api/v1", get(index::show))
        .route("/api/v1/", get(index::show))
        .merge(page::routes())
        .nest("/api/v1", api)
        .fallback(not_found)
        .method_not_allowed_fallback(method_not_allowed)
        .layer(from_fn_with_state(shared.clone(), guard::check))
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
