//! A run and its amendments: what one says of the other.

use std::collections::BTreeMap;

use rusqlite::{Connection, OptionalExtension, params};

use super::Listed;
use crate::{
    record::{Amended, Record, RunStarted},
    seam::Stated,
};

/// What each amendment of a run amends, and whether it was written before the run had ended.
pub(super) const AMENDED: &str = "
    SELECT payload, records.id < ifnull((SELECT max(ends.id) FROM records AS ends
        WHERE ends.run = ?1 AND ends.kind = 'run_finished'), records.id + 1)
    FROM runs CROSS JOIN records ON records.run = runs.key
    WHERE runs.kind = 'amendment' AND runs.name = ?2 AND records.kind = 'amended' AND seq = 1";

/// What may be the outcome of a touch in an amendment that ended before a run went on.
pub(super) const DONE_ELSEWHERE: &str = "
    SELECT seam.seq, outcome.payload
    FROM records AS seam CROSS JOIN runs CROSS JOIN records AS ends ON ends.run = runs.key
        CROSS JOIN records AS outcome ON outcome.run = runs.key
    WHERE seam.run = ?1 AND seam.kind = 'resumed' AND runs.kind = 'amendment' AND runs.name = ?2
        AND ends.kind = 'run_finished' AND ends.id < seam.id
        AND outcome.kind IN ('amended', 'touch_result', 'touch_refused')
    ORDER BY outcome.id";

/// The last record of a run before the first one of an amendment, and whether a digest is that of any before it.
pub(super) const HEAD: &str = "
    WITH amended AS (SELECT key FROM runs WHERE id = ?1),
        first AS (SELECT min(id) AS id FROM records WHERE run = ?2)
    SELECT lower(hex(digest)), kind, EXISTS (
        SELECT 1 FROM records AS any WHERE any.run = (SELECT key FROM amended)
            AND any.id < (SELECT id FROM first) AND lower(hex(any.digest)) = ?3)
    FROM records
    WHERE run = (SELECT key FROM amended) AND records.id < (SELECT id FROM first)
    ORDER BY seq DESC LIMIT 1";

/// The resumptions of a run before the first record of an amendment.
pub(super) const SEAMS_BEFORE: &str = "
    SELECT payload FROM records
    WHERE run = (SELECT key FROM runs WHERE id = ?1) AND kind = 'resumed'
        AND id < (SELECT min(id) FROM records WHERE run = ?2)
    ORDER BY seq";

/// The end of a run when it was amended.
#[derive(Debug, Clone)]
pub(crate) struct Head {
    /// Digest of its last record, in hexadecimal.
    pub(crate) last: String,
    /// Whether the run had ended.
    pub(crate) has_ended: bool,
    /// Whether the digest that the amendment states is that of a record of the run.
    pub(crate) is_of_run: bool,
}

/// The touches of a run that were left out before it had ended, and whether it has any amendment.
pub(super) fn left_out(
    connection: &Connection,
    run: &Listed,
) -> Result<(Vec<String>, bool), rusqlite::Error> {
    let mut statement = connection.prepare_cached(AMENDED)?;
    let mut rows = statement.query(params![run.key, run.id])?;
    let (mut left_out, mut is_amended) = (Vec::new(), false);
    while let Some(row) = rows.next()? {
        is_amended = true;
        if let Ok(Record::Amended(amended)) = serde_json::from_str(&row.get::<_, String>(0)?)
            && amended.what == "skip"
            && row.get(1)?
        {
            left_out.push(amended.step);
        }
    }
    Ok((left_out, is_amended))
}

/// The touches of a run with an outcome in an amendment that had ended, before each record at which the run goes on,
/// and whether the last one is a refusal.
pub(super) fn done_elsewhere(
    connection: &Connection,
    run: &Listed,
) -> Result<BTreeMap<u64, BTreeMap<String, bool>>, rusqlite::Error> {
    let mut done: BTreeMap<u64, BTreeMap<String, bool>> = BTreeMap::new();
    let mut statement = connection.prepare_cached(DONE_ELSEWHERE)?;
    let mut rows = statement.query(params![run.key, run.id])?;
    while let Some(row) = rows.next()? {
        let (step, is_refused) = match serde_json::from_str(&row.get::<_, String>(1)?) {
            Ok(Record::TouchResult(result)) => (result.touch.step, false),
            Ok(Record::TouchRefused(refused)) => (refused.touch.step, true),
            Ok(Record::Amended(amended)) if amended.what == "skip" => (amended.step, false),
            _ => continue,
        };
        done.entry(row.get::<_, i64>(0)?.cast_unsigned()).or_default().insert(step, is_refused);
    }
    Ok(done)
}

/// The settings of an amendment: its own, or those of the last resumption of its run before, and what the last part of the run
/// before it states. Its run is the one in whose name it is listed, whatever its first record says. `None` if that run is not
/// there.
pub(super) fn settings_of(
    connection: &Connection,
    Amended { rig, .. }: &Amended,
    &Listed { key, name: ref run, .. }: &Listed,
) -> Result<Option<(Box<RunStarted>, Stated)>, rusqlite::Error> {
    let payload: Option<String> = connection
        .query_row(
            "SELECT payload FROM records WHERE run = (SELECT key FROM runs WHERE id = ?1) AND seq = 1",
            [run],
            |row| row.get(0),
        )
        .optional()?;
    let Some(Ok(Record::RunStarted(mut started))) =
        payload.map(|payload| serde_json::from_str(&payload))
    else {
        return Ok(None);
    };
    let mut stated = Stated::of(&started);
    let mut seams = connection.prepare_cached(SEAMS_BEFORE)?;
    let mut rows = seams.query(params![run, key])?;
    while let Some(row) = rows.next()? {
        if let Ok(Record::Resumed(resumed)) = serde_json::from_str(&row.get::<_, String>(0)?) {
            stated.take(&resumed);
        }
    }
    started.rig = rig.clone().unwrap_or_else(|| stated.rig().clone());
    Ok(Some((started, stated)))
}

/// The end of a run when it was amended; `None` if it has no record before the amendment.
pub(super) fn head(
    connection: &Connection,
    amended: &Amended,
    &Listed { key, name: ref run, .. }: &Listed,
) -> Result<Option<Head>, rusqlite::Error> {
    connection
        .prepare_cached(HEAD)?
        .query_row(params![run, key, amended.head], |row| {
            let has_ended = row.get::<_, String>(1)? == "run_finished";
            Ok(Head { last: row.get(0)?, has_ended, is_of_run: row.get(2)? })
        })
        .optional()
}
