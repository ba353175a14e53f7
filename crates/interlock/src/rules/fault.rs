//! After a fault or a stop, only the way out of contact is open, and it leads up or nowhere.

use crate::{PortCommand, Refusal};

/// Whether a fault is open.
///
/// ```text
///            a command failed, or the rig latched
///   ┌──────┐ ─────────────────────────────────▶ ┌─────────┐
///   │ Open │                                    │ Latched │
///   └──────┘ ◀───────────────────────────────── └─────────┘
///            a person acknowledges
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Latch {
    is_latched: bool,
    is_stopping: bool,
}

impl Latch {
    pub(crate) const fn admit(
        &self,
        command: &PortCommand,
        is_retract: bool,
    ) -> Result<(), Refusal> {
        let is_way_out =
            is_retract || matches!(command, PortCommand::Stop | PortCommand::FindLinear);
        let what = command.name();
        if self.is_latched && !is_way_out {
            return Err(Refusal::Latched { what });
        }
        if self.is_stopping && !is_way_out {
            return Err(Refusal::Stopping { what });
        }
        Ok(())
    }

    pub(crate) const fn failed(&mut self) {
        self.is_latched = true;
    }

    pub(crate) const fn stop_begun(&mut self) {
        self.is_stopping = true;
    }

    pub(crate) const fn cleared(&mut self) {
        self.is_stopping = false;
    }

    pub(crate) const fn acknowledged(&mut self) {
        self.is_latched = false;
        self.is_stopping = false;
    }

    pub(crate) const fn is_latched(&self) -> bool {
        self.is_latched
    }
}
