//! The routes below `/api/v1`: one table for the router and for the `OpenAPI` document.

use axum::{
    Router,
    http::Method,
    routing::{MethodRouter, delete, get, post, put},
};
use rig_store::Sweep;
use schemars::{JsonSchema, Schema, SchemaGenerator};

use super::{
    Shared, block_runs, changes,
    changes::ChangesView,
    checks, commission, events, export,
    export::ExportOptions,
    frames,
    frames::FramesView,
    lease,
    lease::{LeaseForm, LeaseView},
    moves,
    moves::MoveForm,
    notes,
    notes::{Note, Notes},
    plan,
    plan::PlanView,
    queue,
    queue::{PlaceForm, QueueForm, QueueView},
    reload,
    reload::Reloaded,
    resume,
    resume::{ContinueForm, TouchForm},
    rig,
    rig::{HomeForm, IdentifiedView},
    runs,
    runs::{AnswerOptions, BegunView, ListOptions, RunDetail, RunView},
    sensor_check, session,
    session::{ClientView, LinkView},
    sweeps,
    sweeps::{SweepLine, SweepView},
};
use crate::{rig_view::RigView, sweep_form::SweepForm};

/// An operation of the interface.
pub(super) struct Route {
    pub(super) method: Method,
    /// Below `/api/v1`.
    pub(super) path: &'static str,
    /// Name of the operation for clients that are generated.
    pub(super) id: &'static str,
    pub(super) summary: &'static str,
    /// The options after `?`.
    pub(super) query: Option<SchemaOf>,
    /// Headers of the request that only this operation has.
    pub(super) headers: &'static [Header],
    pub(super) body: Content,
    pub(super) status: u16,
    pub(super) answer: Content,
    handler: fn() -> MethodRouter<Shared>,
}

/// A header of a request.
#[derive(Clone, Copy)]
pub(super) struct Header {
    pub(super) name: &'static str,
    /// Form of its values, as a regular expression.
    pub(super) pattern: &'static str,
    pub(super) description: &'static str,
}

/// Makes the schema of a type.
pub(super) type SchemaOf = fn(&mut SchemaGenerator) -> Schema;

/// A body.
pub(super) enum Content {
    None,
    Json(SchemaOf),
    /// It may be left out.
    OptionalJson(SchemaOf),
    /// A protocol as TOML, or as JSON with `protocol_toml`; without it, the loaded one.
    Protocol,
    /// Of one of these media types.
    Text(&'static [&'static str]),
}

pub(super) const fn json<T: JsonSchema>() -> Content {
    Content::Json(schema_of::<T>)
}

fn schema_of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    generator.subschema_for::<T>()
}

impl Route {
    pub(super) const fn get(
        path: &'static str,
        id: &'static str,
        summary: &'static str,
        answer: Content,
        handler: fn() -> MethodRouter<Shared>,
    ) -> Self {
        let (method, body) = (Method::GET, Content::None);
        Self {
            method,
            path,
            id,
            summary,
            query: None,
            headers: &[],
            body,
            status: 200,
            answer,
            handler,
        }
    }

    pub(super) const fn post(
        path: &'static str,
        id: &'static str,
        summary: &'static str,
        body: Content,
        status: u16,
        answer: Content,
        handler: fn() -> MethodRouter<Shared>,
    ) -> Self {
        let method = Method::POST;
        Self { method, path, id, summary, query: None, headers: &[], body, status, answer, handler }
    }

    fn with_query<T: JsonSchema>(self) -> Self {
        Self { query: Some(schema_of::<T>), ..self }
    }

    fn with_headers(self, headers: &'static [Header]) -> Self {
        Self { headers, ..self }
    }
}

pub(super) const KEY: Header = Header {
    name: "Idempotency-Key",
    pattern: "^[!-~]{1,255}$",
    description: "a repeated request with it begins no second run, and adds no second entry",
};
const LAST: Header = Header {
    name: "Last-Event-ID",
    pattern: "^[0-9]{1,18}$",
    description: "number of the last event that the client has seen",
};
const EVENTS: &[&str] = &["text/event-stream"];
const TOML: &[&str] = &["application/toml"];
pub(super) const HTML: &[&str] = &["text/html"];
const TABLES: &[&str] =
    &["text/csv", "application/vnd.apache.parquet", "application/x-hdf5", "application/jsonl"];

