//! A shipment as `ingest` takes it: one document of JSON.

use std::fmt::Write;

use rig_store::{ListEntry, RunEnd, Shipment, StoredRecord, Stretch};
use serde::Serialize;

/// Records behind an event, ready to be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Batch {
    /// The event before the first record.
    pub after_event: u64,
    /// The last event.
    pub last_event: u64,
    /// Number of records.
    pub records: usize,
    json: String,
}

#[derive(Serialize)]
struct Document<'a> {
    /// Digest of the record at `after_event`, in hexadecimal; empty before the first event.
    after_digest: &'a str,
    runs: Vec<EntryPart<'a>>,
    stretches: Vec<StretchPart<'a>>,
    records: Vec<RecordPart<'a>>,
    ends: Vec<EndPart<'a>>,
}

#[derive(Serialize)]
struct EntryPart<'a> {
    id: &'a str,
    kind: &'a str,
    name: &'a str,
    bench: &'a str,
    journal: &'a str,
    format: i64,
    epoch: i64,
    started_at: &'a str,
}

#[derive(Serialize)]
struct StretchPart<'a> {
    run: &'a str,
    epoch: i64,
    started_at: &'a str,
    rig_us: i64,
}

// Whole numbers are signed, as SQLite and PostgreSQL have them.
#[derive(Serialize)]
struct RecordPart<'a> {
    event: i64,
    run: String,
    seq: i64,
    epoch: i64,
    rig_us: i64,
    kind: &'a str,
    payload: &'a str,
    digest: String,
}

#[derive(Serialize)]
struct EndPart<'a> {
    run: String,
    records: i64,
    head: String,
    finished_at: &'a str,
    status: &'a str,
    seal: Option<String>,
    signature: Option<String>,
}

impl Batch {
    /// The batch of a shipment behind the event `after_event`, whose record has the digest `after_digest` in
    /// hexadecimal.
    ///
    /// # Errors
    /// The error of the JSON.
    pub fn new(
        after_event: u64,
        after_digest: &str,
        shipment: &Shipment,
    ) -> Result<Self, serde_json::Error> {
        let document = Document {
            after_digest,
            runs: shipment.entries.iter().map(EntryPart::of).collect(),
            stretches: shipment.stretches.iter().map(StretchPart::of).collect(),
            records: shipment.records.iter().map(RecordPart::of).collect(),
            ends: shipment.ends.iter().map(EndPart::of).collect(),
        };
        Ok(Self {
            after_event,
            last_event: shipment.records.last().map_or(after_event, |record| record.event),
            records: shipment.records.len(),
            json: serde_json::to_string(&document)?,
        })
    }

    /// The document.
    pub fn json(&self) -> &str {
        &self.json
    }
}

impl<'a> EntryPart<'a> {
    fn of(entry: &'a ListEntry) -> Self {
        Self {
            id: &entry.run,
            kind: &entry.kind,
            name: &entry.name,
            bench: &entry.bench,
            journal: &entry.journal,
            format: entry.format.cast_signed(),
            epoch: entry.epoch.cast_signed(),
            started_at: &entry.started_at,
        }
    }
}

impl<'a> StretchPart<'a> {
    fn of((run, stretch): &'a (String, Stretch)) -> Self {
        Self {
            run,
            epoch: stretch.epoch.cast_signed(),
            started_at: &stretch.started_at,
            rig_us: stretch.rig_us.cast_signed(),
        }
    }
}

impl<'a> RecordPart<'a> {
    fn of(record: &'a StoredRecord) -> Self {
        Self {
            event: record.event.cast_signed(),
            run: record.run.to_string(),
            seq: record.seq.cast_signed(),
            epoch: record.epoch.cast_signed(),
            rig_us: record.rig_us.cast_signed(),
            kind: &record.kind,
            payload: &record.payload,
            digest: record.digest.to_string(),
        }
    }
}

impl<'a> EndPart<'a> {
    fn of(end: &'a RunEnd) -> Self {
        Self {
            run: end.run.to_string(),
            records: end.records.cast_signed(),
            head: end.head.to_string(),
            finished_at: &end.finished_at,
            status: &end.status,
            seal: end.seal.map(|seal| seal.to_string()),
            signature: end.signature.as_deref().map(hex),
        }
    }
}

/// Bytes in hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        // Writing to a string cannot fail.
        _ = write!(text, "{byte:02x}");
        text
    })
}
