//! The server side of Modbus, without I/O.
//!
//! It is written for the simulator alone and shares nothing with the library that the drivers use,
//! so that a driver is never tested against its own idea of the protocol. A unit sees requests and
//! gives answers; framing, checksums, broadcasts and foreign units are dealt with here.

mod pdu;
mod rtu;
mod tcp;

use std::ops::Range;

pub use pdu::{Block, Exception, Reply, Request};
pub use rtu::RtuDecoder;
pub use tcp::{NotModbus, TcpDecoder};

/// The reaction of a unit to a request: an answer, an exception, or none, as from drives that
/// ignore a command.
pub type Answer = Option<Result<Reply, Exception>>;

/// A whole frame from a master, whose checksum or header is right.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// The addressed unit; 0 is a broadcast on a serial line.
    pub unit: u8,
    /// The request, or why a unit has to refuse it.
    pub request: Result<Request, Exception>,
    bytes: Vec<u8>,
    /// Range of function code and data in the bytes.
    pdu: Range<usize>,
    framing: Framing,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Framing {
    Rtu,
    Tcp { transaction: u16 },
}

impl Frame {
    fn new(unit: u8, bytes: &[u8], pdu: Range<usize>, framing: Framing) -> Self {
        let request = Request::parse(&bytes[pdu.clone()]);
        Self { unit, request, bytes: bytes.to_vec(), pdu, framing }
    }

    fn pdu(&self) -> &[u8] {
        &self.bytes[self.pdu.clone()]
    }

    /// The function code.
    pub fn function(&self) -> u8 {
        self.pdu()[0]
    }

    /// The bytes of the frame.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// An answer to this frame as if another unit gave it.
    pub(crate) fn readdressed(&self, answer: &[u8], unit: u8) -> Vec<u8> {
        match self.framing {
            Framing::Rtu => rtu::frame(unit, &answer[1..answer.len() - 2]),
            Framing::Tcp { transaction } => {
                tcp::frame(transaction, unit, &answer[tcp::HEADER + 1..])
            }
        }
    }

    /// The bytes of an answer to this frame from `unit`.
    pub fn answer(&self, unit: u8, answer: &Result<Reply, Exception>) -> Vec<u8> {
        let pdu = pdu::encode(self.pdu(), answer);
        match self.framing {
            Framing::Rtu => rtu::frame(unit, &pdu),
            Framing::Tcp { transaction } => tcp::frame(transaction, unit, &pdu),
        }
    }

    /// The bytes of an answer with any exception code, also one that does not exist.
    pub fn exception(&self, unit: u8, code: u8) -> Vec<u8> {
        let pdu = [self.function() | 0x80, code];
        match self.framing {
            Framing::Rtu => rtu::frame(unit, &pdu),
            Framing::Tcp { transaction } => tcp::frame(transaction, unit, &pdu),
        }
    }
}

/// A serial frame from its unit, function and data.
#[cfg(test)]
pub(crate) fn with_checksum(frame: &[u8]) -> Vec<u8> {
    rtu::frame(frame[0], &frame[1..])
}
