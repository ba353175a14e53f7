//! The side of a bench: where its journal stands in the hub, and what comes next.

use rig_store::{Reader, StoreError};
use tokio_postgres::{Client, Row};

use crate::Batch;

/// Most records and bytes of payload of a batch.
const RECORDS_MAX: u32 = 1000;
const BYTES_MAX: usize = 1 << 20;

/// The last event of a journal that the hub has committed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Cursor {
    /// The event; 0 before the first one.
    pub event: u64,
    /// Digest of its record, in hexadecimal; empty before the first one.
    pub digest: String,
}

/// Why nothing was shipped.
#[derive(Debug, thiserror::Error)]
pub enum InletError {
    /// The hub cannot be reached, or refuses.
    #[error("the hub refuses, or the connection has failed")]
    Hub(#[from] tokio_postgres::Error),
    /// The hub takes nothing of this journal.
    #[error("the hub takes nothing of this journal: {reason}")]
    Refused {
        /// Why.
        reason: String,
    },
    /// The journal.
    #[error("the journal cannot be read")]
    Journal(#[from] StoreError),
    /// A batch cannot be made.
    #[error("a batch cannot be made")]
    Json(#[from] serde_json::Error),
}

/// Ships one journal over one connection.
#[derive(Debug)]
pub struct Inlet {
    client: Client,
    journal: String,
    cursor: Cursor,
}

impl Inlet {
    /// Asks the hub for its cursor. If the journal has another record there, it is begun again.
    ///
    /// # Errors
    /// [`InletError`].
    pub async fn open(client: Client, reader: &Reader, software: &str) -> Result<Self, InletError> {
        let (journal, _) = reader.identity()?;
        let cursor = asked(&client, &journal, software).await?;
        let mut inlet = Self { client, journal, cursor };
        if !inlet.is_at_cursor(reader)? {
            inlet.rewind().await?;
        }
        Ok(inlet)
    }

    /// The last event that the hub has committed.
    pub const fn cursor(&self) -> &Cursor {
        &self.cursor
    }

    /// Whether the connection has ended.
    pub fn is_closed(&self) -> bool {
        self.client.is_closed()
    }

    /// What comes next; `None` if the hub has everything.
    ///
    /// # Errors
    /// [`InletError`] of the journal.
    pub fn next(&self, reader: &Reader) -> Result<Option<Batch>, InletError> {
        let Cursor { event, digest } = &self.cursor;
        let shipment = reader.shipment(*event, RECORDS_MAX, BYTES_MAX)?;
        if shipment.records.is_empty() {
            return Ok(None);
        }
        Ok(Some(Batch::new(*event, digest, &shipment)?))
    }

    /// Sends a batch. It is committed when this returns.
    ///
    /// # Errors
    /// [`InletError`]; whether the batch is committed is unknown then, and the next [`Inlet`] asks.
    pub async fn send(&mut self, batch: &Batch) -> Result<&Cursor, InletError> {
        let ingest = "SELECT (c).* FROM hub.ingest($1::text::uuid, $2, $3::text::json) AS c";
        let after = batch.after_event.cast_signed();
        let row = self.client.query_one(ingest, &[&self.journal, &after, &batch.json()]).await?;
        self.cursor = cursor(&row)?;
        Ok(&self.cursor)
    }

    /// Tells the hub that the bench is there, and asks whether it still has what it had. If the journal has another
    /// record at the cursor, a copy of it has shipped meanwhile, and it is begun again.
    ///
    /// # Errors
    /// [`InletError`].
    pub async fn greet(&mut self, reader: &Reader, software: &str) -> Result<(), InletError> {
        self.cursor = asked(&self.client, &self.journal, software).await?;
        if !self.is_at_cursor(reader)? {
            self.rewind().await?;
        }
        Ok(())
    }

    fn is_at_cursor(&self, reader: &Reader) -> Result<bool, InletError> {
        let Cursor { event, digest } = &self.cursor;
        let held = reader.digest_of_event(*event)?;
        Ok(*event == 0 || held.is_some_and(|held| held.to_string() == *digest))
    }

    async fn rewind(&mut self) -> Result<(), InletError> {
        let rewind = "SELECT (c).* FROM hub.rewind($1::text::uuid, $2) AS c";
        let from = self.cursor.event.cast_signed();
        let row = self.client.query_one(rewind, &[&self.journal, &from]).await?;
        self.cursor = cursor(&row)?;
        Ok(())
    }
}

/// The cursor of a journal, which the hub is asked for.
async fn asked(client: &Client, journal: &str, software: &str) -> Result<Cursor, InletError> {
    let greet = "SELECT (c).* FROM hub.greet($1::text::uuid, $2) AS c";
    cursor(&client.query_one(greet, &[&journal, &software]).await?)
}

/// The cursor of an answer.
fn cursor(row: &Row) -> Result<Cursor, InletError> {
    if let Some(reason) = row.get::<_, Option<String>>("refusal") {
        return Err(InletError::Refused { reason });
    }
    let event = row.get::<_, Option<i64>>("event").unwrap_or(0).cast_unsigned();
    Ok(Cursor { event, digest: row.get::<_, Option<String>>("digest").unwrap_or_default() })
}
