//! Numbers in the formats of instruments and spreadsheets.

use super::fault::SweepFileFault;

/// Smallest of the numbers that mean none in SCPI: 9.9e37 is infinity, 9.91e37 is not a number.
const NO_NUMBER: f64 = 9.9e37;

/// Reads the numbers of a file, which has one kind of decimal mark.
#[derive(Debug, Clone, Default)]
pub(super) struct Numbers {
    mark: Option<char>,
    /// Commas separate the cells, so that they are no decimal marks.
    are_commas_taken: bool,
    /// The first number whose comma may be a mark for thousands.
    thousands: Option<String>,
    /// Whether a comma is surely a decimal mark.
    is_decimal: bool,
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
    /// Those of a file whose cells are separated by commas, or by something else.
    pub(super) fn new(are_commas_taken: bool) -> Self {
        Self { are_commas_taken, ..Self::default() }
    }

    /// A number of which it cannot be told whether its comma is a decimal mark.
    pub(super) fn ambiguous(&self) -> Option<&str> {
        self.thousands.as_deref().filter(|_| !self.is_decimal)
    }

    /// The number in a cell.
    pub(super) fn read(&mut self, text: &str) -> Result<Value, SweepFileFault> {
        if ["OL", "OF", "OVLD", "OVERLOAD"].iter().any(|word| text.eq_ignore_ascii_case(word)) {
            return Ok(Value::Overload);
        }
        if let Some(word) = missing(text) {
            return Ok(Value::Missing(word));
        }
        let refused = || SweepFileFault::NotANumber { text: excerpt(text) };
        let mut marks = text.chars().filter(|character| matches!(character, '.' | ','));
        let number: f64 = match (marks.next(), marks.next()) {
            (Some(_), Some(_)) => return Err(refused()),
            (Some(','), None) if self.are_commas_taken => return Err(refused()),
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
        match text.split_once(',') {
            Some((before, after)) if is_thousands(before, after) => {
                self.thousands.get_or_insert_with(|| excerpt(text));
            }
            Some(_) => self.is_decimal = true,
            None => {}
        }
        Ok(if number.abs() < NO_NUMBER { Value::Number(number) } else { Value::Overload })
    }
}

/// The word of a cell that says that there is no number.
pub(super) fn missing(text: &str) -> Option<&'static str> {
    ["NaN", "N/A", "#N/A", "---"].into_iter().find(|word| text.eq_ignore_ascii_case(word))
}

/// Whether a comma between these is where a mark for thousands would be.
fn is_thousands(before: &str, after: &str) -> bool {
    let before = before.trim_start_matches(['+', '-']);
    let are_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    (1..=3).contains(&before.len())
        && !before.starts_with('0')
        && after.len() == 3
        && are_digits(before)
        && are_digits(after)
}

/// The start of a text, for a message.
pub(super) fn excerpt(text: &str) -> String {
    const CHARACTERS: usize = 40;
    match text.char_indices().nth(CHARACTERS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
