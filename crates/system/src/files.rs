//! Files for one user, files and folders that outlive a power cut, and locks.

use std::{
    fs::{File, Metadata, OpenOptions},
    io,
    path::{Path, PathBuf},
};

/// Source of random numbers, for messages.
pub const RANDOM_NUMBERS: &str = crate::system::RANDOM_NUMBERS;

/// Has a file made with these permission bits of Unix, before the umask.
///
/// Windows has no such bits: a file gets the access list of its folder, and [`protection`] says that to a person.
pub fn with_mode(options: &mut OpenOptions, mode: u32) -> &mut OpenOptions {
    crate::system::with_mode(options, mode)
}

/// Sets the permission bits of a file; nothing on Windows.
///
/// # Errors
/// [`io::Error`] of the system.
pub fn set_mode(file: &File, mode: u32) -> io::Result<()> {
    crate::system::set_mode(file, mode)
}

/// The permission bits of a file, if some of them are forbidden.
///
/// Always `None` on Windows, where access lists are not read: see [`protection`].
pub fn forbidden_mode(file: &Metadata, forbidden: u32) -> Option<u32> {
    crate::system::forbidden_mode(file, forbidden)
}

/// What a person must know of the protection of a file with a secret; `None` where rigd sees to it itself.
pub fn protection(path: &Path) -> Option<String> {
    crate::system::protection(path)
}

/// Tells one state of a file from another: a file in its place, or other content.
///
/// By number, time of the last change and size. Windows gives programs no number of a file by its path: there by the times of
/// its making and of its last change, and size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp(pub(crate) u64, pub(crate) i64, pub(crate) i64, pub(crate) u64);

impl Stamp {
    /// The state of a file.
    pub fn of(file: &Metadata) -> Self {
        crate::system::stamp(file)
    }
}

/// Puts the names in a folder on the disk; an empty path is the current folder.
///
/// Windows cannot do that: NTFS writes names to its own journal, some seconds later at most. Nothing but the existence of the folder is
/// checked there, so that a power cut within these seconds may take back the last renaming, and never leaves half a file.
///
/// # Errors
/// [`io::Error`] of the folder.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    crate::system::sync_folder(if folder.as_os_str().is_empty() { Path::new(".") } else { folder })
}

/// Puts the content of a file on the disk, also of one that is read-only.
///
/// Windows flushes only files that are open for writing, so that a file that is read-only can be written to for that moment.
///
/// # Errors
/// [`io::Error`] of the file.
pub fn sync_file(path: &Path) -> io::Result<()> {
    crate::system::sync_file(path)
}

/// The whole path of a file or a folder that is there.
///
/// Without links on Unix. On Windows links stay, because the path without them would begin with `\\?\`, which many programs do not take.
///
/// # Errors
/// [`io::Error`] if it is not there.
pub fn whole_path(path: &Path) -> io::Result<PathBuf> {
    crate::system::whole_path(path)
}

/// What to lock in place of an open file that others read meanwhile.
///
/// The file itself on Unix, where a lock hinders nobody who does not ask for it. On Windows nobody can read a locked file, so that
/// another one stands for it, which is made here and stays: the path with `.lock` at its end.
///
/// # Errors
/// [`io::Error`] of that file.
pub fn lock_to_hold(file: &File, path: &Path) -> io::Result<File> {
    crate::system::lock_to_hold(file, path)
}

/// The same for a program that only asks whether another one holds the lock: it makes no file.
///
/// # Errors
/// [`io::Error`] of that file, [`io::ErrorKind::NotFound`] where no program has ever held the lock.
pub fn lock_to_try(file: &File, path: &Path) -> io::Result<File> {
    crate::system::lock_to_try(file, path)
}

/// A folder in which no other program writes folders meanwhile.
///
/// On Unix the folder itself is locked. Windows cannot lock a folder: there it is the file `.rigd.lock` in it, which stays.
#[derive(Debug)]
pub struct FolderTurn {
    /// Held, and let go with the value.
    _lock: File,
    folder: PathBuf,
}

