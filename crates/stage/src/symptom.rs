//! Classifies the bytes that arrived instead of an answer.

use std::fmt;

use crate::{Framing, Request};

/// A classification of the bytes that arrived instead of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symptom {
    /// No byte arrived before the deadline.
    Silence,
    /// Only the request itself, from an adapter that receives its own bytes.
    OnlyEcho,
    /// The beginning of an answer.
    Truncated,
    /// An answer with a wrong checksum.
    Corrupted,
    /// The answer of another unit.
    ForeignUnit(u8),
    /// A sound answer, but to another request.
    OtherAnswer,
    /// An answer to this request with another number of data.
    WrongCount {
        /// Bytes of data that it announces.
        found: u8,
        /// Number of requested bytes of data.
        expected: usize,
    },
    /// More than an answer.
    Surplus,
    /// Nothing that looks like an answer.
    Garbage,
}

impl fmt::Display for Symptom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silence => f.write_str("no answer"),
            Self::OnlyEcho => f.write_str("only an echo of the request"),
            Self::Truncated => f.write_str("the answer broke off"),
            Self::Corrupted => f.write_str("the checksum of the answer is wrong"),
            Self::ForeignUnit(unit) => write!(f, "unit {unit} answered"),
            Self::OtherAnswer => f.write_str("the answer belongs to another request"),
            Self::WrongCount { found, expected } => {
                write!(f, "the answer announces {found} bytes of data instead of {expected}")
            }
            Self::Surplus => f.write_str("more than one answer arrived"),
            Self::Garbage => f.write_str("the bytes are not a Modbus frame"),
        }
    }
}

impl Symptom {
    /// Reads it from the bytes that followed a request.
    pub(crate) fn of(
        framing: Framing,
        sent: &[u8],
        received: &[u8],
        unit: u8,
        request: &Request,
    ) -> Self {
        match framing {
            Framing::Rtu => Self::of_rtu(sent, received, unit, request),
            Framing::Tcp => Self::of_tcp(sent, received, unit, request),
        }
    }

    fn of_rtu(sent: &[u8], received: &[u8], unit: u8, request: &Request) -> Self {
        let (received, is_echo) = match received.strip_prefix(sent) {
            Some(rest) => (rest, true),
            None => (received, false),
        };
        if received.is_empty() {
            return if is_echo { Self::OnlyEcho } else { Self::Silence };
        }
        let function = received.get(1).copied().unwrap_or_default();
        let is_ours = received[0] == unit && function & 0x7F == sent[1];
        let length = if function & 0x80 == 0 { request.reply_wire_len() } else { 5 };
        let is_sound = |frame: &[u8]| crc(frame) == 0;
        let is_one = is_sound(received);
        if is_one || received.get(..length).is_some_and(is_sound) {
            return match received[0] {
                found if found != unit => Self::ForeignUnit(found),
                _ if is_one && is_ours => {
                    Self::wrong_count(&received[1..], request).unwrap_or(Self::OtherAnswer)
                }
                _ if is_one => Self::OtherAnswer,
                _ => Self::Surplus,
            };
        }
        match (is_ours, received.len() < length) {
            (true, true) => Self::Truncated,
            (true, false) => Self::Corrupted,
            (false, _) => Self::Garbage,
        }
    }

    /// Whether an answer from its function on announces a different number of data than requested.
    fn wrong_count(answer: &[u8], request: &Request) -> Option<Self> {
        let (expected, found) = (request.data_len()?, *answer.get(1)?);
        let is_refusal = answer[0] & 0x80 != 0;
        (!is_refusal && usize::from(found) != expected)
            .then_some(Self::WrongCount { found, expected })
    }

