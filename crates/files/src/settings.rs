//! Reads TOML and reports all faults, each with line, column and advice.
//!
//! Plain functions read a file: they ask a [`Table`] for its keys. The keys that they ask for are
//! the keys that the file may have. An unknown key, a missing required key, a value of the wrong type
//! and a value outside its range are faults. A fault never stops the reading: the reader gets a
//! placeholder and continues, so that a person sees all faults of a file at once.
//!
//! ```
//! use rig_files::settings::{self, Table};
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
//! let (_, faults) = settings::read("sweep.toml", text, sweep);
//! assert_eq!(
//!     faults.to_string(),
//!     "sweep.toml:1:1: `settle` is not a key at the top of the file; did you mean `settle_s`?\n\
//!      sweep.toml:2:10: cycles = 0 is below the limit of 1; use at least 1"
//! );
//! ```
//!
//! Each value is a [`Setting`] with its [`Location`], so that a later check (a protocol against a
//! rig) also names the line and column of the key. The meaning of the values is not checked here.

mod in_force;
mod keys;
mod kind;
mod schema;
mod setting;
mod source;
mod table;
mod text;
mod unit_hint;
mod value_fault;

#[cfg(test)]
mod tests;

pub use in_force::{InForce, in_force};
pub use kind::{Choice, ChoiceOrFile, Flag, Integer, Interval, Kind, List, Number, Section, Text};
pub use schema::schema;
pub use setting::Setting;
pub use table::{Entry, Presence, Table};
pub use text::text;
pub use unit_hint::unit_hint;
pub(crate) use unit_hint::with_unit_hint;

use crate::{Faults, Location};
use source::Source;

/// Reads the TOML `text` of the file `file` with `reader`, which gets the table at the root.
///
/// Returns the value of the reader and the faults of the file: the first fifty, and the number of the
/// others. The value has a placeholder for each
/// faulty setting; [`Faults::finish`] returns it only without faults.
pub fn read<T>(file: &str, text: &str, reader: impl FnOnce(&mut Table<'_>) -> T) -> (T, Faults) {
    let (source, tree) = Source::parse(file, text);
    let root = Table::new(&source, String::new(), Location::START, Some(tree.get_ref()));
    let value = root.read(reader);
    let mut faults = source.into_faults();
    faults.shorten();
    (value, faults)
}
