//! Prompts for a person, and commands of a person.

use serde::{Deserialize, Serialize};

/// A prompt for a person.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum Prompt {
    /// Put a sample under the probe.
    PlaceSample {
        /// Name of the sample.
        sample: String,
    },
    /// Turn the sensor about its own axis.
    TurnSensor {
        /// Orientation of the sensor: `front/back` or `left`.
        orientation: String,
    },
}

/// A prompt that was asked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PromptAsked {
    /// Address of the step.
    pub step: String,
    /// Action that the person is asked for.
    pub prompt: Prompt,
}

/// The answer to a prompt.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PromptAnswered {
    /// Address of the step.
    pub step: String,
    /// Name of the operator.
    pub by: String,
}

/// A command and its operator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Operator {
    /// The command, such as `run`, `pause`, `stop` or `acknowledge`.
    pub action: String,
    /// Name of the operator.
    pub who: String,
}
