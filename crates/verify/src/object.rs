//! A sealed run in an object store: one Parquet file with every record and what the seal covers.
//!
//! The file alone is checked: its records against their digests, the digests against the seal, the seal
//! against its signature. What moved the axes before the run is not in it, so that moves and labels are checked
//! in the journal only ([`crate::verify`]).

mod columns;
mod time;

use bytes::Bytes;
use parquet::errors::ParquetError;
use ring::signature::{ED25519, UnparsedPublicKey};
use serde::{Deserialize, Serialize};

use crate::{
    chain::{self, Chain, hex},
    finding::{Check, Finding, Findings},
    journal::{Entry, Journal, Listed, Part, Seal, Stretch, digest},
};
use columns::Columns;
pub(crate) use time::unix_ms;

/// The format of objects that this checker reads.
const FORMAT: u32 = 1;
/// What is signed is this and the seal in hexadecimal.
const SIGNED: &str = "rigd seal ";
/// The time of a record is rounded twice, ms.
const TIME_LIMIT_MS: i64 = 1;

/// Why an object cannot be checked at all.
#[derive(Debug, thiserror::Error)]
pub enum ObjectError {
    /// The file is damaged, or no Parquet file.
    #[error("it cannot be read as Parquet")]
    Parquet(#[from] ParquetError),
    /// It has no seal.
    #[error("its metadata has no entry `rigd:seal`: it is no sealed run")]
    NoSeal,
    /// The seal cannot be read.
    #[error("its seal cannot be read")]
    Seal(#[from] serde_json::Error),
    /// It has another format.
    #[error("format {found} of the object is not {FORMAT}, which this checker reads")]
    OtherFormat {
        /// The format found.
        found: u32,
    },
    /// Its columns are not those of a sealed run.
    #[error("its columns are {found}, which are not the ten of a sealed run")]
    Columns {
        /// The columns found.
        found: String,
    },
    /// A column is missing, has another type, or lacks values.
    #[error("its column `{name}` is missing, is not of {kind}, or lacks values")]
    Column {
        /// Name of the column.
        name: &'static str,
        /// The type of its values.
        kind: &'static str,
    },
}

/// The result of a check of an object.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ObjectVerdict {
    /// Id of the run.
    pub run: String,
    /// Kind of the run.
    pub kind: String,
    /// Name of the run.
    pub name: String,
    /// Whether nothing was found.
    pub is_sound: bool,
    /// Number of records checked.
    pub records: u64,
    /// Digest of the last record, in hexadecimal.
    pub digest: String,
    /// The seal that the object states, in hexadecimal.
    pub seal: String,
    /// The public key by which the seal is signed, in hexadecimal; none without a signature.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub signed_by: Option<String>,
    /// Version of the checker.
    pub checker: String,
    /// What was found, in the order of the records.
    pub findings: Vec<Finding>,
}

impl ObjectVerdict {
    /// The verdict in a sentence.
    pub fn sentence(&self) -> String {
        let Self { records, signed_by, findings, .. } = self;
        match (findings.len(), signed_by) {
            (0, None) => format!("sound: {records} records under its seal, not signed"),
            (0, Some(key)) => format!("sound: {records} records under its seal, signed by {key}"),
            (1, _) => format!("not sound: 1 finding in {records} records"),
            (count, _) => format!("not sound: {count} findings in {records} records"),
        }
    }
}

#[derive(Debug, Deserialize)]
struct Format {
    format: u32,
}

/// What the seal covers, as the object states it.
#[derive(Debug, Deserialize)]
struct Stated {
    run_id: String,
    kind: String,
    name: String,
    bench_id: String,
    journal_id: String,
    record_format: u64,
    epoch: u64,
    started_at: String,
    stretches: Vec<StatedStretch>,
    finished_at: String,
    status: String,
    records: u64,
    head: String,
    seal: String,
    signature: Option<Signature>,
}

#[derive(Debug, Deserialize)]
struct StatedStretch {
    epoch: u64,
    started_at: String,
    rig_us: u64,
}

#[derive(Debug, Deserialize)]
struct Signature {
    public_key: String,
    ed25519: String,
}

/// The part of a record that tells a new epoch.
#[derive(Debug, Deserialize)]
struct Opening {
    kind: String,
    epoch: Option<u64>,
}

/// Checks a sealed run from the bytes of its object. With `key`, it must be signed by this Ed25519 key.
///
/// # Errors
/// [`ObjectError`] if the file cannot be read at all. Damage of the run is a finding.
pub fn verify_object(object: Bytes, key: Option<&[u8]>) -> Result<ObjectVerdict, ObjectError> {
    let columns = Columns::open(object)?;
    let stated = columns.seal().ok_or(ObjectError::NoSeal)?;
    let Format { format: found } = serde_json::from_str(stated)?;
    if found != FORMAT {
        return Err(ObjectError::OtherFormat { found });
    }
    let stated: Stated = serde_json::from_str(stated)?;
    let mut findings = Findings::default();
    let entries = entries(&columns, &stated, &mut findings)?;
    let journal = stated.journal(entries);
    let mut chain = Chain::new();
    for entry in &journal.entries {
        let opens = opens(entry, &mut findings);
        chain.follow(entry, opens, &mut findings);
    }
    chain.check_list(&journal, true, &mut findings);
    stated.check_signature(key, &mut findings);
    let Stated { run_id, kind, name, seal, signature, .. } = stated;
    let mut findings = findings.0;
    findings.sort_by_key(|finding| finding.record);
    Ok(ObjectVerdict {
        run: run_id,
        kind,
        name,
        is_sound: findings.is_empty(),
        records: chain.records(),
        digest: chain.digest(),
        seal,
        signed_by: signature.map(|signature| signature.public_key),
        checker: env!("CARGO_PKG_VERSION").to_owned(),
        findings,
    })
}

/// The records. What repeats the seal in each row must be equal to it.
fn entries(
    columns: &Columns,
    stated: &Stated,
    findings: &mut Findings,
) -> Result<Vec<Entry>, ObjectError> {
    let (seq, epoch) = (columns.numbers("seq")?, columns.numbers("epoch")?);
    let (rig_us, at) = (columns.numbers("rig_us")?, columns.numbers("at")?);
    let (kind, payload) = (columns.texts("kind")?, columns.texts("payload")?);
    for (name, expected) in
        [("run_id", &stated.run_id), ("run_kind", &stated.kind), ("run_name", &stated.name)]
    {
        let found = columns.texts(name)?;
        if let Some((row, found)) = found.iter().enumerate().find(|(_, found)| *found != expected) {
            let record = seq[row].cast_unsigned();
            findings.add(Check::List, record, format!("the column {name}"), expected, found);
        }
    }
    let digests = columns.texts("digest")?;
    let texts = kind.into_iter().zip(payload).zip(digests);
    let mut entries = Vec::with_capacity(seq.len());
    for (row, ((kind, payload), digest)) in texts.enumerate() {
        let entry = Entry {
            key: 0,
            is_own: true,
            is_of_session: false,
            seq: seq[row].cast_unsigned(),
            epoch: epoch[row].cast_unsigned(),
            rig_us: rig_us[row].cast_unsigned(),
            kind,
            payload,
            digest: bytes(&digest),
        };
        let expected = stated.time_of(&entry);
        if expected.is_none_or(|expected| (expected - at[row]).abs() > TIME_LIMIT_MS) {
            let expected = expected.map_or("a stretch".to_owned(), |ms| ms.to_string());
            let what = "the time in the column at, ms since 1970";
            findings.add(Check::Time, entry.seq, what, expected, at[row]);
        }
        entries.push(entry);
    }
    Ok(entries)
}

/// The epoch that a record says it opens.
fn opens(entry: &Entry, findings: &mut Findings) -> Option<u64> {
    match serde_json::from_str::<Opening>(&entry.payload) {
        Ok(opening) if opening.kind != entry.kind => {
            let what = "the kind of the record";
            findings.add(Check::Readable, entry.seq, what, &entry.kind, &opening.kind);
            None
        }
        Ok(Opening { kind, epoch }) => {
            epoch.filter(|_| ["resumed", "given_up"].contains(&kind.as_str()))
        }
        Err(error) => {
            findings.add(Check::Readable, entry.seq, "the record", "JSON with a kind", error);
            None
        }
    }
}

impl Stated {
    /// The run as it was in the journal. Its entry and its stretches have no digests of their own here: the
    /// seal covers them.
    fn journal(&self, entries: Vec<Entry>) -> Journal {
        let mut run = Listed {
            key: 0,
            id: self.run_id.clone(),
            kind: self.kind.clone(),
            name: self.name.clone(),
            journal: self.journal_id.clone(),
            bench: self.bench_id.clone(),
            format: self.record_format,
            epoch: self.epoch,
            started_at: self.started_at.clone(),
            digest: Vec::new(),
            link: Vec::new(),
            finished_at: Some(self.finished_at.clone()),
            status: self.status.clone(),
        };
        run.digest = digest(run.parts()).to_vec();
        let stretch = |StatedStretch { epoch, started_at, rig_us }: &StatedStretch| {
            let mut stretch = Stretch {
                epoch: *epoch,
                started_at: started_at.clone(),
                rig_us: *rig_us,
                digest: Vec::new(),
            };
            let id = [Part::Text(&self.run_id)].into_iter();
            stretch.digest = digest(id.chain(chain::parts(&stretch))).to_vec();
            stretch
        };
        let seal =
            Seal { records: self.records, head: bytes(&self.head), digest: bytes(&self.seal) };
        Journal::alone(run, self.stretches.iter().map(stretch).collect(), seal, entries)
    }

