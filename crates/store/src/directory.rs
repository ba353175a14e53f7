//! Directories and copies that outlive a power cut.

use std::{fs, io, path::Path};

use rig_system::files::{sync_file, sync_folder};

use crate::{PathAct, StoreError};

/// Copies those of the files and folders with these names that a data directory has beside its journal. The journal of the
/// copy gets its name after this: a directory with a journal has everything.
///
/// # Errors
/// The first one, after all others were copied.
pub(crate) fn copy_all_beside(from: &Path, to: &Path, names: &[&str]) -> Result<(), StoreError> {
    let copied = names.iter().map(|name| {
        let copy = to.join(name);
        copy_beside(&from.join(name), &copy).map_err(PathAct::Place.failed(&copy))
    });
    let copied = copied.fold(Ok(()), Result::and);
    sync_folder(to).map_err(PathAct::Place.failed(to))?;
    copied
}

/// Copies what stands beside a journal, if it is there: a file, or a folder with its files and without the folders in it.
/// The copy is on the disk when this returns.
///
/// # Errors
/// [`io::Error`] of a file that cannot be read or written.
pub(crate) fn copy_beside(from: &Path, to: &Path) -> io::Result<()> {
    if from.is_dir() {
        make_directory(to)?;
        for entry in fs::read_dir(from)? {
            let entry = entry?;
            if entry.file_type()?.is_file() {
                copy_beside(&entry.path(), &to.join(entry.file_name()))?;
            }
        }
        return sync_folder(to);
    }
    match fs::copy(from, to) {
        Err(error) if error.kind() == io::ErrorKind::NotFound && !from.exists() => Ok(()),
        copied => {
            copied?;
            sync_file(to)
        }
    }
}

/// Makes a directory, and those above it, where they are missing. The disk has their names then: what is flushed
/// within a directory is lost with the directory if that is not.
///
/// # Errors
/// [`io::Error`] of a directory that cannot be made or flushed.
pub fn make_directory(directory: &Path) -> io::Result<()> {
    let missing: Vec<_> = directory
        .ancestors()
        .take_while(|above| !above.as_os_str().is_empty() && !above.is_dir())
        .collect();
    fs::create_dir_all(directory)?;
    for made in missing {
        sync_folder(made.parent().unwrap_or(Path::new("")))?;
    }
    Ok(())
}
