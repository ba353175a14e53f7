//! Runs.

use std::{num::NonZeroUsize, sync::Arc};

use axum::{
    Extension, Json,
    body::Bytes,
    extract::{Path, Query, State, rejection::QueryRejection},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{Html, IntoResponse, Response},
};
use rig_engine::{Command, RefusalAnswer};
use rig_protocol::StepId;
use rig_store::{Reader, Record, Run, RunId, RunKind, intact};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Problem, Purpose, Shared, access::Client, object::object};
use crate::{
    interruption::InterruptionView,
    local_time,
    operator::Operator,
    protocol_file::LoadedProtocol,
    run_files::{self, ResultsView},
};

/// A run in the list of runs.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct RunView {
    id: String,
    name: String,
    protocol: String,
    status: &'static str,
    is_simulated: bool,
    started_at: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    finished_at: Option<String>,
    records: u64,
    /// The folder in the archive that has its readings.
    #[serde(skip_serializing_if = "Option::is_none")]
    archived_to: Option<String>,
    /// It can be continued.
    is_resumable: bool,
    links: RunLinks,
}

/// Paths of what belongs to a run.
#[derive(Debug, Serialize, JsonSchema)]
struct RunLinks {
    #[serde(rename = "self")]
    own: String,
    plan: String,
    protocol: String,
    sweeps: String,
    report: String,
    export: String,
}

impl RunLinks {
    fn of(run: RunId) -> Self {
        let own = format!("/api/v1/runs/{run}");
        let of = |part: &str| format!("{own}/{part}");
        Self {
            plan: of("plan"),
            protocol: of("protocol"),
            sweeps: of("sweeps"),
            report: of("report"),
            export: of("export"),
            own,
        }
    }
}

/// A run that was begun.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct BegunView {
    id: String,
}

/// Which runs to list.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ListOptions {
    /// Number of runs at most. A page has no more than 1000, which is also the number without it.
    #[schemars(range(min = 1))]
    limit: Option<NonZeroUsize>,
    /// Only runs that were begun before this one: its id.
    before: Option<String>,
}

/// One run with its results so far.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct RunDetail {
    #[serde(flatten)]
    run: RunView,
    #[serde(skip_serializing_if = "Option::is_none")]
    interruption: Option<InterruptionView>,
    results: ResultsView,
}

/// A protocol in a JSON body.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct RunForm {
    protocol_toml: String,
}

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct AnswerOptions {
    /// The step of the prompt. The rig refuses an answer to an earlier prompt.
    step: Option<String>,
    /// After a refused touch: `widen`, `repeat`, `skip` or `abort`.
    refused: Option<String>,
}

/// Most runs of a page: some 600 kB. A bench has a few thousand in a year.
const PAGE_MAX: usize = 1000;

/// The runs, the latest first. The header `Link` leads to the next page.
pub(super) async fn list(
    State(shared): State<Shared>,
    options: Result<Query<ListOptions>, QueryRejection>,
) -> Result<Response, Problem> {
    let Query(ListOptions { limit, before }) = options?;
    let before = match before {
        Some(before) => Some(shared.run(&before).await?),
        None => None,
    };
    let limit = page_size(limit);
    let page = shared.read(move |reader| {
        // One more than asked for, which tells whether there is a next page.
        let mut runs = reader.latest_runs(Some(limit + 1), before)?;
        let has_more = runs.len() > limit;
        runs.truncate(limit);
        let next = runs.last().filter(|_| has_more).map(|last| last.id);
        let views: Vec<_> = runs.into_iter().map(|run| RunView::new(reader, run)).collect();
        Ok((views, next))
    });
    let (views, next) = page.await?;
    let mut answer = Json(views).into_response();
    if let Some(next) = next {
        let link = format!("</api/v1/runs?limit={limit}&before={next}>; rel=\"next\"");
        let link =
            HeaderValue::try_from(link).map_err(|error| Problem::internal(&error.to_string()))?;
        answer.headers_mut().insert(header::LINK, link);
    }
    Ok(answer)
}

