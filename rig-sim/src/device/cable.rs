//! An analyzer at the end of its cable, where faults are injected into its messages.

use std::{
    fmt,
    sync::{Arc, Weak},
    time::Duration,
};

use rig_model::RigTime;

use super::{
    corruption::{self, Reply},
    meter::{ClientId, Meter, Model},
    output_queue::OutputQueue,
};
use crate::{
    faults::{DeviceContext, DeviceFault, RequestFault},
    wiring::{HangUp, PortId},
    world::{ContactFault, World},
};

/// Boot time of an analyzer.
const BOOT: Duration = Duration::from_secs(3);

/// A message longer than this never ends: it is discarded, like in an instrument whose buffer
/// overruns.
const MAX_MESSAGE: usize = 64 * 1024;

/// An analyzer of any make.
pub(crate) trait Analyzer: fmt::Debug + Send {
    fn push(&mut self, now: RigTime, id: ClientId, bytes: &[u8], world: &mut World);
    fn advance(&mut self, now: RigTime, world: &mut World);
    fn deadline(&self) -> Option<RigTime>;
    fn take_said(&mut self, id: ClientId) -> Vec<(RigTime, Vec<u8>)>;
    fn hang_up(&mut self, id: ClientId);
    fn overload(&mut self);
    fn read_wrongly(&mut self, factor: f64);
    fn clear_faults(&mut self);
    fn restart(&mut self, now: RigTime, world: &mut World);
}

impl<M: Model<Command: Send + Sync> + Send> Analyzer for Meter<M> {
    fn push(&mut self, now: RigTime, id: ClientId, bytes: &[u8], world: &mut World) {
        self.push(now, id, bytes, world);
    }

    fn advance(&mut self, now: RigTime, world: &mut World) {
        self.advance(now, world);
    }

    fn deadline(&self) -> Option<RigTime> {
        self.deadline()
    }

    fn take_said(&mut self, id: ClientId) -> Vec<(RigTime, Vec<u8>)> {
        self.take_said(id)
    }

    fn hang_up(&mut self, id: ClientId) {
        self.hang_up(id);
    }

    fn overload(&mut self) {
        self.overload();
    }

    fn read_wrongly(&mut self, factor: f64) {
        self.read_wrongly(factor);
    }

    fn clear_faults(&mut self) {
        self.clear_faults();
    }

    fn restart(&mut self, now: RigTime, world: &mut World) {
        self.restart(now, world);
    }
}

/// An analyzer with a socket for its cables.
#[derive(Debug)]
pub(crate) struct Socket {
    analyzer: Box<dyn Analyzer>,
    /// Whether every character is sent back, and the next one waits for that.
    echoes: bool,
    /// The cables that are plugged in, as long as they are alive.
    plugged: Vec<(ClientId, Weak<()>)>,
    /// Counts the cables.
    cables: ClientId,
    /// It is switched on and does not listen yet.
    boots_until: RigTime,
}

/// A client's cable.
#[derive(Debug)]
pub(crate) struct Cable {
    id: ClientId,
    _plug: Arc<()>,
    /// The beginning of a message whose end has not come.
    begun: Vec<u8>,
    /// The last message, for an echo.
    last: Vec<u8>,
    output: OutputQueue,
    /// When the instrument itself does something next.
    instrument_at: Option<RigTime>,
}

impl Cable {
    /// When something will happen without further bytes.
    pub(crate) fn deadline(&self) -> Option<RigTime> {
        [self.instrument_at, self.output.deadline()].into_iter().flatten().min()
    }
}

impl Socket {
    pub(crate) fn new(analyzer: Box<dyn Analyzer>, echoes: bool) -> Self {
        let (plugged, cables) = (Vec::new(), 0);
        Self { analyzer, echoes, plugged, cables, boots_until: RigTime::ZERO }
    }

    /// A new cable without input or output. The output for closed cables is discarded.
    pub(crate) fn plug(&mut self) -> Cable {
        for (id, _) in self.plugged.extract_if(.., |(_, plug)| plug.strong_count() == 0) {
            self.analyzer.hang_up(id);
        }
        self.cables += 1;
        let plug = Arc::new(());
        self.plugged.push((self.cables, Arc::downgrade(&plug)));
        Cable {
            id: self.cables,
            _plug: plug,
            begun: Vec::new(),
            last: Vec::new(),
            output: OutputQueue::default(),
            instrument_at: None,
        }
    }

