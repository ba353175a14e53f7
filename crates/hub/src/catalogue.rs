//! Rigs and runs of the laboratory, as the page shows them.

use std::{sync::Arc, time::Duration};

use serde::{Deserialize, Serialize};
use tokio::{sync::Mutex, time::timeout};
use tokio_postgres::{Client, Config, types::ToSql};

use crate::{
    ConnectError, VersionError,
    compare::{self, Reference},
    connect, migrations,
};

/// Most runs of an answer.
const RUNS_MAX: i64 = 500;
const RUNS: i64 = 100;

/// Time limits towards PostgreSQL.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Of a connection, until it can be used.
    pub connect: Duration,
    /// Of a statement, which the server ends then.
    pub statement: Duration,
    /// Of the answer to a statement. It is longer, so that a server that answers says itself what happened.
    pub answer: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        let [connect, statement, answer] = [10, 30, 35].map(Duration::from_secs);
        Self { connect, statement, answer }
    }
}

/// Reads the hub, and connects again where the connection has ended or does not answer.
#[derive(Debug)]
pub struct Catalogue {
    config: Config,
    limits: Limits,
    client: Mutex<Option<Arc<Client>>>,
}

/// Why the hub cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum CatalogueError {
    /// No connection.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The database has another version.
    #[error(transparent)]
    Version(#[from] VersionError),
    /// PostgreSQL refuses.
    #[error("PostgreSQL refuses")]
    Refused(#[from] tokio_postgres::Error),
    /// No connection in time.
    #[error("PostgreSQL has given no connection within {} s", within.as_secs_f64())]
    NoConnection {
        /// The time limit.
        within: Duration,
    },
    /// No answer in time.
    #[error("PostgreSQL has not answered within {} s", within.as_secs_f64())]
    Silent {
        /// The time limit.
        within: Duration,
    },
}

/// A bench and what its rig does.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Rig {
    /// `LAB/NAME`.
    pub bench: String,
    /// State of the rig, as its last record of it says.
    pub state: Option<String>,
    /// Why it is in this state.
    pub reason: Option<String>,
    /// Id and name of the run under way.
    pub run_id: Option<String>,
    /// Its name.
    pub run: Option<String>,
    /// Touches of that run that have an outcome, and all of them.
    pub touches_done: Option<i64>,
    /// All touches of that run.
    pub touches: Option<i32>,
    /// What a person is asked to do.
    pub waits: Option<String>,
    /// When the shipper of the bench has called last: UTC, RFC 3339.
    pub last_seen: Option<String>,
    /// Seconds since then.
    pub seen_s_ago: Option<i64>,
    /// Alarms of the hub that wait.
    pub alarms: i64,
    /// Address of the page of the rig.
    pub page: Option<String>,
}

/// A run of the laboratory.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FoundRun {
    /// `LAB/NAME` of the bench.
    pub bench: String,
    /// Id of the run.
    pub run_id: String,
    /// Name of its protocol.
    pub protocol: String,
    /// When it began: UTC, RFC 3339, by the clock of the bench.
    pub started_at: String,
    /// When it ended.
    pub finished_at: Option<String>,
    /// How it ended; `running` without an end.
    pub status: String,
    /// Whether it has its seal, which the hub has checked.
    pub is_sealed: bool,
    /// Whether records of it were put aside.
    pub has_clash: bool,
    /// Whether no real device took part.
    pub is_simulated: Option<bool>,
    /// Its samples.
    pub samples: Vec<String>,
    /// Who gave commands.
    pub operators: Vec<String>,
    /// Touches with a frequency shift.
    pub measured: i64,
    /// Touches without one.
    pub refused: i64,
    /// Whether the model behind its stiffness holds: `holds`, `strained` or `rejected`; none if it was not judged yet, or
    /// its touches cannot say.
    pub model_verdict: Option<String>,
    /// Number of its records.
    pub records: i64,
    /// The object that has them, if they are not in PostgreSQL any more.
    pub object: Option<String>,
    /// Address of its report on the page of the rig.
    pub report: Option<String>,
}

