//! The text of a file: where its bytes stand, and what is wrong with its syntax.

use std::{cell::RefCell, collections::BTreeSet, ops::Range};

use toml::{
    Spanned,
    de::{DeTable, Error},
};

use crate::{
    Complaint, Faults, Place,
    shape::{self, Record},
};

/// One file while it is read.
#[derive(Debug)]
pub(crate) struct Source<'a> {
    text: &'a str,
    /// Byte offset at which each line begins.
    lines: Vec<usize>,
    /// Lines with faulty syntax. What stands there is not looked at again.
    broken_lines: BTreeSet<usize>,
    /// Whether faulty syntax may have hidden a key.
    may_hide_keys: bool,
    /// Whether a header is among it, so that keys may have landed in another table.
    may_misplace_keys: bool,
    found: RefCell<Found>,
}

/// What the tables report while they are read.
#[derive(Debug)]
struct Found {
    faults: Faults,
    records: Vec<Record>,
}

/// What the parser says of the syntax.
#[derive(Debug, thiserror::Error)]
enum Syntax {
    #[error("`{0}` is given twice")]
    Duplicate(String),
    #[error("{0}")]
    Comma(&'static str),
    #[error("not TOML: {0}")]
    Other(String),
}

impl Complaint for Syntax {
    fn suggestion(&self) -> Option<String> {
        match self {
            Self::Duplicate(_) => Some("remove one".into()),
            Self::Comma(_) => Some("write a decimal point".into()),
            Self::Other(_) => None,
        }
    }
}

impl<'a> Source<'a> {
    /// Parses as much of `text` as can be understood.
    pub(crate) fn parse(file: &str, text: &'a str) -> (Self, Spanned<DeTable<'a>>) {
        let (tree, errors) = DeTable::parse_recoverable(text);
        let newlines = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let found = Found { faults: Faults::new(file), records: Vec::new() };
        let mut source = Self {
            text,
            lines: std::iter::once(0).chain(newlines.map(|(at, _)| at + 1)).collect(),
            broken_lines: BTreeSet::new(),
            may_hide_keys: false,
            may_misplace_keys: false,
            found: RefCell::new(found),
        };
        for error in &errors {
            source.note_syntax(error);
        }
        (source, tree)
    }

    /// One fault for each line, because the first error often brings others with it.
    fn note_syntax(&mut self, error: &Error) {
        let span = error.span().unwrap_or(self.text.len()..self.text.len());
        let place = self.place(span.start);
        let syntax = self.syntax(error.message(), span);
        if matches!(syntax, Syntax::Duplicate(_)) {
            self.refuse(place, &syntax);
            return;
        }
        self.may_hide_keys = true;
        self.may_misplace_keys |= self.line(place.line).trim_start().starts_with('[');
        if self.broken_lines.insert(place.line) {
            self.refuse(place, &syntax);
        }
    }

    fn syntax(&self, message: &str, span: Range<usize>) -> Syntax {
        let (before, after) = self.text.split_at(span.start);
        let digit_before = before.ends_with(|c: char| c.is_ascii_digit());
        let comma_after = after
            .strip_prefix(',')
            .is_some_and(|rest| rest.trim_start().starts_with(|c: char| c.is_ascii_digit()));
        if message == "duplicate key" {
            Syntax::Duplicate(shape::shortened(self.written(span)))
        } else if digit_before && comma_after {
            Syntax::Comma("a decimal comma is not TOML")
        } else {
            Syntax::Other(message.trim_end_matches(", expected nothing").into())
        }
    }

    /// The place of a byte. Past the end it is the end.
    pub(crate) fn place(&self, offset: usize) -> Place {
        let offset = offset.min(self.text.len());
        let line = self.lines.partition_point(|&start| start <= offset);
        let start = self.lines[line - 1];
        Place { line, column: self.text[start..offset].chars().count() + 1 }
    }

    fn line(&self, line: usize) -> &'a str {
        self.text[self.lines[line - 1]..].lines().next().unwrap_or_default()
    }

    /// What is written there.
    pub(crate) fn written(&self, span: Range<usize>) -> &'a str {
        self.text.get(span).unwrap_or_default()
    }

    /// Whether the syntax there is faulty, so that its value means nothing.
    pub(crate) fn is_broken(&self, place: Place) -> bool {
        self.broken_lines.contains(&place.line)
    }

    pub(crate) fn refuse(&self, place: Place, complaint: &impl Complaint) {
        self.found.borrow_mut().faults.refuse(place, complaint);
    }

    pub(crate) fn record(&self, record: Record) {
        self.found.borrow_mut().records.push(record);
    }

    /// Everything that is wrong, after the last table is closed.
    pub(crate) fn into_faults(self) -> Faults {
        let Found { mut faults, records } = self.found.into_inner();
        for (place, complaint) in shape::complaints(&records) {
            let is_doubtful =
                if complaint.is_missing() { self.may_hide_keys } else { self.may_misplace_keys };
            if !is_doubtful && !self.broken_lines.contains(&place.line) {
                faults.refuse(place, &complaint);
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_characters_and_the_end_of_the_file_has_a_place() {
        let (source, _) = Source::parse("x.toml", "a = 1\r\nb = \"µ°\" # µ\n");
        let place = |needle: &str| {
            let Place { line, column } = source.place(source.text.find(needle).unwrap());
            (line, column)
        };
        assert_eq!(place("a"), (1, 1));
        assert_eq!(place("\r"), (1, 6));
        assert_eq!(place("b"), (2, 1));
        assert_eq!(place("\" #"), (2, 8));
        assert_eq!(source.place(usize::MAX), Place { line: 3, column: 1 });
    }
}