/// Number of runs in a page.
fn page_size(asked: Option<NonZeroUsize>) -> usize {
    asked.map_or(PAGE_MAX, |asked| asked.get().min(PAGE_MAX))
}

pub(super) async fn show(
    State(shared): State<Shared>,
    Path(id): Path<String>,
) -> Result<Json<RunDetail>, Problem> {
    let id = shared.run(&id).await?;
    let inner = Arc::clone(&shared.inner);
    let detail = shared.build(move |reader| {
        let found = inner.results.of(reader, id)?;
        intact(id, &found.check)?;
        let folder = run_files::folder(&inner.data, found.results.run());
        let verdict = found.verdict(&inner.data);
        let results = ResultsView::new(&found.results, verdict, folder);
        let run = found.results.run();
        let interruption = InterruptionView::read(reader, run)?;
        Ok(RunDetail { run: RunView::new(reader, run.clone()), interruption, results })
    });
    detail.await.map(Json)
}

pub(super) async fn report(
    State(shared): State<Shared>,
    Path(id): Path<String>,
) -> Result<Html<String>, Problem> {
    let id = shared.run(&id).await?;
    let inner = Arc::clone(&shared.inner);
    let html = shared.build(move |reader| {
        let found = inner.results.of(reader, id)?;
        let began = local_time::local(&found.results.run().started_at);
        Ok(found.results.html(&found.check, found.verdict(&inner.data), &began))
    });
    html.await.map(Html)
}

/// A client makes a key of a UUID (36 characters) or of a name and a date.
const KEY_MAX: usize = 255;

/// Begins a run. The body is a protocol as `application/toml`, or as JSON with `protocol_toml`;
/// without a body the loaded protocol is replayed.
pub(super) async fn begin(
    State(shared): State<Shared>,
    Extension(client): Extension<Client>,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let protocol = posted(&shared, &headers, &body, Purpose::Run).await?;
    // The lease may have been taken over while the protocol was laid out.
    shared.check_lease(&client)?;
    let operator = client.name;
    let text = protocol.source.toml.clone();
    let Some(key) = idempotency_key(&headers)? else {
        return Ok(begun(shared.inner.rig.run(protocol, operator.as_str()).await?));
    };
    // A client that goes away does not leave the key half used.
    let beginning = tokio::spawn(async move {
        let _keyed = shared.inner.keyed.lock().await;
        let wanted = key.clone();
        let Some(first) = shared.read(move |reader| Ok(reader.keyed_run(&wanted)?)).await? else {
            return Ok(begun(
                shared.inner.rig.keyed_run(protocol, operator.as_str(), Some(key)).await?,
            ));
        };
        match first.record()? {
            Record::RunStarted(started) if started.protocol.toml == text => Ok(begun(first.run)),
            _ => Err(Problem::unprocessable(format!(
                "Idempotency-Key {key} was used for run {} with another protocol; take another key",
                first.run
            ))),
        }
    });
    beginning.await.map_err(|_| Problem::internal("the beginning of the run has panicked"))?
}

/// The idempotency key of a request, if it has one.
pub(super) fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(key) = headers.get("idempotency-key") else { return Ok(None) };
    match key.to_str() {
        Ok(key) if (1..=KEY_MAX).contains(&key.len()) => Ok(Some(key.to_owned())),
        _ => Err(Problem::bad_request(format!(
            "Idempotency-Key must be 1 to {KEY_MAX} visible ASCII characters"
        ))),
    }
}

pub(super) async fn pause(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    give(&shared, &id, Command::Pause, &operator).await
}

pub(super) async fn resume(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    give(&shared, &id, Command::Resume, &operator).await
}

pub(super) async fn abort(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    give(&shared, &id, Command::Abort, &operator).await
}

