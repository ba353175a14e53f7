//! An axis moves only after it was identified and read back, and goes down only as far as the journal
//! says.

use rig_model::{Mm, Position};

use crate::{Outcome, PortCommand, Refusal};

/// Which axes were identified and read back since they were last in doubt.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Identity {
    is_linear_known: bool,
    is_rotary_known: bool,
    /// The linear stage was known once, so that a retract may start without identifying it again.
    was_linear_known: bool,
}

impl Identity {
    pub(crate) const fn admit(
        &self,
        command: &PortCommand,
        is_retract: bool,
    ) -> Result<(), Refusal> {
        let what = command.name();
        let (is_known, axis) = match command {
            PortCommand::MoveLinear { .. } if is_retract => (self.was_linear_known, "linear stage"),
            PortCommand::MoveLinear { .. } | PortCommand::Descend { .. }
                if self.is_linear_known =>
            {
                // How deep it may go rests on the tilt.
                (self.is_rotary_known, "rotary stage")
            }
            PortCommand::MoveLinear { .. } | PortCommand::Descend { .. } => (false, "linear stage"),
            PortCommand::MoveRotary { .. } => (self.is_rotary_known, "rotary stage"),
            _ => (true, ""),
        };
        if is_known { Ok(()) } else { Err(Refusal::NotIdentified { what, axis }) }
    }

    pub(crate) fn ended(&mut self, command: &PortCommand, outcome: &Outcome) {
        let is_failed = matches!(outcome, Outcome::Failed);
        match command {
            PortCommand::HomeLinear | PortCommand::FindLinear => {
                self.is_linear_known = matches!(outcome, Outcome::LinearAt(_));
                self.was_linear_known |= self.is_linear_known;
            }
            PortCommand::HomeRotary => {
                self.is_rotary_known = matches!(outcome, Outcome::RotaryAt(_));
            }
            PortCommand::MoveLinear { .. } | PortCommand::Descend { .. } => {
                self.is_linear_known &= !is_failed;
            }
            PortCommand::MoveRotary { .. } => self.is_rotary_known &= !is_failed,
            PortCommand::JogLinear { .. } | PortCommand::SeekLinear => self.is_linear_known = false,
            PortCommand::JogRotary { .. } | PortCommand::SeekRotary => self.is_rotary_known = false,
            PortCommand::Stop
            | PortCommand::ClearLinear
            | PortCommand::ClearRotary
            | PortCommand::Measure
            | PortCommand::Stream => {}
        }
    }
}

/// The deepest position that a durable record of an intent allows, until the probe is at the clear position
/// again or the sample turns.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Intent {
    down_to: Option<Position<Mm>>,
}

impl Intent {
    /// A record of the intent to go down to this position is durable.
    pub(crate) const fn durable(&mut self, down_to: Position<Mm>) {
        self.down_to = Some(down_to);
    }

    pub(crate) fn admit(&self, command: &PortCommand, is_retract: bool) -> Result<(), Refusal> {
        match *command {
            PortCommand::MoveLinear { to, .. } | PortCommand::Descend { to, .. }
                // A target that is not a number is not above the floor.
                if !is_retract && !self.down_to.is_some_and(|down_to| down_to <= to) =>
            {
                Err(Refusal::NoIntent { to })
            }
            _ => Ok(()),
        }
    }

    /// The intent was for the tilt before a turn.
    pub(crate) const fn begun(&mut self, command: &PortCommand) {
        if command.is_turn() {
            self.down_to = None;
        }
    }

    pub(crate) const fn cleared(&mut self) {
        self.down_to = None;
    }
}
