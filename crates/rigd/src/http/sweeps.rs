//! Single sweeps at the present pose.

use axum::{
    Extension, Json,
    extract::{Path, State},
    http::{StatusCode, header},
    response::IntoResponse,
};
use rig_store::{Reader, Record, RunId, RunKind, StoreError, StoredRecord, Sweep, SweepOutcome};
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    Problem, Shared,
    object::{Object, ObjectBody},
};
use crate::{operator::Operator, sweep_form::SweepForm, sweeps};

/// A sweep as a resource.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct SweepView {
    id: String,
    /// `running`, `accepted`, `refused` or `failed`.
    status: &'static str,
    #[serde(skip_serializing_if = "Option::is_none", flatten)]
    sweep: Option<Sweep>,
}

/// A sweep of a run, without its readings.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct SweepLine {
    number: u64,
    /// `no_load`, `touch` or `manual`.
    purpose: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    step: Option<String>,
    /// Number of readings.
    readings: usize,
    outcome: SweepOutcome,
    /// Path of the sweep with its readings.
    href: String,
}

/// The sweeps of a run and of the touches that were measured again, without their readings.
pub(super) async fn of_run(
    State(shared): State<Shared>,
    Path(id): Path<String>,
) -> Result<Json<Vec<SweepLine>>, Problem> {
    let id = shared.run(&id).await?;
    let found = shared.build(move |reader| {
        reader.run(id)?;
        let line = |record: StoredRecord| match record.record() {
            Ok(Record::Sweep(sweep)) => Some(SweepLine {
                href: format!("/api/v1/runs/{id}/sweeps/{}", sweep.number),
                number: sweep.number,
                purpose: sweep.purpose.name(),
                step: sweep.step,
                readings: sweep.readings.len(),
                outcome: sweep.outcome,
            }),
            _ => None,
        };
        Ok(reader.amended(id)?.into_iter().filter_map(line).collect())
    });
    found.await.map(Json)
}

pub(super) async fn begin(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    order: ObjectBody<SweepForm>,
) -> Result<impl IntoResponse, Problem> {
    let Json(Object(order)) = order?;
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
    let (is_running, present) = {
        let status = shared.inner.rig.status();
        let status = status.borrow();
        let is_running = status.session == session && status.sweep == Some(number);
        (is_running, (status.session, status.sweeps))
    };
    if is_running {
        return Ok(Json(SweepView { id, status: "running", sweep: None }));
    }
    let found = shared.read(move |reader| {
        let found = sweeps::find(reader, session, number)?;
        Ok((found, begun(reader, session, present)?))
    });
    match found.await? {
        (Some(sweep), _) => {
            let status = match sweep.outcome {
                SweepOutcome::Accepted { .. } => "accepted",
                SweepOutcome::Refused { .. } => "refused",
            };
            Ok(Json(SweepView { id, status, sweep: Some(sweep) }))
        }
        (None, count) if (1..=count).contains(&number) => {
            Ok(Json(SweepView { id, status: "failed", sweep: None }))
        }
        (None, _) => Err(unknown()),
    }
}

/// Number of single sweeps that the daemon of a session has begun. `present` has the session and the number of the
/// present daemon, whose journal may not have the last one yet.
fn begun(reader: &Reader, session: RunId, present: (RunId, u64)) -> Result<u64, StoreError> {
    /// The command, as the journal has it.
    const SWEEP: &str = "sweep";
    let of = reader.run(session)?;
    if of.kind != RunKind::Session {
        return Ok(0);
    }
    if reader.run(present.0)?.epoch == of.epoch {
        return Ok(present.1);
    }
    let mut count = 0;
    for run in reader.runs()? {
        if run.kind == RunKind::Session && run.epoch == of.epoch {
            for stored in reader.unchecked(run.id, &["operator"])? {
                let record = stored.record()?;
                count +=
                    u64::from(matches!(record, Record::Operator(done) if done.action == SWEEP));
            }
        }
    }
    Ok(count)
}
