//! What the bytes tell that came in place of an answer.

use std::fmt;

use crate::{Framing, Request};

/// What came in place of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symptom {
    /// Nothing.
    Silence,
    /// Only the request itself, from an adapter that hears itself.
    OnlyEcho,
    /// The beginning of an answer.
    Truncated,
    /// An answer with a wrong checksum.
    Corrupted,
    /// The answer of another unit.
    ForeignUnit(u8),
    /// A sound answer, but to another request.
    OtherAnswer,
    /// More than an answer.
    Surplus,
    /// Nothing that looks like an answer.
    Garbage,
}

impl fmt::Display for Symptom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silence => f.write_str("no answer; is it powered, wired, and at this address?"),
            Self::OnlyEcho => f.write_str(
                "only the echo of the adapter; is the device powered, wired, and at this address?",
            ),
            Self::Truncated => f.write_str("the answer broke off"),
            Self::Corrupted => f.write_str("the checksum of the answer is wrong"),
            Self::ForeignUnit(unit) => {
                write!(f, "unit {unit} answered; is there a second master, or an address twice?")
            }
            Self::OtherAnswer => f.write_str("the answer belongs to another request"),
            Self::Surplus => f.write_str("more came than one answer; is there a second master?"),
            Self::Garbage => f.write_str("garbage came; do speed and parity match?"),
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
            Framing::Tcp => Self::of_tcp(received, unit),
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

    /// Transaction, protocol and length of Modbus TCP stand before the unit, two bytes each.
    fn of_tcp(received: &[u8], unit: u8) -> Self {
        match received {
            [] => Self::Silence,
            [_, _, 0, 0, high, low, rest @ ..] => {
                let length = usize::from(u16::from_be_bytes([*high, *low]));
                match rest.first() {
                    _ if rest.len() < length => Self::Truncated,
                    Some(found) if *found != unit => Self::ForeignUnit(*found),
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
        let rows: [(&[u8], Symptom); 9] = [
            (&[], Symptom::Silence),
            (REQUEST, Symptom::OnlyEcho),
            (&REPLY[..6], Symptom::Truncated),
            (&corrupted, Symptom::Corrupted),
            (&[REQUEST, &corrupted].concat(), Symptom::Corrupted),
            (&longer, Symptom::OtherAnswer),
            (&[REPLY, REPLY].concat(), Symptom::Surplus),
            (&foreign, Symptom::ForeignUnit(2)),
            (&[0xF8, 0x80, 0xFE], Symptom::Garbage),
        ];
        for (received, expected) in rows {
            let found = Symptom::of(Framing::Rtu, REQUEST, received, 1, &request);
            assert_eq!(found, expected, "{received:02X?}");
        }
        let rows: [(&[u8], Symptom); 5] = [
            (&[], Symptom::Silence),
            (&[0, 7, 0, 0, 0, 7, 1, 3], Symptom::Truncated),
            (&[0, 7, 0, 0, 0, 3, 2, 0x83, 2], Symptom::ForeignUnit(2)),
            (&[0, 6, 0, 0, 0, 3, 1, 0x83, 2], Symptom::OtherAnswer),
            (b"HTTP/1.1 400", Symptom::Garbage),
        ];
        for (received, expected) in rows {
            let found = Symptom::of(Framing::Tcp, &[], received, 1, &request);
            assert_eq!(found, expected, "{received:02X?}");
        }
    }
}
