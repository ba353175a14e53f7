//! Modbus requests and replies without their framing.
//!
//! # Source
//! Modbus Application Protocol Specification V1.1b3, chapter 6.

/// A request of a master.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// Function 1.
    ReadCoils(Block),
    /// Function 2.
    ReadDiscreteInputs(Block),
    /// Function 3.
    ReadHoldingRegisters(Block),
    /// Function 4.
    ReadInputRegisters(Block),
    /// Function 5.
    WriteCoil {
        /// Address of the coil.
        address: u16,
        /// Whether it is to be on.
        value: bool,
    },
    /// Function 6.
    WriteRegister {
        /// Address of the register.
        address: u16,
        /// The new value.
        value: u16,
    },
    /// Function 8, which echoes for sub-function 0.
    Diagnose {
        /// Number of the diagnostic sub-function.
        function: u16,
        /// Data of the request behind the function.
        data: u16,
    },
    /// Function 15.
    WriteCoils {
        /// Address of the first coil.
        address: u16,
        /// The new values.
        values: Vec<bool>,
    },
    /// Function 16.
    WriteRegisters {
        /// Address of the first register.
        address: u16,
        /// The new values.
        values: Vec<u16>,
    },
    /// Function 22.
    MaskRegister {
        /// Address of the register.
        address: u16,
        /// Bits to keep.
        and: u16,
        /// Bits to set where not kept.
        or: u16,
    },
    /// Function 23: the write comes first.
    ReadWrite {
        /// The block to read.
        read: Block,
        /// Address of the first register to write.
        address: u16,
        /// The new values.
        values: Vec<u16>,
    },
}

/// A run of coils or registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    /// Address of the first.
    pub address: u16,
    /// Number of addresses.
    pub count: u16,
}

/// Why a request was not done. The code that goes over the wire is its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exception {
    /// The function is not supported.
    Function = 1,
    /// There is nothing at this address.
    Address = 2,
    /// The value or the count is not allowed.
    Value = 3,
    /// The device could not do it.
    Failure = 4,
    /// The device is at it, and it will take long.
    Acknowledge = 5,
    /// The device is busy and did not do it.
    Busy = 6,
}

/// The answer of a unit to a request that it carried out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reply {
    /// Coils or discrete inputs.
    Bits(Vec<bool>),
    /// Values of the registers read.
    Registers(Vec<u16>),
    /// A write was done.
    Done,
}

/// Most coils that one request may read.
const MAX_BITS: u16 = 2000;
/// Most registers that one request may read.
const MAX_REGISTERS: u16 = 125;
/// Most coils that one request may write.
const MAX_WRITTEN_BITS: u16 = 1968;
/// Most registers that one request may write.
const MAX_WRITTEN_REGISTERS: u16 = 123;
/// Most registers that a combined request may write.
const MAX_COMBINED_REGISTERS: u16 = 121;

/// Length of the request that begins with these bytes, function code first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Length {
    /// This many bytes.
    Known(usize),
    /// That cannot be said yet.
    NeedsMore,
    /// That can never be said: the function is unknown.
    Unknown,
}

impl Length {
    pub(super) fn of(pdu: &[u8]) -> Self {
        // Position of the byte count.
        let counted = |at: usize| {
            pdu.get(at).map_or(Self::NeedsMore, |&count| Self::Known(at + 1 + usize::from(count)))
        };
        match pdu.first() {
            None => Self::NeedsMore,
            Some(1..=6 | 8) => Self::Known(5),
            Some(15 | 16) => counted(5),
            Some(22) => Self::Known(7),
            Some(23) => counted(9),
            Some(_) => Self::Unknown,
        }
    }
}

