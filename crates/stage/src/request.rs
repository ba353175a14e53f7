//! Requests to a Modbus device, and their answers.

use std::{borrow::Cow, fmt};

use tokio_modbus as modbus;

/// A request to one device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// Function 1.
    ReadCoils {
        /// First coil.
        address: u16,
        /// Number of addresses.
        count: u16,
    },
    /// Function 2.
    ReadDiscreteInputs {
        /// First input.
        address: u16,
        /// Number of addresses.
        count: u16,
    },
    /// Function 3.
    ReadHolding {
        /// First register.
        address: u16,
        /// Number of addresses.
        count: u16,
    },
    /// Function 4.
    ReadInput {
        /// First register.
        address: u16,
        /// Number of addresses.
        count: u16,
    },
    /// Function 5.
    WriteCoil {
        /// Address of the coil.
        address: u16,
        /// Value of the register or coil.
        is_on: bool,
    },
    /// Function 6.
    WriteRegister {
        /// Address of the register.
        address: u16,
        /// Value of the register or coil.
        value: u16,
    },
    /// Function 16.
    WriteRegisters {
        /// First register.
        address: u16,
        /// Values of the registers.
        values: Vec<u16>,
    },
}

/// An answer that answers its request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reply {
    /// Coils or discrete inputs, as many as requested.
    Bits(Vec<bool>),
    /// Registers, as many as requested.
    Words(Vec<u16>),
    /// Written as asked, by the device's own account.
    Written,
}

impl Request {
    /// Whether it writes to the device.
    pub(crate) const fn is_write(&self) -> bool {
        matches!(
            self,
            Self::WriteCoil { .. } | Self::WriteRegister { .. } | Self::WriteRegisters { .. }
        )
    }

    pub(crate) fn to_wire(&self) -> modbus::Request<'_> {
        match self {
            Self::ReadCoils { address, count } => modbus::Request::ReadCoils(*address, *count),
            Self::ReadDiscreteInputs { address, count } => {
                modbus::Request::ReadDiscreteInputs(*address, *count)
            }
            Self::ReadHolding { address, count } => {
                modbus::Request::ReadHoldingRegisters(*address, *count)
            }
            Self::ReadInput { address, count } => {
                modbus::Request::ReadInputRegisters(*address, *count)
            }
            Self::WriteCoil { address, is_on } => {
                modbus::Request::WriteSingleCoil(*address, *is_on)
            }
            Self::WriteRegister { address, value } => {
                modbus::Request::WriteSingleRegister(*address, *value)
            }
            Self::WriteRegisters { address, values } => {
                modbus::Request::WriteMultipleRegisters(*address, Cow::Borrowed(values))
            }
        }
    }

    /// The number of bytes of the request on a serial line.
    pub(crate) fn wire_len(&self) -> usize {
        match self {
            Self::WriteRegisters { values, .. } => 9 + 2 * values.len(),
            _ => 8,
        }
    }

    /// The number of bytes of data that the answer announces, where it announces it.
    pub(crate) fn data_len(&self) -> Option<usize> {
        match self {
            Self::WriteCoil { .. } | Self::WriteRegister { .. } | Self::WriteRegisters { .. } => {
                None
            }
            _ => Some(self.reply_wire_len() - 5),
        }
    }

    /// The number of bytes of the answer on a serial line.
    pub(crate) fn reply_wire_len(&self) -> usize {
        match self {
            Self::ReadCoils { count, .. } | Self::ReadDiscreteInputs { count, .. } => {
                5 + usize::from(*count).div_ceil(8)
            }
            Self::ReadHolding { count, .. } | Self::ReadInput { count, .. } => {
                5 + 2 * usize::from(*count)
            }
            Self::WriteCoil { .. } | Self::WriteRegister { .. } | Self::WriteRegisters { .. } => 8,
        }
    }

    /// Takes an answer only when everything in it agrees with the request. The library compares
    /// length, address and value in debug builds alone.
    pub(crate) fn accept(&self, response: modbus::Response) -> Option<Reply> {
        use modbus::Response as R;
        let bits = |mut bits: Vec<bool>, count: u16| {
            // They come in whole bytes.
            let count = usize::from(count);
            let is_whole = bits.len() == count.div_ceil(8) * 8;
            bits.truncate(count);
            is_whole.then_some(Reply::Bits(bits))
        };
        let words = |words: Vec<u16>, count: u16| {
            (words.len() == usize::from(count)).then_some(Reply::Words(words))
        };
        let written = |is_same: bool| is_same.then_some(Reply::Written);
        match (self, response) {
            (Self::ReadCoils { count, .. }, R::ReadCoils(found)) => bits(found, *count),
            (Self::ReadDiscreteInputs { count, .. }, R::ReadDiscreteInputs(found)) => {
                bits(found, *count)
            }
            (Self::ReadHolding { count, .. }, R::ReadHoldingRegisters(found)) => {
                words(found, *count)
            }
            (Self::ReadInput { count, .. }, R::ReadInputRegisters(found)) => words(found, *count),
            (Self::WriteCoil { address, is_on }, R::WriteSingleCoil(at, value)) => {
                written(*address == at && *is_on == value)
            }
            (Self::WriteRegister { address, value }, R::WriteSingleRegister(at, found)) => {
                written(*address == at && *value == found)
            }
            (Self::WriteRegisters { address, values }, R::WriteMultipleRegisters(at, count)) => {
                written(*address == at && values.len() == usize::from(count))
            }
            _ => None,
        }
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ReadCoils { address, count } => write!(f, "read {count} coils at {address:#06x}"),
            Self::ReadDiscreteInputs { address, count } => {
                write!(f, "read {count} discrete inputs at {address:#06x}")
            }
            Self::ReadHolding { address, count } => {
                write!(f, "read {count} holding registers at {address:#06x}")
            }
            Self::ReadInput { address, count } => {
                write!(f, "read {count} input registers at {address:#06x}")
            }
            Self::WriteCoil { address, is_on } => {
                write!(f, "write coil {address:#06x} = {}", if *is_on { "on" } else { "off" })
            }
            Self::WriteRegister { address, value } => {
                write!(f, "write register {address:#06x} = {value:#06x}")
            }
            Self::WriteRegisters { address, values } => {
                write!(f, "write {} registers at {address:#06x}", values.len())
            }
        }
    }
}
