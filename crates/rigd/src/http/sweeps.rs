//! Single sweeps at the present pose.

use axum::{
    Extension, Json,
    extract::{Path, State, rejection::JsonRejection},
    http::{StatusCode, header},
    response::IntoResponse,
};
use rig_store::{RunId, Sweep};
use serde::Serialize;

use super::{Problem, Shared};
use crate::{operator::Operator, sweep_form::SweepForm, sweeps};

/// A sweep as a resource.
#[derive(Debug, Serialize)]
pub(super) struct SweepView {
    id: String,
    /// `running`, `accepted`, `refused` or `failed`.
    status: &'static str,
    #[serde(skip_serializing_if = "Option::is_none", flatten)]
    sweep: Option<Sweep>,
}

pub(super) async fn begin(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    order: Result<Json<SweepForm>, JsonRejection>,
) -> Result<impl IntoResponse, Problem> {
    let Json(order) = order?;
    let request = order.request(&shared.inner.facts.limits.analyzer);
    let request = request.map_err(|faults| Problem::unprocessable(faults.to_string()))?;
    let number = shared.inner.rig.sweep(request, operator.as_str()).await?;
    let session = shared.inner.rig.status().borrow().session;
    let id = format!("{session}-{number}");
    let location = [(header::LOCATION, format!("/api/v1/sweeps/{id}"))];
    let view = SweepView { id, status: "running", sweep: None };
    Ok((StatusCode::ACCEPTED, location, Json(view)))
}

pub(super) async fn show(
    State(shared): State<Shared>,
    Path(id): Path<String>,
) -> Result<Json<SweepView>, Problem> {
    let unknown = || Problem::not_found(format!("there is no sweep {id}"));
    let (session, number) = id.rsplit_once('-').ok_or_else(unknown)?;
    let session: RunId = session.parse().map_err(|_| unknown())?;
    let number: u64 = number.parse().map_err(|_| unknown())?;
    let (is_running, is_begun) = {
        let status = shared.inner.rig.status();
        let status = status.borrow();
        let is_present = status.session == session;
        (is_present && status.sweep == Some(number), !is_present || number <= status.sweeps)
    };
    if is_running {
        return Ok(Json(SweepView { id, status: "running", sweep: None }));
    }
    let found = shared.read(move |reader| Ok(sweeps::find(reader, session, number)?));
    match found.await? {
        Some(sweep) => {
            let status = match sweep.outcome {
                rig_store::SweepOutcome::Accepted { .. } => "accepted",
                rig_store::SweepOutcome::Refused { .. } => "refused",
            };
            Ok(Json(SweepView { id, status, sweep: Some(sweep) }))
        }
        None if is_begun && number > 0 => Ok(Json(SweepView { id, status: "failed", sweep: None })),
        None => Err(unknown()),
    }
}
