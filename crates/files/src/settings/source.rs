//! The text of a file: the locations of its bytes, and the faults of its syntax.

use std::{
    cell::{Cell, RefCell},
    collections::BTreeSet,
    ops::Range,
};

use toml::{
    Spanned,
    de::{DeTable, Error},
};

use super::{
    InForce,
    keys::{self, TableKeys},
};
use crate::{Complaint, Faults, Location};

/// A file during the reading.
#[derive(Debug)]
pub(crate) struct Source<'a> {
    text: &'a str,
    /// Byte offset of the start of each line.
    lines: Vec<usize>,
    /// Lines with faulty syntax. Their values are ignored.
    broken_lines: BTreeSet<usize>,
    /// Whether faulty syntax may hide a key.
    may_hide_keys: bool,
    /// Whether the syntax of a header is faulty, so that keys may be in the wrong table.
    may_misplace_keys: bool,
    findings: RefCell<Findings>,
    /// Whether a schema is made of the keys that the reader asks for.
    pub(crate) is_described: bool,
    /// Whether values are recorded: those in force, while they are asked for.
    pub(crate) is_recorded: Cell<bool>,
}

/// Faults and keys found during the reading.
#[derive(Debug)]
struct Findings {
    faults: Faults,
    tables: Vec<TableKeys>,
    in_force: Vec<InForce>,
}

/// A fault of the syntax.
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
    /// Parses `text` as far as its syntax is right.
    pub(crate) fn parse(file: &str, text: &'a str) -> (Self, Spanned<DeTable<'a>>) {
        let (tree, errors) = DeTable::parse_recoverable(text);
        let newlines = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let findings =
            Findings { faults: Faults::new(file), tables: Vec::new(), in_force: Vec::new() };
        let mut source = Self {
            text,
            lines: std::iter::once(0).chain(newlines.map(|(at, _)| at + 1)).collect(),
            broken_lines: BTreeSet::new(),
            may_hide_keys: false,
            may_misplace_keys: false,
            findings: RefCell::new(findings),
            is_described: false,
            is_recorded: Cell::new(false),
        };
        for error in &errors {
            source.note_syntax(error);
        }
        (source, tree)
    }

    /// Reports one fault per line, because the first error often causes others.
    fn note_syntax(&mut self, error: &Error) {
        let span = error.span().unwrap_or(self.text.len()..self.text.len());
        let location = self.location(span.start);
        let syntax = self.syntax(error.message(), span);
        if matches!(syntax, Syntax::Duplicate(_)) {
            self.refuse(location, &syntax);
            return;
        }
        self.may_hide_keys = true;
        self.may_misplace_keys |= self.line(location.line).trim_start().starts_with('[');
        if self.broken_lines.insert(location.line) {
            self.refuse(location, &syntax);
        }
    }

    fn syntax(&self, message: &str, span: Range<usize>) -> Syntax {
        let (before, after) = self.text.split_at(span.start);
        let digit_before = before.ends_with(|c: char| c.is_ascii_digit());
        let comma_after = after
            .strip_prefix(',')
            .is_some_and(|rest| rest.trim_start().starts_with(|c: char| c.is_ascii_digit()));
        if message == "duplicate key" {
            Syntax::Duplicate(keys::shortened(self.written(span)))
        } else if digit_before && comma_after {
            Syntax::Comma("a decimal comma is not TOML")
        } else {
            Syntax::Other(message.trim_end_matches(", expected nothing").into())
        }
    }

    /// The location of a byte. An offset beyond the end gives the end.
    pub(crate) fn location(&self, offset: usize) -> Location {
        let offset = offset.min(self.text.len());
        let line = self.lines.partition_point(|&start| start <= offset);
        let start = self.lines[line - 1];
        Location { line, column: self.text[start..offset].chars().count() + 1 }
    }

    fn line(&self, line: usize) -> &'a str {
        self.text[self.lines[line - 1]..].lines().next().unwrap_or_default()
    }

    /// The text at these bytes.
    pub(crate) fn written(&self, span: Range<usize>) -> &'a str {
        self.text.get(span).unwrap_or_default()
    }

    /// Whether the syntax of this line is faulty.
    pub(crate) fn is_broken(&self, location: Location) -> bool {
        self.broken_lines.contains(&location.line)
    }

    pub(crate) fn refuse(&self, location: Location, complaint: &impl Complaint) {
        self.findings.borrow_mut().faults.refuse(location, complaint);
    }

    pub(crate) fn close(&self, table: TableKeys) {
        self.findings.borrow_mut().tables.push(table);
    }

    /// Records a value in force.
    pub(crate) fn record(&self, value: impl FnOnce() -> InForce) {
        if self.is_recorded.get() {
            self.findings.borrow_mut().in_force.push(value());
        }
    }

    /// Number of values recorded so far.
    pub(crate) fn recorded(&self) -> usize {
        self.findings.borrow().in_force.len()
    }

    /// Reads a table that is not in force, for its keys alone.
    pub(crate) fn idly(&self, read: impl FnOnce()) {
        let before = self.is_recorded.replace(false);
        read();
        self.is_recorded.set(before);
    }

    pub(crate) fn take_in_force(&self) -> Vec<InForce> {
        std::mem::take(&mut self.findings.borrow_mut().in_force)
    }

    /// The tables that were read, after the last one is closed.
    pub(crate) fn into_tables(self) -> Vec<TableKeys> {
        self.findings.into_inner().tables
    }

    /// All faults, after the last table is closed.
    pub(crate) fn into_faults(self) -> Faults {
        let Findings { mut faults, tables, .. } = self.findings.into_inner();
        for (location, complaint) in keys::complaints(&tables) {
            let is_doubtful =
                if complaint.is_missing() { self.may_hide_keys } else { self.may_misplace_keys };
            if !is_doubtful && !self.broken_lines.contains(&location.line) {
                faults.refuse(location, &complaint);
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
        let location = |needle: &str| {
            let Location { line, column } = source.location(source.text.find(needle).unwrap());
            (line, column)
        };
        assert_eq!(location("a"), (1, 1));
        assert_eq!(location("\r"), (1, 6));
        assert_eq!(location("b"), (2, 1));
        assert_eq!(location("\" #"), (2, 8));
        assert_eq!(source.location(usize::MAX), Location { line: 3, column: 1 });
    }
}
