//! A sealed run as one Parquet file: every record, byte for byte, and what its seal covers.

use std::io::Write;

use rig_record::{ListEntry, SealedRun, StoredRecord, Stretch};
use serde::Serialize;

use super::{column::SEALED, error::ExportError, parquet::ParquetTable, table::TableValue};

/// The key of the seal in the metadata of the file, as JSON.
const SEAL_KEY: &str = "rigd:seal";
/// Version of the columns and of the seal document.
const FORMAT: u32 = 1;

/// What the seal of a run covers, the seal, and its signature.
#[derive(Debug, Clone, Serialize)]
pub struct SealDocument {
    format: u32,
    run_id: String,
    kind: String,
    name: String,
    bench_id: String,
    journal_id: String,
    record_format: u64,
    epoch: u64,
    started_at: String,
    stretches: Vec<StretchView>,
    finished_at: String,
    status: String,
    records: u64,
    /// Digest of the last record, in hexadecimal, as all digests here.
    head: String,
    seal: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    signature: Option<Signature>,
}

#[derive(Debug, Clone, Serialize)]
struct StretchView {
    epoch: u64,
    started_at: String,
    rig_us: u64,
}

/// A signature of a seal by Ed25519.
#[derive(Debug, Clone, Serialize)]
pub struct Signature {
    /// The public key, 32 bytes in hexadecimal.
    pub public_key: String,
    /// The signature, 64 bytes in hexadecimal.
    pub ed25519: String,
}

impl SealDocument {
    /// The document of a run, signed or not.
    pub fn new(run: &SealedRun, signature: Option<Signature>) -> Self {
        let SealedRun { entry, stretches, finished_at, status, records, head } = run.clone();
        let ListEntry { bench, journal, run: run_id, kind, name, format, epoch, started_at } =
            entry;
        let view =
            |Stretch { epoch, started_at, rig_us }| StretchView { epoch, started_at, rig_us };
        Self {
            format: FORMAT,
            run_id,
            kind,
            name,
            bench_id: bench,
            journal_id: journal,
            record_format: format,
            epoch,
            started_at,
            stretches: stretches.into_iter().map(view).collect(),
            finished_at,
            status,
            records,
            head: head.to_string(),
            seal: run.seal().to_string(),
            signature,
        }
    }
}

/// Writes a sealed run with all of its records. The same run gives the same bytes.
///
/// # Errors
/// Errors of the writer.
pub fn sealed(
    seal: &SealDocument,
    records: &[StoredRecord],
    out: impl Write + Send,
) -> Result<(), ExportError> {
    let document = serde_json::to_string(seal).map_err(std::io::Error::from)?;
    let mut table = ParquetTable::new(&SEALED, vec![(SEAL_KEY, document)], out)?;
    for record in records {
        let StoredRecord { seq, rig_us, epoch, at, kind, payload, digest, .. } = record;
        let digest = digest.to_string();
        table.row(&[
            TableValue::Text(&seal.run_id),
            TableValue::Text(&seal.kind),
            TableValue::Text(&seal.name),
            TableValue::Whole(*seq),
            TableValue::Whole(*epoch),
            TableValue::Whole(*rig_us),
            TableValue::of(at.as_deref(), TableValue::Time),
            TableValue::Text(kind),
            TableValue::Text(payload),
            TableValue::Text(&digest),
        ])?;
    }
    table.finish()
}
