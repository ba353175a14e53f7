//! Settings and timing of a serial line.

use std::{fmt, time::Duration};

/// What a port is to this computer, for advice about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PortKind {
    /// A serial line.
    Serial,
    /// A connection of the network.
    Network,
    /// An instrument on USB, without a serial line in between.
    Usb,
}

/// The parity bit of a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// The number of ones is even.
    Even,
    /// The number of ones is odd.
    Odd,
}

/// The stop bits of a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopBits {
    /// One.
    One,
    /// Two.
    Two,
}

/// The terminator of a line of text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Terminator {
    /// Line feed.
    Lf,
    /// Carriage return and line feed.
    CrLf,
    /// Carriage return.
    Cr,
}

impl Terminator {
    /// Every terminator.
    pub const ALL: [Self; 3] = [Self::Lf, Self::CrLf, Self::Cr];

    /// The name in rig files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lf => "lf",
            Self::CrLf => "crlf",
            Self::Cr => "cr",
        }
    }
}

/// The settings of a serial line. Characters have eight data bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second.
    pub baud: u32,
    /// The parity bit.
    pub parity: Parity,
    /// The stop bits.
    pub stop_bits: StopBits,
}

impl LineSettings {
    /// Transfer time of `bytes` characters.
    pub fn duration_of(&self, bytes: usize) -> Duration {
        let parity = u32::from(self.parity != Parity::None);
        let stop = if self.stop_bits == StopBits::Two { 2 } else { 1 };
        let bits_per_character = 1 + 8 + parity + stop;
        let seconds = f64::from(bits_per_character) / f64::from(self.baud.max(1));
        Duration::from_secs_f64(seconds * bytes as f64)
    }

    /// The silence that separates two frames of Modbus RTU: 3.5 characters of 11 bits, and a fixed
    /// time above 19200 baud.
    ///
    /// # Source
    /// Modbus over Serial Line, Specification and Implementation Guide V1.02, page 13.
    pub fn frame_silence(&self) -> Duration {
        if self.baud > 19_200 {
            return Duration::from_micros(1_750);
        }
        Duration::from_secs_f64(3.5 * 11.0 / f64::from(self.baud.max(1)))
    }
}

impl fmt::Display for LineSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        let stop = match self.stop_bits {
            StopBits::One => 1,
            StopBits::Two => 2,
        };
        write!(f, "{} 8{parity}{stop}", self.baud)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_modbus_guide() {
        let micros = |duration: Duration| duration.as_micros();
        assert_eq!(
            micros(
                LineSettings { baud: 9_600, parity: Parity::Even, stop_bits: StopBits::One }
                    .frame_silence()
            ),
            4_010
        );
        assert_eq!(
            micros(
                LineSettings { baud: 19_200, parity: Parity::Even, stop_bits: StopBits::One }
                    .frame_silence()
            ),
            2_005
        );
        assert_eq!(
            micros(
                LineSettings { baud: 115_200, parity: Parity::Even, stop_bits: StopBits::One }
                    .frame_silence()
            ),
            1_750
        );
        assert_eq!(
            micros(
                LineSettings { baud: 9_600, parity: Parity::Even, stop_bits: StopBits::One }
                    .duration_of(8)
            ),
            9_166
        );
        assert_eq!(
            micros(
                LineSettings { baud: 9_600, parity: Parity::None, stop_bits: StopBits::One }
                    .duration_of(8)
            ),
            8_333
        );
        assert_eq!(
            LineSettings { baud: 115_200, parity: Parity::Even, stop_bits: StopBits::One }
                .to_string(),
            "115200 8E1"
        );
    }
}
