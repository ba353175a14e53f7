//! Unknown and missing keys.

use crate::{Complaint, Location};

/// The keys that a reader asked a table for, and the keys that the table has.
#[derive(Debug)]
pub(crate) struct TableKeys {
    /// Dotted name of the table; empty at the root.
    pub(crate) path: String,
    pub(crate) location: Location,
    /// Keys that the reader asked for.
    pub(crate) asked: Vec<&'static str>,
    /// Keys of the table that the reader asked for.
    pub(crate) present: Vec<&'static str>,
    /// Required keys that the table does not have.
    pub(crate) missing: Vec<&'static str>,
    /// Keys of the table that the reader did not ask for.
    pub(crate) unknown: Vec<(String, Location)>,
    /// Keys that the reader asked for, each with its schema, while a schema is made.
    pub(crate) described: Vec<Described>,
}

/// A key and what its value may be.
#[derive(Debug)]
pub(crate) struct Described {
    pub(crate) key: &'static str,
    pub(crate) schema: serde_json::Value,
    pub(crate) is_required: bool,
}

impl TableKeys {
    pub(crate) fn new(path: String, location: Location) -> Self {
        let (asked, present, missing) = (vec![], vec![], vec![]);
        let (unknown, described) = (vec![], vec![]);
        Self { path, location, asked, present, missing, unknown, described }
    }

    /// Keys that the reader asked for and the table does not have.
    fn free(&self) -> Vec<&'static str> {
        self.asked.iter().filter(|asked| !self.present.contains(asked)).copied().collect()
    }
}

/// A missing or unknown key.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeyFault {
    #[error("`{key}` is missing {}", within(path))]
    Missing { key: &'static str, path: String },
    #[error("`{key}` is not a key {}", within(path))]
    Unknown { key: String, path: String, suggestion: Suggestion },
}

/// The probable meaning of an unknown key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Suggestion {
    /// A key of the same table.
    Key(&'static str),
    /// The key belongs to another table.
    Table(String),
    /// No probable meaning; these are the keys of the table.
    OneOf(Vec<&'static str>),
}

impl KeyFault {
    pub(crate) fn is_missing(&self) -> bool {
        matches!(self, Self::Missing { .. })
    }
}

impl Complaint for KeyFault {
    fn suggestion(&self) -> Option<String> {
        let Self::Unknown { suggestion, .. } = self else { return None };
        match suggestion {
            Suggestion::Key(key) => Some(format!("did you mean `{key}`?")),
            Suggestion::Table(path) => Some(format!("it belongs {}", within(path))),
            Suggestion::OneOf(keys) if keys.is_empty() => Some("remove it".into()),
            Suggestion::OneOf(keys) => Some(format!("the keys there are {}", keys.join(", "))),
        }
    }
}

/// The table, in the words of a message.
fn within(path: &str) -> String {
    if path.is_empty() { "at the top of the file".into() } else { format!("in [{path}]") }
}

/// The faults of the keys of all tables.
///
/// A missing key that is misspelt or written in another table is one mistake and gives one fault.
pub(crate) fn complaints(tables: &[TableKeys]) -> Vec<(Location, KeyFault)> {
    let mut complaints = Vec::new();
    // Missing keys whose misspelling was found, each with the index of its table.
    let mut explained = Vec::new();
    for (index, table) in tables.iter().enumerate() {
        for (key, location) in &table.unknown {
            let suggestion = if let Some(meant) = nearest(key, &table.free()) {
                explained.push((index, meant));
                Suggestion::Key(meant)
            } else if let Some((index, meant)) = elsewhere(key, &table.path, tables) {
                explained.push((index, meant));
                Suggestion::Table(tables[index].path.clone())
            } else {
                Suggestion::OneOf(table.asked.clone())
            };
            let (key, path) = (shortened(key), table.path.clone());
            complaints.push((*location, KeyFault::Unknown { key, path, suggestion }));
        }
    }
    for (index, table) in tables.iter().enumerate() {
        for &key in &table.missing {
            if !explained.contains(&(index, key)) {
                let path = table.path.clone();
                complaints.push((table.location, KeyFault::Missing { key, path }));
            }
        }
    }
    complaints
}

/// The index of another table that takes this key. A table that requires it comes first.
fn elsewhere(key: &str, path: &str, tables: &[TableKeys]) -> Option<(usize, &'static str)> {
    let find = |keys: fn(&TableKeys) -> Vec<&'static str>| {
        let others = tables.iter().enumerate().filter(|(_, other)| other.path != path);
        let mut candidates =
            others.flat_map(|(index, other)| keys(other).into_iter().map(move |key| (index, key)));
        candidates.find(|(_, free)| *free == key)
    };
    find(|table| table.missing.clone()).or_else(|| find(TableKeys::free))
}

/// The word nearest to `written`, if one is near.
pub(crate) fn nearest<'a>(written: &str, words: &[&'a str]) -> Option<&'a str> {
    // Two letters of five may differ: `indentaton_mm` is near `indentation_mm`, `depth` is near nothing.
    const LEAST_LIKENESS: f64 = 0.6;
    // All keys are much shorter. The time of a comparison grows with the length.
    const MAX_CHARS: usize = 64;
    if written.chars().count() > MAX_CHARS {
        return None;
    }
    let written = written.to_lowercase();
    let likeness = |word: &str| strsim::normalized_damerau_levenshtein(&written, word);
    let near = words.iter().map(|word| (likeness(word), *word));
    let near = near.filter(|(likeness, _)| *likeness >= LEAST_LIKENESS);
    // The first of equally near words, so that the result is always the same.
    near.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, word)| word)
}

/// The start of `written` for a message: one line of at most 60 characters.
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
