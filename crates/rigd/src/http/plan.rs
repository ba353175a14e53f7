//! The plan of a protocol or of a run: checked, in steps, with their times.

use axum::{
    Json,
    body::Bytes,
    extract::{Path, State},
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use rig_files::rig_file::RigFile;
use rig_model::RigLimits;
use rig_protocol::{Action, Plan, Pose, Step};
use rig_store::{Amended, Reader, Record, RunId, RunKind, RunStarted, Sweep};
use schemars::JsonSchema;
use serde::Serialize;

use super::{Problem, Purpose, Shared, export, runs};
use crate::{describe, protocol_file::LoadedProtocol, rig::Outcomes, rig_view::PromptAction};

/// A protocol laid out for a bench.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct PlanView {
    /// Name of the protocol.
    protocol: String,
    samples: Vec<String>,
    touches: usize,
    no_loads: usize,
    prompts: usize,
    /// Expected time on the rig's clock, without the time that a person takes, s.
    duration_s: f64,
    /// The lowest position that a touch may ask for, and the clear position, mm.
    linear_mm: [f64; 2],
    /// The extreme positions of the rotary stage, degrees.
    rotary_deg: [f64; 2],
    indentation_mm: f64,
    max_indentation_mm: f64,
    target_sigma_hz: f64,
    /// Whether the surface is looked for again after each sweep, so that steps lost in a touch show.
    is_slip_checked: bool,
    steps: Vec<StepView>,
    protocol_toml: String,
}

#[derive(Debug, Serialize, JsonSchema)]
struct StepView {
    step: String,
    /// The step as text.
    what_is_done: String,
    /// Expected, on the rig's clock, s.
    duration_s: f64,
    #[serde(flatten)]
    action: ActionView,
}

#[derive(Debug, Serialize, JsonSchema)]
#[serde(tag = "action", rename_all = "snake_case")]
enum ActionView {
    Prompt {
        #[serde(flatten)]
        prompt: PromptAction,
    },
    NoLoad {
        #[serde(flatten)]
        pose: PoseView,
    },
    Touch {
        phase: &'static str,
        sample: String,
        repeat: u32,
        #[serde(flatten)]
        pose: PoseView,
    },
}

#[derive(Debug, Serialize, JsonSchema)]
struct PoseView {
    direction: &'static str,
    angle_deg: f64,
}

/// Checks a protocol and returns its plan. Nothing moves.
pub(super) async fn check(
    State(shared): State<Shared>,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let protocol = runs::posted(&shared, &headers, &body, Purpose::Look).await?;
    let plan = shared.work(move |inner| PlanView::of(&protocol, &inner.facts.limits).written());
    shared.plan(plan.await??)
}

/// The plan of a run on the bench of its start, or the plan of its last resumption.
pub(super) async fn of_run(
    State(shared): State<Shared>,
    Path(id): Path<String>,
) -> Result<Response, Problem> {
    let id = shared.run(&id).await?;
    let plan = shared.build(move |reader| {
        let amended = amended(reader, id)?;
        let run = amended.as_ref().map_or(Ok(id), |amended| amended.run.parse())?;
        let started = started(reader, run)?;
        // Both were checked before the run began; another version may see them otherwise.
        let rig = RigFile::read(&started.rig.name, &started.rig.toml);
        let limits = rig.map_err(|faults| Problem::protocol(&faults))?.limits;
        let protocol = LoadedProtocol::of_run(&started, &limits, None);
        let mut protocol = protocol.map_err(|faults| Problem::protocol(&faults))?;
        if let Some(only) = amended.and_then(|amended| protocol.plan.only(&amended.step)) {
            protocol.summary = only.summary(&limits);
            protocol.plan = only;
            return PlanView::of(&protocol, &limits).written();
        }
        let mut records = reader.amended(id)?;
        if let Some(seam) = records.iter().rev().find(|stored| stored.kind == "resumed") {
            let seam = seam.event;
            records.retain(|stored| stored.event < seam);
            let outcomes = Outcomes::of(&records)?;
            protocol.plan = protocol.plan.resumed(|step| outcomes.is_done(&step.0)).0;
        }
        PlanView::of(&protocol, &limits).written()
    });
    shared.plan(plan.await?)
}

