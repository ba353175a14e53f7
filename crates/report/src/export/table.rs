//! A table as CSV or Parquet. Programs read every value with the type of its column.
//!
//! In CSV, text is in quotes, so that a label such as `"01"` stays text. A fraction has a decimal
//! point in every row, so that a column that begins with `0.0` is not read as whole numbers. A
//! missing value is empty. Parquet has the types, and the numbers with all digits.

use std::io::{self, Write};

use csv::{QuoteStyle, Writer, WriterBuilder};

use super::{
    column::{Column, ColumnKind},
    error::ExportError,
    parquet::ParquetTable,
};
use crate::units::unix_ms;

/// A drive reads back a tenth of a micrometre or of a millidegree at best.
pub(super) const POSITION_DECIMALS: usize = 4;

/// The format of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    /// Text, one line for each row below a line of names.
    Csv,
    /// Apache Parquet, with units and descriptions.
    Parquet,
}

impl TableFormat {
    /// Both formats.
    pub const ALL: [Self; 2] = [Self::Csv, Self::Parquet];

    /// The extension of its files.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
        }
    }
}

/// A value of a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TableValue<'a> {
    /// A missing value.
    Empty,
    /// A label or a sentence.
    Text(&'a str),
    /// A time, RFC 3339, UTC.
    Time(&'a str),
    /// A whole number.
    Whole(u64),
    /// Yes or no.
    Flag(bool),
    /// A number, with the digits that distinguish it from every other one.
    Exact(f64),
    /// A number with this many decimals.
    Decimals(f64, usize),
    /// A number with this many significant digits.
    Digits(f64, usize),
}

impl TableValue<'_> {
    /// `table_value` of a value; `Empty` without one.
    pub(super) fn of<T>(value: Option<T>, table_value: impl FnOnce(T) -> Self) -> Self {
        value.map_or(Self::Empty, table_value)
    }

    /// A value and its standard deviation, both to three digits of the latter. Rounding then adds
    /// nothing to it.
    pub(super) fn with_sigma(value: f64, sigma: f64) -> [Self; 2] {
        let is_short = |decimals: &i32| sigma * 10_f64.powi(*decimals) < 99.5;
        let decimals = if sigma > 0.0 { (1..12).take_while(is_short).count() + 1 } else { 6 };
        [Self::Decimals(value, decimals), Self::Decimals(sigma, decimals)]
    }

    /// Whether a column of this kind can have the value.
    pub(super) const fn is_of(&self, kind: ColumnKind) -> bool {
        match self {
            Self::Empty => true,
            Self::Text(_) => matches!(kind, ColumnKind::Text),
            Self::Time(_) => matches!(kind, ColumnKind::Time),
            Self::Whole(_) => matches!(kind, ColumnKind::Whole),
            Self::Flag(_) => matches!(kind, ColumnKind::Flag),
            Self::Exact(_) | Self::Decimals(..) | Self::Digits(..) => {
                matches!(kind, ColumnKind::Number)
            }
        }
    }

    /// The value as JSON, with all digits; a time in seconds since 1970.
    pub(super) fn json(self) -> serde_json::Value {
        match self {
            Self::Empty => serde_json::Value::Null,
            Self::Text(text) => text.into(),
            Self::Time(text) => unix_ms(text).map(|ms| ms as f64 / 1e3).into(),
            Self::Whole(number) => number.into(),
            Self::Flag(is_set) => is_set.into(),
            Self::Exact(number) | Self::Decimals(number, _) | Self::Digits(number, _) => {
                number.into()
            }
        }
    }

    fn text(self) -> String {
        match self {
            Self::Empty => String::new(),
            Self::Text(text) | Self::Time(text) => format!("\"{}\"", text.replace('"', "\"\"")),
            Self::Whole(number) => number.to_string(),
            Self::Flag(is_set) => is_set.to_string(),
            Self::Exact(number) => pointed(format!("{number:?}")),
            Self::Decimals(number, decimals) => format!("{number:.decimals$}"),
            Self::Digits(number, digits) => {
                let rounded = format!("{number:.*e}", digits.saturating_sub(1));
                // Rust reads back every number that it writes.
                rounded.parse().map_or(rounded, |number: f64| pointed(format!("{number:?}")))
            }
        }
    }
}

/// Rust writes no point in numbers such as `1e-7`.
fn pointed(number: String) -> String {
    match number.split_once('e') {
        Some((mantissa, exponent)) if !mantissa.contains('.') => format!("{mantissa}.0e{exponent}"),
        _ => number,
    }
}

/// Writes a table row by row.
#[derive(Debug)]
pub(super) struct Table<W: Write + Send> {
    columns: Vec<Column>,
    sink: Sink<W>,
}

#[derive(Debug)]
enum Sink<W: Write + Send> {
    Csv(Box<Writer<W>>),
    Parquet(Box<ParquetTable<W>>),
}