/// The requests about the rig as a whole.
fn of_rig() -> Vec<Route> {
    vec![
        Route::get("/rig", "getRig", "The rig as it is now", json::<RigView>(), || get(rig::show)),
        Route::post(
            "/stop",
            "stop",
            "Stops both axes, retracts, and latches",
            Content::None,
            200,
            json::<RigView>(),
            || post(rig::stop),
        ),
        Route::post(
            "/acknowledge",
            "acknowledge",
            "Leaves the latch: the rig is prepared again, retracting first",
            Content::None,
            200,
            json::<RigView>(),
            || post(rig::acknowledge),
        ),
        Route::post(
            "/home",
            "home",
            "Homes a linear stage that has lost its position",
            json::<HomeForm>(),
            200,
            json::<RigView>(),
            || post(rig::home),
        ),
        Route::post(
            "/identify",
            "identify",
            "Asks each device of an idle rig again who it is. Nothing moves",
            Content::None,
            200,
            json::<Vec<IdentifiedView>>(),
            || post(rig::identify),
        ),
        Route::post(
            "/moves",
            "move",
            "Moves one axis by hand",
            json::<MoveForm>(),
            202,
            json::<RigView>(),
            || post(moves::begin),
        ),
        Route::post(
            "/config/reload",
            "reloadConfig",
            "Reads the configuration of the daemon again, and changes what needs no restart",
            Content::None,
            200,
            json::<Reloaded>(),
            || post(reload::reload),
        ),
    ]
}

/// Single sweeps, the check of a protocol, and events.
fn of_measurements() -> Vec<Route> {
    vec![
        Route::post(
            "/sweeps",
            "sweep",
            "Begins one sweep at the present pose",
            json::<SweepForm>(),
            202,
            json::<SweepView>(),
            || post(sweeps::begin),
        ),
        Route::get("/sweeps/{id}", "getSweep", "One single sweep", json::<SweepView>(), || {
            get(sweeps::show)
        }),
        Route::post(
            "/protocols/check",
            "checkProtocol",
            "The plan of a protocol, or its faults. Nothing moves",
            Content::Protocol,
            200,
            json::<PlanView>(),
            || post(plan::check),
        ),
        Route::get(
            "/events",
            "events",
            "Every record of the journal, as server-sent events",
            Content::Text(EVENTS),
            || get(events::stream),
        )
        .with_query::<events::StreamOptions>()
        .with_headers(&[LAST]),
    ]
}

/// The requests that read runs.
fn of_runs() -> Vec<Route> {
    vec![
        Route::get(
            "/runs",
            "listRuns",
            "The runs, the latest first",
            json::<Vec<RunView>>(),
            || get(runs::list),
        )
        .with_query::<ListOptions>(),
        Route::get(
            "/runs/{id}",
            "getRun",
            "One run with its results so far",
            json::<RunDetail>(),
            || get(runs::show),
        ),
        Route::get("/runs/{id}/plan", "getPlan", "Its plan", json::<PlanView>(), || {
            get(plan::of_run)
        }),
        Route::get(
            "/runs/{id}/protocol",
            "getProtocol",
            "Its protocol",
            Content::Text(TOML),
            || get(plan::protocol),
        ),
        Route::get(
            "/runs/{id}/sweeps",
            "listRunSweeps",
            "Its sweeps, without their readings",
            json::<Vec<SweepLine>>(),
            || get(sweeps::of_run),
        ),
        Route::get(
            "/runs/{id}/sweeps/{number}",
            "getRunSweep",
            "One of its sweeps, with readings",
            json::<Sweep>(),
            || get(plan::sweep),
        ),
        Route::get("/runs/{id}/report", "getReport", "Its report", Content::Text(HTML), || {
            get(runs::report)
        }),
        Route::get(
            "/runs/{id}/export",
            "exportRun",
            "Its tables, documents or records",
            Content::Text(TABLES),
            || get(export::show),
        )
        .with_query::<ExportOptions>(),
    ]
}

/// The requests that begin a run or lead it.
fn to_runs() -> Vec<Route> {
    vec![
        Route::post(
            "/runs",
            "beginRun",
            "Begins a run",
            Content::Protocol,
            202,
            json::<BegunView>(),
            || post(runs::begin),
        )
        .with_headers(&[KEY]),
        Route::post(
            "/runs/{id}/pause",
            "pauseRun",
            "Pauses before the next step, with the probe clear",
            Content::None,
            202,
            Content::None,
            || post(runs::pause),
        ),
        Route::post(
            "/runs/{id}/resume",
            "resumeRun",
            "Goes on after a pause",
            Content::None,
            202,
            Content::None,
            || post(runs::resume),
        ),
        Route::post(
            "/runs/{id}/abort",
            "abortRun",
            "Retracts and ends the run",
            Content::None,
            202,
            Content::None,
            || post(runs::abort),
        ),
        Route::post(
            "/runs/{id}/answer",
            "answer",
            "Answers a prompt, or decides about a refused touch",
            Content::None,
            202,
            Content::None,
            || post(runs::answer),
        )
        .with_query::<AnswerOptions>(),
    ]
}