impl Shared {
    /// The answer with a plan. A long one takes a place among the exports until the client has it: memory is used for
    /// few of them.
    fn plan(&self, plan: Vec<u8>) -> Result<Response, Problem> {
        let json = [(header::CONTENT_TYPE, "application/json")];
        if plan.len() <= export::PART {
            return Ok((json, plan).into_response());
        }
        let place = self.place_of_export()?;
        let length = [(header::CONTENT_LENGTH, plan.len().to_string())];
        Ok((json, length, export::whole(plan.into(), place)).into_response())
    }
}

/// The text of the protocol of a run.
pub(super) async fn protocol(
    State(shared): State<Shared>,
    Path(id): Path<String>,
) -> Result<impl IntoResponse, Problem> {
    let id = shared.run(&id).await?;
    let toml = shared.read(move |reader| Ok(started(reader, id)?.protocol.toml)).await?;
    Ok(([(header::CONTENT_TYPE, "application/toml")], toml))
}

/// One sweep of a run, with its readings.
pub(super) async fn sweep(
    State(shared): State<Shared>,
    Path((id, number)): Path<(String, String)>,
) -> Result<Json<Sweep>, Problem> {
    let id = shared.run(&id).await?;
    let found = shared.build(move |reader| {
        reader.run(id)?;
        let is_wanted = |sweep: &Sweep| sweep.number.to_string() == number;
        let sweeps = reader.amended(id)?.into_iter().filter_map(|record| match record.record() {
            Ok(Record::Sweep(sweep)) => Some(sweep),
            _ => None,
        });
        let none = || Problem::not_found(format!("run {id} has no sweep {number}"));
        sweeps.into_iter().find(is_wanted).ok_or_else(none)
    });
    found.await.map(Json)
}

/// The run of an amendment; `None` for a run.
fn amended(reader: &Reader, id: RunId) -> Result<Option<Amended>, Problem> {
    if reader.run(id)?.kind != RunKind::Amendment {
        return Ok(None);
    }
    let first = reader.records(id)?.into_iter().next();
    Ok(match first.map(|first| first.record()).transpose()? {
        Some(Record::Amended(amended)) => Some(amended),
        _ => None,
    })
}

fn started(reader: &Reader, id: RunId) -> Result<RunStarted, Problem> {
    reader.run(id)?;
    for record in reader.records(id)? {
        if let Record::RunStarted(started) = record.record()? {
            return Ok(started);
        }
    }
    Err(Problem::not_found(format!("run {id} has no protocol")))
}

impl PlanView {
    /// As JSON.
    fn written(&self) -> Result<Vec<u8>, Problem> {
        serde_json::to_vec(self).map_err(|error| Problem::internal(&error.to_string()))
    }

    fn of(loaded: &LoadedProtocol, limits: &RigLimits) -> Self {
        let (plan, summary) = (&loaded.plan, &loaded.summary);
        let durations_s = plan.durations_s(limits);
        let step = |((index, step), duration_s): ((usize, &Step), f64)| StepView {
            step: step.id.to_string(),
            what_is_done: describe::step(plan, index),
            duration_s,
            action: ActionView::of(plan, &step.action),
        };
        Self {
            protocol: plan.name.clone(),
            samples: plan.samples.clone(),
            touches: summary.touches,
            no_loads: summary.no_loads,
            prompts: summary.prompts,
            duration_s: summary.duration_s,
            linear_mm: [summary.linear.min.value(), summary.linear.max.value()],
            rotary_deg: [summary.rotary.min.value(), summary.rotary.max.value()],
            indentation_mm: plan.touch.indentation_mm,
            max_indentation_mm: limits.motion.max_indentation_mm,
            target_sigma_hz: plan.contact_sweep.target_sigma_hz,
            is_slip_checked: plan.touch.approach.has_slip_check(),
            steps: plan.steps.iter().enumerate().zip(durations_s).map(step).collect(),
            protocol_toml: loaded.source.toml.clone(),
        }
    }
}

impl ActionView {
    fn of(plan: &Plan, action: &Action) -> Self {
        let pose = |pose: Pose| PoseView {
            direction: pose.direction.name(),
            angle_deg: pose.angle.degrees(),
        };
        match *action {
            Action::Prompt(prompt) => Self::Prompt { prompt: PromptAction::of(plan, prompt) },
            Action::NoLoad(at) => Self::NoLoad { pose: pose(at) },
            Action::Touch(touch) => Self::Touch {
                phase: touch.phase.name(),
                sample: plan.samples.get(touch.sample).cloned().unwrap_or_default(),
                repeat: touch.repeat,
                pose: pose(touch.pose),
            },
        }
    }
}
