//! The values of a file that are in force, each with its place: also those that the file leaves out.

use super::{Table, source::Source};
use crate::{Faults, Location};

/// A value that a file gives, or that holds because the file leaves it out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InForce {
    /// Its key with the names of its tables and dots; `samples[1].name` in the second table of a list.
    pub name: String,
    /// The value as TOML. `None` for a key that the file leaves out and whose default is no single value.
    pub text: Option<String>,
    /// Where the file gives it; `None` for a default.
    pub location: Option<Location>,
}

/// Reads like [`read`](super::read), and also returns the values in force, in the order of the reader.
///
/// A table that the file may leave out as a whole has no values in force while it is left out, unless the
/// reader gives it a default.
pub fn in_force<T>(
    file: &str,
    text: &str,
    reader: impl FnOnce(&mut Table<'_>) -> T,
) -> (T, Faults, Vec<InForce>) {
    let (source, tree) = Source::parse(file, text);
    source.is_recorded.set(true);
    let root = Table::new(&source, String::new(), Location::START, Some(tree.get_ref()));
    let value = root.read(reader);
    let values = numbered(&source.take_in_force());
    (value, source.into_faults(), values)
}

/// Gives the tables of lists their numbers. The reader asks each of them for the same keys, so that the
/// n-th value of a name is that of the n-th table.
fn numbered(values: &[InForce]) -> Vec<InForce> {
    let number = |index: usize, value: &InForce| {
        let Some((_, rest)) = value.name.split_once('[') else { return value.clone() };
        let (list, key) = rest.split_once(']').unwrap_or((rest, ""));
        let before = values[..index].iter().filter(|other| other.name == value.name).count();
        InForce { name: format!("{list}[{before}]{key}"), ..value.clone() }
    };
    values.iter().enumerate().map(|(index, value)| number(index, value)).collect()
}
