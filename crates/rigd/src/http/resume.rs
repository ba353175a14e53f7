//! Runs that were not completed: continue them, or give them up. Touches: measure one again, or
//! leave
//! it out.

use axum::{
    Extension, Json,
    body::Bytes,
    extract::{Path, State},
    http::StatusCode,
    response::Response,
};
use schemars::JsonSchema;
use serde::Deserialize;

use super::{
    Problem, Shared,
    object::{Object, ObjectBody, object_or_default},
    runs::{begun, begun_in},
};
use crate::{operator::Operator, reason, rig::TouchOrder};

/// The confirmations of a client.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ContinueForm {
    /// The changes since the last part of the run are wanted.
    accept_changes: bool,
}

/// Resumes a run at its next touch without an outcome.
pub(super) async fn resume(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
    body: Bytes,
) -> Result<Response, Problem> {
    let id = shared.run(&id).await?;
    let ContinueForm { accept_changes } = object_or_default(&body)?;
    shared.inner.rig.resume(id, accept_changes, operator.as_str()).await?;
    Ok(begun(id))
}

/// One touch, and why it is amended.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct TouchForm {
    /// Address of the touch.
    step: String,
    /// The reason, for the journal and the report.
    #[serde(deserialize_with = "reason::deserialize")]
    #[schemars(length(min = 1))]
    why: String,
    /// The changes since the run are wanted.
    #[serde(default)]
    accept_changes: bool,
}

/// Measures a touch of a run again. The answer has the id of the amendment, and leads to the run, which gets the outcome.
pub(super) async fn redo(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
    form: ObjectBody<TouchForm>,
) -> Result<Response, Problem> {
    let Json(Object(TouchForm { step, why, accept_changes })) = form?;
    let run = shared.run(&id).await?;
    let order = TouchOrder { run, step, why };
    let amendment = shared.inner.rig.redo(order, accept_changes, operator.as_str()).await?;
    Ok(begun_in(amendment, run))
}

/// Leaves a touch of a run out.
pub(super) async fn skip(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
    form: ObjectBody<TouchForm>,
) -> Result<StatusCode, Problem> {
    let Json(Object(TouchForm { step, why, .. })) = form?;
    let run = shared.run(&id).await?;
    let order = TouchOrder { run, step, why };
    shared.inner.rig.skip(order, operator.as_str()).await?;
    shared.write_files(run).await;
    Ok(StatusCode::NO_CONTENT)
}

/// Seals a run in its present state.
pub(super) async fn give_up(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    let run = shared.run(&id).await?;
    shared.inner.rig.give_up(run, operator.as_str()).await?;
    shared.write_files(run).await;
    Ok(StatusCode::NO_CONTENT)
}
