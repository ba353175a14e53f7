//! A fault of a file: its location, a message and advice.

use std::fmt;

/// A character of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Location {
    /// Number of the line, from 1.
    pub line: usize,
    /// Number of the character in its line, from 1.
    pub column: usize,
}

impl Location {
    /// The first character of a file.
    pub(crate) const START: Self = Self { line: 1, column: 1 };
}

/// The reason of a fault. The crate that knows a rule has an enum of its complaints, each displayed
/// as a fragment that names the key, its value and the limit.
pub trait Complaint: fmt::Display {
    /// Advice to the person: a fragment such as `use at most 2`.
    fn suggestion(&self) -> Option<String> {
        None
    }
}

/// One fault of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Name of the file, as the person gave it.
    pub file: String,
    /// Location of the faulty value.
    pub location: Location,
    /// The reason: a fragment that names the key, its value and the limit.
    pub message: String,
    /// Advice to the person.
    pub suggestion: Option<String>,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, location: Location { line, column }, message, suggestion } = self;
        write!(f, "{file}:{line}:{column}: {message}")?;
        match suggestion {
            Some(suggestion) => write!(f, "; {suggestion}"),
            None => Ok(()),
        }
    }
}

/// Largest number of faults in the keys of a file that are reported. A file written by hand has fewer.
const FAULTS_MAX: usize = 50;

/// Faults beyond the largest number.
#[derive(Debug, thiserror::Error)]
#[error("the file has {more} more faults from here on")]
struct More {
    more: usize,
}

impl Complaint for More {
    fn suggestion(&self) -> Option<String> {
        Some("correct these first".to_owned())
    }
}

/// All faults of a file, in the order of its lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Faults {
    file: String,
    list: Vec<Fault>,
}

impl Faults {
    /// An empty list for the file of this name.
    pub fn new(file: impl Into<String>) -> Self {
        Self { file: file.into(), list: Vec::new() }
    }

    /// Adds a complaint about the setting at `location`.
    pub fn refuse(&mut self, location: impl Into<Location>, complaint: &(impl Complaint + ?Sized)) {
        let location = location.into();
        let fault = Fault {
            file: self.file.clone(),
            location,
            message: complaint.to_string(),
            suggestion: complaint.suggestion(),
        };
        // Faults at one location keep the order in which the reader found them.
        let at = self.list.partition_point(|earlier| earlier.location <= location);
        self.list.insert(at, fault);
    }

    /// Whether the file has no faults.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Number of faults.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// The faults in the order of the lines.
    pub fn iter(&self) -> std::slice::Iter<'_, Fault> {
        self.list.iter()
    }

    /// Keeps the first faults of a file that is full of them, and says how many more it has.
    pub(crate) fn shorten(&mut self) {
        let more = self.list.len().saturating_sub(FAULTS_MAX);
        if let (1.., Some(first)) = (more, self.list.get(FAULTS_MAX)) {
            let location = first.location;
            self.list.truncate(FAULTS_MAX);
            self.refuse(location, &More { more });
        }
    }

    /// Adds the faults of another file at the end.
    pub fn append(&mut self, other: Self) {
        self.list.extend(other.list);
    }

    /// The value of a file without faults.
    ///
    /// # Errors
    /// The faults, if there are any.
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
