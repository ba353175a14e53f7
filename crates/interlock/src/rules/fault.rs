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
    /// A person has acknowledged while a command was under way, which ends first.
    is_acknowledged: bool,
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
        (self.is_latched, self.is_acknowledged) = (true, false);
    }

    /// A command of the axes has ended. Its failure was acknowledged if its command was under way then.
    pub(crate) const fn ended(&mut self, is_failed: bool) {
        if self.is_acknowledged {
            self.acknowledged(false);
        } else if is_failed {
            self.failed();
        }
    }

    pub(crate) const fn stop_begun(&mut self) {
        (self.is_stopping, self.is_acknowledged) = (true, false);
    }

    pub(crate) const fn cleared(&mut self) {
        self.is_stopping = false;
    }

    /// A person acknowledges. A command that is under way is still one of the latched rig.
    pub(crate) const fn acknowledged(&mut self, is_under_way: bool) {
        self.is_acknowledged = is_under_way;
        self.is_latched &= is_under_way;
        self.is_stopping &= is_under_way;
    }

    pub(crate) const fn is_latched(&self) -> bool {
        self.is_latched
    }
}
