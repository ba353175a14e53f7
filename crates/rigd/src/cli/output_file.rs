//! The files that `--out` names. A file that is there is replaced if it is an earlier output of the same kind, and is left
//! as it is otherwise: a wrong name must not cost a protocol.

use std::{
    fs::{self, File},
    io::{self, Read},
    path::Path,
};

use rig_report::export::{TableExport, TableFormat, TableName};

use super::Failure;

/// What is written to a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OutputKind {
    /// The report of a run, HTML.
    Report,
    /// One table as CSV.
    Csv(TableName),
    /// One table as Apache Parquet.
    Parquet,
    /// All tables.
    Hdf5,
    /// Records, one JSON object a line.
    Records,
    /// The event model of bluesky.
    Documents,
    /// A sweep.
    Touchstone,
}

/// The beginning of a file by which text is told, bytes.
const HEAD: u64 = 4096;

/// The columns by which a table is told: the first three of sweeps and of readings are the same.
const COLUMNS: usize = 4;

impl OutputKind {
    const fn name(self) -> &'static str {
        match self {
            Self::Report => "a report of rigd",
            Self::Csv(_) => "this table of rigd as CSV",
            Self::Parquet => "a table of rigd as Parquet",
            Self::Hdf5 => "an HDF5 file of rigd",
            Self::Records => "records of rigd",
            Self::Documents => "documents of rigd",
            Self::Touchstone => "a Touchstone file of rigd",
        }
    }

    /// Whether a file that begins in this way can be one of this kind.
    fn is_head(self, head: &[u8]) -> bool {
        match self {
            Self::Report => {
                let has_title = head.windows(14).any(|bytes| bytes == b"report</title>");
                head.starts_with(b"<!DOCTYPE html>") && has_title
            }
            Self::Csv(table) => {
                let own = head.strip_prefix(b"run,").unwrap_or(head);
                let columns = first_columns(table);
                !columns.is_empty() && own.starts_with(columns.as_bytes())
            }
            Self::Parquet => head.starts_with(b"PAR1"),
            Self::Hdf5 => head.starts_with(b"\x89HDF"),
            Self::Records => head.starts_with(br#"{"seq":"#),
            Self::Documents => head.starts_with(br#"{"doc":"#),
            Self::Touchstone => head.starts_with(b"! rigd: sweep "),
        }
    }

    /// Whether other programs write files with the same beginning.
    const fn is_common(self) -> bool {
        matches!(self, Self::Parquet | Self::Hdf5)
    }
}

/// The names of the first columns of a table, with the comma behind each.
fn first_columns(table: TableName) -> String {
    let mut header = Vec::new();
    let written = TableExport::new(table, TableFormat::Csv, false, &mut header);
    if written.and_then(TableExport::finish).is_err() {
        return String::new();
    }
    String::from_utf8_lossy(&header).split_inclusive(',').take(COLUMNS).collect()
}

/// Opens a file to write, empty.
///
/// # Errors
/// [`Failure::Kept`] for a file that is there and is of another kind; it is unchanged. The error of the system.
pub(super) fn create(path: &Path, kind: OutputKind) -> Result<File, Failure> {
    check(path, kind)?;
    File::create(path).map_err(|source| Failure::File { path: path.to_path_buf(), source })
}

/// Refuses a path at which another file is.
///
/// # Errors
/// As [`create`].
pub(super) fn check(path: &Path, kind: OutputKind) -> Result<(), Failure> {
    match may_replace(path, kind) {
        Ok(true) => Ok(()),
        Ok(false) => Err(Failure::Kept { path: path.to_path_buf(), kind: kind.name() }),
        Err(source) => Err(Failure::File { path: path.to_path_buf(), source }),
    }
}

/// Whether there is nothing to lose: no file, an empty one, one of this kind, or a device or a pipe.
fn may_replace(path: &Path, kind: OutputKind) -> io::Result<bool> {
    match fs::metadata(path) {
        Ok(found) if found.is_file() && found.len() > 0 => {}
        // A directory is refused when it is opened.
        Ok(_) => return Ok(true),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(true),
        Err(error) => return Err(error),
    }
    let mut bytes = Vec::new();
    let mut file = File::open(path)?;
    file.by_ref().take(HEAD).read_to_end(&mut bytes)?;
    if !kind.is_head(&bytes) || !kind.is_common() {
        return Ok(kind.is_head(&bytes));
    }
    file.read_to_end(&mut bytes)?;
    Ok(bytes.windows(4).any(|bytes| bytes == b"rigd"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_columns_tell_each_table_from_the_others() {
        let all = TableName::ALL.map(first_columns);
        for (index, columns) in all.iter().enumerate() {
            assert_eq!(columns.matches(',').count(), COLUMNS, "{columns}");
            assert_eq!(all.iter().position(|other| other == columns), Some(index), "{columns}");
        }
    }
}
