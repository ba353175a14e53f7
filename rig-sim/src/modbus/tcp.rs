//! Frames on a network connection: transaction, protocol, length, unit, function, data.
//!
//! # Source
//! Modbus Messaging on TCP/IP Implementation Guide V1.0b, section 3.1.3.

use super::{Frame, Framing};

/// Transaction, protocol and length, before the unit.
pub(super) const HEADER: usize = 6;

/// The largest length that the specification allows: unit and the longest request.
const MAX_LENGTH: usize = 254;

/// Finds the frames of a master in a connection's stream.
#[derive(Debug, Default)]
pub struct TcpDecoder {
    buffer: Vec<u8>,
}

/// The stream is not Modbus; the connection has to be closed, since no later frame can be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a header with protocol {protocol} and length {length} is no Modbus")]
pub struct NotModbus {
    /// The protocol identifier, which has to be 0.
    pub protocol: u16,
    /// The length in the header; valid are 2 to 254.
    pub length: u16,
}

impl TcpDecoder {
    /// Appends received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The next frame, if one is complete.
    ///
    /// # Errors
    /// [`NotModbus`]; the bytes after it cannot be read.
    pub fn poll(&mut self) -> Result<Option<Frame>, NotModbus> {
        let Some((header, rest)) = self.buffer.split_first_chunk::<HEADER>() else {
            return Ok(None);
        };
        let word = |at: usize| u16::from_be_bytes([header[at], header[at + 1]]);
        let (transaction, protocol, length) = (word(0), word(2), word(4));
        let bytes = usize::from(length);
        if protocol != 0 || !(2..=MAX_LENGTH).contains(&bytes) {
            return Err(NotModbus { protocol, length });
        }
        if rest.len() < bytes {
            return Ok(None);
        }
        let (unit, whole) = (rest[0], &self.buffer[..HEADER + bytes]);
        let frame = Frame::new(unit, whole, HEADER + 1..whole.len(), Framing::Tcp { transaction });
        self.buffer.drain(..HEADER + bytes);
        Ok(Some(frame))
    }
}

/// The frame of an answer.
pub(super) fn frame(transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let length = u16::try_from(1 + pdu.len()).expect("an answer has at most 253 bytes");
    let mut bytes = Vec::with_capacity(HEADER + 1 + pdu.len());
    for word in [transaction, 0, length] {
        bytes.extend_from_slice(&word.to_be_bytes());
    }
    bytes.push(unit);
    bytes.extend_from_slice(pdu);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modbus::{Block, Reply, Request};

    /// The example of the implementation guide, section 3.1.3: read register 4 of unit 0xFF.
    const READ: [u8; 12] = [0x15, 0x01, 0, 0, 0, 6, 0xFF, 3, 0, 4, 0, 1];

    #[test]
    fn the_example_of_the_guide_is_read_and_answered_however_it_is_cut() {
        for cut in 0..READ.len() {
            let mut decoder = TcpDecoder::default();
            decoder.push(&READ[..cut]);
            assert_eq!(decoder.poll(), Ok(None));
            decoder.push(&READ[cut..]);
            let frame = decoder.poll().unwrap().unwrap();
            let block = Block { address: 4, count: 1 };
            assert_eq!(frame.request, Ok(Request::ReadHoldingRegisters(block)));
            let answer = frame.answer(0xFF, &Ok(Reply::Registers(vec![5])));
            assert_eq!(answer, [0x15, 0x01, 0, 0, 0, 5, 0xFF, 3, 2, 0, 5]);
        }
    }

    #[test]
    fn what_is_no_modbus_is_told_so() {
        let mut decoder = TcpDecoder::default();
        decoder.push(b"GET / HTTP/1.1");
        assert_eq!(decoder.poll(), Err(NotModbus { protocol: 0x5420, length: 0x2F20 }));
    }
}
