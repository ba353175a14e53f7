//! The rig as a whole.

use std::time::SystemTime;

use axum::{Extension, Json, extract::State, http::header, response::IntoResponse};
use rig_engine::{Command, FailureKind, Fault, RefusalAnswer, RigState, Snapshot};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Problem, Shared,
    object::{Object, ObjectBody},
    progress, tag,
};
use crate::{
    hint,
    loaded_rig::RigFacts,
    operator::Operator,
    rig::{DeviceIdentity, Identified, Status},
    rig_view::{DeviceView, FaultView, Limits, RefusedView, RigView, RunProgress, SilenceView},
};

/// The rig, with the tag for `If-Match` of a command.
pub(super) async fn show(State(shared): State<Shared>) -> impl IntoResponse {
    let status = shared.inner.rig.status().borrow().clone();
    ([(header::ETAG, tag::of_rig(&status))], Json(view(&shared, &status)))
}

pub(super) fn view_now(shared: &Shared) -> RigView {
    let status = shared.inner.rig.status().borrow().clone();
    view(shared, &status)
}

pub(super) async fn stop(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Result<Json<RigView>, Problem> {
    give(shared, Command::Stop, &operator).await
}

/// What a device answered when it was asked again who it is.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct IdentifiedView {
    role: String,
    /// The identity since rigd was started.
    known: String,
    /// The identity of the device that answered; absent if it could not be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    found: Option<String>,
    is_as_known: bool,
    /// Where an axis is by its own account.
    #[serde(skip_serializing_if = "Option::is_none")]
    position: Option<String>,
    /// Why it cannot be used as before.
    #[serde(skip_serializing_if = "Option::is_none")]
    trouble: Option<String>,
}

impl From<Identified> for IdentifiedView {
    fn from(Identified { role, known, found, position, trouble }: Identified) -> Self {
        let is_as_known = found.as_ref() == Some(&known);
        Self { role: role.to_owned(), known, found, is_as_known, position, trouble }
    }
}

/// The statement of a person who has looked.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct HomeForm {
    /// Nothing is below the probe, down to the end of its travel.
    nothing_below_probe: bool,
}

/// Homes a linear stage that has lost its position, in the direction that is set in its drive.
pub(super) async fn home(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<HomeForm>,
) -> Result<Json<RigView>, Problem> {
    let Json(Object(HomeForm { nothing_below_probe })) = form?;
    if !nothing_below_probe {
        let what = "somebody must have seen that nothing is below the probe";
        return Err(Problem::unprocessable(what.to_owned()));
    }
    give(shared, Command::HomeLinear, &operator).await
}

pub(super) async fn acknowledge(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Result<Json<RigView>, Problem> {
    give(shared, Command::Acknowledge, &operator).await
}

/// Asks each device of an idle rig again who it is.
pub(super) async fn identify(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Result<Json<Vec<IdentifiedView>>, Problem> {
    let found = shared.inner.rig.identify(operator.as_str()).await?;
    Ok(Json(found.into_iter().map(IdentifiedView::from).collect()))
}

async fn give(
    shared: Shared,
    command: Command,
    operator: &Operator,
) -> Result<Json<RigView>, Problem> {
    shared.inner.rig.command(command, None, operator.as_str()).await?;
    Ok(Json(view_now(&shared)))
}

pub(super) fn view(shared: &Shared, status: &Status) -> RigView {
    RigView { lease: shared.lease(), ..view_of(&shared.inner.facts, status) }
}

/// The kind of a fault that asks for something of its own.
fn kind(snapshot: &Snapshot, fault: &Fault) -> &'static str {
    match fault {
        fault if hint::is_jumped(snapshot, fault) => "position_jumped",
        Fault::Interrupted(_) => "interrupted",
        Fault::NotCommissioned { .. } => "not_commissioned",
        Fault::Device(failure) if failure.kind == FailureKind::Lost => "position_lost",
        fault if hint::is_unhomed(fault) => "not_homed",
        _ => "fault",
    }
}

fn view_of(facts: &RigFacts, status: &Status) -> RigView {
    let (snapshot, now) = (&status.snapshot, status.present(facts.is_virtual_time));
    let run = match (&snapshot.progress, &status.run) {
        (Some(progress), Some(run)) => Some(RunProgress {
            id: run.id.to_string(),
            protocol: progress.protocol.clone(),
            step: progress.step,
            steps: progress.steps,
            touches_planned: run.touches_planned(),
            touches_measured: run.touches_done - run.touches_refused,
            touches_refused: run.touches_refused,
            doing: run.describe_step(progress.step),
            ahead: progress::ahead(run, progress, now),
        }),
        _ => None,
    };
    let prompt = snapshot.prompt.zip(status.run.as_ref()).map(|(prompt, run)| run.ask(&prompt));
    let fault = snapshot.fault.as_ref().map(|fault| FaultView {
        kind: kind(snapshot, fault).to_owned(),
        cause: fault.to_string(),
        hint: if snapshot.state == RigState::Retracting {
            hint::during_retract(fault)
        } else {
            let hint = hint::latched(snapshot, fault);
            let trying = |attempts| hint::during_attempts(attempts, hint);
            snapshot.attempts.map_or_else(|| hint.over_http(), trying)
        },
        attempts: snapshot.attempts,
    });
    let device = |device: &DeviceIdentity| DeviceView {
        role: device.role.to_owned(),
        identity: device.identity.clone(),
        health: device.health.read().into(),
    };
    RigView {
        name: facts.name.clone(),
        state: snapshot.state.name().to_owned(),
        probe: snapshot.clearance.name().to_owned(),
        linear_mm: snapshot.linear.map(rig_model::Position::value),
        rotary_deg: snapshot.rotary.map(rig_model::Position::value),
        rig_time_s: now.as_seconds(),
        unix_ms: progress::unix_ms(SystemTime::now()),
        state_since_s: status.state_since.as_seconds(),
        session: status.session.to_string(),
        is_simulated: facts.is_simulated,
        is_virtual_time: facts.is_virtual_time,
        limits: Limits::of(&facts.limits),
        devices: status.devices.iter().map(device).collect(),
        run,
        last_run: status.run.as_ref().and_then(progress::last_run),
        prompt,
        refused: snapshot.refused.as_ref().map(|touch| RefusedView {
            step: touch.step.to_string(),
            reason: touch.reason.clone(),
            answers: RefusalAnswer::ALL.map(|answer| answer.name().to_owned()),
        }),
        asked: progress::asked(status),
        fault,
        lease: None,
        journal_error: status.journal_error.as_ref().map(ToString::to_string),
        silence: status.silence.map(|silence| SilenceView {
            since_unix_ms: progress::unix_ms(silence.since),
            message: silence.to_string(),
            hint: hint::WHILE_SILENT.to_owned(),
        }),
    }
}
