//! The fault menu: faults on the wire and in the devices, and their triggers.
//!
//! A fault waits for its frame. Faults of requests and of devices count the requests that arrive,
//! faults of replies count the replies that leave; each may be for one unit of a line only.

use std::time::Duration;

use rig_model::random::Stream;

use crate::{wiring::PortId, world::World};

/// A scheduled fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// The port at which it happens.
    pub port: PortId,
    /// The unit of the line; `None` for all units.
    pub unit: Option<u8>,
    /// The kind of the fault.
    pub kind: FaultKind,
    /// When the fault acts.
    pub trigger: FaultTrigger,
}

/// The time of a fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultTrigger {
    /// Once, at the n-th frame from now. The next one is the first.
    Nth(u64),
    /// At each of the next n frames.
    Next(u64),
    /// At each frame with this probability, without end.
    Rate(f64),
}

/// The kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// A fault of a request.
    Request(RequestFault),
    /// A fault of the device, when a request arrives.
    Device(DeviceFault),
    /// A fault of a reply.
    Reply(ReplyFault),
}

/// A fault of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequestFault {
    /// It is lost.
    Drop,
    /// It is refused with this Modbus exception and not carried out: 6 is busy.
    Exception(u8),
    /// The connection breaks before it is carried out.
    Disconnect,
    /// The connection ends, and for this long no new one can be made.
    Unplug(Duration),
}

/// A fault of a reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReplyFault {
    /// It is lost. Its request was carried out.
    Drop,
    /// It comes later by this much.
    Delay(Duration),
    /// It comes twice.
    Duplicate,
    /// One bit of it is wrong.
    Corrupt,
    /// It ends early.
    Truncate,
    /// This number of random bytes comes before it.
    Noise(usize),
    /// The request comes back before it, as from an adapter that receives its own bytes.
    Echo,
    /// It says that it comes from this unit.
    Unit(u8),
    /// The connection breaks instead of it. Its request was carried out.
    Disconnect,
}

/// A fault of a device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DeviceFault {
    /// It is switched off and on again.
    Reboot,
    /// A drive goes into the alarm with this code and stops.
    Alarm(u8),
    /// The motor halts where it is. The next move works again.
    Stall,
    /// The motor does not move any more until the faults are cleared.
    Jam,
    /// The load is moved by this much, mm or degrees, and the encoder does not see it.
    LoseSteps(f64),
    /// The drive says from now on, also after a restart, that it is further up by this much, mm or degrees: its encoder has lost
    /// count of its turns.
    Miscount(f64),
    /// A limit switch says that it was reached.
    LimitSwitch,
    /// A person presses the emergency stop of both drives, until the faults are cleared.
    EmergencyStop,
    /// The input of the analyzer is overloaded at the next measurement.
    Overload,
    /// The impedance of the next measurement is this many times what was measured.
    WrongReading(f64),
    /// The impedance is that of a free sensor, also in contact.
    BlindContact,
    /// The impedance is that of a sensor in contact, also when it is clear.
    StuckContact,
    /// A knock at the sensor: its free resonance jumps by this, Hz.
    Knock(f64),
    /// The drive of the analyzer stays at its frequency, and the analyzer says another one.
    StuckFrequency,
}

/// The surroundings of a device: the world and the scheduled faults.
#[derive(Debug)]
pub(crate) struct DeviceContext<'a> {
    pub(crate) world: &'a mut World,
    pub(crate) faults: &'a mut FaultSchedule,
}

/// The scheduled faults.
#[derive(Debug)]
pub(crate) struct FaultSchedule {
    waiting: Vec<Fault>,
    stream: Stream,
    /// The port whose cable was pulled just now, and for how long.
    pulled: Option<(PortId, Duration)>,
}

impl FaultSchedule {
    pub(crate) fn new(stream: Stream) -> Self {
        Self { waiting: Vec::new(), stream, pulled: None }
    }

    pub(crate) fn add(&mut self, fault: Fault) {
        self.waiting.push(fault);
    }

    pub(crate) fn clear(&mut self) {
        self.waiting.clear();
    }