/// Which runs are wanted. What is left out or empty restricts nothing.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Wanted {
    /// `LAB/NAME` of the bench.
    pub bench: String,
    /// A part of the name of a sample.
    pub sample: String,
    /// A part of the name of the protocol.
    pub protocol: String,
    /// A part of the name of who gave commands.
    pub operator: String,
    /// How the run ended, such as `completed`; `running` for one without an end.
    pub status: String,
    /// Whether the model holds: `holds`, `strained` or `rejected`.
    pub verdict: String,
    /// Begun at this time or later: RFC 3339 or the beginning of it, such as `2026-11`.
    pub from: String,
    /// Begun before this time.
    pub until: String,
    /// Number of runs at most, 100 if left out, 500 at most.
    pub limit: Option<u32>,
}

impl Catalogue {
    /// Reads the hub with this connection. Nothing is connected yet.
    pub fn new(config: Config) -> Self {
        Self::within(Limits::default(), config)
    }

    /// Reads the hub with this connection, within other limits.
    pub fn within(limits: Limits, config: Config) -> Self {
        Self { config, limits, client: Mutex::new(None) }
    }

    /// The connection. Requests that wait for another one, which connects, have the same limit.
    async fn client(&self) -> Result<Arc<Client>, CatalogueError> {
        let within = self.limits.connect;
        let client = timeout(within, self.connected()).await;
        client.unwrap_or(Err(CatalogueError::NoConnection { within }))
    }

    async fn connected(&self) -> Result<Arc<Client>, CatalogueError> {
        let mut held = self.client.lock().await;
        if let Some(client) = held.as_ref().filter(|client| !client.is_closed()) {
            return Ok(Arc::clone(client));
        }
        let (client, _task) = connect(&self.config, None).await?;
        // From here on the connection can only read, as any role.
        let restrict = format!(
            "SET ROLE rigd_hub_reader; SET default_transaction_read_only = on; SET statement_timeout = {}",
            self.limits.statement.as_millis()
        );
        client.batch_execute(&restrict).await?;
        migrations::check(&client).await?;
        let client = Arc::new(client);
        *held = Some(Arc::clone(&client));
        Ok(client)
    }

    /// What is read by a statement. A connection that does not answer is left.
    async fn read<T>(
        &self,
        statement: impl AsyncFnOnce(&Client) -> Result<T, tokio_postgres::Error>,
    ) -> Result<T, CatalogueError> {
        let client = self.client().await?;
        let within = self.limits.answer;
        if let Ok(read) = timeout(within, statement(&client)).await {
            return Ok(read?);
        }
        let mut held = self.client.lock().await;
        if held.as_ref().is_some_and(|held| Arc::ptr_eq(held, &client)) {
            *held = None;
        }
        Err(CatalogueError::Silent { within })
    }

    /// The rigs, by laboratory and name.
    ///
    /// # Errors
    /// [`CatalogueError`].
    pub async fn rigs(&self) -> Result<Vec<Rig>, CatalogueError> {
        let select = "
            SELECT b.role::text, l.state, l.reason, r.id::text, r.name,
                   (SELECT count(*) FROM hub.touch AS t WHERE t.run = r.id), f.touches, l.waits,
                   to_char(j.seen AT TIME ZONE 'UTC', 'YYYY-MM-DD\"T\"HH24:MI:SS\"Z\"'),
                   extract(epoch FROM now() - j.seen)::bigint,
                   (SELECT count(*) FROM hub.alarm AS a WHERE a.bench = b.id AND a.acknowledged_at IS NULL), b.page
            FROM hub.bench AS b
            LEFT JOIN hub.live AS l ON l.bench = b.id
            LEFT JOIN hub.run AS r ON r.id = l.run
            LEFT JOIN hub.run_fact AS f ON f.run = r.id
            LEFT JOIN (SELECT bench, max(last_seen) AS seen FROM hub.journal GROUP BY bench) AS j ON j.bench = b.id
            ORDER BY b.lab, b.name";
        let rows = self.read(async |client| client.query(select, &[]).await).await?;
        let rigs = rows.iter().map(|row| {
            let run_id: Option<String> = row.get(3);
            Rig {
                bench: row.get(0),
                state: row.get(1),
                reason: row.get(2),
                touches_done: run_id.as_ref().map(|_| row.get(5)),
                run_id,
                run: row.get(4),
                touches: row.get(6),
                waits: row.get(7),
                last_seen: row.get(8),
                seen_s_ago: row.get(9),
                alarms: row.get(10),
                page: row.get(11),
            }
        });
        Ok(rigs.collect())
    }

