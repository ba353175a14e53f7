//! The beginning of a run and of its steps.

use serde::{Deserialize, Serialize};

use super::{Phase, Pose, Prompt, TouchSettings};

/// Everything needed to repeat a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunStarted {
    /// Version of the program.
    pub software: String,
    /// The seed of every random choice.
    pub seed: u64,
    /// The protocol as it was read.
    pub protocol: Source,
    /// The rig as it was read.
    pub rig: Source,
    /// Whether no real device took part.
    pub is_simulated: bool,
    /// The scene behind a simulated rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<Source>,
    /// Who answered on the ports.
    pub devices: Vec<Device>,
    /// The samples, in the protocol's order.
    pub samples: Vec<Sample>,
    /// What there is to do.
    pub plan: PlanSize,
    /// Every planned touch, in order.
    pub touches: Vec<TouchSettings>,
    /// Into how many classes the blind touches are sorted, when there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classes: Option<u32>,
    /// What the client called its request, so that asking twice begins one run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub idempotency_key: Option<String>,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// The name that it gives itself.
    pub name: String,
    /// All of its text.
    pub toml: String,
}

/// A device that answered.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Device {
    /// What it is on the rig, such as `analyzer`.
    pub role: String,
    /// What it says that it is.
    pub identity: String,
}

/// A sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Its name.
    pub name: String,
    /// Its stiffness in MPa, where it is known by other means.
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

/// What a step does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "action", rename_all = "snake_case")]
pub enum Action {
    /// A person is asked for something.
    Prompt {
        /// What.
        prompt: Prompt,
    },
    /// The resonance is measured with the probe clear.
    NoLoad {
        /// How the surface stands.
        pose: Pose,
    },
    /// One touch, from clear to clear.
    Touch {
        /// The part of the protocol.
        phase: Phase,
        /// Name of the sample.
        sample: String,
        /// How the surface stands.
        pose: Pose,
        /// Counts from 1.
        repeat: u32,
    },
}

/// The beginning of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepStarted {
    /// Its address.
    pub step: String,
    /// Its place in the plan, from 1.
    pub index: u32,
    /// How many steps the plan has.
    pub count: u32,
    /// What it does.
    pub action: Action,
}