impl FolderTurn {
    /// Waits until no other program has the folder.
    ///
    /// # Errors
    /// [`io::Error`] of the folder.
    pub fn take(folder: &Path) -> io::Result<Self> {
        let lock = crate::system::folder_lock(folder)?;
        Ok(Self { _lock: lock, folder: folder.to_path_buf() })
    }

    /// Puts the names in the folder on the disk, as [`sync_folder`] does.
    ///
    /// # Errors
    /// [`io::Error`] of the folder.
    pub fn sync(&self) -> io::Result<()> {
        sync_folder(&self.folder)
    }
}

/// Puts a folder in the place of another, in one step. The other one, if there was one, is left at `staged` or removed.
///
/// Some network file systems, and Windows, cannot exchange two folders: there the old one is moved away first, and for a moment there is
/// no folder. On Windows it also fails while another program has a file of the old folder open; the old folder stays then.
///
/// # Errors
/// [`io::Error`] of the folders.
pub fn exchange(staged: &Path, place: &Path) -> io::Result<()> {
    crate::system::exchange(staged, place)
}

/// Moves the old folder away, the new one to its place, and removes the old one.
pub(crate) fn exchange_by_moves(staged: &Path, place: &Path) -> io::Result<()> {
    let old = staged.with_extension("old");
    remove(&old)?;
    std::fs::rename(place, &old)?;
    if let Err(error) = std::fs::rename(staged, place) {
        // The old one is better than none.
        std::fs::rename(&old, place)?;
        return Err(error);
    }
    remove(&old)
}

fn remove(folder: &Path) -> io::Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_folder_takes_the_place_of_another_in_both_ways() {
        for way in [exchange, exchange_by_moves] {
            let above = tempfile::TempDir::new().unwrap();
            let [staged, place] = ["a.new", "a"].map(|name| above.path().join(name));
            for (folder, text) in [(&staged, "new"), (&place, "old")] {
                fs::create_dir(folder).unwrap();
                fs::write(folder.join("file"), text).unwrap();
            }
            let turn = FolderTurn::take(above.path()).unwrap();
            way(&staged, &place).unwrap();
            turn.sync().unwrap();
            assert_eq!(fs::read_to_string(place.join("file")).unwrap(), "new");
        }
    }

    #[test]
    fn a_folder_takes_a_place_that_is_empty() {
        let above = tempfile::TempDir::new().unwrap();
        let [staged, place] = ["a.new", "a"].map(|name| above.path().join(name));
        fs::create_dir(&staged).unwrap();
        exchange(&staged, &place).unwrap();
        assert!(place.is_dir() && !staged.exists());
        let missing = exchange_by_moves(&staged, &place);
        assert!(missing.is_err() && place.is_dir(), "what cannot be replaced stays");
    }

    #[test]
    fn a_read_only_file_is_flushed_and_stays_read_only() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "text").unwrap();
        let before = Stamp::of(&fs::metadata(&path).unwrap());
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).unwrap();
        sync_file(&path).unwrap();
        sync_folder(folder.path()).unwrap();
        sync_folder(Path::new("")).unwrap();
        assert!(fs::metadata(&path).unwrap().permissions().readonly());
        assert_eq!(Stamp::of(&fs::metadata(&path).unwrap()), before);
        assert!(sync_file(&folder.path().join("gone")).is_err());
        assert!(sync_folder(&folder.path().join("gone")).is_err());
    }

    #[test]
    fn a_file_that_is_locked_for_others_can_be_read() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "text").unwrap();
        let open = || File::open(&path).unwrap();
        let lock = lock_to_hold(&open(), &path).unwrap();
        let is_free = || lock_to_try(&open(), &path).unwrap().try_lock_shared().is_ok();
        assert!(is_free());
        lock.lock().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "text");
        assert!(!is_free());
        drop(lock);
        assert!(is_free());
    }
}