impl Request {
    /// Reads a request, function code first.
    ///
    /// # Errors
    /// The exception with which a unit answers a request that makes no sense.
    pub(super) fn parse(pdu: &[u8]) -> Result<Self, Exception> {
        match Length::of(pdu) {
            Length::Unknown => return Err(Exception::Function),
            Length::Known(length) if length == pdu.len() => {}
            Length::Known(_) | Length::NeedsMore => return Err(Exception::Value),
        }
        let word = |at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        let block = |at: usize, most: u16| {
            let block = Block { address: word(at), count: word(at + 2) };
            if (1..=most).contains(&block.count) { Ok(block) } else { Err(Exception::Value) }
        };
        // The byte count was used to find the end, so that it only has to agree with the count.
        let words = |count_at: usize, most: u16| {
            let (count, bytes) = (word(count_at), &pdu[count_at + 3..]);
            if (1..=most).contains(&count) && bytes.len() == 2 * usize::from(count) {
                let pairs = bytes.chunks_exact(2);
                Ok(pairs.map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect())
            } else {
                Err(Exception::Value)
            }
        };
        match pdu[0] {
            1 => Ok(Self::ReadCoils(block(1, MAX_BITS)?)),
            2 => Ok(Self::ReadDiscreteInputs(block(1, MAX_BITS)?)),
            3 => Ok(Self::ReadHoldingRegisters(block(1, MAX_REGISTERS)?)),
            4 => Ok(Self::ReadInputRegisters(block(1, MAX_REGISTERS)?)),
            5 => match word(3) {
                0xFF00 => Ok(Self::WriteCoil { address: word(1), value: true }),
                0x0000 => Ok(Self::WriteCoil { address: word(1), value: false }),
                _ => Err(Exception::Value),
            },
            6 => Ok(Self::WriteRegister { address: word(1), value: word(3) }),
            8 => Ok(Self::Diagnose { function: word(1), data: word(3) }),
            15 => Ok(Self::WriteCoils { address: word(1), values: bits(&pdu[3..])? }),
            16 => {
                let values = words(3, MAX_WRITTEN_REGISTERS)?;
                Ok(Self::WriteRegisters { address: word(1), values })
            }
            22 => Ok(Self::MaskRegister { address: word(1), and: word(3), or: word(5) }),
            23 => {
                let read = block(1, MAX_REGISTERS)?;
                let values = words(7, MAX_COMBINED_REGISTERS)?;
                Ok(Self::ReadWrite { read, address: word(5), values })
            }
            _ => Err(Exception::Function),
        }
    }
}

/// The values of function 15: count, byte count, bytes.
fn bits(pdu: &[u8]) -> Result<Vec<bool>, Exception> {
    let count = u16::from_be_bytes([pdu[0], pdu[1]]);
    let bytes = &pdu[3..];
    if !(1..=MAX_WRITTEN_BITS).contains(&count) || bytes.len() != usize::from(count).div_ceil(8) {
        return Err(Exception::Value);
    }
    Ok((0..usize::from(count)).map(|i| bytes[i / 8] >> (i % 8) & 1 == 1).collect())
}

/// The answer to `request` as it goes over the wire, function code first.
pub(super) fn encode(request: &[u8], answer: &Result<Reply, Exception>) -> Vec<u8> {
    let function = request[0];
    match answer {
        Err(exception) => vec![function | 0x80, *exception as u8],
        // A write is confirmed by its own beginning; a mask and a diagnosis by all of it.
        Ok(Reply::Done) if function == 22 => request[..7].to_vec(),
        Ok(Reply::Done) => request[..5].to_vec(),
        Ok(Reply::Registers(registers)) => {
            let bytes: Vec<u8> = registers.iter().flat_map(|word| word.to_be_bytes()).collect();
            counted(function, &bytes)
        }
        Ok(Reply::Bits(bits)) => {
            let mut bytes = vec![0_u8; bits.len().div_ceil(8)];
            for (i, bit) in bits.iter().enumerate() {
                bytes[i / 8] |= u8::from(*bit) << (i % 8);
            }
            counted(function, &bytes)
        }
    }
}

