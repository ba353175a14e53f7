//! The black box of a port.

use std::{
    collections::VecDeque,
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use rig_model::RigTime;

/// Direction of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// From the host to the device.
    Sent,
    /// From the device to the host, during the wait for an answer.
    Received,
    /// From the device to the host, without a query. The bytes were discarded.
    Discarded,
}

/// Bytes that went one way without a pause in the exchange.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// When the first byte went.
    pub at: RigTime,
    /// Direction of the bytes.
    pub flow: Flow,
    /// Bytes on the wire.
    pub bytes: Vec<u8>,
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let arrow = match self.flow {
            Flow::Sent => "->",
            Flow::Received => "<-",
            Flow::Discarded => "<x",
        };
        write!(f, "{} {arrow} {}", self.at, self.bytes.escape_ascii())
    }
}

/// The last frames of a port. Clones show the same frames, so that the daemon can keep one and
/// write it down after a fault, also when the port has another owner by then.
#[derive(Debug, Clone)]
pub struct Transcript {
    ring: Arc<Mutex<Ring>>,
}

#[derive(Debug)]
struct Ring {
    frames: VecDeque<Frame>,
    capacity: usize,
    /// Set when the next bytes begin a new frame even if they go the same way.
    is_cut: bool,
}

/// A frame longer than this is continued in a new one, so that a chattering line cannot fill the
/// memory.
const FRAME_BYTES_MAX: usize = 1024;

impl Transcript {
    /// Keeps the last `capacity` frames.
    pub fn new(capacity: usize) -> Self {
        let ring = Ring { frames: VecDeque::with_capacity(capacity), capacity, is_cut: true };
        Self { ring: Arc::new(Mutex::new(ring)) }
    }

    /// Changes the number of frames that are kept to `capacity`. The newest ones stay.
    pub fn keep(&self, capacity: usize) {
        let mut ring = self.lock();
        ring.capacity = capacity.max(1);
        while ring.frames.len() > ring.capacity {
            ring.frames.pop_front();
        }
    }

    /// The frames kept, oldest first.
    pub fn frames(&self) -> Vec<Frame> {
        self.lock().frames.iter().cloned().collect()
    }

    /// The next bytes belong to another exchange.
    pub(crate) fn cut(&self) {
        self.lock().is_cut = true;
    }

    pub(crate) fn record(&self, at: RigTime, flow: Flow, bytes: &[u8]) {
        let mut ring = self.lock();
        let is_new = ring.is_cut;
        ring.is_cut = false;
        if let Some(last) = ring.frames.back_mut()
            && !is_new
            && last.flow == flow
            && last.bytes.len() + bytes.len() <= FRAME_BYTES_MAX
        {
            last.bytes.extend_from_slice(bytes);
            return;
        }
        // The oldest frame lends its memory to the newest.
        let mut memory = if ring.frames.len() < ring.capacity {
            Vec::new()
        } else {
            ring.frames.pop_front().map(|frame| frame.bytes).unwrap_or_default()
        };
        memory.clear();
        memory.extend_from_slice(bytes);
        ring.frames.push_back(Frame { at, flow, bytes: memory });
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Ring> {
        // Every change is complete before the lock is released, also when a panic releases it.
        self.ring.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_of_a_frame_are_joined_and_only_the_last_frames_are_kept() {
        let transcript = Transcript::new(2);
        transcript.record(RigTime::from_micros(1), Flow::Sent, b"*IDN?\r\n");
        transcript.record(RigTime::from_micros(2), Flow::Received, b"HIO");
        transcript.record(RigTime::from_micros(3), Flow::Received, b"KI\r\n");
        transcript.cut();
        transcript.record(RigTime::from_micros(4), Flow::Received, &[0xFF]);
        let frames: Vec<String> = transcript.frames().iter().map(ToString::to_string).collect();
        assert_eq!(frames, ["0.000002 s <- HIOKI\\r\\n", "0.000004 s <- \\xff"]);
        transcript.keep(3);
        transcript.cut();
        transcript.record(RigTime::from_micros(5), Flow::Sent, b"a");
        assert_eq!(transcript.frames().len(), 3);
        transcript.keep(1);
        assert_eq!(transcript.frames()[0].bytes, b"a");
    }
}
