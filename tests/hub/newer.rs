//! A run as a newer rigd might write it: another format, and kinds of records that are not known yet.

use std::path::Path;

use rig_store::{Digest, FORMAT, ListEntry, SealedRun, Stretch};
use rusqlite::{Connection, params};
use sha2::{Digest as _, Sha256};

/// A kind of record that gets a new name, and the new name.
const KIND: &str = "touch_result";
const NEWER: &str = "touch_result_of_a_newer_rigd";

/// Writes the last sealed run of a journal in a newer format, with all digests and its seal. Nothing of it may have been
/// shipped.
pub(crate) fn convert(data: &Path) {
    let journal = Connection::open(data.join("rigd.db")).unwrap();
    let select =
        "SELECT key, id, kind, name, journal, bench, epoch, started_at, finished_at, status
                  FROM runs JOIN seals ON run = key WHERE kind = 'run' ORDER BY key DESC LIMIT 1";
    let (key, entry, finished_at, status): (i64, _, String, String) = journal
        .query_row(select, [], |row| {
            let entry = ListEntry {
                run: row.get(1)?,
                kind: row.get(2)?,
                name: row.get(3)?,
                journal: row.get(4)?,
                bench: row.get(5)?,
                format: u64::from(FORMAT) + 1,
                epoch: row.get::<_, i64>(6)?.cast_unsigned(),
                started_at: row.get(7)?,
            };
            Ok((row.get(0)?, entry, row.get(8)?, row.get(9)?))
        })
        .unwrap();
    journal.execute_batch("BEGIN").unwrap();
    let (records, head) = rechain(&journal, key);
    let update = "UPDATE runs SET format = ?2, digest = ?3 WHERE key = ?1";
    let digest = entry.digest();
    journal.execute(update, params![key, i64::from(FORMAT) + 1, digest.as_bytes()]).unwrap();
    let sealed = SealedRun {
        stretches: stretches(&journal, key),
        entry,
        finished_at,
        status,
        records,
        head,
    };
    let update = "UPDATE seals SET head = ?2, seal = ?3 WHERE run = ?1";
    journal.execute(update, params![key, head.as_bytes(), sealed.seal().as_bytes()]).unwrap();
    relink(&journal);
    journal.execute_batch("COMMIT").unwrap();
}

/// Renames a kind of records, and makes the digests anew.
fn rechain(journal: &Connection, run: i64) -> (u64, Digest) {
    let select = "SELECT id, seq, rig_us, kind, payload FROM records WHERE run = ?1 ORDER BY seq";
    let records: Vec<(i64, i64, i64, String, String)> = rows(journal, select, run, |row| {
        Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?))
    });
    let mut head = Digest::START;
    for (id, seq, rig_us, kind, payload) in &records {
        let is_renamed = kind == KIND;
        let kind = if is_renamed { NEWER } else { kind };
        let payload = if is_renamed {
            payload.replacen(&format!("\"{KIND}\""), &format!("\"{NEWER}\""), 1)
        } else {
            payload.clone()
        };
        head = head.next(seq.cast_unsigned(), rig_us.cast_unsigned(), kind, &payload);
        let update = "UPDATE records SET kind = ?2, payload = ?3, digest = ?4 WHERE id = ?1";
        journal.execute(update, params![id, kind, payload, head.as_bytes()]).unwrap();
    }
    (records.len() as u64, head)
}

fn stretches(journal: &Connection, run: i64) -> Vec<Stretch> {
    let select = "SELECT epoch, started_at, rig_us FROM stretches WHERE run = ?1 ORDER BY epoch";
    rows(journal, select, run, |row| {
        Ok(Stretch {
            epoch: row.get::<_, i64>(0)?.cast_unsigned(),
            started_at: row.get(1)?,
            rig_us: row.get::<_, i64>(2)?.cast_unsigned(),
        })
    })
}

/// Links the entries of the list of runs anew.
fn relink(journal: &Connection) {
    let select = "SELECT key, digest FROM runs WHERE key > ?1 ORDER BY key";
    let entries: Vec<(i64, Vec<u8>)> =
        rows(journal, select, 0, |row| Ok((row.get(0)?, row.get(1)?)));
    let mut before = vec![0; 32];
    for (key, digest) in entries {
        before = Sha256::new().chain_update(&before).chain_update(&digest).finalize().to_vec();
        journal.execute("UPDATE runs SET link = ?2 WHERE key = ?1", params![key, before]).unwrap();
    }
}

fn rows<T>(
    journal: &Connection,
    select: &str,
    of: i64,
    row: impl FnMut(&rusqlite::Row<'_>) -> rusqlite::Result<T>,
) -> Vec<T> {
    let mut statement = journal.prepare(select).unwrap();
    let rows = statement.query_map([of], row).unwrap();
    rows.collect::<rusqlite::Result<_>>().unwrap()
}
