//! The results of runs, as their report has them: stiffness, and whether the model behind it holds.

use std::collections::BTreeSet;

use rig_model::with_causes;
use rig_report::RunResults;
use rig_store::{Digest, Run, RunId, RunKind, RunStatus, StoredRecord};
use tokio_postgres::{Client, Row};

/// Makes the results of the sealed runs that have none yet, or whose results could not be made, or that were amended since, and
/// returns how many runs these were.
///
/// # Errors
/// The error of PostgreSQL; the runs before stay judged. Values of a run that PostgreSQL refuses are the reason why this run has
/// no results, and no error.
pub async fn judge(client: &mut Client) -> Result<usize, tokio_postgres::Error> {
    let select = "
        SELECT r.id::text, r.name, r.started_at, r.finished_at, r.status, r.records, r.epoch
        FROM hub.run AS r LEFT JOIN hub.result AS found ON found.run = r.id
        WHERE r.kind = 'run' AND r.seal IS NOT NULL AND r.pruned_at IS NULL
          AND (found.run IS NULL OR found.reason IS NOT NULL OR found.amendments <> hub.amendments(r))
        ORDER BY r.id";
    let runs = client.query(select, &[]).await?;
    for run in &runs {
        let Err(error) = judge_run(client, run).await else { continue };
        if !is_of_values(&error) {
            return Err(error);
        }
        note_reason(client, run, &with_causes(&error)).await?;
    }
    Ok(runs.len())
}

/// Whether PostgreSQL has refused values, and would refuse them again.
fn is_of_values(error: &tokio_postgres::Error) -> bool {
    const DATA_EXCEPTION: &str = "22";
    const CONSTRAINT_VIOLATION: &str = "23";
    let class = error.code().and_then(|code| code.code().get(..2));
    matches!(class, Some(DATA_EXCEPTION | CONSTRAINT_VIOLATION))
}

/// Notes why the results of a run cannot be made; those that it had before are withdrawn.
async fn note_reason(
    client: &mut Client,
    run: &Row,
    reason: &str,
) -> Result<(), tokio_postgres::Error> {
    let id: &str = run.get(0);
    let transaction = client.transaction().await?;
    transaction.execute("DELETE FROM hub.stiffness WHERE run = $1::text::uuid", &[&id]).await?;
    let note = "INSERT INTO hub.result (run, reason, amendments) VALUES ($1::text::uuid, $2, 0)
                ON CONFLICT (run) DO UPDATE
                SET model_verdict = NULL, reason = excluded.reason, judged_at = now()";
    transaction.execute(note, &[&id, &reason]).await?;
    transaction.commit().await
}

async fn judge_run(client: &mut Client, row: &Row) -> Result<(), tokio_postgres::Error> {
    let id: &str = row.get(0);
    let transaction = client.transaction().await?;
    let rows = transaction.query(RECORDS, &[&id]).await?;
    let results = results(row, &rows);
    let (verdict, reason) = match &results {
        Ok(results) => (results.model_verdict(), None),
        Err(reason) => (None, Some(reason)),
    };
    let before = "DELETE FROM hub.stiffness WHERE run = $1::text::uuid";
    transaction.execute(before, &[&id]).await?;
    let judged = "INSERT INTO hub.result (run, model_verdict, reason, amendments) VALUES ($1::text::uuid, $2, $3, $4)
                  ON CONFLICT (run) DO UPDATE
                  SET model_verdict = excluded.model_verdict, reason = excluded.reason,
                      amendments = excluded.amendments, judged_at = now()";
    let parts: BTreeSet<&str> = rows.iter().map(|row| row.get(1)).collect();
    let amendments = parts.iter().filter(|part| **part != id).count();
    let amendments = i64::try_from(amendments).unwrap_or(i64::MAX);
    transaction.execute(judged, &[&id, &verdict, &reason, &amendments]).await?;
    for found in results.iter().flat_map(|results| results.summary().stiffness) {
        let Some(stiffness_mpa) = found.stiffness_mpa else { continue };
        let insert = "INSERT INTO hub.stiffness VALUES ($1::text::uuid, $2, $3, $4, $5)";
        let values: [&(dyn tokio_postgres::types::ToSql + Sync); 5] =
            [&id, &found.sample, &stiffness_mpa, &found.sigma_mpa, &found.known_mpa];
        transaction.execute(insert, &values).await?;
    }
    transaction.commit().await
}

/// The records of a run, and behind them those of its amendments in the order in which the journal has these.
const RECORDS: &str = "
    SELECT r.event, r.run::text, r.seq, r.rig_us, r.epoch,
           (extract(epoch FROM s.started_at::timestamptz - whole.started_at::timestamptz) * 1e6)::bigint
               + r.rig_us - s.rig_us,
           r.kind, r.payload, r.digest
    FROM hub.run AS amended
    JOIN hub.run AS whole ON whole.id = amended.id OR whole.kind = 'amendment' AND whole.name = amended.id::text
                             AND whole.bench = amended.bench AND whole.seal IS NOT NULL
    JOIN hub.record AS r ON r.run = whole.id
    JOIN hub.record AS begun ON begun.run = whole.id AND begun.seq = 1
    JOIN hub.stretch AS s ON s.run = r.run AND s.epoch = r.epoch
    WHERE amended.id = $1::text::uuid
    ORDER BY whole.kind = 'amendment', begun.event, whole.id, r.seq";

/// The results, or why there are none.
fn results(run: &Row, records: &[Row]) -> Result<RunResults, String> {
    let run = known_run(run)
        .ok_or_else(|| format!("its status `{}` is not known", run.get::<_, &str>(4)))?;
    let records: Option<Vec<_>> = records.iter().map(record).collect();
    let records = records.ok_or("the id or the digest of a record is not as it must be")?;
    RunResults::new(&run, &records).map_err(|error| with_causes(&error))
}

fn known_run(row: &Row) -> Option<Run> {
    Some(Run {
        id: row.get::<_, &str>(0).parse().ok()?,
        kind: RunKind::Run,
        name: row.get(1),
        number: 1,
        started_at: row.get(2),
        finished_at: row.get(3),
        wall_s: None,
        status: RunStatus::from_name(row.get(4))?,
        records: row.get::<_, i64>(5).cast_unsigned(),
        epoch: row.get::<_, i64>(6).cast_unsigned(),
        amendments: 0,
        is_sealed: true,
    })
}

fn record(row: &Row) -> Option<StoredRecord> {
    let run: RunId = row.get::<_, &str>(1).parse().ok()?;
    Some(StoredRecord {
        event: row.get::<_, i64>(0).cast_unsigned(),
        run,
        seq: row.get::<_, i64>(2).cast_unsigned(),
        rig_us: row.get::<_, i64>(3).cast_unsigned(),
        epoch: row.get::<_, i64>(4).cast_unsigned(),
        // A clock that was put back does not make it negative.
        run_us: row.get::<_, i64>(5).max(0).cast_unsigned(),
        at: None,
        kind: row.get(6),
        payload: row.get(7),
        digest: Digest::from_bytes(row.get::<_, &[u8]>(8).try_into().ok()?),
    })
}