    /// Accepts bytes that arrived at `now`.
    pub(crate) fn push(
        &mut self,
        now: RigTime,
        cable: &mut Cable,
        bytes: &[u8],
        mut context: DeviceContext<'_>,
    ) -> Result<(), HangUp> {
        for &byte in bytes {
            if self.echoes && self.boots_until <= now {
                cable.output.push(now, vec![byte]);
            }
            if cable.begun.len() < MAX_MESSAGE {
                cable.begun.push(byte);
            }
            if byte == b'\n' {
                cable.last = std::mem::take(&mut cable.begun);
                self.take(now, cable.id, &cable.last, &mut context)?;
            }
        }
        self.say(now, cable, &mut context)
    }

    /// Takes the output up to `now`.
    pub(crate) fn poll(
        &mut self,
        now: RigTime,
        cable: &mut Cable,
        mut context: DeviceContext<'_>,
    ) -> Result<Vec<u8>, HangUp> {
        self.say(now, cable, &mut context)?;
        Ok(cable.output.poll(now))
    }

    /// Injects a fault into the analyzer.
    pub(crate) fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        match fault {
            DeviceFault::Reboot => {
                self.analyzer.restart(now, world);
                self.boots_until = now + BOOT;
            }
            DeviceFault::Overload => self.analyzer.overload(),
            DeviceFault::WrongReading(factor) => self.analyzer.read_wrongly(factor),
            DeviceFault::BlindContact => world.set_contact_fault(now, Some(ContactFault::Blind)),
            DeviceFault::StuckContact => world.set_contact_fault(now, Some(ContactFault::Stuck)),
            DeviceFault::Knock(by_hz) => world.knock(now, by_hz),
            DeviceFault::StuckFrequency => {
                world.set_contact_fault(now, Some(ContactFault::StuckFrequency));
            }
            // These are faults of drives.
            DeviceFault::Alarm(_)
            | DeviceFault::Stall
            | DeviceFault::Jam
            | DeviceFault::LoseSteps(_)
            | DeviceFault::Miscount(_)
            | DeviceFault::LimitSwitch
            | DeviceFault::EmergencyStop => {}
        }
    }

    /// Clears the faults that have not happened yet.
    pub(crate) fn clear_faults(&mut self) {
        self.analyzer.clear_faults();
    }

    fn take(
        &mut self,
        now: RigTime,
        id: ClientId,
        message: &[u8],
        context: &mut DeviceContext<'_>,
    ) -> Result<(), HangUp> {
        for fault in context.faults.on_device(PortId::Analyzer, None) {
            self.apply_fault(now, fault, context.world);
        }
        let mut is_lost = now < self.boots_until;
        for fault in context.faults.on_request(PortId::Analyzer, None) {
            match fault {
                RequestFault::Drop => is_lost = true,
                RequestFault::Disconnect => return Err(HangUp),
                RequestFault::Unplug(absence) => {
                    context.faults.pull(PortId::Analyzer, absence);
                    return Err(HangUp);
                }
                // There are no such replies here.
                RequestFault::Exception(_) => {}
            }
        }
        if !is_lost {
            self.analyzer.push(now, id, message, context.world);
        }
        Ok(())
    }

    /// Advances the instrument to `now`, and takes its output for a cable.
    fn say(
        &mut self,
        now: RigTime,
        cable: &mut Cable,
        context: &mut DeviceContext<'_>,
    ) -> Result<(), HangUp> {
        self.analyzer.advance(now, context.world);
        for (at, bytes) in self.analyzer.take_said(cable.id) {
            let applied = context.faults.on_reply(PortId::Analyzer, None);
            // One instrument never overtakes its own answers.
            let due = cable.output.last_due().map_or(at, |last| last.max(at));
            let reply = Reply { due, request: &cable.last, bytes };
            corruption::send(reply, &applied, |_| None, context.faults, &mut cable.output)?;
        }
        cable.instrument_at = self.analyzer.deadline();
        Ok(())
    }
}
