//! The output of a device, with the time of each answer on the wire.

use std::collections::VecDeque;

use rig_model::RigTime;

/// Bytes with the moment at which the last of them has arrived, in the order of arrival.
#[derive(Debug, Default)]
pub(crate) struct OutputQueue(VecDeque<(RigTime, Vec<u8>)>);

impl OutputQueue {
    /// Queues bytes. Bytes that are due earlier overtake later ones: the devices of a line do not
    /// wait for each other.
    pub(crate) fn push(&mut self, due: RigTime, bytes: Vec<u8>) {
        let at = self.0.partition_point(|(earlier, _)| *earlier <= due);
        self.0.insert(at, (due, bytes));
    }

    /// When the next bytes are due.
    pub(crate) fn deadline(&self) -> Option<RigTime> {
        self.0.front().map(|(due, _)| *due)
    }

    /// When the last bytes are due.
    pub(crate) fn last_due(&self) -> Option<RigTime> {
        self.0.back().map(|(due, _)| *due)
    }

    /// The bytes that have arrived by `now`.
    pub(crate) fn poll(&mut self, now: RigTime) -> Vec<u8> {
        let mut arrived = Vec::new();
        while self.deadline().is_some_and(|due| due <= now) {
            arrived.extend(self.0.pop_front().into_iter().flat_map(|(_, bytes)| bytes));
        }
        arrived
    }
}
