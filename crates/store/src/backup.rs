//! Copies a journal while it may be written.

use std::{fs, path::Path};

use rig_system::files::{sync_file, sync_folder};
use rusqlite::{
    Connection,
    backup::{Backup, StepResult},
};

use crate::{
    ChainCheck, Flaw, PathAct, Reader, StoreError, directory::copy_all_beside, lock::DirectoryLock,
    schema,
};

/// A run in a copy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BackedUpRun {
    /// Id of the run.
    pub id: String,
    /// Number of records before the first flaw.
    pub records: u64,
    /// What is wrong with it, in the original too; `None` for a sound one.
    pub flaw: Option<Flaw>,
}

/// Copies the committed records of the journal in `from` to a new journal in `to`, with those of the files and folders
/// `beside` that are beside it, and reads every run of the copy. A program that writes the journal meanwhile goes on: it
/// waits for nothing. A copy that was broken off is begun again.
///
/// # Errors
/// [`StoreError::NoJournal`]; [`StoreError::NotEmpty`] if `to` has a journal already; or an error of the
/// system or of SQLite. A copy that is not complete has another name than a journal.
pub fn back_up(from: &Path, to: &Path, beside: &[&str]) -> Result<Vec<BackedUpRun>, StoreError> {
    let source = schema::database(from);
    if !source.exists() {
        return Err(StoreError::NoJournal);
    }
    let (old, _copy) = schema::open_to_read(&source)?;
    let lock = DirectoryLock::take(to)?;
    let target = schema::database(to);
    if target.exists() {
        return Err(StoreError::NotEmpty);
    }
    let part = to.join("rigd.db.part");
    if part.exists() {
        fs::remove_file(&part).map_err(PathAct::Remove.failed(&part))?;
    }
    let mut new = Connection::open(&part)?;
    // All pages in one step are one state of the journal. Its writer appends to a log meanwhile.
    if Backup::new(&old, &mut new)?.step(-1)? != StepResult::Done {
        return Err(StoreError::InUse);
    }
    new.close().map_err(|(_, error)| error)?;
    copy_all_beside(from, to, beside)?;
    let place = || {
        sync_file(&part)?;
        fs::rename(&part, &target)?;
        sync_folder(to)
    };
    place().map_err(PathAct::Place.failed(&target))?;
    drop(lock);
    let reader = Reader::open(to)?;
    let check = |run: crate::Run| {
        let (records, flaw) = match reader.verify(run.id)? {
            ChainCheck::Intact { records, .. } => (records, None),
            ChainCheck::Broken { seq, flaw } => (seq.saturating_sub(1), Some(flaw)),
        };
        Ok(BackedUpRun { id: run.id.to_string(), records, flaw })
    };
    let mut runs = reader.runs()?.into_iter().map(check).collect::<Result<Vec<_>, StoreError>>()?;
    let damaged = |(id, flaw)| BackedUpRun { id, records: 0, flaw: Some(flaw) };
    runs.extend(reader.damaged_entries()?.into_iter().map(damaged));
    Ok(runs)
}
