//! The columns of a Parquet file, each read as a whole.

use bytes::Bytes;
use parquet::{
    column::reader::{ColumnReader, ColumnReaderImpl},
    data_type::{ByteArray, DataType},
    errors::ParquetError,
    file::reader::{FileReader, SerializedFileReader},
};

use super::ObjectError;

/// The key of the seal in the metadata of the file.
const SEAL_KEY: &str = "rigd:seal";

/// The columns of a sealed run. With another one, or a group with columns of these names, other programs would read a
/// table that nobody has checked.
const NAMES: [&str; 10] =
    ["run_id", "run_kind", "run_name", "seq", "epoch", "rig_us", "at", "kind", "payload", "digest"];

/// An open file.
pub(super) struct Columns(SerializedFileReader<Bytes>);

impl Columns {
    pub(super) fn open(object: Bytes) -> Result<Self, ObjectError> {
        let reader = SerializedFileReader::new(object)?;
        let schema = reader.metadata().file_metadata().schema_descr();
        let found: Vec<String> =
            schema.columns().iter().map(|column| column.path().string()).collect();
        let are_all = NAMES.iter().all(|name| found.iter().any(|column| column == name));
        if are_all && found.len() == NAMES.len() {
            return Ok(Self(reader));
        }
        Err(ObjectError::Columns { found: found.join(", ") })
    }

    /// The seal, as JSON.
    pub(super) fn seal(&self) -> Option<&str> {
        let metadata = self.0.metadata().file_metadata().key_value_metadata()?;
        let mut seals = metadata.iter().filter(|entry| entry.key == SEAL_KEY);
        // Of two, another program may show the other one.
        seals.next().filter(|_| seals.next().is_none())?.value.as_deref()
    }

    /// A column of texts without missing values.
    pub(super) fn texts(&self, name: &'static str) -> Result<Vec<String>, ObjectError> {
        let wrong = || ObjectError::Column { name, kind: "text" };
        let values: Vec<ByteArray> = self.values(name, "text", |reader| match reader {
            ColumnReader::ByteArrayColumnReader(reader) => Some(reader),
            _ => None,
        })?;
        let text = |value: ByteArray| String::from_utf8(value.data().to_vec()).map_err(|_| wrong());
        values.into_iter().map(text).collect()
    }

    /// A column of whole numbers or times without missing values.
    pub(super) fn numbers(&self, name: &'static str) -> Result<Vec<i64>, ObjectError> {
        self.values(name, "whole numbers", |reader| match reader {
            ColumnReader::Int64ColumnReader(reader) => Some(reader),
            _ => None,
        })
    }

    fn values<T: DataType>(
        &self,
        name: &'static str,
        kind: &'static str,
        typed: impl Fn(ColumnReader) -> Option<ColumnReaderImpl<T>>,
    ) -> Result<Vec<T::T>, ObjectError> {
        let wrong = || ObjectError::Column { name, kind };
        let metadata = self.0.metadata();
        let columns = metadata.file_metadata().schema_descr().columns();
        let index = columns.iter().position(|column| column.name() == name).ok_or_else(wrong)?;
        let (mut values, mut rows) = (Vec::new(), 0);
        for group in 0..metadata.num_row_groups() {
            let group = self.0.get_row_group(group)?;
            let mut reader = typed(group.get_column_reader(index)?).ok_or_else(wrong)?;
            let in_group = usize::try_from(group.metadata().num_rows()).map_err(|_| wrong())?;
            rows += in_group;
            read(&mut reader, in_group, &mut values)?;
        }
        if values.len() == rows { Ok(values) } else { Err(wrong()) }
    }
}

/// Reads the values of a column of a group.
fn read<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    values: &mut Vec<T::T>,
) -> Result<(), ParquetError> {
    let (mut left, mut levels) = (rows, Vec::new());
    while left > 0 {
        let (read, _, _) = reader.read_records(left, Some(&mut levels), None, values)?;
        if read == 0 {
            break;
        }
        left -= read;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use parquet::{file::writer::SerializedFileWriter, schema::parser::parse_message_type};

    use super::*;

    /// An empty file with these columns.
    fn file(columns: &str) -> Bytes {
        let schema = parse_message_type(&format!("message run {{ {columns} }}")).unwrap();
        let mut bytes = Vec::new();
        let writer =
            SerializedFileWriter::new(&mut bytes, Arc::new(schema), Arc::default()).unwrap();
        writer.close().unwrap();
        bytes.into()
    }

    #[test]
    fn a_file_has_the_columns_of_a_sealed_run_and_no_others() {
        let of = |name: &str| format!("required binary {name} (UTF8); ");
        let all: String = NAMES.iter().map(|name| of(name)).collect();
        let less: String = NAMES.iter().skip(1).map(|name| of(name)).collect();
        let hidden = format!("required group x {{ {} }} ", of("payload"));
        let files = [
            (all.clone(), true),
            (less.clone(), false),
            (less + &of("payload"), false),
            (hidden.clone() + &all, false),
            (all.replace(&of("payload"), &hidden), false),
            (all + &of("note"), false),
        ];
        for (columns, is_read) in files {
            let opened = Columns::open(file(&columns));
            assert_eq!(opened.is_ok(), is_read, "{columns}: {:?}", opened.err());
        }
    }
}
