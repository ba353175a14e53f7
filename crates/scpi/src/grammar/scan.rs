//! Finds the ends of units and messages in a stream of bytes that is cut anywhere.
//!
//! A terminator inside a string or a block is data, so the search handles both. [`crate::grammar`]
//! parses the units.

/// The terminator of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ending {
    /// Line feed.
    #[default]
    Lf,
    /// Carriage return and line feed.
    CrLf,
    /// Carriage return.
    Cr,
}

impl Ending {
    /// The bytes of the terminator.
    pub const fn bytes(self) -> &'static [u8] {
        match self {
            Self::Lf => b"\n",
            Self::CrLf => b"\r\n",
            Self::Cr => b"\r",
        }
    }
}

/// A boundary that the scanner found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Boundary {
    /// A semicolon between two units.
    Unit,
    /// The terminator of a message.
    Message,
}

/// Terminators of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Terminators {
    /// Line feed. A carriage return before it is white space, as in IEEE 488.2.
    #[default]
    LineFeed,
    /// Line feed or carriage return, whichever comes; both together end one message.
    LineFeedOrCarriageReturn,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Position {
    /// Before the header of a unit.
    Blank,
    Header,
    /// After white space or a comma: a block or a string may begin here.
    DataStart,
    Data,
    /// Within parentheses, this many deep.
    Expression(u32),
    /// Within a string; `depth` counts the parentheses around it.
    Text {
        quote: u8,
        depth: u32,
    },
    /// Directly after a string; a repeated quote continues it.
    TextEnd {
        quote: u8,
    },
    /// Behind the `#` that may begin a block.
    Hash,
    /// Within the length of a block.
    Length {
        n_digits_left: u8,
        declared: usize,
    },
    /// Within a block of known length.
    Block {
        left: usize,
    },
    /// Within a block that only the terminator ends.
    Indefinite,
}

/// The state between two bytes of a stream.
#[derive(Debug, Clone)]
pub(crate) struct Scanner {
    position: Position,
    rules: Rules,
}

/// The terminator of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rules {
    pub(crate) terminators: Terminators,
    /// A terminator inside a string is part of the string.
    pub(crate) strings_span_lines: bool,
}

impl Scanner {
    pub(crate) const fn new(rules: Rules) -> Self {
        Self { position: Position::Blank, rules }
    }

    /// Consumes bytes up to and including the next boundary. `None` when there is none; then all
    /// bytes were consumed.
    pub(crate) fn scan(&mut self, bytes: &[u8]) -> Option<(usize, Boundary)> {
        let mut at = 0;
        while at < bytes.len() {
            if let Position::Block { left } = self.position {
                let n_taken = left.min(bytes.len() - at);
                at += n_taken;
                self.position = match left - n_taken {
                    0 => Position::Data,
                    left => Position::Block { left },
                };
                continue;
            }
            let boundary = self.step(bytes[at]);
            at += 1;
            if boundary.is_some() {
                self.position = Position::Blank;
                return boundary.map(|boundary| (at, boundary));
            }
        }
        None
    }

    fn is_terminator(&self, byte: u8) -> bool {
        byte == b'\n'
            || (byte == b'\r' && self.rules.terminators == Terminators::LineFeedOrCarriageReturn)
    }

    fn step(&mut self, byte: u8) -> Option<Boundary> {
        self.position = match self.position {
            // Only in a counted block or a string is a terminator data.
            Position::Block { left: 0 | 1 } => Position::Data,
            Position::Block { left } => Position::Block { left: left - 1 },
            Position::Text { quote, depth }
                if self.rules.strings_span_lines || !self.is_terminator(byte) =>
            {
                match depth {
                    _ if byte != quote => Position::Text { quote, depth },
                    0 => Position::TextEnd { quote },
                    _ => Position::Expression(depth),
                }
            }
            _ if self.is_terminator(byte) => return Some(Boundary::Message),
            Position::Indefinite => return None,
            _ if byte == b';' => return Some(Boundary::Unit),
            Position::Blank if is_blank(byte) => Position::Blank,
            Position::Blank | Position::Header => match byte {
                b',' => Position::DataStart,
                _ if is_blank(byte) => Position::DataStart,
                _ => Position::Header,
            },
            Position::TextEnd { quote } if byte == quote => Position::Text { quote, depth: 0 },
            Position::DataStart => match byte {
                b'#' => Position::Hash,
                b'"' | b'\'' => Position::Text { quote: byte, depth: 0 },
                _ => in_data(byte),
            },
            Position::Hash => match byte {
                b'0' => Position::Indefinite,
                b'1'..=b'9' => Position::Length { n_digits_left: byte - b'0', declared: 0 },
                _ => in_data(byte),
            },
            Position::Length { n_digits_left, declared } if byte.is_ascii_digit() => {
                let declared = declared * 10 + usize::from(byte - b'0');
                match (n_digits_left, declared) {
                    (1, 0) => Position::Data,
                    (1, left) => Position::Block { left },
                    _ => Position::Length { n_digits_left: n_digits_left - 1, declared },
                }
            }
            Position::Length { .. }
            | Position::TextEnd { .. }
            | Position::Text { .. }
            | Position::Data => in_data(byte),
            Position::Expression(depth) => match byte {
                b'(' => Position::Expression(depth.saturating_add(1)),
                b')' if depth == 1 => Position::Data,
                b')' => Position::Expression(depth - 1),
                b'"' | b'\'' => Position::Text { quote: byte, depth },
                _ => Position::Expression(depth),
            },
        };
        None
    }
}

/// IEEE 488.2, 7.4.1.2: every control character but the line feed is white space.
pub(crate) const fn is_blank(byte: u8) -> bool {
    byte <= b' ' && byte != b'\n'
}

const fn in_data(byte: u8) -> Position {
    match byte {
        b',' => Position::DataStart,
        b'(' => Position::Expression(1),
        _ if is_blank(byte) => Position::DataStart,
        _ => Position::Data,
    }
}
