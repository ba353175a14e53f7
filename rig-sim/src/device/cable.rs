//! An analyzer at the end of its cable, where faults befall its messages.

use std::{fmt, time::Duration};

use rig_model::RigTime;

use super::{
    meter::{Meter, Model},
    outbox::Outbox,
    spoil::{self, Reply},
};
use crate::{
    faults::{DeviceFault, Faults, RequestFault},
    rig::{HangUp, PortId},
    world::{ContactFault, World},
};

/// How long an analyzer needs until it listens after it was switched on.
const BOOT: Duration = Duration::from_secs(3);

/// A message longer than this never ends: it is thrown away, as an instrument's buffer overruns.
const MAX_MESSAGE: usize = 64 * 1024;

/// An analyzer of any make.
pub(crate) trait Analyzer: fmt::Debug + Send {
    fn push(&mut self, now: RigTime, bytes: &[u8], world: &mut World);
    fn advance(&mut self, now: RigTime, world: &mut World);
    fn deadline(&self) -> Option<RigTime>;
    fn take_said(&mut self) -> Vec<(RigTime, Vec<u8>)>;
    fn overload(&mut self);
    fn restart(&mut self, now: RigTime, world: &mut World);
}

impl<M: Model<Command: Send + Sync> + Send> Analyzer for Meter<M> {
    fn push(&mut self, now: RigTime, bytes: &[u8], world: &mut World) {
        self.push(now, bytes, world);
    }

    fn advance(&mut self, now: RigTime, world: &mut World) {
        self.advance(now, world);
    }

    fn deadline(&self) -> Option<RigTime> {
        self.deadline()
    }

    fn take_said(&mut self) -> Vec<(RigTime, Vec<u8>)> {
        self.take_said()
    }

    fn overload(&mut self) {
        self.overload();
    }

    fn restart(&mut self, now: RigTime, world: &mut World) {
        self.restart(now, world);
    }
}

/// An analyzer and its cable.
#[derive(Debug)]
pub(crate) struct Cable {
    analyzer: Box<dyn Analyzer>,
    /// The beginning of a message whose end has not come.
    begun: Vec<u8>,
    /// The last message, for an echo.
    last: Vec<u8>,
    outbox: Outbox,
    /// It is switched on and does not listen yet.
    boots_until: RigTime,
}

impl Cable {
    pub(crate) fn new(analyzer: Box<dyn Analyzer>) -> Self {
        Self {
            analyzer,
            begun: Vec::new(),
            last: Vec::new(),
            outbox: Outbox::default(),
            boots_until: RigTime::ZERO,
        }
    }

    /// A new client: what the last one left on the cable is gone.
    pub(crate) fn connect(&mut self) {
        self.begun.clear();
        self.outbox.clear();
    }

    pub(crate) fn push(
        &mut self,
        now: RigTime,
        bytes: &[u8],
        world: &mut World,
        faults: &mut Faults,
    ) -> Result<(), HangUp> {
        for &byte in bytes {
            if self.begun.len() < MAX_MESSAGE {
                self.begun.push(byte);
            }
            if byte == b'\n' {
                let message = std::mem::take(&mut self.begun);
                self.take(now, message, world, faults)?;
            }
        }
        self.say(now, world, faults)
    }

    pub(crate) fn poll(
        &mut self,
        now: RigTime,
        world: &mut World,
        faults: &mut Faults,
    ) -> Result<Vec<u8>, HangUp> {
        self.say(now, world, faults)?;
        Ok(self.outbox.poll(now))
    }

    pub(crate) fn deadline(&self) -> Option<RigTime> {
        [self.analyzer.deadline(), self.outbox.deadline()].into_iter().flatten().min()
    }

    /// Lets a fault befall the analyzer now.
    pub(crate) fn suffer(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        match fault {
            DeviceFault::Reboot => {
                self.analyzer.restart(now, world);
                self.outbox.clear();
                self.boots_until = now + BOOT;
            }
            DeviceFault::Overload => self.analyzer.overload(),
            DeviceFault::BlindContact => world.set_contact_fault(now, Some(ContactFault::Blind)),
            DeviceFault::StuckContact => world.set_contact_fault(now, Some(ContactFault::Stuck)),
            // These befall drives.
            DeviceFault::Alarm(_)
            | DeviceFault::Stall
            | DeviceFault::Jam
            | DeviceFault::LoseSteps(_)
            | DeviceFault::LimitSwitch => {}
        }
    }

    fn take(
        &mut self,
        now: RigTime,
        message: Vec<u8>,
        world: &mut World,
        faults: &mut Faults,
    ) -> Result<(), HangUp> {
        for fault in faults.on_device(PortId::Analyzer, None) {
            self.suffer(now, fault, world);
        }
        let mut is_lost = now < self.boots_until;
        for fault in faults.on_request(PortId::Analyzer, None) {
            match fault {
                RequestFault::Drop => is_lost = true,
                RequestFault::Disconnect => return Err(HangUp),
                // There are no such replies here.
                RequestFault::Exception(_) => {}
            }
        }
        if !is_lost {
            self.analyzer.push(now, &message, world);
        }
        self.last = message;
        Ok(())
    }

    /// Takes what the analyzer says.
    fn say(&mut self, now: RigTime, world: &mut World, faults: &mut Faults) -> Result<(), HangUp> {
        self.analyzer.advance(now, world);
        for (at, bytes) in self.analyzer.take_said() {
            let struck = faults.on_reply(PortId::Analyzer, None);
            // It is one instrument: what it says later never comes earlier.
            let due = self.outbox.last_due().map_or(at, |last| last.max(at));
            let reply = Reply { due, request: &self.last, bytes };
            spoil::send(reply, &struck, |_| None, faults, &mut self.outbox)?;
        }
        Ok(())
    }
}
