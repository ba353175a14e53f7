//! Errors of exports.

use std::io;

use parquet::errors::ParquetError;
use rig_record::UnreadableRecord;

/// A failed export.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The file cannot be written.
    #[error("export")]
    Io(#[from] io::Error),
    /// A record cannot be understood.
    #[error("export")]
    Record(#[from] UnreadableRecord),
    /// The table cannot be written as Parquet.
    #[error("export")]
    Parquet(#[from] ParquetError),
}
