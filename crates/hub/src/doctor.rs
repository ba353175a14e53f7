//! Checks a hub and advises on each problem. Every check gives a finding, also a good one.

use serde::Serialize;
use tokio_postgres::Client;

use crate::{MIGRATIONS, State, state};

/// A bench that has not called for longer is told, s.
const SILENCE_S: i64 = 86_400;

/// Runs of an hour or two may wait for their results.
const UNJUDGED_MAX: i64 = 100;

/// Where records were pruned once, they are to be pruned at least every week, s.
const PRUNING_S: i64 = 604_800;

/// The severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// No problem.
    Ok,
    /// It works, and could be better.
    Warning,
    /// It does not work, or not safely.
    Problem,
}

impl Level {
    /// The word in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Problem => "problem",
        }
    }
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The thing checked.
    pub check: &'static str,
    /// Its severity.
    pub level: Level,
    /// The observation.
    pub text: String,
    /// Advice; none if all is well.
    pub advice: Option<&'static str>,
}

/// Checks the database, the server, and what the benches have shipped.
///
/// # Errors
/// The error of PostgreSQL.
pub async fn findings(client: &Client) -> Result<Vec<Finding>, tokio_postgres::Error> {
    let schema = schema(crate::migrations::version(client).await?);
    // The other checks read tables that an older schema does not have.
    if schema.level != Level::Ok {
        return Ok(vec![schema]);
    }
    let mut state = state(client).await?;
    state.listen(client).await?;
    let mut all = vec![schema, durability(client).await?];
    all.extend(access(client).await?);
    all.push(backup(client).await?);
    all.push(alarms(&state));
    all.extend(silent(&state));
    all.push(unread(client).await?);
    all.push(without_results(client).await?);
    all.push(unjudged(client).await?);
    all.push(pruning(&state));
    all.push(live(&state));
    Ok(all)
}

fn finding(
    check: &'static str,
    is_well: bool,
    level: Level,
    text: String,
    advice: &'static str,
) -> Finding {
    if is_well {
        Finding { check, level: Level::Ok, text, advice: None }
    } else {
        Finding { check, level, text, advice: Some(advice) }
    }
}

fn schema(version: usize) -> Finding {
    let known = MIGRATIONS.len();
    finding(
        "schema",
        version == known,
        Level::Problem,
        format!("version {version} of {known}"),
        "run `rigd-hub init`",
    )
}

/// What is committed must be on the disk: a bench does not send again what the hub says it has.
async fn durability(client: &Client) -> Result<Finding, tokio_postgres::Error> {
    let mut off = Vec::new();
    for name in ["fsync", "full_page_writes", "synchronous_commit"] {
        if setting(client, name).await? == "off" {
            off.push(name);
        }
    }
    let text = if off.is_empty() {
        "what is committed is on the disk".to_owned()
    } else {
        format!("off in PostgreSQL: {}", off.join(", "))
    };
    Ok(finding(
        "durability",
        off.is_empty(),
        Level::Problem,
        text,
        "set these to `on` in postgresql.conf: after a power cut, the hub would lack what benches do not send again",
    ))
}

