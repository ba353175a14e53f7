//! Reads TOML and reports every fault at once, each with line, column and a suggestion.
//!
//! A file is read by plain functions that ask a [`Table`] for its keys. What they ask for is what
//! the file may hold: a key that nobody asked for is a fault, and so is a required key that is not
//! there, a value of the wrong type, or one outside its range. A fault never stops the reading;
//! the reader gets a placeholder and goes on, so that a person sees all faults of a file at once.
//!
//! ```
//! use rig_settings::Table;
//!
//! struct Sweep { settle_s: f64, cycles: u32 }
//!
//! fn sweep(table: &mut Table<'_>) -> Sweep {
//!     Sweep {
//!         settle_s: table.number("settle_s").range(0.0..=60.0).required().value,
//!         cycles: table.count("cycles").at_least(1).or(10).value,
//!     }
//! }
//!
//! let text = "settle = 0.1\ncycles = 0\n";
//! let (_, faults) = rig_settings::read("sweep.toml", text, sweep);
//! assert_eq!(
//!     faults.to_string(),
//!     "sweep.toml:1:1: `settle` is not a key at the top of the file; did you mean `settle_s`?\n\
//!      sweep.toml:2:10: cycles = 0 is below the limit of 1; use at least 1"
//! );
//! ```
//!
//! Each value comes as a [`Setting`] that remembers its [`Place`], so that a later check (a
//! protocol against a rig) points at the right key too. What the values mean is left to others.

#![deny(clippy::disallowed_methods)]

mod fault;
mod kind;
mod setting;
mod shape;
mod slip;
mod source;
mod table;
mod text;
mod wrong;

#[cfg(test)]
mod tests;

pub use fault::{Complaint, Fault, Faults, Place};
pub use kind::{Choice, Flag, Interval, Kind, List, Number, Section, Text, Whole};
pub use setting::Setting;
pub use slip::slip;
pub use table::{Entry, Table};
pub use text::text;

use source::Source;

/// Reads the TOML `text` of the file `file` with `reader`, which gets the table at the root.
///
/// Returns what the reader made of it together with everything that is wrong with it. The value
/// holds placeholders wherever there are faults; [`Faults::finish`] gives it out only when there
/// are none.
pub fn read<T>(file: &str, text: &str, reader: impl FnOnce(&mut Table<'_>) -> T) -> (T, Faults) {
    let (source, tree) = Source::parse(file, text);
    let root = Table::new(&source, String::new(), Place::START, Some(tree.get_ref()));
    let value = root.read(reader);
    (value, source.into_faults())
}
