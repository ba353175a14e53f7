//! The size of a run in the database.

use super::Reader;
use crate::{RunId, StoreError};

/// Size of a page, bytes: the default of SQLite.
const PAGE: u64 = 4096;
/// What a page of rows has room for, and a page on which a long row goes on.
const ROOM: u64 = PAGE - 8;
const OVERFLOW: u64 = PAGE - 4;
/// The least and the most that a row keeps on its own page when it goes on elsewhere.
///
/// # Source
/// SQLite, "Database File Format", section 1.6.
const LOCAL: [u64; 2] = [489, PAGE - 35];
/// The numbers, the digest and the head of a record, and its entry in the index by number, bytes.
const REST: [u64; 2] = [64, 12];

impl Reader {
    /// Size of the records of a run in the database, bytes: the pages that its rows fill one after the
    /// other.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn bytes_of(&self, id: RunId) -> Result<u64, StoreError> {
        let mut statement = self.connection.prepare_cached(
            "SELECT octet_length(payload) + length(kind) FROM records
             WHERE run = (SELECT key FROM runs WHERE id = ?1) ORDER BY seq",
        )?;
        let mut rows = statement.query([id.to_string()])?;
        let (mut full, mut filled, mut index) = (0, 0, 0);
        while let Some(row) = rows.next()? {
            let size = row.get::<_, i64>(0)?.cast_unsigned() + REST[0];
            let (local, pages) = spread(size);
            if filled + local > ROOM {
                (full, filled) = (full + PAGE, 0);
            }
            (full, filled) = (full + pages * PAGE, filled + local);
            index += REST[1];
        }
        Ok(full + filled + index)
    }
}

/// The part of a row on its own page, and the number of pages on which it goes on.
fn spread(size: u64) -> (u64, u64) {
    let [least, most] = LOCAL;
    if size <= most {
        return (size, 0);
    }
    let fitting = least + (size - least) % OVERFLOW;
    let local = if fitting <= most { fitting } else { least };
    (local, (size - local).div_ceil(OVERFLOW))
}
