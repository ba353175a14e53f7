//! The sample turns only under a probe that was read back clear, not long ago, with no command to the
//! linear stage since.

use std::time::Duration;

use rig_model::{Axis, Mm, RigTime};

use crate::{Outcome, PortCommand, Refusal};

/// How old the read-back may be. A hand or a slipping brake moves the stage within minutes.
const FRESH: Duration = Duration::from_secs(60);

/// ```text
///            a command to the linear stage
///   ┌───────┐ ──────────────────────────▶ ┌──────────┐
///   │ Clear │                             │ In doubt │
///   └───────┘ ◀────────────────────────── └──────────┘
///            its read-back is at the clear position or above
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Turn {
    linear: Axis<Mm>,
    /// When the probe was read back clear; `None` when in doubt.
    clear_at: Option<RigTime>,
}

impl Turn {
    /// In doubt.
    pub const fn new(linear: Axis<Mm>) -> Self {
        Self { linear, clear_at: None }
    }

    /// Whether a turn needs the probe to be read back anew, and nothing else.
    pub fn needs_reading(&self, now: RigTime) -> bool {
        self.clear_at.is_some_and(|at| FRESH < now.since(at))
    }

    pub(crate) fn admit(&self, now: RigTime, command: &PortCommand) -> Result<(), Refusal> {
        if !command.is_turn() {
            return Ok(());
        }
        let what = command.name();
        let clear_at = self.clear_at.ok_or(Refusal::NotClear { what })?;
        let age = now.since(clear_at);
        if FRESH < age {
            let (age_s, limit_s) = (age.as_secs_f64(), FRESH.as_secs_f64());
            return Err(Refusal::ClearIsOld { what, age_s, limit_s });
        }
        Ok(())
    }

    pub(crate) fn begun(&mut self, command: &PortCommand) {
        if command.is_linear() {
            self.clear_at = None;
        }
    }

    /// The end of a command, or a reading of the linear stage without a command.
    pub(crate) fn read(&mut self, now: RigTime, outcome: &Outcome) {
        if let Outcome::LinearAt(at) = outcome {
            let lowest = self.linear.rest_target().position().offset(-self.linear.tolerance());
            self.clear_at = (*at >= lowest).then_some(now);
        }
    }

    /// Whether the probe was read back clear, however long ago.
    pub(crate) const fn is_clear(&self) -> bool {
        self.clear_at.is_some()
    }
}
