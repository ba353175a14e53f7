//! One writer per data directory.

use std::{
    fs::{File, TryLockError},
    io,
    path::Path,
    thread,
    time::Duration,
};

use crate::{PathAct, StoreError, make_directory};

pub(crate) const FILE: &str = "rigd.lock";

/// A reader that asks whether there is a writer holds the lock for some microseconds. A writer that
/// meets one tries again, this often and with this pause.
const TRIES: u32 = 50;
const PAUSE: Duration = Duration::from_millis(2);

/// Held as long as the store is open. The system releases it at any end of the program.
#[derive(Debug)]
pub(crate) struct DirectoryLock {
    _file: File,
}

impl DirectoryLock {
    /// Makes the directory where it is missing, and takes its lock.
    pub(crate) fn take(directory: &Path) -> Result<Self, StoreError> {
        if directory.is_file() {
            return Err(StoreError::NotADirectory);
        }
        make_directory(directory).map_err(PathAct::Make.failed(directory))?;
        let path = directory.join(FILE);
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&path)
            .map_err(PathAct::Make.failed(&path))?;
        for _ in 0..TRIES {
            match file.try_lock() {
                Ok(()) => return Ok(Self { _file: file }),
                Err(TryLockError::WouldBlock) => thread::sleep(PAUSE),
                Err(TryLockError::Error(source)) => {
                    return Err(PathAct::Lock.failed(&path)(source));
                }
            }
        }
        Err(StoreError::InUse)
    }
}

/// Whether a program has the directory open for writing. If the lock cannot be tested, the answer
/// is yes, because then nothing shows that the program has ended.
pub(crate) fn is_held(directory: &Path) -> bool {
    match File::open(directory.join(FILE)) {
        Ok(file) => file.try_lock_shared().is_err(),
        Err(error) => error.kind() != io::ErrorKind::NotFound,
    }
}
