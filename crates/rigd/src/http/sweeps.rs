//! Single sweeps at the present pose.

use axum::{
    Json,
    extract::{Path, State, rejection::JsonRejection},
    http::{StatusCode, header},
    response::IntoResponse,
};
use rig_model::{DriveLevel, SweepMethod, SweepRequest, Window};
use rig_store::{Record, RunId, Sweep};
use serde::{Deserialize, Serialize};

use super::{Problem, Shared};

/// What a client asks for. Only the window is required.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SweepOrder {
    min_hz: f64,
    max_hz: f64,
    /// Number of points of a uniform sweep; without it the planner chooses them.
    points: Option<u32>,
    #[serde(default = "default_target_sigma_hz")]
    target_sigma_hz: f64,
    #[serde(default = "default_time_limit_s")]
    time_limit_s: f64,
    #[serde(default = "default_cycles")]
    cycles: u32,
    #[serde(default = "default_settle_s")]
    settle_s: f64,
    #[serde(default = "default_level_v")]
    level_v: f64,
}

const fn default_target_sigma_hz() -> f64 {
    0.05
}

const fn default_time_limit_s() -> f64 {
    60.0
}

const fn default_cycles() -> u32 {
    10
}

const fn default_settle_s() -> f64 {
    0.5
}

const fn default_level_v() -> f64 {
    1.0
}

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
    order: Result<Json<SweepOrder>, JsonRejection>,
) -> Result<impl IntoResponse, Problem> {
    let Json(order) = order?;
    let request = SweepRequest {
        window: Window { min_hz: order.min_hz, max_hz: order.max_hz },
        method: order
            .points
            .map_or(SweepMethod::Adaptive, |points| SweepMethod::Uniform { points }),
        target_sigma_hz: order.target_sigma_hz,
        time_limit_s: order.time_limit_s,
        cycles: order.cycles,
        settle_s: order.settle_s,
        level: DriveLevel { volt: order.level_v },
    };
    let mut faults: Vec<String> = request.faults().iter().map(ToString::to_string).collect();
    let analyzer = shared.inner.facts.bench.analyzer;
    faults.extend(analyzer.faults(&request).iter().map(ToString::to_string));
    if !faults.is_empty() {
        return Err(Problem::unprocessable(faults.join("; ")));
    }
    let number = shared.inner.rig.sweep(request, "http").await?;
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
    let found = shared.read(move |reader| {
        for stored in reader.records(session)? {
            if stored.kind == "sweep"
                && let Record::Sweep(sweep) = stored.record()?
                && sweep.number == number
            {
                return Ok(Some(sweep));
            }
        }
        Ok(None)
    });
    match found.await? {
        Some(sweep) => {
            let status = match sweep.verdict {
                rig_store::SweepVerdict::Accepted { .. } => "accepted",
                rig_store::SweepVerdict::Refused { .. } => "refused",
            };
            Ok(Json(SweepView { id, status, sweep: Some(sweep) }))
        }
        None if is_begun && number > 0 => Ok(Json(SweepView { id, status: "failed", sweep: None })),
        None => Err(unknown()),
    }
}
