//! A table as Apache Parquet: types, and with each column its unit and its meaning.

use std::{io::Write, sync::Arc};

use parquet::{
    basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical},
    data_type::{BoolType, ByteArrayType, DataType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        properties::{WriterProperties, WriterPropertiesPtr},
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    schema::types::{Type, TypePtr},
};
use serde_json::json;

use super::{
    arrow,
    column::{Column, ColumnKind},
    error::ExportError,
    table::TableValue,
    values::{Typed, Values},
};

/// Rows that are written together. A reader can skip what it does not need, and writing takes some
/// megabytes of memory.
const GROUP_ROWS: usize = 65_536;

/// The key under which the file has the dictionary of its columns, as JSON.
const COLUMNS_KEY: &str = "rigd:columns";

/// Collects rows, and writes them in groups.
#[derive(Debug)]
pub(super) struct ParquetTable<W: Write + Send> {
    columns: Vec<(Column, Values)>,
    rows: usize,
    writer: SerializedFileWriter<W>,
}

impl<W: Write + Send> ParquetTable<W> {
    /// `more` are entries of the metadata of the file, beside those about the columns.
    pub(super) fn new(
        columns: &[Column],
        more: Vec<(&str, String)>,
        out: W,
    ) -> Result<Self, ExportError> {
        let fields = columns.iter().map(field).collect::<Result<_, _>>()?;
        let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
        let writer = SerializedFileWriter::new(out, Arc::new(schema), properties(columns, more))?;
        let columns = columns.iter().map(|column| (*column, Values::new(column.kind))).collect();
        Ok(Self { columns, rows: 0, writer })
    }

    /// Adds a row, whose values fit the columns.
    pub(super) fn row(&mut self, values: &[TableValue<'_>]) -> Result<(), ExportError> {
        for ((_, column), value) in self.columns.iter_mut().zip(values) {
            column.push(*value);
        }
        self.rows += 1;
        if self.rows == GROUP_ROWS { self.write_group() } else { Ok(()) }
    }

    fn write_group(&mut self) -> Result<(), ExportError> {
        let mut group = self.writer.next_row_group()?;
        for (column, values) in &mut self.columns {
            let written = std::mem::replace(values, Values::new(column.kind));
            written.write(&mut group)?;
        }
        group.close()?;
        self.rows = 0;
        Ok(())
    }

    /// Writes the rows that are left, and the end of the file.
    pub(super) fn finish(mut self) -> Result<(), ExportError> {
        if self.rows > 0 {
            self.write_group()?;
        }
        self.writer.into_inner()?.flush()?;
        Ok(())
    }
}

/// A column in the schema. Each can have missing values.
fn field(column: &Column) -> Result<TypePtr, ParquetError> {
    let (physical, logical) = match column.kind {
        ColumnKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        ColumnKind::Whole => (Physical::INT64, None),
        ColumnKind::Number => (Physical::DOUBLE, None),
        ColumnKind::Flag => (Physical::BOOLEAN, None),
        ColumnKind::Time => {
            let unit = TimeUnit::MILLIS;
            (Physical::INT64, Some(LogicalType::timestamp(true, unit)))
        }
    };
    let builder = Type::primitive_type_builder(column.name, physical)
        .with_repetition(Repetition::OPTIONAL)
        .with_logical_type(logical);
    builder.build().map(Arc::new)
}

fn properties(columns: &[Column], more: Vec<(&str, String)>) -> WriterPropertiesPtr {
    let dictionary: Vec<_> = columns
        .iter()
        .map(|Column { name, kind, unit, description }| {
            json!({ "name": name, "type": kind.name(), "unit": unit, "description": description })
        })
        .collect();
    let entry = |key: &str, value: String| KeyValue::new(key.to_owned(), value);
    let own =
        [(COLUMNS_KEY, json!(dictionary).to_string()), (arrow::SCHEMA_KEY, arrow::schema(columns))];
    let metadata = own.into_iter().chain(more).map(|(key, value)| entry(key, value)).collect();
    let properties = WriterProperties::builder()
        .set_created_by("rigd".to_owned())
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(metadata));
    Arc::new(properties.build())
}

impl Values {
    fn write<W: Write + Send>(
        self,
        group: &mut SerializedRowGroupWriter<'_, W>,
    ) -> Result<(), ParquetError> {
        let is_there = &self.is_there;
        match self.values {
            Typed::Text(values) => write::<ByteArrayType, W>(group, &values, is_there),
            Typed::Whole(values) => write::<Int64Type, W>(group, &values, is_there),
            Typed::Number(values) => write::<DoubleType, W>(group, &values, is_there),
            Typed::Flag(values) => write::<BoolType, W>(group, &values, is_there),
        }
    }
}

/// Writes the next column of a group.
fn write<T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    is_there: &[i16],
) -> Result<(), ParquetError> {
    let none = || ParquetError::General("the group has fewer columns than the schema".to_owned());
    let mut column = group.next_column()?.ok_or_else(none)?;
    column.typed::<T>().write_batch(values, Some(is_there), None)?;
    column.close()
}
