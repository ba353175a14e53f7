//! The fault menu: what goes wrong on the wire and in the devices, and when.
//!
//! A fault waits for its frame. Faults of requests and of devices count the requests that arrive,
//! faults of replies count the replies that leave; each may be for one unit of a line only.

use std::time::Duration;

use rig_model::random::Stream;

use crate::{wiring::PortId, world::World};

/// A fault that is going to happen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// The port at which it happens.
    pub port: PortId,
    /// The only unit of the line that it is for; all of them if none.
    pub unit: Option<u8>,
    /// What happens.
    pub kind: FaultKind,
    /// When.
    pub when: When,
}

/// When a fault happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum When {
    /// Once, at the n-th frame from now. The next one is the first.
    Nth(u64),
    /// At so many frames from now on.
    Next(u64),
    /// At each frame with this probability, for ever.
    Rate(f64),
}

/// What happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// To a request.
    Request(RequestFault),
    /// In the device, when a request arrives.
    Device(DeviceFault),
    /// To a reply.
    Reply(ReplyFault),
}

/// What happens to a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequestFault {
    /// It is lost.
    Drop,
    /// It is refused with this Modbus exception and not carried out: 6 is busy.
    Exception(u8),
    /// The connection breaks before it is carried out.
    Disconnect,
}

/// What happens to a reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReplyFault {
    /// It is lost. What it answers was done.
    Drop,
    /// It comes later by this much.
    Delay(Duration),
    /// It comes twice.
    Duplicate,
    /// One bit of it is wrong.
    Corrupt,
    /// It ends early.
    Truncate,
    /// So many random bytes come before it.
    Noise(usize),
    /// The request comes back before it, as from an adapter that hears itself.
    Echo,
    /// It says that it comes from this unit.
    Unit(u8),
    /// The connection breaks instead of it. What it answers was done.
    Disconnect,
}

/// What happens in a device.
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
    /// A limit switch says that it was reached.
    LimitSwitch,
    /// The input of the analyzer is overloaded at the next measurement.
    Overload,
    /// The impedance is that of a free sensor, whatever the probe touches.
    BlindContact,
    /// The impedance is that of a sensor in contact, also when it is clear.
    StuckContact,
}

/// What devices are up against: the world, and the faults that wait for them.
#[derive(Debug)]
pub(crate) struct Fate<'a> {
    pub(crate) world: &'a mut World,
    pub(crate) faults: &'a mut Faults,
}

/// The faults that are waiting.
#[derive(Debug)]
pub(crate) struct Faults {
    waiting: Vec<Fault>,
    stream: Stream,
}

impl Faults {
    pub(crate) fn new(stream: Stream) -> Self {
        Self { waiting: Vec::new(), stream }
    }

    pub(crate) fn add(&mut self, fault: Fault) {
        self.waiting.push(fault);
    }

    pub(crate) fn clear(&mut self) {
        self.waiting.clear();
    }

    /// What happens in the device when a request arrives.
    pub(crate) fn on_device(&mut self, port: PortId, unit: Option<u8>) -> Vec<DeviceFault> {
        self.strike(port, unit, |kind| match kind {
            FaultKind::Device(fault) => Some(fault),
            _ => None,
        })
    }

    /// What happens to a request that arrives.
    pub(crate) fn on_request(&mut self, port: PortId, unit: Option<u8>) -> Vec<RequestFault> {
        self.strike(port, unit, |kind| match kind {
            FaultKind::Request(fault) => Some(fault),
            _ => None,
        })
    }

    /// What happens to a reply that leaves.
    pub(crate) fn on_reply(&mut self, port: PortId, unit: Option<u8>) -> Vec<ReplyFault> {
        self.strike(port, unit, |kind| match kind {
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

    /// Lets one frame pass the faults of one sort, and returns those whose time has come.
    fn strike<T>(
        &mut self,
        port: PortId,
        unit: Option<u8>,
        sort: impl Fn(FaultKind) -> Option<T>,
    ) -> Vec<T> {
        let mut struck = Vec::new();
        let stream = &mut self.stream;
        self.waiting.retain_mut(|fault| {
            let is_for = fault.port == port && (fault.unit.is_none() || fault.unit == unit);
            let Some(kind) = sort(fault.kind).filter(|_| is_for) else { return true };
            let (is_struck, is_kept) = match &mut fault.when {
                When::Nth(left) => {
                    *left = left.saturating_sub(1);
                    (*left == 0, *left > 0)
                }
                When::Next(left) => {
                    let is_struck = *left > 0;
                    *left = left.saturating_sub(1);
                    (is_struck, *left > 0)
                }
                When::Rate(rate) => (stream.uniform() < *rate, true),
            };
            if is_struck {
                struck.push(kind);
            }
            is_kept
        });
        struck
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strikes(when: When, frames: usize) -> Vec<bool> {
        let mut faults = Faults::new(Stream::new(1, 1));
        let kind = FaultKind::Reply(ReplyFault::Drop);
        faults.add(Fault { port: PortId::Bus, unit: Some(2), kind, when });
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
        assert_eq!(strikes(When::Nth(3), 5), [false, false, true, false, false]);
        assert_eq!(strikes(When::Nth(1), 2), [true, false]);
        assert_eq!(strikes(When::Next(2), 4), [true, true, false, false]);
    }

    #[test]
    fn a_rate_is_a_rate() {
        let struck = strikes(When::Rate(0.1), 10_000).into_iter().filter(|is| *is).count();
        assert!((900..1100).contains(&struck), "{struck}");
        assert!(!strikes(When::Rate(0.0), 100).contains(&true));
    }
}
