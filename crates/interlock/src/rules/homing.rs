//! The linear stage is homed in an unknown direction only when nothing is below the probe. No read-back
//! shows that: a probe above a sample is clear, and homing downwards leads through the sample.

use std::time::Duration;

use rig_model::RigTime;

use crate::{PortCommand, Refusal};

/// How long a statement holds: a sample is placed within minutes.
const FRESH: Duration = Duration::from_secs(60);

/// ```text
///              a person states that nothing is below the probe
///   ┌────────┐ ──────────────────────────────────────────────▶ ┌────────┐
///   │ Closed │                                                 │ Stated │
///   └────────┘ ◀────────────────────────────────────────────── └────────┘
///              a command to the linear stage, a stop, or 60 s later
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Homing {
    stated_at: Option<RigTime>,
}

impl Homing {
    pub(crate) fn stated(&mut self, now: RigTime) {
        self.stated_at = Some(now);
    }

    pub(crate) fn withdrawn(&mut self) {
        self.stated_at = None;
    }

    pub(crate) fn admit(&self, now: RigTime, command: &PortCommand) -> Result<(), Refusal> {
        let is_stated = self.stated_at.is_some_and(|at| now.since(at) <= FRESH);
        if matches!(command, PortCommand::HomeLinear) && !is_stated {
            return Err(Refusal::HomingUnproven);
        }
        Ok(())
    }

    pub(crate) fn begun(&mut self, command: &PortCommand) {
        if command.is_linear() {
            self.withdrawn();
        }
    }
}
