//! What was asked of a person, and what a person asked for.

use serde::{Deserialize, Serialize};

/// What a person is asked for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum Prompt {
    /// Put a sample under the probe.
    PlaceSample {
        /// Its name.
        sample: String,
    },
    /// Turn the sensor about its own axis.
    TurnSensor {
        /// How it must stand afterwards: `front/back` or `left`.
        orientation: String,
    },
}

/// A question to a person.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PromptAsked {
    /// The step.
    pub step: String,
    /// What is asked for.
    pub prompt: Prompt,
}

/// The answer to a question.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PromptAnswered {
    /// The step.
    pub step: String,
    /// Who answered.
    pub by: String,
}

/// A command and who gave it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Operator {
    /// The command in a word, such as `run`, `pause`, `stop` or `acknowledge`.
    pub action: String,
    /// Who asked.
    pub who: String,
}
