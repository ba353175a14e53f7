//! The beginning of a run and of its steps.

use serde::{Deserialize, Serialize};

use super::{Aim, Phase, Pose, Prompt, TouchSettings};

/// Everything needed to repeat a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunStarted {
    /// Version of the program.
    pub software: String,
    /// The seed of every random choice.
    pub seed: u64,
    /// The text of the protocol file.
    pub protocol: Source,
    /// The text of the rig file.
    pub rig: Source,
    /// Whether no real device took part.
    pub is_simulated: bool,
    /// The scene behind a simulated rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<Source>,
    /// Devices on the ports.
    pub devices: Vec<Device>,
    /// The calibrations of the bench that held when the run began, its last daily check, and the last corrections of the
    /// analyzer. A simulated bench that is as
    /// described needs none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibrations: Vec<CitedCalibration>,
    /// The samples, in the protocol's order.
    pub samples: Vec<Sample>,
    /// Size of the plan.
    pub plan: PlanSize,
    /// Every planned touch, in order.
    pub touches: Vec<TouchSettings>,
    /// Number of classes of the blind touches, if there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classes: Option<u32>,
    /// The expected duration of the run, so that it can be compared with the real one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected: Option<Expected>,
    /// What the protocol wants of its touches, if it says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aim: Option<Aim>,
    /// Idempotency key of the request: a repeated request begins no second run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub idempotency_key: Option<String>,
}

/// The expected duration of a run, on the rig's clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    /// When every answer comes at once and the rig is fast, s.
    pub least_s: f64,
    /// If answers take their usual time and the rig is slow, s.
    pub most_s: f64,
    /// Number of touches of earlier runs from which it was learned; 0 for the plan alone.
    pub from_touches: u32,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// Name in the file.
    pub name: String,
    /// Text of the file.
    pub toml: String,
}

/// A device that answered.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Device {
    /// Role on the rig, such as `analyzer`.
    pub role: String,
    /// Identity that the device reported.
    pub identity: String,
    /// What tells how to speak with it, if it is a file of the bench's own and not one of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instrument: Option<Source>,
}

/// A calibration of the bench that a run cites.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CitedCalibration {
    /// What it shows, such as `scale`.
    pub kind: String,
    /// When it was made, UTC.
    pub made: String,
    /// Name of the person who saw it.
    pub person: String,
    /// Name of its file in `calibrations` of the data directory.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Verdict of a daily check: `accepted`, `look` or `not to be trusted`. The others are accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
    /// The error of the linear screw by touches on blocks, which the results take out of the depths.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub screw: Option<ScrewMap>,
    /// The cable and fixture of a correction of the analyzer, which is `open`, `short` or `load`. Its SHA-256 is that of
    /// its entry in the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cable: Option<String>,
}

/// The error of the linear screw at heights: the position that the drive says, less the true one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScrewMap {
    /// Positions of the linear axis, growing, mm.
    pub heights_mm: Vec<f64>,
    /// The error at each, mm.
    pub errors_mm: Vec<f64>,
    /// Covariance of each error with those up to itself, µm².
    pub covariance_um2: Vec<Vec<f64>>,
}

/// A sample of the protocol, with its known stiffness.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Name in the protocol.
    pub name: String,
    /// Stiffness known by other means, MPa.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness_mpa: Option<f64>,
}

/// The size of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlanSize {
    /// Steps of every kind.
    pub steps: u32,
    /// Steps that touch a sample.
    pub touches: u32,
    /// Steps that ask a person for something.
    pub prompts: u32,
}

/// The action of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "action", rename_all = "snake_case")]
pub enum Action {
    /// A prompt.
    Prompt {
        /// Action that the person is asked for.
        prompt: Prompt,
    },
    /// The resonance is measured with the probe clear.
    NoLoad {
        /// Pose of the surface.
        pose: Pose,
    },
    /// One touch, from clear to clear.
    Touch {
        /// The part of the protocol.
        phase: Phase,
        /// Name of the sample.
        sample: String,
        /// Pose of the surface.
        pose: Pose,
        /// Number of the repeat, from 1.
        repeat: u32,
    },
}

/// The beginning of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepStarted {
    /// Address of the step.
    pub step: String,
    /// Number of the step in the plan, from 1.
    pub index: u32,
    /// Number of steps of the plan.
    pub count: u32,
    /// Action of the step.
    pub action: Action,
}
