//! Program messages as a controller writes them.

use std::io::Write;

use crate::{
    grammar::scan::Ending,
    grammar::value::{write_block, write_quoted, write_shortest},
};

/// Builds one program message of one or more units.
///
/// ```
/// use rig_scpi::{Ending, Program};
///
/// let bytes = Program::command(":SENS:FREQ").number(200.0).unit("HZ")
///     .then_query("*OPC")
///     .finish(Ending::Lf);
/// assert_eq!(bytes, Ok(b":SENS:FREQ 200HZ;*OPC?\n".to_vec()));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    bytes: Vec<u8>,
    has_data: bool,
    fault: Option<ProgramError>,
}

/// Why a message cannot be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProgramError {
    /// The header is not one of IEEE 488.2.
    #[error("`{header}` is not a program header")]
    Header {
        /// The requested header.
        header: String,
    },
    /// A number that has no decimal form.
    #[error("parameter of `{header}`: {value} is not a finite number")]
    NotFinite {
        /// The message so far.
        header: String,
        /// The requested value.
        value: f64,
    },
    /// Data as they are written are printable ASCII without what separates data and units.
    #[error(
        "`{text}` is not one datum of printable ASCII characters without `,`, `;` and quotation marks"
    )]
    NotLiteral {
        /// The requested text.
        text: String,
    },
    /// Strings are ASCII.
    #[error("`{text}` holds characters beyond ASCII")]
    NotAscii {
        /// The requested text.
        text: String,
    },
    /// Character data is one word.
    #[error("`{text}` is not character data")]
    NotCharacters {
        /// The requested text.
        text: String,
    },
    /// A suffix consists of letters, digits, `.`, `/` and `-`, and follows a number.
    #[error("`{unit}` is not the unit of a number")]
    Unit {
        /// The requested unit.
        unit: String,
    },
    /// A block of this length does not fit its header.
    #[error("a block of {n_bytes} bytes is longer than 999999999 bytes")]
    BlockTooLong {
        /// Bytes of the block.
        n_bytes: usize,
    },
}

impl Program {
    /// A message whose first unit is the command `header`, such as `:FREQ` or `*RST`.
    pub fn command(header: &str) -> Self {
        Self { bytes: Vec::new(), has_data: false, fault: None }.unit_header(header, "")
    }

    /// A message whose first unit is the query `header`, written without its `?`.
    pub fn query(header: &str) -> Self {
        Self { bytes: Vec::new(), has_data: false, fault: None }.unit_header(header, "?")
    }

    /// Adds a command. Its header starts at the root, independent of the units before.
    #[must_use]
    pub fn then(self, header: &str) -> Self {
        self.next_unit(header, "")
    }

    /// Adds a query, written without its `?`. Its header is counted from the root.
    #[must_use]
    pub fn then_query(self, header: &str) -> Self {
        self.next_unit(header, "?")
    }

    /// Adds a number in the shortest decimal form that reads back as the same number.
    #[must_use]
    pub fn number(mut self, value: f64) -> Self {
        if !value.is_finite() {
            let header = String::from_utf8_lossy(&self.bytes).into_owned();
            return self.refuse(ProgramError::NotFinite { header, value });
        }
        self.separate();
        write_shortest(value, &mut self.bytes);
        self
    }

    /// Adds a whole number.
    #[must_use]
    pub fn integer(mut self, value: i64) -> Self {
        self.separate();
        write!(self.bytes, "{value}").expect("writing to memory cannot fail");
        self
    }

