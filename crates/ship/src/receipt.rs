//! Receipts: each says that an object was read back from the store and is the run.

use bytes::Bytes;
use rig_store::Digest;
use rig_verify::ObjectVerdict;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::ShipError;

/// The receipt of an object, a JSON file beside it.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Receipt {
    object: String,
    bytes: u64,
    pub(crate) sha256: String,
    run_id: String,
    kind: String,
    name: String,
    records: u64,
    head: String,
    seal: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    signed_by: Option<String>,
}

impl Receipt {
    /// The receipt of an object that was checked.
    pub(crate) fn new(object: &str, bytes: &Bytes, verdict: ObjectVerdict) -> Self {
        let ObjectVerdict { run, kind, name, records, digest, seal, signed_by, .. } = verdict;
        Self {
            object: object.to_owned(),
            bytes: bytes.len() as u64,
            sha256: sha256(bytes),
            run_id: run,
            kind,
            name,
            records,
            head: digest,
            seal,
            signed_by,
        }
    }

    pub(crate) fn json(&self) -> Result<Bytes, ShipError> {
        let failed = |source| ShipError::Receipt { object: self.object.clone(), source };
        serde_json::to_vec_pretty(self).map(Bytes::from).map_err(failed)
    }

    pub(crate) fn read(object: &str, json: &[u8]) -> Result<Self, ShipError> {
        serde_json::from_slice(json)
            .map_err(|source| ShipError::Receipt { object: object.to_owned(), source })
    }
}

/// SHA-256 in hexadecimal.
pub(crate) fn sha256(bytes: &[u8]) -> String {
    Digest::from_bytes(Sha256::digest(bytes).into()).to_string()
}