pub(super) async fn answer(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
    options: Result<Query<AnswerOptions>, QueryRejection>,
) -> Result<StatusCode, Problem> {
    let AnswerOptions { step, refused } = options?.0;
    if let Some(word) = refused {
        let Some((answer, step)) = RefusalAnswer::of(&word).zip(step) else {
            let detail = format!(
                "`refused={word}` needs the step of the touch, and is widen, repeat, skip or abort"
            );
            return Err(Problem::bad_request(detail));
        };
        return give(&shared, &id, Command::Decide { step: StepId(step), answer }, &operator).await;
    }
    match step {
        None => give(&shared, &id, Command::Answer, &operator).await,
        Some(step) => {
            shared.inner.rig.answer(shared.run(&id).await?, step, operator.as_str()).await?;
            Ok(StatusCode::ACCEPTED)
        }
    }
}

/// Gives a command to a run; a run that was never begun is not the same as one that has ended.
async fn give(
    shared: &Shared,
    id: &str,
    command: Command,
    operator: &Operator,
) -> Result<StatusCode, Problem> {
    let id = shared.run(id).await?;
    shared.read(move |reader| Ok(reader.run(id)?)).await?;
    shared.inner.rig.command(command, Some(id), operator.as_str()).await?;
    Ok(StatusCode::ACCEPTED)
}

/// The protocol to replay.
pub(super) async fn posted(
    shared: &Shared,
    headers: &HeaderMap,
    body: &Bytes,
    purpose: Purpose,
) -> Result<LoadedProtocol, Problem> {
    if body.is_empty() {
        return shared.inner.loaded.clone().ok_or_else(|| {
            Problem::unprocessable(
                "no protocol was loaded when the daemon was started; post one".to_owned(),
            )
        });
    }
    let content_type = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
    let essence = content_type.and_then(|value| value.split(';').next()).map(str::trim);
    let not_text = |_| Problem::bad_request("the body is not UTF-8".to_owned());
    let text = match essence {
        Some("application/toml" | "text/x-toml") => {
            std::str::from_utf8(body).map_err(not_text)?.to_owned()
        }
        Some("application/json") => {
            let RunForm { protocol_toml } = object(body)?;
            protocol_toml
        }
        other => {
            return Err(Problem::unsupported_media_type(format!(
                "a protocol must be application/toml or application/json, not {}",
                other.unwrap_or("nothing named")
            )));
        }
    };
    shared.laid_out("protocol", text, purpose).await?.map_err(|faults| Problem::protocol(&faults))
}

pub(super) fn begun(run: RunId) -> Response {
    begun_in(run, run)
}

/// What was begun has its results in this run.
pub(super) fn begun_in(id: RunId, run: RunId) -> Response {
    let location = [(header::LOCATION, format!("/api/v1/runs/{run}"))];
    (StatusCode::ACCEPTED, location, Json(BegunView { id: id.to_string() })).into_response()
}

/// The name of a run; of an amendment, that of the run whose touch is measured again.
fn name(reader: &Reader, run: &Run) -> String {
    let amended = || reader.run(run.name.parse().ok()?).ok();
    match run.kind {
        RunKind::Amendment => amended()
            .map_or_else(|| run.short_name(), |of| format!("{}, a touch again", of.short_name())),
        _ => run.short_name(),
    }
}

impl RunView {
    fn new(reader: &Reader, run: Run) -> Self {
        Self {
            is_simulated: reader.is_simulated(run.id),
            // What cannot be read is told where the run itself is asked for.
            archived_to: reader.archive_of(run.id).ok().flatten().map(|note| note.place),
            is_resumable: run.is_resumable(),
            links: RunLinks::of(run.id),
            name: name(reader, &run),
            id: run.id.to_string(),
            protocol: run.name,
            status: run.status.name(),
            started_at: run.started_at,
            finished_at: run.finished_at,
            records: run.records,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_of_runs_has_a_size_whatever_is_asked_for() {
        for (asked, size) in [(None, 1000), (Some(2), 2), (Some(1000), 1000), (Some(5000), 1000)] {
            assert_eq!(page_size(asked.and_then(NonZeroUsize::new)), size, "{asked:?}");
        }
    }
}
