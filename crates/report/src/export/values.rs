//! The values of a column, collected row by row.

use parquet::data_type::ByteArray;

use super::{column::ColumnKind, table::TableValue};
use crate::units::unix_ms;

/// The values of a column, and for each row whether there is one.
#[derive(Debug)]
pub(super) struct Values {
    /// 1 for a row with a value, 0 for a row without one.
    pub(super) is_there: Vec<i16>,
    pub(super) values: Typed,
}

/// The values that there are.
#[derive(Debug)]
pub(super) enum Typed {
    Text(Vec<ByteArray>),
    /// Whole numbers, and times in ms since 1970.
    Whole(Vec<i64>),
    Number(Vec<f64>),
    Flag(Vec<bool>),
}

impl Values {
    pub(super) const fn new(kind: ColumnKind) -> Self {
        let values = match kind {
            ColumnKind::Text => Typed::Text(Vec::new()),
            ColumnKind::Whole | ColumnKind::Time => Typed::Whole(Vec::new()),
            ColumnKind::Number => Typed::Number(Vec::new()),
            ColumnKind::Flag => Typed::Flag(Vec::new()),
        };
        Self { is_there: Vec::new(), values }
    }

    /// Adds the value of a row, which has been checked against the column.
    pub(super) fn push(&mut self, value: TableValue<'_>) {
        let is_there = match (&mut self.values, value) {
            (Typed::Text(texts), TableValue::Text(text)) => {
                texts.push(text.into());
                true
            }
            (Typed::Whole(times), TableValue::Time(text)) => {
                unix_ms(text).map(|ms| times.push(ms)).is_some()
            }
            (Typed::Whole(numbers), TableValue::Whole(number)) => {
                numbers.push(number.cast_signed());
                true
            }
            (
                Typed::Number(numbers),
                TableValue::Exact(number)
                | TableValue::Decimals(number, _)
                | TableValue::Digits(number, _),
            ) => {
                numbers.push(number);
                true
            }
            (Typed::Flag(flags), TableValue::Flag(is_set)) => {
                flags.push(is_set);
                true
            }
            // The table has refused every other value but a missing one.
            _ => false,
        };
        self.is_there.push(is_there.into());
    }
}
