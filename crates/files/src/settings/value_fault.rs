//! Faults of a single value.

use std::fmt;

use toml::de::DeValue;

use crate::Complaint;

/// The value at fault, in the words of a message.
#[derive(Debug)]
pub(crate) struct FaultyValue {
    pub(crate) key: &'static str,
    /// Its text in the file; `None` for lists and tables, which are too long for a message.
    pub(crate) written: Option<String>,
    pub(crate) is_item: bool,
}

impl fmt::Display for FaultyValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, written, is_item } = self;
        match (written, is_item) {
            (Some(written), true) => write!(f, "{written} in {key}"),
            (Some(written), false) => write!(f, "{key} = {written}"),
            (None, true) => write!(f, "each of {key}"),
            (None, false) => f.write_str(key),
        }
    }
}

/// The allowed side of a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bound {
    /// At the limit or above.
    AtLeast,
    /// Above the limit.
    Above,
    /// At the limit or below.
    AtMost,
}

/// A limit of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limit<T> {
    pub(crate) bound: Bound,
    pub(crate) value: T,
}

impl<T: Copy + PartialOrd> Limit<T> {
    pub(crate) fn at_least(value: T) -> Self {
        Self { bound: Bound::AtLeast, value }
    }

    pub(crate) fn above(value: T) -> Self {
        Self { bound: Bound::Above, value }
    }

    pub(crate) fn at_most(value: T) -> Self {
        Self { bound: Bound::AtMost, value }
    }

    pub(crate) fn allows(&self, number: T) -> bool {
        match self.bound {
            Bound::AtLeast => number >= self.value,
            Bound::Above => number > self.value,
            Bound::AtMost => number <= self.value,
        }
    }
}

/// A fault of a value.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ValueFault {
    #[error("{subject} must be {expected}, not {found}")]
    Kind {
        subject: FaultyValue,
        expected: &'static str,
        found: &'static str,
        suggestion: Option<String>,
    },
    #[error("{0} is not a finite number")]
    NotFinite(FaultyValue),
    #[error("{subject} is {side} the limit of {limit}")]
    Outside { subject: FaultyValue, side: &'static str, limit: String, suggestion: String },
    #[error("{0} is empty")]
    EmptyText(FaultyValue),
    #[error("{subject} has the control character U+{:04X}", u32::from(*character))]
    ControlCharacter { subject: FaultyValue, character: char },
    #[error("{subject} has {count} characters, above the limit of {max}")]
    LongText { subject: FaultyValue, count: usize, max: usize },
    #[error("{0} is an empty list")]
    EmptyList(&'static str),
    #[error("{key} has {count} entries, above the limit of {max}")]
    LongList { key: &'static str, count: usize, max: usize },
    #[error("{key} is not two rising numbers")]
    NotAnInterval { key: &'static str, count: usize, are_equal: bool },
    #[error("{subject} is not one of {}", quoted(words))]
    NotAChoice { subject: FaultyValue, words: Vec<&'static str>, meant: Option<&'static str> },
}

impl ValueFault {
    /// A value of another type than the expected one.
    pub(crate) fn kind(subject: FaultyValue, expected: &'static str, value: &DeValue<'_>) -> Self {
        let (found, suggestion) = match value {
            DeValue::String(text) => {
                let is_number = text.parse::<f64>().is_ok() && expected.contains("number");
                ("text", is_number.then(|| "remove the quotes".to_owned()))
            }
            DeValue::Integer(_) => ("a whole number", None),
            DeValue::Float(_) => ("a number with a fraction", None),
            DeValue::Boolean(_) => ("true or false", None),
            DeValue::Datetime(_) => ("a date", None),
            DeValue::Array(_) => ("a list", None),
            DeValue::Table(_) => ("a table", None),
        };
        let suggestion = match (expected, &subject.written) {
            ("text", Some(written)) => Some(format!("write \"{written}\"")),
            ("a list", Some(written)) => Some(format!("write [{written}]")),
            _ => suggestion,
        };
        Self::Kind { subject, expected, found, suggestion }
    }

    /// A number beyond a limit. `hint` names another unit in which it is right.
    pub(crate) fn outside<T: fmt::Display>(
        subject: FaultyValue,
        limit: Limit<T>,
        hint: Option<String>,
    ) -> Self {
        let Limit { bound, value } = limit;
        let (side, use_what) = match bound {
            Bound::AtLeast => ("below", "at least"),
            Bound::Above => ("not above", "more than"),
            Bound::AtMost => ("above", "at most"),
        };
        let hint = hint.map(|hint| format!("; {hint}")).unwrap_or_default();
        let suggestion = format!("use {use_what} {value}{hint}");
        let limit = format!("{value}{}", unit(subject.key));
        Self::Outside { subject, side, limit, suggestion }
    }
}

impl Complaint for ValueFault {
    fn suggestion(&self) -> Option<String> {
        match self {
            Self::Kind { suggestion, .. } => suggestion.clone(),
            Self::Outside { suggestion, .. } => Some(suggestion.clone()),
            Self::NotAChoice { meant, .. } => {
                meant.map(|meant| format!("did you mean \"{meant}\"?"))
            }
            Self::EmptyList(_) => Some("give at least one, or leave the key out".into()),
            Self::NotAnInterval { are_equal: true, .. } => {
                Some("give two different numbers".into())
            }
            Self::NotAnInterval { count, .. } if *count == 2 => {
                Some("put the smaller one first".into())
            }
            Self::NotAnInterval { .. } => Some("give the lowest and the highest value".into()),
            Self::ControlCharacter { .. } => Some("keep it in one line".into()),
            Self::LongText { .. } => Some("shorten it".into()),
            Self::LongList { .. } => Some("leave some out".into()),
            Self::NotFinite(_) | Self::EmptyText(_) => None,
        }
    }
}

fn quoted(words: &[&str]) -> String {
    let quoted: Vec<_> = words.iter().map(|word| format!("\"{word}\"")).collect();
    quoted.join(", ")
}

/// The unit of a key, in the form that follows a number.
fn unit(key: &str) -> &'static str {
    // Longer endings come first: `_mm_per_s` also ends in `_s`.
    const UNITS: [(&str, &str); 14] = [
        ("_mm_per_s", " mm/s"),
        ("_deg_per_s", " °/s"),
        ("_mm", " mm"),
        ("_deg", "°"),
        ("_hz", " Hz"),
        ("_s", " s"),
        ("_v", " V"),
        ("_ohm", " ohm"),
        ("_mpa", " MPa"),
        ("_gpa", " GPa"),
        ("_kg_per_m3", " kg/m³"),
        ("_c_per_m2", " C/m²"),
        ("_j_per_m2", " J/m²"),
        ("_nf_per_m", " nF/m"),
    ];
    UNITS.iter().find(|(ending, _)| key.ends_with(ending)).map_or("", |(_, unit)| unit)
}
