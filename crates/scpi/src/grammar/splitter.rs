//! Cuts a stream of bytes into program messages, with a bound on what waits.

use std::collections::VecDeque;

use crate::grammar::scan::{Boundary, Rules, Scanner, is_blank};

/// A message, or a lost message, of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SplitMessage {
    /// A whole message, without its terminator, was written to the buffer of the caller.
    Message,
    /// A message was longer than the room left for it, and is lost: −363.
    Overrun,
}

/// Incremental splitter: bytes go in by [`push`](Self::push), messages come out by
/// [`next_message`](Self::next_message).
///
/// A line feed inside a string or a block does not end a message. A message that is too long is
/// scanned for its end but not kept, so that memory never exceeds the limit.
#[derive(Debug, Clone)]
pub(crate) struct MessageSplitter {
    scanner: Scanner,
    rules: Rules,
    // The whole messages in `ready`, one behind the other, then the beginning of the next.
    buffer: VecDeque<u8>,
    ready: VecDeque<SplitState>,
    n_partial: usize,
    is_overrun: bool,
    limit_bytes: usize,
}

#[derive(Debug, Clone, Copy)]
enum SplitState {
    Message { n_bytes: usize },
    Overrun,
}

impl MessageSplitter {
    /// A splitter that holds at most `limit_bytes` of messages that were not taken yet.
    pub(crate) fn new(rules: Rules, limit_bytes: usize) -> Self {
        Self {
            scanner: Scanner::new(rules),
            rules,
            buffer: VecDeque::new(),
            ready: VecDeque::new(),
            n_partial: 0,
            is_overrun: false,
            limit_bytes,
        }
    }

    /// Number of further bytes that are accepted without loss. A host that cannot slow its peer
    /// down may ignore it, like the input buffer of a real instrument.
    pub(crate) fn room(&self) -> usize {
        self.limit_bytes - self.buffer.len()
    }

    /// Takes bytes in, cut anywhere.
    pub(crate) fn push(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let found = self.scanner.scan(bytes);
            let (head, tail) = bytes.split_at(found.map_or(bytes.len(), |(n_bytes, _)| n_bytes));
            bytes = tail;
            if let Some((n_bytes, Boundary::Message)) = found {
                self.keep(&head[..n_bytes - 1]);
                self.end();
            } else {
                self.keep(head);
            }
        }
    }

    /// The transport marks the end of the message (END of IEEE 488.1, or the end of a packet).
    pub(crate) fn end_of_message(&mut self) {
        self.scanner = Scanner::new(self.rules);
        self.end();
    }

    /// Discards all input, as a device clear does.
    pub(crate) fn clear(&mut self) {
        *self = Self::new(self.rules, self.limit_bytes);
    }

    /// Writes the next whole message over `message`. Blank messages are passed over.
    pub(crate) fn next_message(&mut self, message: &mut Vec<u8>) -> Option<SplitMessage> {
        match self.ready.pop_front()? {
            SplitState::Overrun => Some(SplitMessage::Overrun),
            SplitState::Message { n_bytes } => {
                message.clear();
                message.extend(self.buffer.drain(..n_bytes));
                Some(SplitMessage::Message)
            }
        }
    }

    fn keep(&mut self, bytes: &[u8]) {
        if self.is_overrun || self.room() < bytes.len() {
            self.buffer.truncate(self.buffer.len() - self.n_partial);
            self.n_partial = 0;
            self.is_overrun = true;
            return;
        }
        self.buffer.extend(bytes);
        self.n_partial += bytes.len();
    }

    fn end(&mut self) {
        if self.is_overrun {
            self.is_overrun = false;
            // Consecutive lost messages are one fault with one entry.
            if !matches!(self.ready.back(), Some(SplitState::Overrun)) {
                self.ready.push_back(SplitState::Overrun);
            }
            return;
        }
        let start = self.buffer.len() - self.n_partial;
        let is_empty = self.buffer.range(start..).all(|&byte| is_blank(byte) || byte == b'\n');
        if is_empty {
            self.buffer.truncate(start);
        } else {
            self.ready.push_back(SplitState::Message { n_bytes: self.n_partial });
        }
        self.n_partial = 0;
    }
}
