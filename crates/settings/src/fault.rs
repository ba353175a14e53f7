//! What is wrong with a file, and where.

use std::fmt;

use crate::Setting;

/// A place in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    /// Counts from 1.
    pub line: usize,
    /// In characters, from 1.
    pub column: usize,
}

impl Place {
    /// Where a file begins.
    pub const START: Self = Self { line: 1, column: 1 };
}

impl<T> From<&Setting<T>> for Place {
    fn from(setting: &Setting<T>) -> Self {
        setting.place
    }
}

/// What can be said against a setting: the crate that knows a rule has an enum of these.
pub trait Complaint: fmt::Display {
    /// What the person may do about it: a fragment such as `use at most 2`.
    fn suggestion(&self) -> Option<String> {
        None
    }
}

/// One thing that is wrong with a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// The file, by the name that the person gave.
    pub file: String,
    /// Where in it.
    pub place: Place,
    /// What is wrong: a fragment that names the key, its value and the limit.
    pub message: String,
    /// What to do about it.
    pub suggestion: Option<String>,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, place: Place { line, column }, message, suggestion } = self;
        write!(f, "{file}:{line}:{column}: {message}")?;
        match suggestion {
            Some(suggestion) => write!(f, "; {suggestion}"),
            None => Ok(()),
        }
    }
}

/// Everything that is wrong with a file, in the order of its lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Faults {
    file: String,
    list: Vec<Fault>,
}

impl Faults {
    /// No faults of this file yet.
    pub fn new(file: impl Into<String>) -> Self {
        Self { file: file.into(), list: Vec::new() }
    }

    /// Notes a complaint about the setting at `place`.
    pub fn refuse(&mut self, place: impl Into<Place>, complaint: &(impl Complaint + ?Sized)) {
        let place = place.into();
        let fault = Fault {
            file: self.file.clone(),
            place,
            message: complaint.to_string(),
            suggestion: complaint.suggestion(),
        };
        // After those at the same place, so that a reader's own order is kept.
        let at = self.list.partition_point(|earlier| earlier.place <= place);
        self.list.insert(at, fault);
    }

    /// Whether nothing is wrong.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// The faults in the order of the lines.
    pub fn iter(&self) -> std::slice::Iter<'_, Fault> {
        self.list.iter()
    }

    /// The faults of another file, after those of this one.
    pub fn append(&mut self, other: Self) {
        self.list.extend(other.list);
    }

    /// The value, when nothing is wrong.
    ///
    /// # Errors
    /// The faults, when there are any.
    pub fn finish<T>(self, value: T) -> Result<T, Self> {
        if self.list.is_empty() { Ok(value) } else { Err(self) }
    }
}

impl<'a> IntoIterator for &'a Faults {
    type Item = &'a Fault;
    type IntoIter = std::slice::Iter<'a, Fault>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, fault) in self.list.iter().enumerate() {
            let separator = if index == 0 { "" } else { "\n" };
            write!(f, "{separator}{fault}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Faults {}
