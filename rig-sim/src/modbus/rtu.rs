//! Frames on a serial line: unit, function, data, checksum, and silence around them.
//!
//! # Source
//! Modbus over Serial Line Specification V1.02, sections 2.5.1 and 6.2.2.

use std::time::Duration;

use rig_model::RigTime;

use super::{Frame, Framing, pdu::Length};

/// The longest frame that the specification allows.
const MAX_FRAME: usize = 256;

/// Finds the frames of a master on a serial line.
///
/// The specification ends a frame by silence. An operating system delivers bytes in groups with
/// pauses of its own. A frame of known length with a right checksum is therefore accepted at once;
/// silence ends the others. Other bytes are discarded at the next silence.
#[derive(Debug)]
pub struct RtuDecoder {
    buffer: Vec<u8>,
    silence: Duration,
    last_byte: RigTime,
}

impl RtuDecoder {
    /// A decoder for a line on which this silence ends a frame.
    pub fn new(silence: Duration) -> Self {
        Self { buffer: Vec::new(), silence, last_byte: RigTime::ZERO }
    }

    /// Accepts bytes that arrived at `now`.
    pub fn push(&mut self, now: RigTime, bytes: &[u8]) {
        if self.deadline().is_some_and(|deadline| deadline <= now) {
            // The silence has ended the frame before the poll.
            self.buffer.clear();
        }
        self.buffer.extend_from_slice(bytes);
        self.last_byte = now;
    }

    /// The time at which silence ends the present frame.
    pub fn deadline(&self) -> Option<RigTime> {
        (!self.buffer.is_empty()).then(|| self.last_byte + self.silence)
    }

    /// The next frame, if one is complete at `now`.
    pub fn poll(&mut self, now: RigTime) -> Option<Frame> {
        if let Length::Known(pdu) = Length::of(self.buffer.get(1..).unwrap_or_default()) {
            let length = 1 + pdu + 2;
            if let Some(frame) = self.buffer.get(..length).and_then(parse) {
                self.buffer.drain(..length);
                return Some(frame);
            }
        }
        if self.deadline().is_some_and(|deadline| deadline <= now) {
            let lump = std::mem::take(&mut self.buffer);
            return if lump.len() <= MAX_FRAME { parse(&lump) } else { None };
        }
        None
    }
}

/// A frame from exactly these bytes, when their checksum is right.
fn parse(bytes: &[u8]) -> Option<Frame> {
    let (body, sum) = bytes.split_last_chunk::<2>()?;
    (body.len() >= 2 && checksum(body) == u16::from_le_bytes(*sum))
        .then(|| Frame::new(body[0], bytes, 1..body.len(), Framing::Rtu))
}

/// The frame of an answer.
pub(super) fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut bytes = vec![unit];
    bytes.extend_from_slice(pdu);
    let sum = checksum(&bytes);
    bytes.extend_from_slice(&sum.to_le_bytes());
    bytes
}

