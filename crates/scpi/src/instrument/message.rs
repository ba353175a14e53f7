//! The message that an instrument carries out, and the answer that grows with it.

use crate::{
    grammar::parse::Header,
    grammar::scan::Ending,
    grammar::scan::{Rules, Scanner},
    grammar::value::{RealFormat, Value},
};

#[derive(Debug, Clone, Default)]
pub(super) struct Message {
    pub(super) is_running: bool,
    pub(super) bytes: Vec<u8>,
    /// Start of the next unit; the end of the message if there is none.
    position: usize,
    /// The mnemonics that a relative header is appended to.
    path: Vec<u8>,
    /// A query was among its units.
    pub(super) has_query: bool,
    pub(super) answer: Answer,
}

/// The answers to the units so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Answer {
    pub(super) bytes: Vec<u8>,
    /// There is an answer, though it may have no bytes.
    pub(super) has_data: bool,
    /// It ends with data that only the end of the message ends.
    pub(super) is_indefinite: bool,
}

impl Message {
    /// The bytes are those of a new message.
    pub(super) fn begin(&mut self) {
        self.path.clear();
        self.position = 0;
        self.has_query = false;
        self.is_running = true;
    }

    pub(super) const fn has_units(&self) -> bool {
        self.position <= self.bytes.len()
    }

    pub(super) const fn skip_rest(&mut self) {
        self.position = usize::MAX;
    }

    /// The next unit of `bytes`, which are those of this message, without its semicolon.
    pub(super) fn next_unit<'a>(&mut self, bytes: &'a [u8], rules: Rules) -> &'a [u8] {
        let rest = &bytes[self.position..];
        let n_bytes = match Scanner::new(rules).scan(rest) {
            Some((n_bytes, _)) => n_bytes - 1,
            None => rest.len(),
        };
        self.position += n_bytes + 1;
        &rest[..n_bytes]
    }

    /// The header from the root: a relative one is appended to the path.
    pub(super) fn absolute(&self, header: &Header<'_>) -> Vec<u8> {
        if header.is_common || header.is_absolute || self.path.is_empty() {
            return header.text.to_vec();
        }
        [&*self.path, b":", header.text].concat()
    }

    /// The path of the next unit is `path` without its last mnemonic. Common commands belong to no
    /// subsystem and do not change it.
    pub(super) fn enter(&mut self, header: &Header<'_>, mut path: Vec<u8>) {
        if !header.is_common {
            path.truncate(path.iter().rposition(|byte| *byte == b':').unwrap_or(0));
            self.path = path;
        }
    }
}

impl Answer {
    /// Begins the answer to a further unit.
    pub(super) fn begin(&mut self, heading: &str) {
        if self.has_data {
            self.bytes.push(b';');
        }
        self.has_data = true;
        self.bytes.extend_from_slice(heading.as_bytes());
    }

    pub(super) fn values(&mut self, values: &[Value], format: RealFormat) {
        for (index, value) in values.iter().enumerate() {
            if 0 < index {
                self.bytes.push(b',');
            }
            value.write(format, &mut self.bytes);
            self.is_indefinite |= value.is_indefinite();
        }
    }

    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Appends the answer to `output` with its ending, if there is one.
    pub(super) fn finish(&mut self, output: &mut Vec<u8>, ending: Ending) {
        if self.has_data {
            output.append(&mut self.bytes);
            output.extend_from_slice(ending.bytes());
        }
        self.has_data = false;
        self.is_indefinite = false;
    }
}