    /// Transaction, protocol and length of Modbus TCP precede the unit, two bytes each.
    fn of_tcp(sent: &[u8], received: &[u8], unit: u8, request: &Request) -> Self {
        match received {
            [] => Self::Silence,
            [_, _, 0, 0, high, low, rest @ ..] => {
                let length = usize::from(u16::from_be_bytes([*high, *low]));
                match rest.first() {
                    _ if rest.len() < length => Self::Truncated,
                    Some(found) if *found != unit => Self::ForeignUnit(*found),
                    Some(_) if sent.get(7) == rest.get(1) => {
                        Self::wrong_count(&rest[1..], request).unwrap_or(Self::OtherAnswer)
                    }
                    _ => Self::OtherAnswer,
                }
            }
            _ if received.len() < 6 => Self::Truncated,
            _ => Self::Garbage,
        }
    }
}

/// The checksum of Modbus RTU; zero over a frame that includes its own.
///
/// # Source
/// Modbus over Serial Line V1.02, appendix B.
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| {
            if crc & 1 == 1 { (crc >> 1) ^ 0xA001 } else { crc >> 1 }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// IAI's manual reads the alarm of axis 1 so, and is answered so.
    const REQUEST: &[u8] = &[0x01, 0x03, 0x90, 0x0E, 0x00, 0x02, 0x88, 0xC8];
    const REPLY: &[u8] = &[0x01, 0x03, 0x04, 0x00, 0x00, 0x00, 0x0B, 0xBB, 0xF4];

    #[test]
    fn the_checksum_is_that_of_the_frames_in_manuals() {
        assert_eq!((crc(REQUEST), crc(REPLY)), (0, 0));
        assert_ne!(crc(&REPLY[1..]), 0);
    }

    #[test]
    fn a_symptom_is_read_from_the_bytes() {
        let request = Request::ReadHolding { address: 0x900E, count: 2 };
        let longer = [1, 3, 6, 0, 0, 0, 0, 0, 0, 0x21, 0x75];
        let corrupted = [&REPLY[..4], &[0x40], &REPLY[5..]].concat();
        let foreign = [2, 3, 4, 0, 0, 0, 0x0B, 0x88, 0xF4];
        let rows: [(&[u8], Symptom); 11] = [
            (&[], Symptom::Silence),
            (REQUEST, Symptom::OnlyEcho),
            (&REPLY[..6], Symptom::Truncated),
            (&corrupted, Symptom::Corrupted),
            (&[REQUEST, &corrupted].concat(), Symptom::Corrupted),
            (&longer, Symptom::WrongCount { found: 6, expected: 4 }),
            (&[1, 3, 3, 0, 0, 0, 0x0B, 0x0E, 0x34], Symptom::WrongCount { found: 3, expected: 4 }),
            (&[1, 4, 4, 0, 0, 0, 0x0B, 0xBA, 0x43], Symptom::OtherAnswer),
            (&[REPLY, REPLY].concat(), Symptom::Surplus),
            (&foreign, Symptom::ForeignUnit(2)),
            (&[0xF8, 0x80, 0xFE], Symptom::Garbage),
        ];
        for (received, expected) in rows {
            let found = Symptom::of(Framing::Rtu, REQUEST, received, 1, &request);
            assert_eq!(found, expected, "{received:02X?}");
        }
        let asked = [0, 7, 0, 0, 0, 6, 1, 3, 0x90, 0x0E, 0, 2];
        let rows: [(&[u8], Symptom); 7] = [
            (&[], Symptom::Silence),
            (&[0, 7, 0, 0, 0, 5, 1, 3, 6, 0, 0], Symptom::WrongCount { found: 6, expected: 4 }),
            (&[0, 7, 0, 0, 0, 7, 1, 4, 4, 0, 0, 0, 0], Symptom::OtherAnswer),
            (&[0, 7, 0, 0, 0, 7, 1, 3], Symptom::Truncated),
            (&[0, 7, 0, 0, 0, 3, 2, 0x83, 2], Symptom::ForeignUnit(2)),
            (&[0, 6, 0, 0, 0, 3, 1, 0x83, 2], Symptom::OtherAnswer),
            (b"HTTP/1.1 400", Symptom::Garbage),
        ];
        for (received, expected) in rows {
            let found = Symptom::of(Framing::Tcp, &asked, received, 1, &request);
            assert_eq!(found, expected, "{received:02X?}");
        }
    }
}
