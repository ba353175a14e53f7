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

/// A touch was refused, and a person is asked what to do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusalAsked {
    /// Address of the touch.
    pub step: String,
    /// Why it has no result.
    pub reason: String,
}

/// What a person or the policy of the protocol did after a refused touch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RefusalAnswered {
    /// Address of the touch.
    pub step: String,
    /// Why it had no result.
    pub reason: String,
    /// `widen`, `repeat`, `skip` or `abort`.
    pub answer: String,
    /// Name of the operator, or `protocol`.
    pub by: String,
    /// The window of the repeated sweep, if it is wider than that of the protocol, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window_hz: Option<[f64; 2]>,
}
