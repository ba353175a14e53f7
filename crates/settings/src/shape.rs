//! Which keys are there and which should be.

use crate::{Complaint, Place};

/// What one table was asked for and what it holds.
#[derive(Debug)]
pub(crate) struct Record {
    /// Dotted name of the table; empty at the root.
    pub(crate) path: String,
    pub(crate) place: Place,
    /// Keys that the reader asked for.
    pub(crate) asked: Vec<&'static str>,
    /// Keys that are there and were asked for.
    pub(crate) present: Vec<&'static str>,
    /// Keys that the reader must have and did not get.
    pub(crate) missing: Vec<&'static str>,
    /// Keys that nobody asked for, and where.
    pub(crate) unknown: Vec<(String, Place)>,
}

impl Record {
    pub(crate) fn new(path: String, place: Place) -> Self {
        let (asked, present, missing, unknown) = (vec![], vec![], vec![], vec![]);
        Self { path, place, asked, present, missing, unknown }
    }

    /// Keys that may be given and are not.
    fn free(&self) -> Vec<&'static str> {
        self.asked.iter().filter(|asked| !self.present.contains(asked)).copied().collect()
    }
}

/// What is wrong with the shape of a file.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Shape {
    #[error("`{key}` is missing {}", within(path))]
    Missing { key: &'static str, path: String },
    #[error("`{key}` is not a key {}", within(path))]
    Unknown { key: String, path: String, instead: Instead },
}

/// What a person may have meant by an unknown key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Instead {
    /// A key of the same table.
    Key(&'static str),
    /// The same key in another table.
    Table(String),
    /// Nothing known: these are the keys of the table.
    OneOf(Vec<&'static str>),
}

impl Shape {
    pub(crate) fn is_missing(&self) -> bool {
        matches!(self, Self::Missing { .. })
    }
}

impl Complaint for Shape {
    fn suggestion(&self) -> Option<String> {
        let Self::Unknown { instead, .. } = self else { return None };
        match instead {
            Instead::Key(key) => Some(format!("did you mean `{key}`?")),
            Instead::Table(path) => Some(format!("it belongs {}", within(path))),
            Instead::OneOf(keys) if keys.is_empty() => Some("remove it".into()),
            Instead::OneOf(keys) => Some(format!("the keys there are {}", keys.join(", "))),
        }
    }
}

/// The table as a person names it.
fn within(path: &str) -> String {
    if path.is_empty() { "at the top of the file".into() } else { format!("in [{path}]") }
}

/// The complaints about all tables together.
///
/// A key that is missing in one place is not complained about when it was found misspelt there or
/// written in another table: that is one mistake.
pub(crate) fn complaints(records: &[Record]) -> Vec<(Place, Shape)> {
    let mut complaints = Vec::new();
    // Missing keys that an unknown one explains, each with the index of its table.
    let mut explained = Vec::new();
    for (index, record) in records.iter().enumerate() {
        for (key, place) in &record.unknown {
            let instead = if let Some(meant) = nearest(key, &record.free()) {
                explained.push((index, meant));
                Instead::Key(meant)
            } else if let Some((index, meant)) = elsewhere(key, &record.path, records) {
                explained.push((index, meant));
                Instead::Table(records[index].path.clone())
            } else {
                Instead::OneOf(record.asked.clone())
            };
            let (key, path) = (shortened(key), record.path.clone());
            complaints.push((*place, Shape::Unknown { key, path, instead }));
        }
    }
    for (index, record) in records.iter().enumerate() {
        for &key in &record.missing {
            if !explained.contains(&(index, key)) {
                let path = record.path.clone();
                complaints.push((record.place, Shape::Missing { key, path }));
            }
        }
    }
    complaints
}

/// The table, if any, that has room for this very key: one that must have it before one that may.
fn elsewhere(key: &str, path: &str, records: &[Record]) -> Option<(usize, &'static str)> {
    let find = |keys: fn(&Record) -> Vec<&'static str>| {
        let others = records.iter().enumerate().filter(|(_, other)| other.path != path);
        let mut places =
            others.flat_map(|(index, other)| keys(other).into_iter().map(move |key| (index, key)));
        places.find(|(_, free)| *free == key)
    };
    find(|record| record.missing.clone()).or_else(|| find(Record::free))
}

/// The word that `written` was probably meant to be, if any is near enough.
pub(crate) fn nearest<'a>(written: &str, words: &[&'a str]) -> Option<&'a str> {
    // Two letters in five may be wrong: `depth` becomes nothing else, `indentaton_mm` does.
    const LEAST_LIKENESS: f64 = 0.6;
    // No key is nearly as long; the time for a comparison grows with the length.
    const MAX_CHARS: usize = 64;
    if written.chars().count() > MAX_CHARS {
        return None;
    }
    let written = written.to_lowercase();
    let likeness = |word: &str| strsim::normalized_damerau_levenshtein(&written, word);
    let near = words.iter().map(|word| (likeness(word), *word));
    let near = near.filter(|(likeness, _)| *likeness >= LEAST_LIKENESS);
    // The first of equals, so that the answer does not depend on chance.
    near.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, word)| word)
}

/// What a person wrote, fit for a message: one line, not too long.
pub(crate) fn shortened(written: &str) -> String {
    const MAX_CHARS: usize = 60;
    let line = written.lines().next().unwrap_or_default();
    let end = line.char_indices().nth(MAX_CHARS).map_or(line.len(), |(at, _)| at);
    let printable = |character: char| if character.is_control() { '�' } else { character };
    let short: String = line[..end].chars().map(printable).collect();
    if end < written.len() { short + "…" } else { short }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_word_is_found_and_a_far_one_is_not() {
        #[track_caller]
        fn check(written: &str, words: &[&str], expected: Option<&str>) {
            assert_eq!(nearest(written, words), expected);
        }
        check("indentaton_mm", &["dwell_s", "indentation_mm"], Some("indentation_mm"));
        check("indentation", &["dwell_s", "indentation_mm"], Some("indentation_mm"));
        check("Left", &["front", "back", "left"], Some("left"));
        check("randm", &["listed", "random"], Some("random"));
        check("depth_mm", &["dwell_s", "indentation_mm"], None);
        check("x", &[], None);
    }
}
