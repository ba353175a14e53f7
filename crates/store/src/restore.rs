//! Puts a backup in place of a journal that was lost.

use std::{
    ffi::{OsStr, OsString},
    fs, io,
    path::Path,
};

use rig_system::files::sync_folder;

use crate::{
    BackedUpRun, PathAct, StoreError, backup, copy_beside, lock, lock::DirectoryLock, schema,
};

/// The copy is here until it has been read. One that is left was broken off.
const STAGE: &str = "restore.part";

/// Copies the journal in `backup` to `to`, an absent or empty directory, with those of the files and folders `beside` that
/// the backup has. The copy gets its place when every run in it was read and found whole; if one has a flaw, which the
/// list then says, nothing is restored. A restoration that was broken off is begun again.
///
/// # Errors
/// [`StoreError::NoJournal`]; [`StoreError::InUse`] if a program writes to `to`; [`StoreError::Occupied`] names
/// what `to` has in it; [`StoreError::OtherFormat`]; or an error of the system or of SQLite.
pub fn restore(backup: &Path, to: &Path, beside: &[&str]) -> Result<Vec<BackedUpRun>, StoreError> {
    if !schema::database(backup).exists() {
        return Err(StoreError::NoJournal);
    }
    let lock = DirectoryLock::take(to)?;
    let stage = to.join(STAGE);
    let is_again = stage.exists();
    let found = occupant(to, if is_again { beside } else { &[] });
    if let Some(entry) = found.map_err(PathAct::List.failed(to))? {
        let entry = entry.to_string_lossy().into_owned();
        return Err(StoreError::Occupied { entry });
    }
    if is_again {
        fs::remove_dir_all(&stage).map_err(PathAct::Remove.failed(&stage))?;
    }
    let copied = backup::back_up(backup, &stage, &[]);
    let is_whole = |runs: &Vec<BackedUpRun>| runs.iter().all(|run| run.flaw.is_none());
    let placed = match &copied {
        Ok(runs) if is_whole(runs) => place(backup, &stage, to, beside),
        _ => Ok(()),
    };
    // With the stage, the same command begins again after an error: what is beside it may be in its place.
    placed.map_err(PathAct::Place.failed(to))?;
    let removed = fs::remove_dir_all(&stage);
    let runs = copied?;
    removed.map_err(PathAct::Remove.failed(&stage))?;
    drop(lock);
    Ok(runs)
}

/// What a directory has in it, except for its lock, a stage and files with these names.
fn occupant(directory: &Path, but: &[&str]) -> io::Result<Option<OsString>> {
    for entry in fs::read_dir(directory)? {
        let name = entry?.file_name();
        let is_allowed = |allowed: &&str| name == OsStr::new(allowed);
        if ![lock::FILE, STAGE].iter().chain(but).any(is_allowed) {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

/// Moves the copy to its place, the journal last: a directory with a journal has everything.
fn place(backup: &Path, stage: &Path, to: &Path, beside: &[&str]) -> io::Result<()> {
    for name in beside {
        let (copy, staged, placed) = (backup.join(name), stage.join(name), to.join(name));
        if copy.exists() {
            copy_beside(&copy, &staged)?;
            if placed.is_dir() {
                // Of a restoration that was broken off: a folder does not take the place of a full one.
                fs::remove_dir_all(&placed)?;
            }
            fs::rename(&staged, placed)?;
        }
    }
    sync_folder(to)?;
    fs::rename(schema::database(stage), schema::database(to))?;
    sync_folder(to)
}
