//! Progress of a run, the open prompt, and the forecast.

use std::time::{SystemTime, UNIX_EPOCH};

use rig_engine::Progress;
use rig_model::{Axis, RigLimits, RigTime, Unit};
use rig_protocol::{Action, Plan, Prompt};
use schemars::JsonSchema;
use serde::Serialize;

use crate::rig::{RunView, Status};

/// The rest of a run.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Forecast {
    /// It pauses before the next step.
    is_pausing: bool,
    /// Since it began, s on the rig's clock.
    elapsed_s: f64,
    /// Least and largest remaining time, s on the rig's clock.
    remaining_s: [f64; 2],
    /// Number of touches of earlier runs from which it is learned; 0 for the plan alone.
    learned_from_touches: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    next_prompt: Option<NextPrompt>,
}

/// The time of the next prompt.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
struct NextPrompt {
    prompt: String,
    /// From now, s on the rig's clock.
    in_s: f64,
    /// Touches before it, that under way included.
    touches: usize,
}

/// The prompt that waits for an answer.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct OpenPrompt {
    /// Address of the step, for the answer.
    step: String,
    #[serde(flatten)]
    what: PromptAction,
    /// Number of the prompt in the run, from 1.
    number: usize,
    prompts: usize,
}

/// The action that a prompt asks for.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "what", rename_all = "snake_case")]
pub(super) enum PromptAction {
    /// Put this sample under the probe.
    PlaceSample { sample: String },
    /// Turn the sensor to this orientation.
    TurnSensor { orientation: &'static str },
}

/// A run that has ended.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct LastRun {
    id: String,
    /// How the run ended.
    status: &'static str,
}

/// Ranges of the targets of the axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Limits {
    linear_mm: AxisLimits,
    rotary_deg: AxisLimits,
    /// Position of the linear stage at which the tip touches the level sample, mm.
    surface_mm: f64,
    /// Height of that surface above the axis of the rotary stage, mm.
    surface_above_pivot_mm: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
struct AxisLimits {
    min: f64,
    max: f64,
    /// Rest position: clear, or level.
    rest: f64,
}

impl Limits {
    pub(super) fn of(limits: &RigLimits) -> Self {
        fn of<U: Unit>(axis: &Axis<U>) -> AxisLimits {
            let (soft, rest) = (axis.soft(), axis.rest_target().position());
            AxisLimits { min: soft.min.value(), max: soft.max.value(), rest: rest.value() }
        }
        Self {
            linear_mm: of(&limits.linear),
            rotary_deg: of(&limits.rotary),
            surface_mm: limits.geometry.surface.value(),
            surface_above_pivot_mm: limits.geometry.surface_above_pivot_mm,
        }
    }
}

impl PromptAction {
    pub(super) fn of(plan: &Plan, prompt: Prompt) -> Self {
        match prompt {
            Prompt::PlaceSample { sample } => {
                Self::PlaceSample { sample: plan.samples.get(sample).cloned().unwrap_or_default() }
            }
            Prompt::TurnSensor { orientation } => {
                Self::TurnSensor { orientation: orientation.name() }
            }
        }
    }
}

pub(super) fn ahead(run: &RunView, progress: &Progress, now: RigTime) -> Forecast {
    let steps = &run.plan.steps;
    let here = progress.step.min(steps.len());
    let elapsed_s = now.since(run.started).as_secs_f64();
    let is_prompt = |action: &Action| matches!(action, Action::Prompt(_));
    let remaining = run.remaining(here, now);
    // The open prompt is not the next one.
    let next = steps.iter().enumerate().skip(here + 1).find(|(_, step)| is_prompt(&step.action));
    let next_prompt = next.and_then(|(index, step)| {
        let Action::Prompt(prompt) = step.action else { return None };
        let touches = steps[here..index].iter();
        Some(NextPrompt {
            prompt: run.ask(&prompt),
            in_s: run.until_s(here, index, now),
            touches: touches.filter(|step| matches!(step.action, Action::Touch(_))).count(),
        })
    });
    Forecast {
        is_pausing: progress.is_pausing,
        elapsed_s,
        remaining_s: [remaining.least_s, remaining.most_s],
        learned_from_touches: run.history.touches(),
        next_prompt,
    }
}

pub(super) fn last_run(run: &RunView) -> Option<LastRun> {
    let status = run.ending?.name();
    Some(LastRun { id: run.id.to_string(), status })
}

pub(super) fn asked(status: &Status) -> Option<OpenPrompt> {
    let (prompt, run) = status.snapshot.prompt.zip(status.run.as_ref())?;
    let index = status.snapshot.progress.as_ref()?.step;
    let is_prompt = |step: &&rig_protocol::Step| matches!(step.action, Action::Prompt(_));
    let steps = &run.plan.steps;
    Some(OpenPrompt {
        step: steps.get(index)?.id.to_string(),
        what: PromptAction::of(&run.plan, prompt),
        number: steps[..=index].iter().filter(is_prompt).count(),
        prompts: steps.iter().filter(is_prompt).count(),
    })
}

/// The wall clock, ms since 1970.
pub(super) fn unix_ms(at: SystemTime) -> u64 {
    let since = at.duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}
