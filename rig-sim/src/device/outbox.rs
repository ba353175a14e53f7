//! What a device has said and when it will be on the wire.

use std::collections::VecDeque;

use rig_model::RigTime;

/// Bytes with the moment at which the last of them has arrived.
#[derive(Debug, Default)]
pub(crate) struct Outbox(VecDeque<(RigTime, Vec<u8>)>);

impl Outbox {
    /// Puts bytes behind those that are already under way.
    pub(crate) fn push(&mut self, due: RigTime, bytes: Vec<u8>) {
        let due = self.0.back().map_or(due, |last| last.0.max(due));
        self.0.push_back((due, bytes));
    }

    /// When the next bytes are due.
    pub(crate) fn deadline(&self) -> Option<RigTime> {
        self.0.front().map(|(due, _)| *due)
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
