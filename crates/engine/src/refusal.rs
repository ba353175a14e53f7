//! What happens after a touch was refused: the policy of the protocol, or the answer of a person.

use rig_model::{RigLimits, Window};
use rig_protocol::StepId;

/// The answer to a refused touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefusalAnswer {
    /// Widen the window of the sweep in contact, and repeat the touch.
    Widen,
    /// Repeat the touch.
    Repeat,
    /// Keep the refusal, and go on.
    Skip,
    /// Keep the refusal, and end the run.
    Abort,
}

impl RefusalAnswer {
    /// All answers.
    pub const ALL: [Self; 4] = [Self::Widen, Self::Repeat, Self::Skip, Self::Abort];

    /// Whether the touch is measured again.
    pub(crate) const fn is_again(self) -> bool {
        matches!(self, Self::Repeat | Self::Widen)
    }

    /// The word in requests and records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Widen => "widen",
            Self::Repeat => "repeat",
            Self::Skip => "skip",
            Self::Abort => "abort",
        }
    }

    /// The answer of this name.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|answer| answer.name() == name)
    }
}

/// A refused touch about which a person is asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RefusedTouch {
    /// Address of the touch.
    pub step: StepId,
    /// Why it has no result.
    pub reason: String,
}

/// A window that is wider by half of its width on each side, within the range of the analyzer.
pub(crate) fn widened(window: Window, limits: &RigLimits) -> Window {
    let more_hz = 0.5 * (window.max_hz - window.min_hz);
    let (lowest_hz, highest_hz) = limits.analyzer.frequency_hz;
    Window {
        min_hz: (window.min_hz - more_hz).max(lowest_hz),
        max_hz: (window.max_hz + more_hz).min(highest_hz),
    }
}