/// The requests around runs that the page makes.
fn around_runs() -> Vec<Route> {
    vec![
        Route::get(
            "/runs/{id}/changes",
            "getChanges",
            "What has changed since the run",
            json::<ChangesView>(),
            || get(changes::show),
        ),
        Route {
            method: Method::PUT,
            ..Route::post(
                "/runs/{id}/note",
                "writeNote",
                "Keeps a note about the run",
                json::<Note>(),
                204,
                Content::None,
                || put(notes::write),
            )
        },
        Route::get(
            "/notes",
            "listNotes",
            "The notes by the id of their run",
            json::<Notes>(),
            || get(notes::list),
        ),
        Route::get(
            "/frames",
            "getFrames",
            "The last frames of each port",
            json::<FramesView>(),
            || get(frames::show),
        ),
    ]
}

/// The requests about the queue. Each change answers with the queue after it.
fn of_the_queue() -> Vec<Route> {
    vec![
        Route::get(
            "/queue",
            "getQueue",
            "The protocols that wait, and what they ask of a person",
            json::<QueueView>(),
            || get(queue::show),
        ),
        Route::post(
            "/queue",
            "addToQueue",
            "Adds a protocol at the end of the queue",
            json::<QueueForm>(),
            201,
            json::<QueueView>(),
            || post(queue::add),
        )
        .with_headers(&[KEY]),
        Route::post(
            "/queue/hold",
            "holdQueue",
            "Lets no entry begin until the queue is released",
            Content::None,
            200,
            json::<QueueView>(),
            || post(queue::hold),
        ),
        Route::post(
            "/queue/release",
            "releaseQueue",
            "Lets the entries begin, one after the other",
            Content::None,
            200,
            json::<QueueView>(),
            || post(queue::release),
        ),
        Route::post(
            "/queue/{number}/move",
            "moveInQueue",
            "Moves an entry to another place",
            json::<PlaceForm>(),
            200,
            json::<QueueView>(),
            || post(queue::place),
        ),
        Route {
            method: Method::DELETE,
            ..Route::post(
                "/queue/{number}",
                "cancelInQueue",
                "Takes an entry out",
                Content::None,
                200,
                json::<QueueView>(),
                || delete(queue::cancel),
            )
        },
    ]
}

/// The requests about the clients of the daemon.
fn of_clients() -> Vec<Route> {
    vec![
        Route::get(
            "/session",
            "getSession",
            "The client as the daemon knows it",
            json::<ClientView>(),
            || get(session::show),
        ),
        Route::post(
            "/session",
            "beginSession",
            "Gives a browser a cookie for its token",
            Content::None,
            200,
            json::<ClientView>(),
            || post(session::begin),
        ),
        Route {
            method: Method::DELETE,
            ..Route::post(
                "/session",
                "endSession",
                "Ends the cookie of a browser",
                Content::None,
                204,
                Content::None,
                || delete(session::end),
            )
        },
        Route::post(
            "/links",
            "makeLink",
            "Makes a link that lets a browser in once",
            Content::None,
            200,
            json::<LinkView>(),
            || post(session::link),
        ),
        Route::get("/lease", "getLease", "Who operates the rig", json::<LeaseView>(), || {
            get(lease::show)
        }),
        Route::post(
            "/lease",
            "takeLease",
            "Takes the lease, also from another client",
            json::<LeaseForm>(),
            200,
            json::<LeaseView>(),
            || post(lease::take),
        ),
        Route {
            method: Method::DELETE,
            ..Route::post(
                "/lease",
                "giveLeaseBack",
                "Gives the lease back",
                Content::None,
                204,
                Content::None,
                || delete(lease::give_back),
            )
        },
    ]
}

/// The requests about runs that have ended.
fn to_ended_runs() -> Vec<Route> {
    vec![
        Route::post(
            "/runs/{id}/continue",
            "continueRun",
            "Resumes a run that was not completed",
            Content::OptionalJson(schema_of::<ContinueForm>),
            202,
            json::<BegunView>(),
            || post(resume::resume),
        ),
        Route::post(
            "/runs/{id}/redo",
            "redoTouch",
            "Measures one touch again",
            json::<TouchForm>(),
            202,
            json::<BegunView>(),
            || post(resume::redo),
        ),
        Route::post(
            "/runs/{id}/skip",
            "skipTouch",
            "Leaves one touch out",
            json::<TouchForm>(),
            204,
            Content::None,
            || post(resume::skip),
        ),
        Route::post(
            "/runs/{id}/give-up",
            "giveUpRun",
            "Seals a run that was not completed",
            Content::None,
            204,
            Content::None,
            || post(resume::give_up),
        ),
    ]
}

/// Every route, in the order of the document.
pub(super) fn all() -> impl Iterator<Item = Route> {
    of_rig()
        .into_iter()
        .chain(commission::routes())
        .chain(block_runs::routes())
        .chain(sensor_check::routes())
        .chain(checks::routes())
        .chain(of_measurements())
        .chain(of_runs())
        .chain(to_runs())
        .chain(to_ended_runs())
        .chain(around_runs())
        .chain(of_the_queue())
        .chain(of_clients())
}

/// The router of all routes.
pub(super) fn router() -> Router<Shared> {
    all().fold(Router::new(), |router, route| router.route(route.path, (route.handler)()))
}