/// CRC-16 with the reflected polynomial 0xA001 and the initial value 0xFFFF.
fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |sum, byte| {
        (0..8).fold(
            sum ^ u16::from(*byte),
            |sum, _| {
                if sum & 1 == 1 { sum >> 1 ^ 0xA001 } else { sum >> 1 }
            },
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modbus::{Block, Exception, Reply, Request};

    const SILENCE: Duration = Duration::from_micros(1750);

    fn at(micros: u64) -> RigTime {
        RigTime::from_micros(micros)
    }

    fn hex(text: &str) -> Vec<u8> {
        text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    }

    /// Frames with known checksums: a move of an AZ drive and what IAI's Modbus manual prints.
    fn frozen() -> Vec<(Vec<u8>, Request)> {
        let read = |address, count| Request::ReadHoldingRegisters(Block { address, count });
        vec![
            (
                hex("01 10 00 58 00 10 20 00 00 00 00 00 00 00 01 FF FE BA 7B 00 00 B6 4B \
                     00 0F 42 40 00 0F 42 40 00 00 03 E8 00 00 00 01 48 03"),
                Request::WriteRegisters {
                    address: 0x0058,
                    values: vec![
                        0, 0, 0, 1, 0xFFFE, 0xBA7B, 0, 0xB64B, 0x000F, 0x4240, 0x000F, 0x4240, 0,
                        1000, 0, 1,
                    ],
                },
            ),
            (hex("01 06 0D 03 00 01 BA A6"), Request::WriteRegister { address: 0x0D03, value: 1 }),
            (
                hex("01 06 0D 00 10 08 87 60"),
                Request::WriteRegister { address: 0x0D00, value: 0x1008 },
            ),
            (hex("01 05 04 26 FF 00 6C C1"), Request::WriteCoil { address: 0x0426, value: true }),
            (hex("01 03 90 0E 00 02 88 C8"), read(0x900E, 2)),
        ]
    }

    #[test]
    fn frozen_frames_are_read_however_they_are_cut() {
        for (bytes, request) in frozen() {
            for cut in 0..=bytes.len() {
                let mut decoder = RtuDecoder::new(SILENCE);
                decoder.push(at(0), &bytes[..cut]);
                if cut < bytes.len() {
                    assert_eq!(decoder.poll(at(500)), None, "cut at {cut}");
                    decoder.push(at(700), &bytes[cut..]);
                }
                let frame = decoder.poll(at(700)).expect("the frame is complete");
                assert_eq!((frame.unit, &frame.request), (1, &Ok(request.clone())));
                assert_eq!(decoder.deadline(), None);
            }
        }
    }

    #[test]
    fn the_frozen_answer_is_written() {
        let (request, _) = frozen().pop().unwrap();
        let mut decoder = RtuDecoder::new(SILENCE);
        decoder.push(at(0), &request);
        let frame = decoder.poll(at(0)).unwrap();
        let answer = frame.answer(1, &Ok(Reply::Registers(vec![0, 0x000B])));
        assert_eq!(answer, hex("01 03 04 00 00 00 0B BB F4"));
        assert_eq!(frame.exception(1, 6), frame.answer(1, &Err(Exception::Busy)));
    }

    #[test]
    fn damage_is_thrown_away_at_the_next_silence_and_the_frame_after_it_is_read() {
        for (bytes, request) in frozen() {
            for damaged in 0..bytes.len() {
                let mut noise = bytes.clone();
                noise[damaged] ^= 0x10;
                for junk in [noise, bytes[..damaged].to_vec(), vec![0; 300]] {
                    let mut decoder = RtuDecoder::new(SILENCE);
                    decoder.push(at(0), &junk);
                    let early = decoder.poll(at(100));
                    assert!(early.is_none(), "byte {damaged}: {early:?}");
                    let late = decoder.poll(at(1750));
                    assert!(late.is_none(), "byte {damaged}: {late:?}");
                    decoder.push(at(4000), &bytes);
                    assert_eq!(decoder.poll(at(4000)).unwrap().request, Ok(request.clone()));
                }
            }
        }
    }

    #[test]
    fn a_silence_that_nobody_noticed_still_separates() {
        let (bytes, request) = frozen().pop().unwrap();
        let mut decoder = RtuDecoder::new(SILENCE);
        decoder.push(at(0), &bytes[..3]);
        decoder.push(at(1750), &bytes);
        assert_eq!(decoder.poll(at(1750)).unwrap().request, Ok(request));
    }

    #[test]
    fn an_unknown_function_is_refused_after_the_silence() {
        let mut decoder = RtuDecoder::new(SILENCE);
        decoder.push(at(0), &frame(1, &[0x41, 1, 2, 3]));
        assert_eq!(decoder.poll(at(100)), None);
        assert_eq!(decoder.deadline(), Some(at(1750)));
        let refused = decoder.poll(at(1750)).unwrap();
        assert_eq!(refused.request, Err(Exception::Function));
        assert_eq!(refused.answer(1, &Err(Exception::Function)), frame(1, &[0xC1, 1]));
    }

    #[test]
    fn two_frames_in_one_lump_are_both_read() {
        let (bytes, request) = frozen().pop().unwrap();
        let mut decoder = RtuDecoder::new(SILENCE);
        decoder.push(at(0), &[bytes.clone(), bytes].concat());
        assert_eq!(decoder.poll(at(0)).unwrap().request, Ok(request.clone()));
        assert_eq!(decoder.poll(at(0)).unwrap().request, Ok(request));
        assert_eq!(decoder.poll(at(0)), None);
    }
}
