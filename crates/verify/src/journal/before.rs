//! The records before a run that say where the axes were when it began.

use rusqlite::{Connection, OptionalExtension, params};

use super::Entry;

/// The first record of the sessions in the epoch of a run, and that of the last run since then that was completed before it. A
/// program that runs for days has several sessions on one clock, and the axes stay where they are between them.
pub(super) const BEGINS: &str = "
    WITH sessions AS (SELECT key FROM runs WHERE kind = 'session' AND key <= ?1
        AND epoch = (SELECT epoch FROM runs WHERE key = ?1)),
    completed AS (SELECT max(key) AS key FROM runs WHERE kind = 'run' AND status LIKE 'completed%'
        AND key > (SELECT min(key) FROM sessions) AND key < ?1)
    SELECT (SELECT min(id) FROM records WHERE run IN (SELECT key FROM sessions) AND seq = 1),
        (SELECT id FROM records WHERE run = (SELECT key FROM completed) ORDER BY seq LIMIT 1)";

/// The last move of an axis between two records.
pub(super) const LAST_MOVE: &str = "
    SELECT id FROM records
    WHERE id >= ?1 AND id < ?2 AND kind = 'moved'
        AND json_valid(payload) AND json_extract(payload, '$.axis') = ?3
    ORDER BY id DESC LIMIT 1";

const ONE: &str = "
    SELECT run, seq, records.epoch, rig_us, records.kind, payload, records.digest, runs.kind
    FROM records JOIN runs ON runs.key = records.run WHERE records.id = ?1";

/// What moved the axes from a record to the first of the run.
pub(super) const SINCE: &str = "
    SELECT run, seq, records.epoch, rig_us, records.kind, payload, records.digest, runs.kind
    FROM records JOIN runs ON runs.key = records.run
    WHERE records.id >= ?2 AND records.id < (SELECT min(id) FROM records WHERE run = ?1)
        AND records.kind IN ('operator', 'intent', 'moved', 'fault')
    ORDER BY records.id";

/// Calls `pass` for the first record of the sessions of this start of the program, for the last move of each axis before the last
/// run since then that was completed, and for what moved the axes since. A program may run for months, so that neither all
/// records are read, nor more than one is kept at a time.
///
/// A completed run begins on axes whose positions are known and on a rig that is not latched: that is held against
/// the records of that run.
pub(crate) fn before(
    connection: &Connection,
    run: i64,
    mut pass: impl FnMut(&Entry),
) -> Result<(), rusqlite::Error> {
    let (first, completed): (Option<i64>, Option<i64>) = connection
        .prepare_cached(BEGINS)?
        .query_row([run], |row| Ok((row.get(0)?, row.get(1)?)))?;
    let Some(first) = first else { return Ok(()) };
    if let Some(completed) = completed {
        let mut known = vec![first];
        for axis in ["linear_mm", "rotary_deg"] {
            let moved = connection
                .prepare_cached(LAST_MOVE)?
                .query_row(params![first, completed, axis], |row| row.get::<_, i64>(0));
            known.extend(moved.optional()?);
        }
        known.sort_unstable();
        known.dedup();
        let mut one = connection.prepare_cached(ONE)?;
        for id in known {
            pass(&one.query_row([id], |row| Entry::from_row(row, run))?);
        }
    }
    let mut since = connection.prepare_cached(SINCE)?;
    let mut rows = since.query([run, completed.unwrap_or(first)])?;
    while let Some(row) = rows.next()? {
        pass(&Entry::from_row(row, run)?);
    }
    Ok(())
}