async fn access(client: &Client) -> Result<Vec<Finding>, tokio_postgres::Error> {
    let is_encrypted = setting(client, "ssl").await? == "on";
    let by_certificate = rules(
        client,
        "type = 'hostssl' AND auth_method = 'cert'
                                        AND '+rigd_hub_bench' = ANY (user_name)",
    )
    .await?;
    // Which of two rules counts depends on their order; one that could admit a bench otherwise is told.
    let otherwise = rules(client, "type <> 'local' AND auth_method NOT IN ('cert', 'reject')
                                   AND (user_name && ARRAY['all', '+rigd_hub_bench'])
                                   AND (database && ARRAY['all', current_database()::text])
                                   AND coalesce(address, '') NOT IN ('127.0.0.1', '::1', 'samehost')").await?;
    let lines = |lines: &[i32]| {
        let lines: Vec<_> = lines.iter().map(ToString::to_string).collect();
        lines.join(", ")
    };
    Ok(vec![
        finding(
            "TLS",
            is_encrypted,
            Level::Problem,
            format!("ssl is {}", if is_encrypted { "on" } else { "off" }),
            "set ssl, ssl_cert_file, ssl_key_file and ssl_ca_file in postgresql.conf (docs/hub.md)",
        ),
        finding(
            "benches by certificate",
            !by_certificate.is_empty(),
            Level::Problem,
            match by_certificate.len() {
                1 => "1 rule in pg_hba.conf".to_owned(),
                count => format!("{count} rules in pg_hba.conf"),
            },
            "add `hostssl rigd_hub +rigd_hub_bench all cert` to pg_hba.conf, above wider rules, and reload PostgreSQL",
        ),
        finding(
            "other ways for benches",
            otherwise.is_empty(),
            Level::Warning,
            if otherwise.is_empty() {
                "none from other computers".to_owned()
            } else {
                format!("pg_hba.conf, lines {}", lines(&otherwise))
            },
            "a bench needs a certificate and nothing else: restrict these rules to other roles",
        ),
    ])
}

/// The lines of `pg_hba.conf` with a rule of this kind.
async fn rules(client: &Client, which: &str) -> Result<Vec<i32>, tokio_postgres::Error> {
    let select =
        format!("SELECT line_number FROM pg_hba_file_rules WHERE error IS NULL AND {which}");
    Ok(client.query(&select, &[]).await?.iter().map(|row| row.get(0)).collect())
}

async fn backup(client: &Client) -> Result<Finding, tokio_postgres::Error> {
    let mode = setting(client, "archive_mode").await?;
    Ok(finding(
        "backup",
        mode != "off",
        Level::Warning,
        format!("archive_mode is {mode}"),
        "benches send again what their journals still have; for the rest keep a base backup and the WAL (docs/hub.md)",
    ))
}

fn alarms(state: &State) -> Finding {
    let count = state.alarms.len();
    let kinds: Vec<_> =
        state.alarms.iter().map(|alarm| format!("{} {}", alarm.id, alarm.kind)).collect();
    let text = if count == 0 { "none".to_owned() } else { kinds.join(", ") };
    finding(
        "alarms",
        count == 0,
        Level::Problem,
        text,
        "look at them with `rigd-hub status`, then `rigd-hub acknowledge NUMBER --who NAME`",
    )
}

fn silent(state: &State) -> Option<Finding> {
    let is_silent = |seen_s_ago: Option<i64>| seen_s_ago.is_none_or(|ago| ago > SILENCE_S);
    let silent: Vec<_> = state
        .benches
        .iter()
        .filter(|bench| is_silent(bench.seen_s_ago))
        .map(|bench| bench.bench.as_str())
        .collect();
    let text = if silent.is_empty() {
        "all have called within a day".to_owned()
    } else {
        format!("not within a day: {}", silent.join(", "))
    };
    let advice = "look at `rigd doctor` on the computer of the bench; nothing is lost while its journal is there";
    (!state.benches.is_empty())
        .then(|| finding("benches", silent.is_empty(), Level::Warning, text, advice))
}

async fn unread(client: &Client) -> Result<Finding, tokio_postgres::Error> {
    // The first one tells what PostgreSQL has said of it.
    let select = "SELECT count(*), (SELECT left(reason, 200) FROM hub.unread ORDER BY run, seq LIMIT 1) FROM hub.unread";
    let row = client.query_one(select, &[]).await?;
    let (count, reason): (i64, Option<String>) = (row.get(0), row.get(1));
    let text =
        reason.map_or_else(|| count.to_string(), |reason| format!("{count}, the first: {reason}"));
    Ok(finding(
        "records without a typed row",
        count == 0,
        Level::Warning,
        text,
        "hub.unread has them with their reasons; where a bench has a newer rigd, bring rigd-hub to its version; then \
         `rigd-hub rebuild` reads them again",
    ))
}

async fn without_results(client: &Client) -> Result<Finding, tokio_postgres::Error> {
    let select = "SELECT count(*), min(found.run::text || ': ' || left(found.reason, 200))
                  FROM hub.result AS found JOIN hub.run AS r ON r.id = found.run
                  WHERE found.reason IS NOT NULL AND r.pruned_at IS NULL";
    let row = client.query_one(select, &[]).await?;
    let (count, first): (i64, Option<String>) = (row.get(0), row.get(1));
    let text =
        first.map_or_else(|| count.to_string(), |first| format!("{count}, the first: {first}"));
    Ok(finding(
        "runs whose results could not be made",
        count == 0,
        Level::Warning,
        text,
        "their records stay; where a bench has a newer rigd, bring rigd-hub to its version, and the next `rigd-hub judge` makes \
         the results",
    ))
}

async fn unjudged(client: &Client) -> Result<Finding, tokio_postgres::Error> {
    let select = "SELECT count(*) FROM hub.run AS r
                  WHERE r.kind = 'run' AND r.seal IS NOT NULL AND r.pruned_at IS NULL
                    AND NOT EXISTS (SELECT FROM hub.result AS found WHERE found.run = r.id)";
    let count: i64 = client.query_one(select, &[]).await?.get(0);
    Ok(finding(
        "sealed runs without results",
        count <= UNJUDGED_MAX,
        Level::Warning,
        count.to_string(),
        "call `rigd-hub judge` every hour, as by the timer of docs/hub.md: the search by verdict and the comparison of \
         benches rest on it",
    ))
}

fn pruning(state: &State) -> Finding {
    let pruned: i64 = state.benches.iter().map(|bench| bench.pruned).sum();
    let Some(last) = &state.pruning else {
        let text = "never: all records are in PostgreSQL".to_owned();
        return Finding { check: "pruning", level: Level::Ok, text, advice: None };
    };
    let is_well = last.stayed == 0 && last.s_ago < PRUNING_S;
    let text = format!(
        "{pruned} runs have their records in {} only; last pruning {}, {} runs older than {} days stayed",
        last.objects, last.at, last.stayed, last.keep_days
    );
    let advice = "ship the runs of every bench by `rigd ship`, then `rigd-hub prune` names why a run stays; call both \
                  every day (docs/hub.md)";
    finding("pruning", is_well, Level::Warning, text, advice)
}

/// Nothing rests on live messages: what is missing is no problem.
fn live(state: &State) -> Finding {
    let Some(live) = &state.live else {
        let text = "none: the hub has no nats-server".to_owned();
        return Finding { check: "live messages", level: Level::Ok, text, advice: None };
    };
    let (address, unheard) = (&live.address, state.unheard());
    let text = match &live.error {
        Some(error) => error.clone(),
        None if unheard.is_empty() => format!("rigs heard by {address}: {}", live.heard.len()),
        None => format!("not heard by {address}: {}", unheard.join(", ")),
    };
    let advice = "records arrive all the same: look at the log of nats-server, give it the configuration of `rigd-hub live \
                  config` again, and name it by `live` in the section `[hub]` of the benches (docs/hub.md)";
    let is_well = live.error.is_none() && unheard.is_empty();
    finding("live messages", is_well, Level::Warning, text, advice)
}

async fn setting(client: &Client, name: &str) -> Result<String, tokio_postgres::Error> {
    Ok(client.query_one("SELECT current_setting($1)", &[&name]).await?.get(0))
}
