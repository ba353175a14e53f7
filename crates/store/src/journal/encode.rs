//! The text of a record.

use std::io;

use serde::Serialize;
use serde_json::ser::Formatter;

use crate::{Record, StoreError};

/// The JSON of a record.
///
/// JSON writes `null` for a number that is infinite or not a number, and the record could not be
/// read again. Records leave out missing values, so that no other `null` occurs.
pub(super) fn payload(record: &Record) -> Result<String, StoreError> {
    let mut text = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut text, FiniteOnly);
    record
        .serialize(&mut serializer)
        .map_err(|source| StoreError::Unwritable { kind: record.kind(), source })?;
    Ok(String::from_utf8(text).expect("JSON is UTF-8"))
}

struct FiniteOnly;

impl Formatter for FiniteOnly {
    fn write_null<W: ?Sized + io::Write>(&mut self, _: &mut W) -> io::Result<()> {
        let why = "a number is infinite or not a number";
        Err(io::Error::new(io::ErrorKind::InvalidData, why))
    }
}
