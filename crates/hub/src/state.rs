//! What the hub has, and what an administrator must look at.

use serde::Serialize;
use tokio_postgres::Client;

use crate::live::{self, LiveState, live_state};

/// A shipper calls every half minute. One that has not called for longer is not there, s.
const PRESENT_S: i64 = 60;

/// The state of a hub.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct State {
    /// Version of the schema.
    pub version: usize,
    /// The benches, by laboratory and name.
    pub benches: Vec<BenchState>,
    /// The alarms that nobody has acknowledged, oldest first.
    pub alarms: Vec<Alarm>,
    /// The last call of `rigd-hub prune`.
    pub pruning: Option<Pruning>,
    /// What is heard by NATS, if the hub has live messages and [`State::listen`] was called.
    pub live: Option<LiveState>,
}

impl State {
    /// Listens to the rigs by NATS, for 5 s at most.
    ///
    /// # Errors
    /// The error of PostgreSQL. Where nothing can be heard, `live` says why.
    pub async fn listen(&mut self, client: &Client) -> Result<(), tokio_postgres::Error> {
        if let Some(setup) = live::setup(client).await? {
            self.live = Some(live_state(&setup.server.broker(), &self.present()).await);
        }
        Ok(())
    }

    /// Benches whose shipper has called a moment ago, but are not heard by NATS.
    pub fn unheard(&self) -> Vec<String> {
        let heard = self.live.as_ref().map_or(&[][..], |live| &live.heard);
        self.present().into_iter().filter(|bench| !heard.contains(bench)).collect()
    }

    fn present(&self) -> Vec<String> {
        let is_present = |bench: &&BenchState| bench.seen_s_ago.is_some_and(|ago| ago <= PRESENT_S);
        self.benches.iter().filter(is_present).map(|bench| bench.bench.clone()).collect()
    }
}

/// A call of `rigd-hub prune`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Pruning {
    /// When it was: UTC, RFC 3339.
    pub at: String,
    /// Seconds since then.
    pub s_ago: i64,
    /// Days for which records were kept.
    pub keep_days: i32,
    /// The object store.
    pub objects: String,
    /// Runs whose records were removed.
    pub runs: i64,
    /// Number of these records.
    pub records: i64,
    /// Runs that were old enough and stayed, as their object is missing or is not theirs.
    pub stayed: i64,
}

/// What the hub has of a bench.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct BenchState {
    /// `LAB/NAME`.
    pub bench: String,
    /// When its shipper has called last: UTC, RFC 3339.
    pub last_seen: Option<String>,
    /// Seconds since then.
    pub seen_s_ago: Option<i64>,
    /// Number of journals.
    pub journals: i64,
    /// Number of those that are quarantined.
    pub quarantined: i64,
    /// Number of runs, sessions and amendments.
    pub runs: i64,
    /// Number of those that are sealed.
    pub sealed: i64,
    /// Number of those whose records are in an object only.
    pub pruned: i64,
    /// Number of records, with those that were pruned.
    pub records: i64,
    /// Number of records that were put aside.
    pub clashes: i64,
}

/// What an administrator must look at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Alarm {
    /// Its number.
    pub id: i64,
    /// The bench that caused it.
    pub bench: Option<String>,
    /// Its kind: `clash`, `stranger`, `rewound` or `quarantine`.
    pub kind: String,
    /// The run or the journal.
    pub subject: String,
    /// What happened.
    pub detail: String,
    /// How often.
    pub times: i64,
    /// When it happened last: UTC, RFC 3339.
    pub last_at: String,
}

/// A time as a text in UTC.
const TIME: &str = "'YYYY-MM-DD\"T\"HH24:MI:SS\"Z\"'";

/// Reads the state of a hub.
///
/// # Errors
/// The error of PostgreSQL.
pub async fn state(client: &Client) -> Result<State, tokio_postgres::Error> {
    let version = crate::migrations::version(client).await?;
    let benches = client
        .query(
            &format!(
                "SELECT b.role::text, to_char(max(j.last_seen) AT TIME ZONE 'UTC', {TIME}),
                        extract(epoch FROM now() - max(j.last_seen))::bigint,
                        count(j), count(j.quarantined),
                        (SELECT count(*) FROM hub.run AS r WHERE r.bench = b.id),
                        (SELECT count(r.seal) FROM hub.run AS r WHERE r.bench = b.id),
                        (SELECT count(r.pruned_at) FROM hub.run AS r WHERE r.bench = b.id),
                        (SELECT coalesce(sum(r.records), 0)::bigint FROM hub.run AS r WHERE r.bench = b.id),
                        (SELECT count(*) FROM hub.clash AS c WHERE c.bench = b.id)
                 FROM hub.bench AS b LEFT JOIN hub.journal AS j ON j.bench = b.id
                 GROUP BY b.id ORDER BY b.lab, b.name"
            ),
            &[],
        )
        .await?;
    let benches = benches.iter().map(|row| BenchState {
        bench: row.get(0),
        last_seen: row.get(1),
        seen_s_ago: row.get(2),
        journals: row.get(3),
        quarantined: row.get(4),
        runs: row.get(5),
        sealed: row.get(6),
        pruned: row.get(7),
        records: row.get(8),
        clashes: row.get(9),
    });
    let alarms = client
        .query(
            &format!(
                "SELECT a.id, b.role::text, a.kind, a.subject, a.detail, a.times,
                        to_char(a.last_at AT TIME ZONE 'UTC', {TIME})
                 FROM hub.alarm AS a LEFT JOIN hub.bench AS b ON b.id = a.bench
                 WHERE a.acknowledged_at IS NULL ORDER BY a.id"
            ),
            &[],
        )
        .await?;
    let alarms = alarms.iter().map(|row| Alarm {
        id: row.get(0),
        bench: row.get(1),
        kind: row.get(2),
        subject: row.get(3),
        detail: row.get(4),
        times: row.get(5),
        last_at: row.get(6),
    });
    Ok(State {
        version,
        benches: benches.collect(),
        alarms: alarms.collect(),
        pruning: pruning(client).await?,
        live: None,
    })
}

async fn pruning(client: &Client) -> Result<Option<Pruning>, tokio_postgres::Error> {
    let select = format!(
        "SELECT to_char(at AT TIME ZONE 'UTC', {TIME}), extract(epoch FROM now() - at)::bigint, keep_days, objects,
                runs, records, stayed
         FROM hub.pruning ORDER BY at DESC LIMIT 1"
    );
    let row = client.query_opt(&select, &[]).await?;
    Ok(row.map(|row| Pruning {
        at: row.get(0),
        s_ago: row.get(1),
        keep_days: row.get(2),
        objects: row.get(3),
        runs: row.get(4),
        records: row.get(5),
        stayed: row.get(6),
    }))
}
