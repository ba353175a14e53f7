//! What an administrator does with a hub.

use tokio_postgres::{Client, Config};

use crate::{BenchName, ConnectError, MigrationError, connect, migrate};

/// The database where another one has no name.
pub const DATABASE: &str = "rigd_hub";
/// The role that owns tables and functions. Nobody logs in as it.
const OWNER: &str = "rigd_hub";
/// The groups of roles: benches, and those who read everything.
const BENCHES: &str = "rigd_hub_bench";
const READERS: &str = "rigd_hub_reader";
/// Connections of a bench: one that ships, one that begins while the server has not noticed the end of another, and
/// one of `rigd doctor`.
const BENCH_CONNECTIONS: u32 = 3;

/// Why the hub is not as the administrator wants it.
#[derive(Debug, thiserror::Error)]
pub enum AdminError {
    /// No connection.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The database cannot be brought to the version of this program.
    #[error(transparent)]
    Migration(#[from] MigrationError),
    /// PostgreSQL refuses.
    #[error("PostgreSQL refuses")]
    Refused(#[from] tokio_postgres::Error),
    /// There is no such bench.
    #[error("the hub has no bench `{bench}`")]
    NoSuchBench {
        /// The bench that was named.
        bench: String,
    },
    /// There is no such viewer.
    #[error("the hub has no viewer `{viewer}`")]
    NoSuchViewer {
        /// The viewer that was named.
        viewer: String,
    },
    /// There is no such journal.
    #[error("the hub has no quarantined journal `{journal}`")]
    NoSuchJournal {
        /// The journal that was named.
        journal: String,
    },
    /// There is no such alarm.
    #[error("there is no alarm {id} that waits")]
    NoSuchAlarm {
        /// Number of the alarm.
        id: i64,
    },
}

/// Makes roles, database, tables and functions where they are missing, and returns how many steps of the schema were
/// made. The role of `config` must be a superuser.
///
/// # Errors
/// [`AdminError`].
pub async fn init(config: &Config) -> Result<usize, AdminError> {
    let database = config.get_dbname().unwrap_or(DATABASE).to_owned();
    let mut maintenance = config.clone();
    maintenance.dbname("postgres");
    let (server, _task) = connect(&maintenance, None).await?;
    // One program at a time, until this connection ends.
    server.batch_execute("SELECT pg_advisory_lock(hashtextextended('rigd-hub init', 0))").await?;
    for role in [OWNER, BENCHES, READERS] {
        make_role(&server, role).await?;
    }
    let there = "SELECT FROM pg_database WHERE datname = $1";
    if server.query_opt(there, &[&database]).await?.is_none() {
        // The order of texts is that of their bytes, on every computer.
        let make = format!(
            "CREATE DATABASE {} OWNER {OWNER} TEMPLATE template0 ENCODING 'UTF8' LC_COLLATE 'C' LC_CTYPE 'C'",
            quoted(&database)
        );
        server.batch_execute(&make).await?;
    }
    let mut config = config.clone();
    config.dbname(&database);
    let (mut client, _task) = connect(&config, None).await?;
    let name = quoted(&database);
    client
        .batch_execute(&format!(
            "REVOKE ALL ON DATABASE {name} FROM PUBLIC;
             GRANT CONNECT ON DATABASE {name} TO {BENCHES}, {READERS};
             REVOKE ALL ON SCHEMA public FROM PUBLIC;
             SET ROLE {OWNER}",
        ))
        .await?;
    Ok(migrate(&mut client).await?)
}

/// Adds a bench and its role. A bench that is there may ship again if it was not allowed to.
///
/// # Errors
/// [`AdminError`].
pub async fn add_bench(client: &Client, bench: &BenchName) -> Result<(), AdminError> {
    let role = bench.to_string();
    make_role(client, &role).await?;
    let name = quoted(&role);
    client
        .batch_execute(&format!(
            "ALTER ROLE {name} LOGIN CONNECTION LIMIT {BENCH_CONNECTIONS};
             ALTER ROLE {name} SET statement_timeout = '5min';
             GRANT {BENCHES} TO {name}",
        ))
        .await?;
    client
        .execute(
            "INSERT INTO hub.bench (lab, name, role) VALUES ($1, $2, $3::text::name) ON CONFLICT DO NOTHING",
            &[&bench.lab, &bench.name, &role],
        )
        .await?;
    Ok(())
}

/// Says where a person finds the page of the rig of a bench.
///
/// # Errors
/// [`AdminError`].
pub async fn set_page(client: &Client, bench: &BenchName, page: &str) -> Result<(), AdminError> {
    let set = "UPDATE hub.bench SET page = $2 WHERE role = $1::text::name";
    client.execute(set, &[&bench.to_string(), &page]).await?;
    Ok(())
}

/// Ends the connections of a bench, and allows no other one. What it has shipped stays.
///
/// # Errors
/// [`AdminError`].
pub async fn revoke_bench(client: &Client, bench: &BenchName) -> Result<(), AdminError> {
    let role = bench.to_string();
    let known = "SELECT FROM hub.bench WHERE role = $1::text::name";
    if client.query_opt(known, &[&role]).await?.is_none() {
        return Err(AdminError::NoSuchBench { bench: role });
    }
    client.batch_execute(&format!("ALTER ROLE {} NOLOGIN", quoted(&role))).await?;
    let end =
        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE usename = $1::text::name";
    client.query(end, &[&role]).await?;
    Ok(())
}

/// Takes a journal out of quarantine: the copy that connects first goes on.
///
/// # Errors
/// [`AdminError`].
pub async fn release_journal(client: &mut Client, journal: &str) -> Result<(), AdminError> {
    let transaction = client.transaction().await?;
    let released = transaction
        .execute(
            "UPDATE hub.journal SET quarantined = NULL WHERE id::text = $1 AND quarantined IS NOT NULL",
            &[&journal],
        )
        .await?;
    if released == 0 {
        return Err(AdminError::NoSuchJournal { journal: journal.to_owned() });
    }
    transaction.execute("DELETE FROM hub.left_line WHERE journal::text = $1", &[&journal]).await?;
    transaction.commit().await?;
    Ok(())
}

/// Notes that somebody has looked at an alarm.
///
/// # Errors
/// [`AdminError`].
pub async fn acknowledge(client: &Client, id: i64, who: &str) -> Result<(), AdminError> {
    let noted = client
        .execute(
            "UPDATE hub.alarm SET acknowledged_at = now(), acknowledged_by = $2
             WHERE id = $1 AND acknowledged_at IS NULL",
            &[&id, &who],
        )
        .await?;
    if noted == 0 { Err(AdminError::NoSuchAlarm { id }) } else { Ok(()) }
}

/// Makes the typed tables again, and returns how many records were read.
///
/// # Errors
/// [`AdminError`].
pub async fn rebuild(client: &Client) -> Result<i64, AdminError> {
    Ok(client.query_one("SELECT hub.rebuild()", &[]).await?.get(0))
}

async fn make_role(client: &Client, role: &str) -> Result<(), AdminError> {
    let there = "SELECT FROM pg_roles WHERE rolname = $1";
    if client.query_opt(there, &[&role]).await?.is_none() {
        client.batch_execute(&format!("CREATE ROLE {}", quoted(role))).await?;
    }
    Ok(())
}

/// A name as it is written in a statement.
fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}
