//! The room on a disk.

use std::{io, path::Path};

/// Free space of the file system of a directory for this user, bytes.
///
/// # Errors
/// [`io::Error`] if the system does not say.
pub fn free_bytes(directory: &Path) -> io::Result<u64> {
    crate::system::free_bytes(directory)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directory_has_a_free_space_and_a_missing_one_has_none() {
        let directory = tempfile::TempDir::new().unwrap();
        assert!(free_bytes(directory.path()).unwrap() > 0);
        assert!(free_bytes(&directory.path().join("gone")).is_err());
    }
}
