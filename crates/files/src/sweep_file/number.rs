//! Numbers in the formats of instruments and spreadsheets.

use super::fault::SweepFileFault;

/// Smallest of the numbers that mean none in SCPI: 9.9e37 is infinity, 9.91e37 is not a number.
const NO_NUMBER: f64 = 9.9e37;

/// Reads the numbers of a file, which has one kind of decimal mark.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Numbers {
    mark: Option<char>,
}

/// The value of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value {
    Number(f64),
    /// The instrument was overloaded.
    Overload,
    /// The file says with this word that there is no number.
    Missing(&'static str),
}

impl Numbers {
    /// The number in a cell.
    pub(super) fn read(&mut self, text: &str) -> Result<Value, SweepFileFault> {
        if ["OL", "OF", "OVLD", "OVERLOAD"].iter().any(|word| text.eq_ignore_ascii_case(word)) {
            return Ok(Value::Overload);
        }
        let missing = ["NaN", "N/A", "#N/A", "---"];
        if let Some(word) = missing.into_iter().find(|word| text.eq_ignore_ascii_case(word)) {
            return Ok(Value::Missing(word));
        }
        let refused = || SweepFileFault::NotANumber { text: excerpt(text) };
        let mut marks = text.chars().filter(|character| matches!(character, '.' | ','));
        let number: f64 = match (marks.next(), marks.next()) {
            (Some(_), Some(_)) => return Err(refused()),
            (Some(','), None) => text.replace(',', ".").parse(),
            _ => text.parse(),
        }
        .map_err(|_| refused())?;
        if !number.is_finite() {
            return Err(refused());
        }
        if let Some(mark) = text.chars().find(|character| matches!(character, '.' | ','))
            && *self.mark.get_or_insert(mark) != mark
        {
            return Err(SweepFileFault::MixedMarks { text: excerpt(text) });
        }
        Ok(if number.abs() < NO_NUMBER { Value::Number(number) } else { Value::Overload })
    }
}

/// The start of a text, for a message.
pub(super) fn excerpt(text: &str) -> String {
    const CHARACTERS: usize = 40;
    match text.char_indices().nth(CHARACTERS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
