//! The Arrow schema of a table, which Parquet files have under a key of their own: without it, readers show
//! no unit and no meaning with a column.
//!
//! # Source
//! `Schema.fbs` and `Message.fbs` of Apache Arrow, format version 5; the key and its coding as written by
//! Arrow C++ and arrow-rs.

use flatbuffers::{FlatBufferBuilder, TableFinishedWIPOffset, WIPOffset};

use super::column::{Column, ColumnKind};

/// The key of the schema in the metadata of a Parquet file.
pub(super) const SCHEMA_KEY: &str = "ARROW:schema";

type Table = WIPOffset<TableFinishedWIPOffset>;
type Builder = FlatBufferBuilder<'static>;

/// `MetadataVersion.V5`.
const VERSION: i16 = 4;
/// `MessageHeader.Schema`.
const IS_SCHEMA: u8 = 1;
/// `Precision.DOUBLE`.
const DOUBLE: i16 = 2;
/// `TimeUnit.MILLISECOND`.
const MILLISECOND: i16 = 1;

/// The place of a field of a table, counted from 0.
const fn slot(index: u16) -> u16 {
    4 + 2 * index
}

/// The schema as readers of Parquet expect it: an encapsulated message in base 64.
pub(super) fn schema(columns: &[Column]) -> String {
    let mut builder = Builder::new();
    let fields: Vec<Table> = columns.iter().map(|column| field(&mut builder, column)).collect();
    let fields = builder.create_vector(&fields);
    let start = builder.start_table();
    builder.push_slot_always(slot(1), fields);
    let schema = builder.end_table(start);
    let start = builder.start_table();
    builder.push_slot_always(slot(0), VERSION);
    builder.push_slot_always(slot(1), IS_SCHEMA);
    builder.push_slot_always(slot(2), schema);
    let message = builder.end_table(start);
    builder.finish_minimal(message);
    let message = builder.finished_data();
    // The message begins and ends at a multiple of eight bytes.
    let length = message.len().next_multiple_of(8);
    let length_bytes = u32::try_from(length).unwrap_or_default().to_le_bytes();
    let mut bytes = [&[0xFF; 4], &length_bytes[..], message].concat();
    bytes.resize(8 + length, 0);
    base64(&bytes)
}

/// A column that may have missing values, with its unit and its meaning.
fn field(builder: &mut Builder, column: &Column) -> Table {
    let Column { name, kind, unit, description } = *column;
    let (type_number, type_table) = arrow_type(builder, kind);
    let entries: Vec<Table> = [("unit", unit), ("description", description)]
        .into_iter()
        .filter(|(_, value)| !value.is_empty())
        .map(|(key, value)| {
            let (key, value) = (builder.create_string(key), builder.create_string(value));
            let start = builder.start_table();
            builder.push_slot_always(slot(0), key);
            builder.push_slot_always(slot(1), value);
            builder.end_table(start)
        })
        .collect();
    let entries = builder.create_vector(&entries);
    let children = builder.create_vector::<Table>(&[]);
    let name = builder.create_string(name);
    let start = builder.start_table();
    builder.push_slot_always(slot(0), name);
    builder.push_slot_always(slot(1), true);
    builder.push_slot_always(slot(2), type_number);
    builder.push_slot_always(slot(3), type_table);
    builder.push_slot_always(slot(5), children);
    builder.push_slot_always(slot(6), entries);
    builder.end_table(start)
}

/// The number of a type in the union `Type`, and its parameters.
fn arrow_type(builder: &mut Builder, kind: ColumnKind) -> (u8, Table) {
    let zone = matches!(kind, ColumnKind::Time).then(|| builder.create_string("UTC"));
    let start = builder.start_table();
    let number = match kind {
        ColumnKind::Whole => {
            builder.push_slot_always(slot(0), 64_i32);
            builder.push_slot_always(slot(1), true);
            2
        }
        ColumnKind::Number => {
            builder.push_slot_always(slot(0), DOUBLE);
            3
        }
        ColumnKind::Text => 5,
        ColumnKind::Flag => 6,
        ColumnKind::Time => {
            builder.push_slot_always(slot(0), MILLISECOND);
            if let Some(zone) = zone {
                builder.push_slot_always(slot(1), zone);
            }
            10
        }
    };
    (number, builder.end_table(start))
}

/// Base 64 of RFC 4648 with padding.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let of = |index: usize| u32::from(three.get(index).copied().unwrap_or_default());
        let bits = of(0) << 16 | of(1) << 8 | of(2);
        for digit in 0..4 {
            let is_padding = digit > three.len();
            let at = (bits >> (18 - 6 * digit) & 0x3F) as usize;
            text.push(if is_padding { '=' } else { char::from(DIGITS[at]) });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_64_is_that_of_the_standard() {
        // RFC 4648, section 10.
        for (text, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(text.as_bytes()), coded);
        }
        assert_eq!(base64(&[0xFB, 0xFF, 0xFE]), "+//+");
    }
}