    /// Adds the unit of the number before it, such as `HZ`.
    #[must_use]
    pub fn unit(mut self, unit: &str) -> Self {
        let is_unit = unit.starts_with(|c: char| c.is_ascii_alphabetic())
            && unit.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"./-".contains(&byte));
        let is_behind_number = self.has_data && self.bytes.last().is_some_and(u8::is_ascii_digit);
        if !(is_unit && is_behind_number) {
            return self.refuse(ProgramError::Unit { unit: unit.to_owned() });
        }
        // `5E` would begin an exponent, so a blank separates such a unit.
        if unit.starts_with(['e', 'E']) {
            self.bytes.push(b' ');
        }
        self.bytes.extend_from_slice(unit.as_bytes());
        self
    }

    /// Adds `ON` or `OFF`.
    #[must_use]
    pub fn boolean(self, is_on: bool) -> Self {
        self.characters(if is_on { "ON" } else { "OFF" })
    }

    /// Adds character data, such as `BUS` or `MAX`.
    #[must_use]
    pub fn characters(mut self, word: &str) -> Self {
        let is_word = word.starts_with(|c: char| c.is_ascii_alphabetic())
            && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
        if !is_word {
            return self.refuse(ProgramError::NotCharacters { text: word.to_owned() });
        }
        self.separate();
        self.bytes.extend_from_slice(word.as_bytes());
        self
    }

    /// Adds one datum as it is written, such as `0x1F`, `200HZ` or `1.50`.
    #[must_use]
    pub fn literal(mut self, text: &str) -> Self {
        let is_plain = |byte: u8| byte.is_ascii_graphic() && !b",;\"'".contains(&byte);
        if text.is_empty() || !text.bytes().all(is_plain) {
            return self.refuse(ProgramError::NotLiteral { text: text.to_owned() });
        }
        self.separate();
        self.bytes.extend_from_slice(text.as_bytes());
        self
    }

    /// Adds a quoted string.
    #[must_use]
    pub fn text(mut self, text: &str) -> Self {
        if !text.is_ascii() {
            return self.refuse(ProgramError::NotAscii { text: text.to_owned() });
        }
        self.separate();
        write_quoted(text, &mut self.bytes);
        self
    }

    /// Adds a block of known length.
    #[must_use]
    pub fn block(mut self, bytes: &[u8]) -> Self {
        if 999_999_999 < bytes.len() {
            return self.refuse(ProgramError::BlockTooLong { n_bytes: bytes.len() });
        }
        self.separate();
        write_block(bytes, &mut self.bytes);
        self
    }

    /// Adds an expression, written without its outer parentheses: `@1,3:5` for a channel list.
    #[must_use]
    pub fn expression(mut self, inside: &str) -> Self {
        if !inside.is_ascii() || inside.contains(['\n', ';', '"', '\'', '(', ')']) {
            return self.refuse(ProgramError::NotCharacters { text: inside.to_owned() });
        }
        self.separate();
        write!(self.bytes, "({inside})").expect("writing to memory cannot fail");
        self
    }

    /// The message with its ending.
    ///
    /// # Errors
    /// The first part that could not be written.
    pub fn finish(mut self, ending: Ending) -> Result<Vec<u8>, ProgramError> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        self.bytes.extend_from_slice(ending.bytes());
        Ok(self.bytes)
    }

    fn next_unit(mut self, header: &str, question: &str) -> Self {
        self.bytes.push(b';');
        self.has_data = false;
        if !header.starts_with([':', '*']) {
            self.bytes.push(b':');
        }
        self.unit_header(header, question)
    }

    fn unit_header(mut self, header: &str, question: &str) -> Self {
        if !is_header(header) {
            return self.refuse(ProgramError::Header { header: header.to_owned() });
        }
        self.bytes.extend_from_slice(header.as_bytes());
        self.bytes.extend_from_slice(question.as_bytes());
        self
    }

    fn separate(&mut self) {
        self.bytes.push(if self.has_data { b',' } else { b' ' });
        self.has_data = true;
    }

    fn refuse(mut self, fault: ProgramError) -> Self {
        self.fault.get_or_insert(fault);
        self
    }
}

/// `*IDN`, `:SENS:FREQ`, `FREQ`. Hyphens are allowed, because some instruments have them.
fn is_header(header: &str) -> bool {
    let is_mnemonic = |word: &str| {
        word.starts_with(|c: char| c.is_ascii_alphabetic())
            && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"_-".contains(&byte))
    };
    match header.strip_prefix('*') {
        Some(name) => is_mnemonic(name),
        None => header.strip_prefix(':').unwrap_or(header).split(':').all(is_mnemonic),
    }
}
