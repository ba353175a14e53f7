//! Instrument files: what an analyzer or an axis drive must be told.
//!
//! Those in `config/instruments` are in the program ([`Dialect::of`], [`RegisterMap::of`]); a rig file
//! names another one by the path of its file. `docs/instruments.md` says what a file can express. Neither
//! the interlock nor the way out of contact is in such a file.

mod answer_keys;
mod compensation_keys;
pub mod dialect;
mod dialect_keys;
pub mod drive;
mod drive_keys;
mod fault;
mod register_keys;
mod shipped;
pub mod template;

#[cfg(test)]
mod tests;

use std::{
    collections::HashMap,
    path::PathBuf,
    sync::{LazyLock, Mutex, PoisonError},
};

pub use dialect::Dialect;
pub use drive::RegisterMap;
pub use shipped::{
    HIOKI_IM3536, HP_4284A, IAI_RC, KEYSIGHT_E4980A, KEYSIGHT_E4990A, LEADSHINE_PR, ORIENTAL_AZ,
    TONGHUI_TH283X, shipped_text,
};

use crate::{
    Faults, Location,
    settings::{self, Table},
};

/// The instrument that a rig file names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Named<M> {
    /// One that is shipped.
    Shipped(M),
    /// One that has a file.
    File {
        /// The file, relative to the directory of the rig file.
        path: PathBuf,
        /// Where the rig file names it.
        location: Location,
    },
}

/// The end of the name of an instrument file.
pub(crate) const ENDING: &str = ".toml";

impl Dialect {
    /// Reads and checks the `text` of the file of an analyzer.
    ///
    /// # Errors
    /// All faults of the file.
    pub fn read(file: &str, text: &str) -> Result<Self, Faults> {
        let (dialect, faults) = settings::read(file, text, |table| {
            let dialect = dialect_keys::dialect(table);
            refuse_shipped_name(table, &dialect.name);
            dialect
        });
        faults.finish(dialect)
    }

    /// Reads one like [`read`](Self::read), and keeps it for as long as the program runs: drivers and
    /// messages refer to it. The same text is kept once.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_and_keep(file: &str, text: &str) -> Result<&'static Self, Faults> {
        static KEPT: LazyLock<Mutex<HashMap<String, &'static Dialect>>> =
            LazyLock::new(Mutex::default);
        keep(&KEPT, text, || Self::read(file, text))
    }

    /// The JSON Schema of the files of analyzers.
    pub fn schema() -> serde_json::Value {
        settings::schema("analyzer file of rigd", dialect_keys::dialect)
    }
}

impl RegisterMap {
    /// Reads and checks the `text` of the file of a drive.
    ///
    /// # Errors
    /// All faults of the file.
    pub fn read(file: &str, text: &str) -> Result<Self, Faults> {
        let (map, faults) = settings::read(file, text, |table| {
            let map = drive_keys::drive(table);
            refuse_shipped_name(table, &map.name);
            map
        });
        faults.finish(map)
    }

    /// Reads one like [`read`](Self::read), and keeps it for as long as the program runs: drivers and
    /// messages refer to it. The same text is kept once.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_and_keep(file: &str, text: &str) -> Result<&'static Self, Faults> {
        static KEPT: LazyLock<Mutex<HashMap<String, &'static RegisterMap>>> =
            LazyLock::new(Mutex::default);
        keep(&KEPT, text, || Self::read(file, text))
    }

    /// The JSON Schema of the files of drives.
    pub fn schema() -> serde_json::Value {
        settings::schema("drive file of rigd", drive_keys::drive)
    }
}

/// The value of a text: the known one, or a new one.
fn keep<V>(
    kept: &Mutex<HashMap<String, &'static V>>,
    text: &str,
    read: impl FnOnce() -> Result<V, Faults>,
) -> Result<&'static V, Faults> {
    let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(&known) = kept.get(text) {
        return Ok(known);
    }
    let value: &'static V = Box::leak(Box::new(read()?));
    kept.insert(text.to_owned(), value);
    Ok(value)
}

/// A file of a user has another name than the shipped ones, so that a journal tells them apart.
fn refuse_shipped_name(table: &mut Table<'_>, name: &str) {
    if shipped_text(name).is_some() {
        let fault = fault::InstrumentFault::ShippedName { key: "name", name: name.to_owned() };
        table.refuse(table.location(), &fault);
    }
}

/// Refuses what belongs to the program and never to an instrument file.
fn refuse_what_is_code(table: &mut Table<'_>) {
    const PROGRAM: &str = "the program decides it for every rig";
    const CODE: &str = "it needs a driver in Rust";
    let keys = [
        ("interlock", PROGRAM),
        ("recovery", PROGRAM),
        ("soft_limits", "limits of an axis are in the rig file"),
        ("loop", CODE),
        ("branch", CODE),
        ("if", CODE),
        ("script", CODE),
        ("variants", CODE),
    ];
    for (key, reason) in keys {
        table.refuse_key(key, &fault::InstrumentFault::Inexpressible { key, reason });
    }
}
