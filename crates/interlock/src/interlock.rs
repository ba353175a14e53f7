//! All rules together.

use std::time::Duration;

use rig_model::{Mm, Position, RigLimits, RigTime};

use crate::{
    Outcome, PortCommand, Refusal, Word,
    rules::{Commission, Depth, Homing, Identity, Intent, Latch, Ports, Proven, StopClock, Turn},
};

/// The interlock in front of the ports of one rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Interlock {
    rest: Position<Mm>,
    turn: Turn,
    depth: Depth,
    identity: Identity,
    intent: Intent,
    latch: Latch,
    ports: Ports,
    stop: StopClock,
    homing: Homing,
    commission: Commission,
    /// For how long the computer was held up or slept: the clock of its caller may not have counted it.
    held_up: Duration,
}

impl Interlock {
    /// Nothing is known of where the axes are. `proven` is what calibrations show of their drives.
    pub fn new(limits: RigLimits, proven: Proven) -> Self {
        Self {
            commission: Commission::new(&limits, proven),
            rest: limits.linear.rest_target().position(),
            turn: Turn::new(limits),
            depth: Depth::new(limits),
            identity: Identity::default(),
            intent: Intent::default(),
            latch: Latch::default(),
            ports: Ports::default(),
            stop: StopClock::default(),
            homing: Homing::default(),
            held_up: Duration::ZERO,
        }
    }

    /// Nothing was done for this long. What was read or stated before is older by it.
    pub fn held_up(&mut self, lasted: Duration) {
        self.held_up += lasted;
    }

    /// Admits a command that is about to be sent. It counts as under way until [`ended`](Self::ended).
    ///
    /// # Errors
    /// [`Refusal`]; nothing changes then, and the command must not be sent.
    pub fn admit(&mut self, now: RigTime, command: &PortCommand) -> Result<(), Refusal> {
        let now = now + self.held_up;
        let is_retract = self.is_retract(command);
        self.ports.admit(command)?;
        self.commission.admit(now, command)?;
        if command.is_of_commissioning() {
            self.begun(command);
            return Ok(());
        }
        self.latch.admit(command, is_retract && self.depth.is_up(command))?;
        self.identity.admit(command, is_retract)?;
        self.turn.admit(now, command)?;
        self.intent.admit(command, is_retract)?;
        self.depth.admit(now, command)?;
        self.homing.admit(now, command)?;
        self.begun(command);
        Ok(())
    }

    fn begun(&mut self, command: &PortCommand) {
        self.ports.begun(*command);
        self.turn.begun(command);
        self.depth.begun(command);
        self.intent.begun(command);
        self.homing.begun(command);
        self.commission.begun(command);
    }

    /// A command that was admitted has ended.
    pub fn ended(&mut self, now: RigTime, command: &PortCommand, outcome: &Outcome) {
        self.ports.ended(command);
        self.identity.ended(command, outcome);
        let is_failed = matches!(outcome, Outcome::Failed);
        if !matches!(command, PortCommand::Measure | PortCommand::Stream) {
            self.latch.ended(is_failed);
        } else if is_failed {
            self.latch.failed();
        }
        self.read(now, outcome);
    }

    /// A position was read back, at the end of a command or without one.
    pub fn read(&mut self, now: RigTime, outcome: &Outcome) {
        let now = now + self.held_up;
        self.turn.read(now, outcome);
        self.depth.read(now, outcome);
        if matches!(outcome, Outcome::LinearAt(_)) && self.turn.is_clear() {
            self.intent.cleared();
            self.latch.cleared();
        }
    }

    /// Whether the linear stage must be read back before a turn, because its last read-back is old.
    pub fn needs_reading(&self, now: RigTime, command: &PortCommand) -> bool {
        self.turn.needs_reading(now + self.held_up, command)
    }

    /// Whether the rotary stage must be read back before a way down, because its last read-back is old.
    pub fn needs_tilt(&self, now: RigTime, command: &PortCommand) -> bool {
        self.depth.needs_tilt(now + self.held_up, command)
    }

    /// A record of the intent to lower the probe down to this position is durable.
    pub const fn intent_is_durable(&mut self, down_to: Position<Mm>) {
        self.intent.durable(down_to);
    }

    /// The rig has latched.
    pub const fn latched(&mut self) {
        self.latch.failed();
    }

    /// Calibrations that are on the disk show this of the drives.
    pub const fn prove(&mut self, proven: Proven) {
        self.commission.prove(proven);
    }

    /// Whether a fault is open.
    pub const fn is_latched(&self) -> bool {
        self.latch.is_latched()
    }

    /// A person gives a command.
    ///
    /// # Errors
    /// [`Refusal::Anonymous`].
    pub fn operator(&mut self, now: RigTime, by: &str, word: Word) -> Result<(), Refusal> {
        if by.trim().is_empty() {
            return Err(Refusal::Anonymous);
        }
        let now = now + self.held_up;
        match word {
            Word::Command => {}
            Word::Acknowledgement => self.latch.acknowledged(self.ports.is_bus_busy()),
            Word::ThisStep => self.commission.stated(now),
            Word::LinearStepSeen => self.commission.linear_seen(),
            Word::RotaryStepSeen => self.commission.rotary_seen(),
            Word::NothingBelow => {
                self.latch.acknowledged(self.ports.is_bus_busy());
                self.homing.stated(now);
            }
        }
        Ok(())
    }

    /// A stop was requested, and has waited this long. Until the probe is clear, only the way out is open.
    pub fn stop_asked(&mut self, now: RigTime, waited: Duration) {
        self.stop.asked(now + self.held_up, waited);
        self.homing.withdrawn();
        self.commission.withdrawn();
        self.latch.stop_begun();
    }

    /// The frames of a stop have left. Returns how long that took if it was too long.
    pub fn stop_sent(&mut self, now: RigTime) -> Option<Duration> {
        self.stop.sent(now + self.held_up)
    }

    /// A move to the clear position or above is always a way out.
    fn is_retract(&self, command: &PortCommand) -> bool {
        matches!(command, PortCommand::MoveLinear { to, .. } if self.rest <= *to)
    }
}
