//! One command at a time goes to a port, and a measurement needs axes at rest, unless it is the stream of readings
//! of a descent.

use crate::{PortCommand, Refusal};

/// The commands under way.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ports {
    bus: Option<PortCommand>,
    analyzer: Option<PortCommand>,
}

impl Ports {
    pub(crate) const fn admit(&self, command: &PortCommand) -> Result<(), Refusal> {
        let is_measurement = matches!(command, PortCommand::Measure | PortCommand::Stream);
        let other = if is_measurement { &self.analyzer } else { &self.bus };
        if let Some(other) = other {
            return Err(Refusal::PortBusy { what: command.name(), other: other.name() });
        }
        let may_move = matches!(
            (command, &self.bus),
            (PortCommand::Stream, Some(PortCommand::Descend { .. }))
        );
        if let (true, false, Some(moving)) = (is_measurement, may_move, &self.bus) {
            return Err(Refusal::Moving { other: moving.name() });
        }
        Ok(())
    }

    /// Whether a command of the axes is under way.
    pub(crate) const fn is_bus_busy(&self) -> bool {
        self.bus.is_some()
    }

    pub(crate) const fn begun(&mut self, command: PortCommand) {
        match command {
            PortCommand::Measure | PortCommand::Stream => self.analyzer = Some(command),
            _ => self.bus = Some(command),
        }
    }

    pub(crate) const fn ended(&mut self, command: &PortCommand) {
        match command {
            PortCommand::Measure | PortCommand::Stream => self.analyzer = None,
            _ => self.bus = None,
        }
    }
}
