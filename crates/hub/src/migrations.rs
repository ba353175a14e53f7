//! The tables and functions of the hub, in versions.

use std::cmp::Ordering;

use sha2::{Digest as _, Sha256};
use tokio_postgres::Client;

use crate::batch::hex;

/// One step of the schema.
#[derive(Debug, Clone, Copy)]
pub struct Migration {
    /// What it makes.
    pub name: &'static str,
    /// Its statements. They are never changed once they are released.
    pub sql: &'static str,
}

/// All steps, in order; the version of a database is the number of those that it has.
pub const MIGRATIONS: [Migration; 14] = [
    Migration { name: "tables", sql: include_str!("../sql/01-tables.sql") },
    Migration { name: "digests", sql: include_str!("../sql/02-digests.sql") },
    Migration { name: "typed", sql: include_str!("../sql/03-typed.sql") },
    Migration { name: "ingest", sql: include_str!("../sql/04-ingest.sql") },
    Migration { name: "access", sql: include_str!("../sql/05-access.sql") },
    Migration { name: "live", sql: include_str!("../sql/06-live.sql") },
    Migration { name: "results", sql: include_str!("../sql/07-results.sql") },
    Migration { name: "pruning", sql: include_str!("../sql/08-pruning.sql") },
    Migration { name: "links", sql: include_str!("../sql/09-links.sql") },
    Migration { name: "viewers", sql: include_str!("../sql/10-viewers.sql") },
    Migration { name: "ends", sql: include_str!("../sql/11-ends.sql") },
    Migration { name: "amendments", sql: include_str!("../sql/12-amendments.sql") },
    Migration { name: "repairs", sql: include_str!("../sql/13-repairs.sql") },
    Migration {
        name: "results that could not be made",
        sql: include_str!("../sql/14-results.sql"),
    },
];

/// Why the database cannot be brought to the version of this program.
#[derive(Debug, thiserror::Error)]
pub enum MigrationError {
    /// The database has steps that this program does not know.
    #[error(
        "the database has version {found}, and this rigd-hub knows versions up to {known}: use the rigd-hub that made \
         it, or a newer one"
    )]
    Newer {
        /// Version of the database.
        found: usize,
        /// Version of this program.
        known: usize,
    },
    /// A step was made by other statements.
    #[error(
        "step {version} ({name}) of the database was made by other statements than those of this rigd-hub"
    )]
    Altered {
        /// Number of the step, from 1.
        version: usize,
        /// Name of the step.
        name: String,
    },
    /// PostgreSQL refuses a step.
    #[error("step {version} ({name})")]
    Step {
        /// Number of the step, from 1.
        version: usize,
        /// Name of the step.
        name: &'static str,
        /// The error of PostgreSQL.
        source: tokio_postgres::Error,
    },
    /// The version cannot be read or written.
    #[error("version of the database")]
    Version(#[from] tokio_postgres::Error),
}

/// Why this program cannot read a database.
#[derive(Debug, thiserror::Error)]
pub enum VersionError {
    /// The database has fewer steps than this program knows, or more.
    #[error("the database has version {found}, and this rigd-hub reads version {known}: {advice}")]
    Other {
        /// Version of the database; 0 without a hub.
        found: usize,
        /// Version of this program.
        known: usize,
        /// What to do.
        advice: &'static str,
    },
    /// The version cannot be read.
    #[error("version of the database")]
    Refused(#[from] tokio_postgres::Error),
}

/// Checks that the database has the version of this program.
///
/// # Errors
/// [`VersionError`].
pub(crate) async fn check(client: &Client) -> Result<(), VersionError> {
    let (found, known) = (version(client).await?, MIGRATIONS.len());
    let advice = match found.cmp(&known) {
        Ordering::Equal => return Ok(()),
        Ordering::Less => "bring it up to date by `rigd-hub init`",
        Ordering::Greater => "use the rigd-hub that made it, or a newer one",
    };
    Err(VersionError::Other { found, known, advice })
}

/// Brings the database to the version of this program, each step in a transaction, and returns how many were made.
///
/// # Errors
/// [`MigrationError`]; steps before the failed one stay.
pub async fn migrate(client: &mut Client) -> Result<usize, MigrationError> {
    client
        .batch_execute(
            "CREATE SCHEMA IF NOT EXISTS hub;
             CREATE TABLE IF NOT EXISTS hub.migration (
                 version integer PRIMARY KEY,
                 name text NOT NULL,
                 sha256 text NOT NULL,
                 applied_at timestamptz NOT NULL DEFAULT now()
             );",
        )
        .await?;
    let mut made = 0;
    for (version, step) in (1..).zip(&MIGRATIONS) {
        let transaction = client.transaction().await?;
        // One program at a time; the other one then finds the step made.
        transaction.batch_execute("LOCK TABLE hub.migration IN EXCLUSIVE MODE").await?;
        let done = transaction
            .query("SELECT name, sha256 FROM hub.migration ORDER BY version", &[])
            .await?;
        if done.len() > MIGRATIONS.len() {
            return Err(MigrationError::Newer { found: done.len(), known: MIGRATIONS.len() });
        }
        let digest = sha256(step.sql);
        if let Some(row) = done.get(version - 1) {
            if row.get::<_, &str>(1) != digest {
                return Err(MigrationError::Altered { version, name: row.get(0) });
            }
            continue;
        }
        let failed = |source| MigrationError::Step { version, name: step.name, source };
        transaction.batch_execute(step.sql).await.map_err(failed)?;
        let note = "INSERT INTO hub.migration (version, name, sha256) VALUES ($1, $2, $3)";
        let number = i32::try_from(version).unwrap_or(i32::MAX);
        transaction.execute(note, &[&number, &step.name, &digest]).await?;
        transaction.commit().await?;
        made += 1;
    }
    Ok(made)
}

/// The version of a database: how many steps it has; 0 without a hub.
///
/// # Errors
/// The error of PostgreSQL.
pub(crate) async fn version(client: &Client) -> Result<usize, tokio_postgres::Error> {
    let is_there = "SELECT to_regclass('hub.migration') IS NOT NULL";
    if !client.query_one(is_there, &[]).await?.get::<_, bool>(0) {
        return Ok(0);
    }
    let row = client.query_one("SELECT count(*) FROM hub.migration", &[]).await?;
    Ok(usize::try_from(row.get::<_, i64>(0)).unwrap_or(0))
}

fn sha256(text: &str) -> String {
    hex(&Sha256::digest(text))
}
