//! Copies a sealed run to a journal of its own, for an archive.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use rusqlite::{Connection, OptionalExtension, params};

use crate::{
    Digest, Reader, RunId, RunKind, StoreError,
    journal::{ENTRY, entry_from, insert_entry, insert_stretch, stretches},
    reader::intact,
    schema,
};

/// The runs that are in an excerpt with all of their records, and their numbers in the journal that they
/// come from. Other journals have no such table.
const TABLE: &str = "
CREATE TABLE excerpt (
    run INTEGER PRIMARY KEY REFERENCES runs (key),
    number INTEGER NOT NULL
) STRICT;
";

/// The runs of an excerpt, each with its number.
pub(crate) const RUNS: &str =
    "SELECT runs.*, excerpt.number AS number FROM runs JOIN excerpt ON excerpt.run = runs.key";

pub(crate) fn is_excerpt(connection: &Connection) -> rusqlite::Result<bool> {
    let table = "SELECT 1 FROM sqlite_schema WHERE name = 'excerpt'";
    Ok(connection.query_row(table, [], |_| Ok(())).optional()?.is_some())
}

/// Copies a sealed run with its ended amendments from the journal in `from` to a new one in `to`, with what
/// moved the axes in its session before it, which a check of the run needs. Returns the copied runs, the
/// run itself first, and the digests of their last records. The file is complete, but not flushed.
///
/// # Errors
/// [`StoreError::NotSealed`]; [`StoreError::UnderWay`] for one with an amendment that has not ended;
/// [`StoreError::Archived`]; [`StoreError::Broken`]; [`StoreError::NotEmpty`] if `to` has a journal; or an
/// error of the system or of SQLite.
pub fn excerpt(from: &Path, run: RunId, to: &Path) -> Result<Vec<(RunId, Digest)>, StoreError> {
    let reader = Reader::open(from)?;
    let wanted = reader.run(run)?;
    if !wanted.is_sealed {
        let status = wanted.status.describe();
        return Err(StoreError::NotSealed { run: wanted.to_string(), status });
    }
    let name = run.to_string();
    let is_its_amendment =
        |other: &crate::Run| other.kind == RunKind::Amendment && other.name == name;
    let mut own = vec![wanted];
    own.extend(reader.every_run()?.into_iter().rev().filter(is_its_amendment));
    let mut copied = Vec::new();
    for run in &own {
        // A killed program has left one without its end, which it gets when the journal is opened to write.
        if !run.is_sealed {
            return Err(StoreError::UnderWay { run: run.to_string() });
        }
        let chain = reader.chain(run.id)?;
        intact(run.id, &chain.check)?;
        copied.extend(chain.records.last().map(|last| (run.id, last.digest)));
    }
    let target = schema::database(to);
    if target.exists() {
        return Err(StoreError::NotEmpty);
    }
    let source = schema::database(from);
    let (old, _copy) = schema::open_to_read(&source)?;
    let new = schema::open_to_write(&target)?;
    new.execute_batch(TABLE)?;
    new.execute_batch("BEGIN IMMEDIATE")?;
    let mut keys = Vec::new();
    for run in &own {
        let key: i64 =
            old.query_row("SELECT key FROM runs WHERE id = ?1", [run.id.to_string()], |row| {
                row.get(0)
            })?;
        keys.push((key, run.number));
    }
    copy(&old, &new, &keys)?;
    new.execute_batch("COMMIT")?;
    // Such a journal is read without a log beside it.
    new.pragma_update(None, "journal_mode", "DELETE")?;
    new.close().map_err(|(_, error)| error)?;
    Ok(copied)
}

/// The records of a run, those that moved the axes from the beginning of the first session of its epoch to its end, and
/// the last one of each session in its epochs. They are what the checker reads of a run.
const RECORDS: &str = "
    WITH own AS (SELECT min(id) AS first, max(id) AS last FROM records WHERE run = ?1),
    begun AS (SELECT min(id) AS first FROM records WHERE seq = 1 AND run IN (
        SELECT key FROM runs WHERE kind = 'session' AND key <= ?1
            AND epoch = (SELECT epoch FROM runs WHERE key = ?1)))
    SELECT records.id, records.run FROM own, begun, records
    WHERE run = ?1 OR records.id <= own.last
        AND records.id >= coalesce(begun.first, own.first)
        AND (records.kind IN ('operator', 'intent', 'moved', 'fault', 'clock_jumped') OR records.id = begun.first)
    UNION
    SELECT records.id, records.run FROM records JOIN (
        SELECT max(records.id) AS last FROM runs CROSS JOIN records ON records.run = runs.key
        WHERE runs.kind = 'session' AND records.kind <> 'run_finished'
            AND runs.epoch IN (SELECT epoch FROM stretches WHERE run = ?1)
        GROUP BY runs.key) ON records.id = last";