    /// When a record was made, ms since 1970.
    fn time_of(&self, entry: &Entry) -> Option<i64> {
        let stretch = self.stretches.iter().find(|stretch| stretch.epoch == entry.epoch)?;
        let since_us = entry.rig_us.cast_signed().checked_sub(stretch.rig_us.cast_signed())?;
        time::unix_ms(&stretch.started_at)?.checked_add((since_us + 500).div_euclid(1000))
    }

    fn check_signature(&self, key: Option<&[u8]>, findings: &mut Findings) {
        let mut wrong = |expected: String, found: &str| {
            findings.add(Check::Seal, 0, "the signature of the seal", expected, found);
        };
        let Some(Signature { public_key, ed25519 }) = &self.signature else {
            if let Some(key) = key {
                wrong(format!("one by {}", hex(key)), "none");
            }
            return;
        };
        if let Some(key) = key.filter(|key| *key != bytes(public_key)) {
            wrong(format!("one by {}", hex(key)), &format!("one by {public_key}"));
        }
        let message = format!("{SIGNED}{}", self.seal);
        let public = UnparsedPublicKey::new(&ED25519, bytes(public_key));
        if public.verify(message.as_bytes(), &bytes(ed25519)).is_err() {
            wrong(format!("one by {public_key} of {message}"), "another one");
        }
    }
}

/// The bytes of a text in hexadecimal; none for another text.
fn bytes(text: &str) -> Vec<u8> {
    let pair = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok();
    let is_lower = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    if !text.len().is_multiple_of(2) || !text.bytes().all(is_lower) {
        return Vec::new();
    }
    text.as_bytes().chunks(2).map(pair).collect::<Option<_>>().unwrap_or_default()
}
