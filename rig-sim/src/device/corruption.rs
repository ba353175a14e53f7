//! Applies faults to a reply on its way.

use std::time::Duration;

use rig_model::RigTime;

use super::output_queue::OutputQueue;
use crate::{
    faults::{FaultSchedule, ReplyFault},
    wiring::HangUp,
};

/// A reply that is about to leave.
#[derive(Debug)]
pub(super) struct Reply<'a> {
    /// When it will have arrived.
    pub(super) due: RigTime,
    /// Request of the reply.
    pub(super) request: &'a [u8],
    /// Bytes of the reply.
    pub(super) bytes: Vec<u8>,
}

/// Sends a reply as these faults leave it. `readdress` makes the same reply from another unit.
///
/// # Errors
/// [`HangUp`] when the connection breaks.
pub(super) fn send(
    reply: Reply<'_>,
    applied: &[ReplyFault],
    readdress: impl Fn(u8) -> Option<Vec<u8>>,
    faults: &mut FaultSchedule,
    output: &mut OutputQueue,
) -> Result<(), HangUp> {
    let Reply { due, request, mut bytes } = reply;
    let (mut before, mut copies, mut delay) = (Vec::new(), 1, Duration::ZERO);
    for fault in applied {
        match *fault {
            ReplyFault::Drop => copies = 0,
            ReplyFault::Delay(longer) => delay += longer,
            ReplyFault::Duplicate => copies *= 2,
            ReplyFault::Corrupt if !bytes.is_empty() => {
                let at = faults.below(bytes.len());
                bytes[at] ^= 1 << faults.below(8);
            }
            ReplyFault::Truncate => bytes.truncate(faults.below(bytes.len())),
            ReplyFault::Noise(count) => {
                before.extend((0..count).map(|_| u8::try_from(faults.below(256)).unwrap_or(0)));
            }
            ReplyFault::Echo => before.extend_from_slice(request),
            ReplyFault::Unit(unit) => bytes = readdress(unit).unwrap_or(bytes),
            ReplyFault::Disconnect => return Err(HangUp),
            ReplyFault::Corrupt => {}
        }
    }
    if copies == 0 && before.is_empty() {
        return Ok(());
    }
    let mut sent = before;
    for _ in 0..copies {
        sent.extend_from_slice(&bytes);
    }
    output.push(due + delay, sent);
    Ok(())
}
