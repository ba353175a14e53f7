//! The rig as a whole.

use std::time::SystemTime;

use axum::{
    Extension, Json,
    extract::{State, rejection::JsonRejection},
    http::header,
    response::IntoResponse,
};
use rig_engine::{Command, Fault, RefusalAnswer, RigState};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Problem, Shared,
    progress::{self, Forecast, LastRun, Limits, OpenPrompt},
    tag,
};
use crate::{hint, loaded_rig::RigFacts, operator::Operator, rig::Status};

/// The present state of the rig.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct RigView {
    name: String,
    state: &'static str,
    probe: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    linear_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rotary_deg: Option<f64>,
    rig_time_s: f64,
    /// The wall clock of the daemon, ms since 1970.
    unix_ms: u64,
    /// Time of the last change of state on the rig's clock, s.
    state_since_s: f64,
    /// The journal of what happens between runs.
    session: String,
    is_simulated: bool,
    is_virtual_time: bool,
    limits: Limits,
    devices: Vec<DeviceView>,
    #[serde(skip_serializing_if = "Option::is_none")]
    run: Option<RunProgress>,
    /// The run that ended last since the daemon was started.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_run: Option<LastRun>,
    #[serde(skip_serializing_if = "Option::is_none")]
    prompt: Option<String>,
    /// The refused touch about which a person is asked.
    refused: Option<RefusedView>,
    #[serde(skip_serializing_if = "Option::is_none")]
    asked: Option<OpenPrompt>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<FaultView>,
    #[serde(skip_serializing_if = "Option::is_none")]
    journal_error: Option<String>,
    /// The rig loop gives no sign of life; all else is as it was before.
    #[serde(skip_serializing_if = "Option::is_none")]
    silence: Option<SilenceView>,
}

#[derive(Debug, Serialize, JsonSchema)]
struct SilenceView {
    /// Time of the last sign of life, ms since 1970.
    since_unix_ms: u64,
    message: String,
    hint: &'static str,
}

#[derive(Debug, Serialize, JsonSchema)]
struct DeviceView {
    role: &'static str,
    identity: String,
}

impl RigView {
    /// The id and the protocol of the run under way.
    pub(super) fn run(&self) -> Option<(&str, &str)> {
        self.run.as_ref().map(|run| (run.id.as_str(), run.protocol.as_str()))
    }
}

/// The progress of the current run.
#[derive(Debug, Serialize, JsonSchema)]
struct RunProgress {
    id: String,
    protocol: String,
    /// Number of steps done.
    step: usize,
    steps: usize,
    touches_planned: usize,
    touches_measured: usize,
    touches_refused: usize,
    doing: String,
    #[serde(flatten)]
    ahead: Forecast,
}

#[derive(Debug, Serialize, JsonSchema)]
struct FaultView {
    /// `interrupted` if the last program was killed; `not_homed` if the linear stage waits for a statement
    /// that nothing is below the probe; `fault` otherwise.
    kind: &'static str,
    cause: String,
    hint: String,
    /// Attempts to retract so far, while the latched rig goes on trying.
    attempts: Option<u32>,
}

#[derive(Debug, Serialize, JsonSchema)]
struct RefusedView {
    step: String,
    reason: String,
    answers: [&'static str; 4],
}

/// The rig, with the tag for `If-Match` of a command.
pub(super) async fn show(State(shared): State<Shared>) -> impl IntoResponse {
    let status = shared.inner.rig.status().borrow().clone();
    ([(header::ETAG, tag::of_rig(&status))], Json(view(&shared.inner.facts, &status)))
}

pub(super) fn view_now(shared: &Shared) -> RigView {
    let status = shared.inner.rig.status().borrow().clone();
    view(&shared.inner.facts, &status)
}

pub(super) async fn stop(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Result<Json<RigView>, Problem> {
    give(shared, Command::Stop, &operator).await
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
    form: Result<Json<HomeForm>, JsonRejection>,
) -> Result<Json<RigView>, Problem> {
    let Json(HomeForm { nothing_below_probe }) = form?;
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

async fn give(
    shared: Shared,
    command: Command,
    operator: &Operator,
) -> Result<Json<RigView>, Problem> {
    shared.inner.rig.command(command, None, operator.as_str()).await?;
    Ok(Json(view_now(&shared)))
}

pub(super) fn view(facts: &RigFacts, status: &Status) -> RigView {
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
        kind: match fault {
            Fault::Interrupted { .. } => "interrupted",
            fault if hint::is_unhomed(fault) => "not_homed",
            _ => "fault",
        },
        cause: fault.to_string(),
        hint: if snapshot.state == RigState::Retracting {
            hint::during_retract(fault)
        } else {
            let hint = hint::after(fault, snapshot.clearance);
            let trying = |attempts| hint::during_attempts(attempts, hint);
            snapshot.attempts.map_or_else(|| hint.over_http(), trying)
        },
        attempts: snapshot.attempts,
    });
    let device = |device: &crate::rig::DeviceIdentity| DeviceView {
        role: device.role,
        identity: device.identity.clone(),
    };
    RigView {
        name: facts.name.clone(),
        state: snapshot.state.name(),
        probe: snapshot.clearance.name(),
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
            answers: RefusalAnswer::ALL.map(RefusalAnswer::name),
        }),
        asked: progress::asked(status),
        fault,
        journal_error: status.journal_error.as_ref().map(ToString::to_string),
        silence: status.silence.map(|silence| SilenceView {
            since_unix_ms: progress::unix_ms(silence.since),
            message: silence.to_string(),
            hint: hint::WHILE_SILENT,
        }),
    }
}