/// Copies these runs, each a key and a number.
fn copy(old: &Connection, new: &Connection, own: &[(i64, u64)]) -> Result<(), StoreError> {
    let bench: String = old.query_row("SELECT bench FROM meta", [], |row| row.get(0))?;
    new.execute("UPDATE meta SET bench = ?1", [bench])?;
    let mut wanted = BTreeSet::new();
    let mut runs = BTreeSet::new();
    for (key, _) in own {
        let mut statement = old.prepare_cached(RECORDS)?;
        let mut rows = statement.query([key])?;
        while let Some(row) = rows.next()? {
            wanted.insert(row.get::<_, i64>(0)?);
            runs.insert(row.get::<_, i64>(1)?);
        }
    }
    let mut new_keys = BTreeMap::new();
    for key in runs {
        new_keys.insert(key, copy_run(old, new, key, own)?);
    }
    let mut select = old.prepare_cached(
        "SELECT run, seq, epoch, rig_us, kind, payload, digest FROM records WHERE id = ?1",
    )?;
    let mut insert = new.prepare_cached(
        "INSERT INTO records (id, run, seq, epoch, rig_us, kind, payload, digest)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
    )?;
    for id in wanted {
        select.query_row([id], |row| {
            let (run, seq, epoch): (i64, i64, i64) = (row.get(0)?, row.get(1)?, row.get(2)?);
            let (rig_us, kind): (i64, String) = (row.get(3)?, row.get(4)?);
            let (payload, digest): (String, [u8; 32]) = (row.get(5)?, row.get(6)?);
            insert.execute(params![id, new_keys[&run], seq, epoch, rig_us, kind, payload, digest])
        })?;
    }
    Ok(())
}

/// Copies the entry of a run and its stretches with their epochs. Returns its new key. Only a run that is
/// copied as a whole has its seal and its number.
fn copy_run(
    old: &Connection,
    new: &Connection,
    key: i64,
    own: &[(i64, u64)],
) -> Result<i64, StoreError> {
    let (entry, finished_at, status) = old.query_row(
        &format!("SELECT {ENTRY}, finished_at, status FROM runs WHERE key = ?1"),
        [key],
        |row| Ok((entry_from(row)?, row.get::<_, Option<String>>(8)?, row.get::<_, String>(9)?)),
    )?;
    let stretches = stretches(old, key)?;
    let epochs = stretches.iter().map(|stretch| stretch.epoch).chain([entry.epoch]);
    for epoch in epochs {
        copy_epoch(old, new, epoch.cast_signed())?;
    }
    let new_key = insert_entry(new, &entry)?;
    new.execute(
        "UPDATE runs SET status = ?2, finished_at = ?3 WHERE key = ?1",
        params![new_key, status, finished_at],
    )?;
    for stretch in &stretches {
        insert_stretch(new, new_key, &entry.run, stretch)?;
    }
    if let Some((_, number)) = own.iter().find(|(own, _)| *own == key) {
        new.execute("INSERT INTO excerpt VALUES (?1, ?2)", [new_key, number.cast_signed()])?;
        let (records, head, seal, signature) = old.query_row(
            "SELECT records, head, seal, signature FROM seals WHERE run = ?1",
            [key],
            |row| {
                let (head, seal): (Vec<u8>, Vec<u8>) = (row.get(1)?, row.get(2)?);
                Ok((row.get::<_, i64>(0)?, head, seal, row.get::<_, Option<Vec<u8>>>(3)?))
            },
        )?;
        new.execute(
            "INSERT INTO seals VALUES (?1, ?2, ?3, ?4, ?5)",
            params![new_key, records, head, seal, signature],
        )?;
    }
    Ok(new_key)
}

fn copy_epoch(old: &Connection, new: &Connection, epoch: i64) -> Result<(), StoreError> {
    let row = old.query_row(
        "SELECT opened_at, boot_id, software, is_clock_synced FROM epochs WHERE n = ?1",
        [epoch],
        |row| {
            let (opened_at, boot_id): (String, Option<String>) = (row.get(0)?, row.get(1)?);
            Ok((opened_at, boot_id, row.get::<_, String>(2)?, row.get::<_, Option<i64>>(3)?))
        },
    )?;
    let (opened_at, boot_id, software, is_synced) = row;
    new.execute(
        "INSERT OR IGNORE INTO epochs VALUES (?1, ?2, ?3, ?4, ?5)",
        params![epoch, opened_at, boot_id, software, is_synced],
    )?;
    Ok(())
}