    /// The wanted runs of protocols, the latest first.
    ///
    /// # Errors
    /// [`CatalogueError`].
    pub async fn runs(&self, wanted: &Wanted) -> Result<Vec<FoundRun>, CatalogueError> {
        // Parts of names are compared without regard to case; position() knows no wildcards.
        let select = "
            SELECT b.role::text, r.id::text, r.name, r.started_at, r.finished_at, r.status, r.seal IS NOT NULL,
                   EXISTS (SELECT FROM hub.clash AS c WHERE c.run = r.id AND c.bench = r.bench), f.is_simulated,
                   ARRAY(SELECT s.name FROM hub.sample AS s WHERE s.run = r.id ORDER BY s.name),
                   ARRAY(SELECT DISTINCT c.who FROM hub.command AS c WHERE c.run = r.id ORDER BY c.who),
                   (SELECT count(*) FROM hub.touch AS t WHERE t.run = r.id AND t.reason IS NULL),
                   (SELECT count(*) FROM hub.touch AS t WHERE t.run = r.id AND t.reason IS NOT NULL),
                   found.model_verdict, r.records,
                   (SELECT o.name FROM hub.object AS o WHERE o.run = r.id AND r.pruned_at IS NOT NULL),
                   b.page || '/api/v1/runs/' || r.id || '/report'
            FROM hub.run AS r JOIN hub.bench AS b ON b.id = r.bench
            LEFT JOIN hub.run_fact AS f ON f.run = r.id
            LEFT JOIN hub.result AS found ON found.run = r.id
            WHERE r.kind = 'run' AND ($1 = '' OR b.role::text = $1)
              AND ($2 = '' OR EXISTS (SELECT FROM hub.sample AS s
                                      WHERE s.run = r.id AND position(lower($2) IN lower(s.name)) > 0))
              AND ($3 = '' OR position(lower($3) IN lower(r.name)) > 0)
              AND ($4 = '' OR EXISTS (SELECT FROM hub.command AS c
                                      WHERE c.run = r.id AND position(lower($4) IN lower(c.who)) > 0))
              AND ($5 = '' OR r.status = $5)
              AND ($6 = '' OR r.started_at >= $6) AND ($7 = '' OR r.started_at < $7)
              AND ($8 = '' OR found.model_verdict = $8)
            ORDER BY r.started_at DESC, r.id DESC LIMIT $9";
        let limit = wanted.limit.map_or(RUNS, i64::from).clamp(1, RUNS_MAX);
        let Wanted { bench, sample, protocol, operator, status, verdict, from, until, .. } = wanted;
        let values: [&(dyn ToSql + Sync); 9] =
            [bench, sample, protocol, operator, status, from, until, verdict, &limit];
        let rows = self.read(async |client| client.query(select, &values).await).await?;
        let runs = rows.iter().map(|row| FoundRun {
            bench: row.get(0),
            run_id: row.get(1),
            protocol: row.get(2),
            started_at: row.get(3),
            finished_at: row.get(4),
            status: row.get(5),
            is_sealed: row.get(6),
            has_clash: row.get(7),
            is_simulated: row.get(8),
            samples: row.get(9),
            operators: row.get(10),
            measured: row.get(11),
            refused: row.get(12),
            model_verdict: row.get(13),
            records: row.get(14),
            object: row.get(15),
            report: row.get(16),
        });
        Ok(runs.collect())
    }

    /// The reference samples, with what each bench has found of them.
    ///
    /// # Errors
    /// [`CatalogueError`].
    pub async fn references(&self) -> Result<Vec<Reference>, CatalogueError> {
        self.read(compare::references).await
    }
}
