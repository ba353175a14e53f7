//! Small files of the data directory that are never half written.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

use rig_system::files::{sync_folder, with_mode};
use serde::Serialize;

/// Permissions of a file with nothing secret, before the umask.
pub(crate) const FOR_ALL: u32 = 0o666;
/// Permissions of a file for the user of the daemon alone.
pub(crate) const FOR_OWNER: u32 = 0o600;

/// Writes a value as JSON: beside its place first, and waits for the disk.
///
/// # Errors
/// [`io::Error`] of the file or its directory. The file is then the old one or the new one.
pub(crate) fn replace(path: &Path, value: &impl Serialize, mode: u32) -> io::Result<()> {
    replace_bytes(path, &serde_json::to_vec_pretty(value)?, mode)
}

/// The same for bytes.
///
/// # Errors
/// As [`replace`].
pub(crate) fn replace_bytes(path: &Path, bytes: &[u8], mode: u32) -> io::Result<()> {
    let beside = PathBuf::from(format!("{}.new", path.display()));
    // One that was left may have another mode.
    _ = fs::remove_file(&beside);
    let written = write(&beside, bytes, mode).and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        // A part of it would take room on a disk that may be full.
        _ = fs::remove_file(&beside);
    }
    written?;
    sync_folder(path.parent().unwrap_or(Path::new("")))
}

fn write(path: &Path, bytes: &[u8], mode: u32) -> io::Result<()> {
    let mut options = File::options();
    let mut file = with_mode(options.create_new(true).write(true), mode).open(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use rig_system::files::forbidden_mode;

    use super::*;

    #[test]
    fn a_file_is_replaced_with_its_mode_also_where_a_killed_program_left_its_beginning() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("a.json");
        fs::write(folder.path().join("a.json.new"), "{\"cut").unwrap();
        for value in [1, 2] {
            replace(&path, &value, FOR_OWNER).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), value.to_string());
        }
        assert_eq!(forbidden_mode(&fs::metadata(&path).unwrap(), !FOR_OWNER), None);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(replace(&folder.path().join("gone/a.json"), &1, FOR_ALL).is_err());
        // A name that is taken by a folder cannot be replaced, and nothing is left beside it.
        fs::create_dir(folder.path().join("b.json")).unwrap();
        assert!(replace(&folder.path().join("b.json"), &1, FOR_ALL).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
