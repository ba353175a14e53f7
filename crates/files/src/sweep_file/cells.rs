//! The cells of a line.

use std::{borrow::Cow, ops::Range};

/// The character between two cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    Tab,
    Semicolon,
    Comma,
    Spaces,
}

impl Separator {
    /// Characters that are rarer within a cell come first.
    pub(super) const ALL: [Self; 4] = [Self::Tab, Self::Semicolon, Self::Comma, Self::Spaces];

    /// Whether a line without this character can be skipped: other separators find its one cell.
    pub(super) const fn is_rare(self) -> bool {
        matches!(self, Self::Tab | Self::Semicolon)
    }

    /// A line without the blanks before it. A tab there stands between an empty cell and the next one, as
    /// in the files of Gamry.
    pub(super) fn trim_start(self, line: &str) -> &str {
        line.trim_start_matches(|character: char| {
            character.is_whitespace() && (self == Self::Spaces || !self.is(character))
        })
    }

    pub(super) fn is(self, character: char) -> bool {
        match self {
            Self::Tab => character == '\t',
            Self::Semicolon => character == ';',
            Self::Comma => character == ',',
            Self::Spaces => character.is_whitespace(),
        }
    }
}

/// A cell, without the blanks and quotation marks around it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct CsvCell<'a> {
    pub(super) text: Cow<'a, str>,
    /// Byte of the line at which it begins.
    pub(super) at: usize,
}

/// The cells of a line.
///
/// # Errors
/// The byte of a quotation mark that is not closed.
pub(super) fn cells(line: &str, separator: Separator) -> Result<Vec<CsvCell<'_>>, usize> {
    let mut found = Vec::new();
    let mut begin = 0;
    // The open quotation mark of a cell that begins with one.
    let (mut is_quoted, mut open) = (false, None);
    for (at, character) in line.char_indices() {
        if character == '"' {
            is_quoted |= line[begin..at].trim().is_empty();
            // Two marks within a quoted cell close and open it again.
            open = if is_quoted && open.is_none() { Some(at) } else { None };
        } else if open.is_none() && separator.is(character) {
            push(&mut found, line, begin..at, separator);
            begin = at + character.len_utf8();
            is_quoted = false;
        }
    }
    if let Some(at) = open {
        return Err(at);
    }
    push(&mut found, line, begin..line.len(), separator);
    Ok(found)
}

fn push<'a>(found: &mut Vec<CsvCell<'a>>, line: &'a str, cell: Range<usize>, separator: Separator) {
    let raw = &line[cell.clone()];
    let text = raw.trim();
    if separator == Separator::Spaces && text.is_empty() {
        return;
    }
    let at = cell.start + raw.len() - raw.trim_start().len();
    let text = match text.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')) {
        Some(inner) if inner.contains("\"\"") => Cow::Owned(inner.replace("\"\"", "\"")),
        Some(inner) => Cow::Borrowed(inner.trim()),
        None => Cow::Borrowed(text),
    };
    found.push(CsvCell { text, at });
}
