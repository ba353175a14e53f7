//! The tables of runs as HDF5: a group for each table, a dataset for each column, and its unit and meaning
//! as attributes.

mod file;

use file::{Attribute, DataType, Hdf5File};
use parquet::data_type::ByteArray;
use rig_record::StoredRecord;

use super::{
    column::{self, Column, ColumnKind, TableName},
    error::ExportError,
    rows,
    table::checked,
    values::{Typed, Values},
};
use crate::results::RunResults;

/// In place of a missing whole number, time or flag; a missing number is NaN, and a missing text empty.
const MISSING: i64 = -1;

/// The program that writes the file.
const CREATOR: &str = concat!("rigd ", env!("CARGO_PKG_VERSION"));

/// Collects the tables of one or several runs.
#[derive(Debug)]
pub struct Hdf5Export {
    tables: Vec<(TableName, Vec<(Column, Values)>)>,
    runs: Vec<String>,
    /// The first column of each table names the run.
    is_of_several: bool,
}

impl Hdf5Export {
    /// Tables without rows. With `is_of_several`, their first column names the run.
    pub fn new(is_of_several: bool) -> Self {
        let table = |name: TableName| {
            let run = is_of_several.then_some(column::RUN);
            let columns = run.into_iter().chain(name.columns());
            (name, columns.map(|column| (column, Values::new(column.kind))).collect())
        };
        Self { tables: TableName::ALL.map(table).into(), runs: Vec::new(), is_of_several }
    }

    /// Adds the rows of a run: its results, and its records with those of its amendments behind them.
    ///
    /// # Errors
    /// A record that cannot be understood.
    pub fn add(
        &mut self,
        results: &RunResults,
        records: &[StoredRecord],
    ) -> Result<(), ExportError> {
        for (name, columns) in &mut self.tables {
            rows(*name, results, records, self.is_of_several, &mut |row| {
                checked(columns.iter().map(|(column, _)| column.kind), row)?;
                for ((_, values), value) in columns.iter_mut().zip(row) {
                    values.push(*value);
                }
                Ok(())
            })?;
        }
        self.runs.push(results.run.short_name());
        Ok(())
    }

    /// The bytes of the file.
    pub fn finish(self) -> Vec<u8> {
        let runs = self.runs.join(" ");
        let columns = self.tables.iter().flat_map(|(_, columns)| columns);
        let texts = columns.flat_map(|(column, _)| [units(column), column.description]);
        let about = self.tables.iter().map(|(name, _)| name.description());
        let texts = texts.chain(about).chain([CREATOR, &runs]).map(str::to_owned);
        let mut file = Hdf5File::new(texts.collect());
        let mut groups = Vec::new();
        for (name, columns) in &self.tables {
            let datasets: Vec<_> = columns
                .iter()
                .map(|(column, values)| (column.name, dataset(&mut file, column, values)))
                .collect();
            let about = file.text("description", name.description());
            groups.push((name.name(), file.group(&datasets, &[about])));
        }
        let about = [file.text("creator", CREATOR), file.text("runs", &runs)];
        let root = file.group(&groups, &about);
        file.finish(root)
    }
}

/// The unit of a column; a time becomes a number.
const fn units(column: &Column) -> &'static str {
    match column.kind {
        ColumnKind::Time => "ms since 1970-01-01T00:00:00Z",
        _ => column.unit,
    }
}

fn dataset(file: &mut Hdf5File, column: &Column, values: &Values) -> u64 {
    let mut attributes = vec![file.text("description", column.description)];
    if !units(column).is_empty() {
        attributes.push(file.text("units", units(column)));
    }
    let rows = values.is_there.len();
    let (data_type, data) = match &values.values {
        Typed::Number(all) => (DataType::Double, filled(values, all, f64::NAN, f64::to_le_bytes)),
        Typed::Whole(all) => {
            attributes.push(Attribute::whole("missing_value", MISSING));
            (DataType::Whole, filled(values, all, MISSING, i64::to_le_bytes))
        }
        Typed::Flag(all) => {
            attributes.push(Attribute::whole("missing_value", MISSING));
            let all: Vec<i64> = all.iter().map(|is_set| i64::from(*is_set)).collect();
            (DataType::Byte, filled(values, &all, MISSING, |x| [x.to_le_bytes()[0]]))
        }
        Typed::Text(all) => {
            let length = all.iter().map(|text| text.data().len()).max().unwrap_or(0).max(1);
            let mut there = all.iter();
            let mut data = Vec::with_capacity(rows * length);
            for row in 1..=rows {
                if values.is_there[row - 1] == 1 {
                    data.extend(there.next().into_iter().flat_map(ByteArray::data));
                }
                data.resize(row * length, 0);
            }
            (DataType::Text(u32::try_from(length).unwrap_or(u32::MAX)), data)
        }
    };
    file.dataset(data_type, rows, &data, &attributes)
}

/// The bytes of all rows, with `missing` in those without a value.
fn filled<T: Copy, const N: usize>(
    values: &Values,
    all: &[T],
    missing: T,
    bytes: impl Fn(T) -> [u8; N],
) -> Vec<u8> {
    let mut there = all.iter().copied();
    let of_row = |is_there: &i16| match is_there {
        1 => bytes(there.next().unwrap_or(missing)),
        _ => bytes(missing),
    };
    values.is_there.iter().flat_map(of_row).collect()
}