fn counted(function: u8, bytes: &[u8]) -> Vec<u8> {
    let count = u8::try_from(bytes.len()).expect("a request asks for at most 250 bytes");
    let mut pdu = vec![function, count];
    pdu.extend_from_slice(bytes);
    pdu
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_examples_of_the_specification_are_read() {
        // Chapter 6 of the specification, the request of every example.
        let block = |address, count| Block { address, count };
        let rows: [(&[u8], Request); 11] = [
            (&[1, 0x00, 0x13, 0x00, 0x13], Request::ReadCoils(block(0x13, 19))),
            (&[2, 0x00, 0xC4, 0x00, 0x16], Request::ReadDiscreteInputs(block(0xC4, 22))),
            (&[3, 0x00, 0x6B, 0x00, 0x03], Request::ReadHoldingRegisters(block(0x6B, 3))),
            (&[4, 0x00, 0x08, 0x00, 0x01], Request::ReadInputRegisters(block(8, 1))),
            (&[5, 0x00, 0xAC, 0xFF, 0x00], Request::WriteCoil { address: 0xAC, value: true }),
            (&[6, 0x00, 0x01, 0x00, 0x03], Request::WriteRegister { address: 1, value: 3 }),
            (&[8, 0x00, 0x00, 0xA5, 0x37], Request::Diagnose { function: 0, data: 0xA537 }),
            (
                &[15, 0x00, 0x13, 0x00, 0x0A, 0x02, 0xCD, 0x01],
                Request::WriteCoils {
                    address: 0x13,
                    values: [1, 0, 1, 1, 0, 0, 1, 1, 1, 0].map(|bit| bit == 1).to_vec(),
                },
            ),
            (
                &[16, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0A, 0x01, 0x02],
                Request::WriteRegisters { address: 1, values: vec![0x000A, 0x0102] },
            ),
            (
                &[22, 0x00, 0x04, 0x00, 0xF2, 0x00, 0x25],
                Request::MaskRegister { address: 4, and: 0xF2, or: 0x25 },
            ),
            (
                &[23, 0, 3, 0, 6, 0, 0x0E, 0, 3, 6, 0, 0xFF, 0, 0xFF, 0, 0xFF],
                Request::ReadWrite { read: block(3, 6), address: 14, values: vec![0xFF; 3] },
            ),
        ];
        for (pdu, expected) in rows {
            assert_eq!(Request::parse(pdu), Ok(expected));
            assert_eq!(Length::of(pdu), Length::Known(pdu.len()));
            // Any other length is refused.
            assert_eq!(Request::parse(&pdu[..pdu.len() - 1]), Err(Exception::Value));
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_the_right_exception() {
        let rows: [(&[u8], Exception); 8] = [
            (&[7], Exception::Function),
            (&[0x2B, 0x0E, 1, 0], Exception::Function),
            (&[3, 0, 0, 0, 0], Exception::Value),
            (&[3, 0, 0, 0, 126], Exception::Value),
            (&[1, 0, 0, 0x07, 0xD1], Exception::Value),
            (&[5, 0, 0, 0x01, 0x00], Exception::Value),
            (&[16, 0, 0, 0, 2, 2, 0, 1], Exception::Value),
            (&[15, 0, 0, 0, 9, 1, 0xFF], Exception::Value),
        ];
        for (pdu, exception) in rows {
            assert_eq!(Request::parse(pdu), Err(exception), "{pdu:?}");
        }
    }

    /// A request, the reply of the unit, and the bytes of the answer.
    type Row = (&'static [u8], Result<Reply, Exception>, &'static [u8]);

    #[test]
    fn the_examples_of_the_specification_are_answered() {
        let bits = |text: &str| Ok(Reply::Bits(text.bytes().map(|b| b == b'1').collect()));
        let rows: [Row; 6] = [
            // Coils 20 to 38: CD 6B 05, lowest bit first.
            (&[1, 0x00, 0x13, 0x00, 0x13], bits("1011001111010110101"), &[1, 3, 0xCD, 0x6B, 0x05]),
            (
                &[3, 0x00, 0x6B, 0x00, 0x03],
                Ok(Reply::Registers(vec![0x022B, 0, 0x64])),
                &[3, 6, 0x02, 0x2B, 0, 0, 0, 0x64],
            ),
            (&[6, 0, 1, 0, 3], Ok(Reply::Done), &[6, 0, 1, 0, 3]),
            (&[16, 0, 1, 0, 2, 4, 0, 10, 1, 2], Ok(Reply::Done), &[16, 0, 1, 0, 2]),
            (&[22, 0, 4, 0, 0xF2, 0, 0x25], Ok(Reply::Done), &[22, 0, 4, 0, 0xF2, 0, 0x25]),
            (&[1, 0x04, 0xA1, 0, 1], Err(Exception::Address), &[0x81, 0x02]),
        ];
        for (request, answer, expected) in rows {
            assert_eq!(encode(request, &answer), expected);
        }
    }
}
