//! The list of runs of a damaged journal, entry by entry.

use std::collections::{BTreeMap, BTreeSet};

use rusqlite::Connection;

use super::SalvagedRun;
use crate::{
    Flaw, RunId, RunKind, StoreError,
    reader::{parsed, unread},
};

/// Most entries on a page of 4096 bytes: each has three ids of 36 bytes and two digests of 32 bytes.
const ENTRIES_A_PAGE: i64 = 24;

/// What the list of runs tells before a run is copied.
pub(super) struct List {
    /// The greatest key that a run may have.
    pub(super) last_key: i64,
    /// Ids of runs by their keys.
    ids: BTreeMap<i64, String>,
    /// Ids of the runs with a sealed note that their readings were archived.
    archived: BTreeSet<String>,
    /// The first entry that cannot be read: it may be such a note.
    damage: Option<String>,
}

impl List {
    /// Reads the list.
    ///
    /// # Errors
    /// [`StoreError`] of SQLite if no entry can be read.
    pub(super) fn read(old: &Connection) -> Result<Self, StoreError> {
        let last_key = last_key(old)?;
        let (mut archived, mut has_entry, mut first) = (BTreeSet::new(), false, None);
        for key in 1..=last_key {
            match archived_by(old, key) {
                Ok(run) => {
                    has_entry = true;
                    archived.extend(run);
                }
                Err(rusqlite::Error::QueryReturnedNoRows) => {}
                Err(error) => _ = first.get_or_insert((key, error)),
            }
        }
        match first {
            Some((_, error)) if !has_entry => Err(error.into()),
            first => {
                let damage = first.map(|(key, error)| unread(key, &error));
                Ok(Self { last_key, ids: ids(old), archived, damage })
            }
        }
    }

    /// Whether the readings of a run were archived, or why this is not known.
    pub(super) fn is_archived(&self, run: &str) -> Result<bool, &str> {
        match &self.damage {
            _ if self.archived.contains(run) => Ok(true),
            Some(damage) => Err(damage.as_str()),
            None => Ok(false),
        }
    }

    /// The run whose entry cannot be read; `None` for a key that no run has.
    pub(super) fn lost(&self, key: i64, error: &rusqlite::Error) -> Option<SalvagedRun> {
        let id = self.ids.get(&key);
        if id.is_none() && *error == rusqlite::Error::QueryReturnedNoRows {
            return None;
        }
        Some(SalvagedRun {
            id: id.cloned().unwrap_or_default(),
            name: String::new(),
            kind: String::new(),
            records: 0,
            flaw: Some(Flaw::Unreadable { reason: unread(key, error) }),
        })
    }
}

/// The greatest key that a run may have. The list cannot tell it if its last page is lost.
fn last_key(old: &Connection) -> Result<i64, StoreError> {
    const TELLING: [&str; 3] = [
        "SELECT max(seq) FROM sqlite_sequence WHERE name = 'runs'",
        "SELECT max(key) FROM runs",
        "SELECT max(run) FROM records",
    ];
    let mut last: i64 = 0;
    let mut damage = None;
    for telling in TELLING {
        match old.query_row(telling, [], |row| row.get::<_, Option<i64>>(0)) {
            Ok(key) => last = last.max(key.unwrap_or(0)),
            Err(error) => _ = damage.get_or_insert(error),
        }
    }
    if let (0, Some(error)) = (last, damage) {
        return Err(error.into());
    }
    // A damaged number may be any.
    let pages: i64 = old.pragma_query_value(None, "page_count", |row| row.get(0))?;
    Ok(last.min(pages.saturating_mul(ENTRIES_A_PAGE)))
}

/// The run whose readings were archived by the note with this key; `None` if the key is that of another entry.
fn archived_by(old: &Connection, key: i64) -> rusqlite::Result<Option<String>> {
    let entry = "SELECT id, kind, name FROM runs WHERE key = ?1";
    let (kind, name): (RunKind, String) = old.query_row(entry, [key], |row| {
        // A note that is not copied itself tells nothing of the copy.
        parsed(row, 0, |id| id.parse::<RunId>().ok())?;
        Ok((parsed(row, 1, RunKind::from_name)?, row.get(2)?))
    })?;
    if kind != RunKind::Archive {
        return Ok(None);
    }
    // The copy of a note whose seal cannot be read is sealed again.
    let seal = "SELECT EXISTS (SELECT 1 FROM seals WHERE run = ?1)";
    let is_sealed = old.query_row(seal, [key], |row| row.get(0)).unwrap_or(true);
    Ok(is_sealed.then_some(name))
}

/// The ids in the index of the ids, which has other pages than the list, up to the first damage.
fn ids(old: &Connection) -> BTreeMap<i64, String> {
    let mut ids = BTreeMap::new();
    let all = "SELECT key, id FROM runs INDEXED BY sqlite_autoindex_runs_1";
    let Ok(mut statement) = old.prepare(all) else { return ids };
    let Ok(mut rows) = statement.query([]) else { return ids };
    while let Ok(Some(row)) = rows.next() {
        if let (Ok(key), Ok(id)) = (row.get(0), row.get(1)) {
            ids.insert(key, id);
        }
    }
    ids
}
