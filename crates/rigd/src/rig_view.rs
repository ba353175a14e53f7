//! The rig as `GET /api/v1/rig` describes it: written by the daemon, read by the commands that speak to it.

use rig_model::{Axis, RigLimits, Unit};
use rig_protocol::{Plan, Prompt};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The present state of the rig.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub(crate) struct RigView {
    pub(crate) name: String,
    pub(crate) state: String,
    pub(crate) probe: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) linear_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rotary_deg: Option<f64>,
    pub(crate) rig_time_s: f64,
    /// The wall clock of the daemon, ms since 1970.
    pub(crate) unix_ms: u64,
    /// Time of the last change of state on the rig's clock, s.
    pub(crate) state_since_s: f64,
    /// The journal of what happens between runs.
    pub(crate) session: String,
    pub(crate) is_simulated: bool,
    pub(crate) is_virtual_time: bool,
    pub(crate) limits: Limits,
    pub(crate) devices: Vec<DeviceView>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) run: Option<RunProgress>,
    /// The run that ended last since the daemon was started.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) last_run: Option<LastRun>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) prompt: Option<String>,
    /// The refused touch about which a person is asked.
    pub(crate) refused: Option<RefusedView>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) asked: Option<OpenPrompt>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) fault: Option<FaultView>,
    /// Who operates the rig, where clients have tokens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) lease: Option<LeaseHolder>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) journal_error: Option<String>,
    /// The rig loop gives no sign of life; all else is as it was before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) silence: Option<SilenceView>,
}

/// The client that operates the rig; the others watch.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub(crate) struct LeaseHolder {
    pub(crate) name: String,
    /// Since when it does, ms since 1970.
    pub(crate) since_unix_ms: u64,
}

/// A rig loop that gives no sign of life.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub(crate) struct SilenceView {
    /// Time of the last sign of life, ms since 1970.
    pub(crate) since_unix_ms: u64,
    pub(crate) message: String,
    pub(crate) hint: String,
}

/// A device, and what has gone over its port.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub(crate) struct DeviceView {
    pub(crate) role: String,
    pub(crate) identity: String,
    pub(crate) health: HealthView,
}

/// Counts of a device since the daemon was started.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub(crate) struct HealthView {
    pub(crate) requests: u64,
    /// Requests that were sent again.
    pub(crate) retries: u64,
    /// Answers that did not come in time.
    pub(crate) late: u64,
    /// Answers that could not be read, or answered something else.
    pub(crate) corrupt: u64,
    /// Requests that the device refused.
    pub(crate) refusals: u64,
    /// From the first byte of the last request to the end of its answer, ms. The answer to a
    /// measurement comes after its settling and integration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) last_round_trip_ms: Option<f64>,
}

/// The progress of the current run.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub(crate) struct RunProgress {
    pub(crate) id: String,
    pub(crate) protocol: String,
    /// Number of steps done.
    pub(crate) step: usize,
    pub(crate) steps: usize,
    pub(crate) touches_planned: usize,
    pub(crate) touches_measured: usize,
    pub(crate) touches_refused: usize,
    pub(crate) doing: String,
    #[serde(flatten)]
    pub(crate) ahead: Forecast,
}

/// The rest of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Forecast {
    /// It pauses before the next step.
    pub(crate) is_pausing: bool,
    /// Since it began, s on the rig's clock.
    pub(crate) elapsed_s: f64,
    /// Least and largest remaining time, s on the rig's clock.
    pub(crate) remaining_s: [f64; 2],
    /// Number of touches of earlier runs from which it is learned; 0 for the plan alone.
    pub(crate) learned_from_touches: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) next_prompt: Option<NextPrompt>,
}

/// The time of the next prompt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct NextPrompt {
    pub(crate) prompt: String,
    /// From now, s on the rig's clock.
    pub(crate) in_s: f64,
    /// Touches before it, that under way included.
    pub(crate) touches: usize,
}

#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub(crate) struct FaultView {
    /// `interrupted` if the last program was killed or left the rig latched; `not_homed` or `position_jumped` if the linear stage waits for a
    /// statement that nothing is below the probe; `position_lost` if an axis is where it cannot be; `not_commissioned` if a
    /// step of the commissioning is missing; `fault` otherwise.
    pub(crate) kind: String,
    pub(crate) cause: String,
    pub(crate) hint: String,
    /// Attempts to retract so far, while the latched rig goes on trying.
    pub(crate) attempts: Option<u32>,
}

#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub(crate) struct RefusedView {
    pub(crate) step: String,
    pub(crate) reason: String,
    pub(crate) answers: [String; 4],
}

/// The prompt that waits for an answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct OpenPrompt {
    /// Address of the step, for the answer.
    pub(crate) step: String,
    #[serde(flatten)]
    pub(crate) what: PromptAction,
    /// Number of the prompt in the run, from 1.
    pub(crate) number: usize,
    pub(crate) prompts: usize,
}

/// The action that a prompt asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "what", rename_all = "snake_case")]
pub(crate) enum PromptAction {
    /// Put this sample under the probe.
    PlaceSample { sample: String },
    /// Turn the sensor to this orientation.
    TurnSensor { orientation: String },
}

/// A run that has ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct LastRun {
    pub(crate) id: String,
    /// How the run ended.
    pub(crate) status: String,
}

/// What the readings of a sweep have said so far.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct EstimateView {
    /// Number of readings behind it.
    pub(crate) readings: usize,
    pub(crate) resonance_hz: f64,
    pub(crate) sigma_hz: f64,
}

/// Ranges of the targets of the axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Limits {
    linear_mm: AxisLimits,
    rotary_deg: AxisLimits,
    /// Position of the linear stage at which the tip touches the level sample, mm.
    surface_mm: f64,
    /// Height of that surface above the axis of the rotary stage, mm.
    surface_above_pivot_mm: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
struct AxisLimits {
    min: f64,
    max: f64,
    /// Rest position: clear, or level.
    rest: f64,
}

impl Limits {
    pub(crate) fn of(limits: &RigLimits) -> Self {
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
    pub(crate) fn of(plan: &Plan, prompt: Prompt) -> Self {
        match prompt {
            Prompt::PlaceSample { sample } => {
                Self::PlaceSample { sample: plan.samples.get(sample).cloned().unwrap_or_default() }
            }
            Prompt::TurnSensor { orientation } => {
                Self::TurnSensor { orientation: orientation.name().to_owned() }
            }
        }
    }
}

impl From<rig_link::Health> for HealthView {
    fn from(health: rig_link::Health) -> Self {
        let rig_link::Health { requests, retries, late, corrupt, refusals, .. } = health;
        let last_round_trip_ms = health.last_round_trip.map(|time| time.as_secs_f64() * 1e3);
        Self { requests, retries, late, corrupt, refusals, last_round_trip_ms }
    }
}
