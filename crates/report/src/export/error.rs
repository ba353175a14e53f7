//! Errors of exports.

use std::io;

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
}