    /// A device tells that the cable of its port was pulled.
    pub(crate) fn pull(&mut self, port: PortId, absence: Duration) {
        self.pulled = Some((port, absence));
    }

    /// The port whose cable was pulled just now, and for how long.
    pub(crate) fn take_pulled(&mut self) -> Option<(PortId, Duration)> {
        self.pulled.take()
    }

    /// The faults of the device that are due when a request arrives.
    pub(crate) fn on_device(&mut self, port: PortId, unit: Option<u8>) -> Vec<DeviceFault> {
        self.due(port, unit, |kind| match kind {
            FaultKind::Device(fault) => Some(fault),
            _ => None,
        })
    }

    /// The faults of a request that are due when it arrives.
    pub(crate) fn on_request(&mut self, port: PortId, unit: Option<u8>) -> Vec<RequestFault> {
        self.due(port, unit, |kind| match kind {
            FaultKind::Request(fault) => Some(fault),
            _ => None,
        })
    }

    /// The faults of a reply that are due when it leaves.
    pub(crate) fn on_reply(&mut self, port: PortId, unit: Option<u8>) -> Vec<ReplyFault> {
        self.due(port, unit, |kind| match kind {
            FaultKind::Reply(fault) => Some(fault),
            _ => None,
        })
    }

    /// A random number below `bound`, for the details of a fault.
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        let bound = bound.max(1);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it is small")]
        let drawn = (self.stream.uniform() * bound as f64) as usize;
        drawn.min(bound - 1)
    }

    /// Counts one frame for the faults of one sort, and returns those that are due.
    fn due<T>(
        &mut self,
        port: PortId,
        unit: Option<u8>,
        sort: impl Fn(FaultKind) -> Option<T>,
    ) -> Vec<T> {
        let mut applied = Vec::new();
        let stream = &mut self.stream;
        self.waiting.retain_mut(|fault| {
            let is_for = fault.port == port && (fault.unit.is_none() || fault.unit == unit);
            let Some(kind) = sort(fault.kind).filter(|_| is_for) else { return true };
            let (is_due, is_kept) = match &mut fault.trigger {
                FaultTrigger::Nth(left) => {
                    *left = left.saturating_sub(1);
                    (*left == 0, *left > 0)
                }
                FaultTrigger::Next(left) => {
                    let is_due = *left > 0;
                    *left = left.saturating_sub(1);
                    (is_due, *left > 0)
                }
                FaultTrigger::Rate(rate) => (stream.uniform() < *rate, true),
            };
            if is_due {
                applied.push(kind);
            }
            is_kept
        });
        applied
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_due(trigger: FaultTrigger, frames: usize) -> Vec<bool> {
        let mut faults = FaultSchedule::new(Stream::new(1, 1));
        let kind = FaultKind::Reply(ReplyFault::Drop);
        faults.add(Fault { port: PortId::Bus, unit: Some(2), kind, trigger });
        (0..frames)
            .map(|_| {
                // Frames of another sort, another unit or another port do not count.
                assert!(faults.on_reply(PortId::Bus, Some(1)).is_empty());
                assert!(faults.on_reply(PortId::Analyzer, None).is_empty());
                assert!(faults.on_request(PortId::Bus, Some(2)).is_empty());
                !faults.on_reply(PortId::Bus, Some(2)).is_empty()
            })
            .collect()
    }

    #[test]
    fn a_fault_happens_at_its_frame_and_not_before_or_after() {
        assert_eq!(is_due(FaultTrigger::Nth(3), 5), [false, false, true, false, false]);
        assert_eq!(is_due(FaultTrigger::Nth(1), 2), [true, false]);
        assert_eq!(is_due(FaultTrigger::Next(2), 4), [true, true, false, false]);
    }

    #[test]
    fn a_rate_is_a_rate() {
        let applied = is_due(FaultTrigger::Rate(0.1), 10_000).into_iter().filter(|is| *is).count();
        assert!((900..1100).contains(&applied), "{applied}");
        assert!(!is_due(FaultTrigger::Rate(0.0), 100).contains(&true));
    }
}
