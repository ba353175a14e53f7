//! Messages to an instrument: units, each counted from the root of its command tree.

use std::fmt;

use rig_files::instrument::template::{Quantity, Template, datum};
use rig_scpi::{Ending, Program};

/// One message, of one or more units.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Message {
    program: Option<Program>,
}

impl Message {
    /// A message without units.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// Adds a command.
    pub(crate) fn command(self, header: &str) -> Self {
        let program = match self.program {
            None => Program::command(header),
            Some(program) => program.then(header),
        };
        Self { program: Some(program) }
    }

    /// Adds a query, written without its `?`.
    pub(crate) fn query(self, header: &str) -> Self {
        let program = match self.program {
            None => Program::query(header),
            Some(program) => program.then_query(header),
        };
        Self { program: Some(program) }
    }

    /// Adds a number to the last unit.
    pub(crate) fn number(self, value: f64) -> Self {
        Self { program: self.program.map(|program| program.number(value)) }
    }

    /// Adds character data to the last unit.
    pub(crate) fn word(self, word: &str) -> Self {
        Self { program: self.program.map(|program| program.characters(word)) }
    }

    /// Adds the units of a message of an instrument file, with the values of its quantities.
    pub(crate) fn template(self, template: &Template, value: impl Fn(Quantity) -> f64) -> Self {
        template.units.iter().fold(self, |message, unit| {
            let header = unit.header.as_str();
            let message =
                if unit.is_question { message.query(header) } else { message.command(header) };
            unit.data
                .iter()
                .fold(message, |message, pieces| message.literal(&datum(pieces, &value)))
        })
    }

    /// Adds the units of a message that holds no quantities.
    pub(crate) fn plain(self, template: &Template) -> Self {
        self.template(template, |_| f64::NAN)
    }

    /// Adds a datum to the last unit, as it is written.
    fn literal(self, text: &str) -> Self {
        Self { program: self.program.map(|program| program.literal(text)) }
    }

    /// A command with a number.
    pub(crate) fn set(self, header: &str, value: f64) -> Self {
        self.command(header).number(value)
    }

    /// A command with character data.
    pub(crate) fn choose(self, header: &str, word: &str) -> Self {
        self.command(header).word(word)
    }

    /// The bytes that go out.
    pub(crate) fn bytes(&self, ending: Ending) -> Vec<u8> {
        let program = self.program.clone().expect("a message has units when it is sent");
        program.finish(ending).expect("headers and data were checked when they were read")
    }

    /// The bytes with the short form of each header, for a line on which every character waits.
    pub(crate) fn short_bytes(&self, ending: Ending) -> Vec<u8> {
        let mut bytes = self.bytes(ending);
        let mut is_header = true;
        bytes.retain(|byte| {
            is_header = *byte == b';' || is_header && *byte != b' ';
            !(is_header && byte.is_ascii_lowercase())
        });
        bytes
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bytes = self.bytes(Ending::Lf);
        f.write_str(&String::from_utf8_lossy(bytes.trim_ascii_end()))
    }
}