impl<W: Write + Send> Table<W> {
    /// A table with these columns.
    ///
    /// # Errors
    /// Errors of the writer.
    pub(super) fn new(
        columns: Vec<Column>,
        format: TableFormat,
        out: W,
    ) -> Result<Self, ExportError> {
        let sink = match format {
            TableFormat::Csv => {
                let mut writer =
                    WriterBuilder::new().quote_style(QuoteStyle::Never).from_writer(out);
                writer.write_record(columns.iter().map(|column| column.name)).map_err(failed)?;
                Sink::Csv(Box::new(writer))
            }
            TableFormat::Parquet => {
                Sink::Parquet(Box::new(ParquetTable::new(&columns, Vec::new(), out)?))
            }
        };
        Ok(Self { columns, sink })
    }

    /// Adds a row, which has a value of the right kind for each column.
    ///
    /// # Errors
    /// Errors of the writer.
    pub(super) fn row(&mut self, values: &[TableValue<'_>]) -> Result<(), ExportError> {
        checked(self.columns.iter().map(|column| column.kind), values)?;
        match &mut self.sink {
            Sink::Csv(writer) => {
                writer.write_record(values.iter().map(|value| value.text())).map_err(failed)
            }
            Sink::Parquet(table) => table.row(values),
        }
    }

    /// Writes what is left.
    ///
    /// # Errors
    /// Errors of the writer.
    pub(super) fn finish(self) -> Result<(), ExportError> {
        match self.sink {
            Sink::Csv(mut writer) => writer.flush()?,
            Sink::Parquet(table) => table.finish()?,
        }
        Ok(())
    }
}

/// Refuses a row that has not a value of the right kind for each column.
pub(super) fn checked(
    kinds: impl ExactSizeIterator<Item = ColumnKind>,
    values: &[TableValue<'_>],
) -> Result<(), ExportError> {
    if kinds.len() == values.len() && kinds.zip(values).all(|(kind, value)| value.is_of(kind)) {
        return Ok(());
    }
    let message = format!("a row does not fit the columns: {values:?}");
    Err(io::Error::new(io::ErrorKind::InvalidData, message).into())
}

/// Keeps the kind of the system's error: a closed pipe is not a failure.
fn failed(error: csv::Error) -> ExportError {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error.into(),
        kind => io::Error::other(format!("{kind:?}")).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_with_a_fraction_always_has_a_point_and_is_read_back() {
        #[track_caller]
        fn check(value: TableValue<'_>, expected: &str) {
            assert_eq!(value.text(), expected);
        }
        check(TableValue::Exact(0.0), "0.0");
        check(TableValue::Exact(15.0), "15.0");
        check(TableValue::Exact(17.66), "17.66");
        check(TableValue::Exact(1e-7), "1.0e-7");
        check(TableValue::Exact(2.74e-8), "2.74e-8");
        check(TableValue::Exact(1e20), "1.0e20");
        check(TableValue::Decimals(10.0, 4), "10.0000");
        check(TableValue::Digits(2.740_000_3e-8, 6), "2.74e-8");
        check(TableValue::Digits(33.0, 6), "33.0");
        check(TableValue::Digits(33.123_456_7, 6), "33.1235");
    }

    #[test]
    fn a_value_ends_where_three_digits_of_its_standard_deviation_end() {
        #[track_caller]
        fn check(value: f64, sigma: f64, expected: [&str; 2]) {
            assert_eq!(TableValue::with_sigma(value, sigma).map(TableValue::text), expected);
        }
        check(140.403_123, 0.012_34, ["140.4031", "0.0123"]);
        check(140.403_123, 0.099_96, ["140.403", "0.100"]);
        check(140.403_123, 0.234, ["140.403", "0.234"]);
        check(140.403_123, 23.4, ["140.4", "23.4"]);
        check(140.403_123, 2340.0, ["140.4", "2340.0"]);
        check(5.0, 0.0, ["5.000000", "0.000000"]);
    }

    #[test]
    fn labels_are_quoted_and_a_row_that_does_not_fit_is_refused() {
        let column = |name, kind| Column { name, kind, unit: "", description: "" };
        let columns =
            || vec![column("sample", ColumnKind::Text), column("count", ColumnKind::Whole)];
        let mut bytes = Vec::new();
        let mut table = Table::new(columns(), TableFormat::Csv, &mut bytes).unwrap();
        table.row(&[TableValue::Text("01"), TableValue::Whole(1)]).unwrap();
        table.row(&[TableValue::Text("agar, \"soft\""), TableValue::Empty]).unwrap();
        table.finish().unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert_eq!(text, "sample,count\n\"01\",1\n\"agar, \"\"soft\"\"\",\n");
        for format in TableFormat::ALL {
            let mut table = Table::new(columns(), format, Vec::new()).unwrap();
            assert!(table.row(&[TableValue::Text("01")]).is_err(), "too short");
            assert!(table.row(&[TableValue::Whole(1), TableValue::Whole(1)]).is_err(), "a number");
        }
    }
}
