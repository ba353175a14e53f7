//! Moves sealed runs to an archive: a directory with one folder for each run, which is never written again.
//!
//! ```text
//!  begun ─▶ copied ─▶ listed ─▶ flushed ─▶ checked ─▶ placed │ ─▶ taken out ─▶ folder removed
//!  in `.NAME.part`, begun again after a kill                  │ in one transaction of the journal
//! ```
//!
//! A program that is killed at any of these steps leaves the run in the journal, in the archive, or in both;
//! the same command goes on from there. Nothing is taken out before the checker has read the copy.

mod object;

use std::{
    fs::{self, File, TryLockError},
    io,
    path::{Path, PathBuf},
};

use rig_store::{Digest, Reader, Run, RunId, Store, StoreError, make_directory};
use rig_system::files::whole_path;
use rig_verify::JournalError;

use crate::run_files;
pub(crate) use object::{Object, find, is_archive, objects};

/// Held while a program writes to the archive.
const LOCK: &str = "archive.lock";

/// Why a run is not archived.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ArchiveError {
    /// A file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The directory is that of a journal.
    #[error(
        "archive {}: the directory has a journal or the folders of its runs; an archive needs one of its own", root.display()
    )]
    NotApart {
        /// The directory.
        root: PathBuf,
    },
    /// Another program writes to the archive.
    #[error("archive {} is in use by another rigd", root.display())]
    InUse {
        /// The archive.
        root: PathBuf,
    },
    /// The journal.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The checker cannot read the journal.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The checker has findings.
    #[error("the journal is {sentence}")]
    NotSound {
        /// The verdict.
        sentence: String,
    },
    /// The folder of the run is not the one in its manifest.
    #[error("{}: {what}", file.display())]
    FolderDiffers {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The folder in the archive is not that of the run.
    #[error("{}: {what}", object.display())]
    ObjectDiffers {
        /// The folder.
        object: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The wanted run fits more than one folder.
    #[error("`{wanted}` fits {count} runs of the archive: name one by its id")]
    Ambiguous {
        /// The wanted run.
        wanted: String,
        /// Number of runs that fit.
        count: usize,
    },
}

impl ArchiveError {
    /// Whether an amendment of the run has not ended.
    pub(crate) const fn is_under_way(&self) -> bool {
        matches!(self, Self::Store(StoreError::UnderWay { .. }))
    }

    /// Whether the run itself is at fault, and not the system or another program.
    pub(crate) const fn is_of_run(&self) -> bool {
        matches!(
            self,
            Self::NotSound { .. }
                | Self::FolderDiffers { .. }
                | Self::ObjectDiffers { .. }
                | Self::Store(StoreError::Broken { .. })
        )
    }
}

/// The error of the system at a path.
fn failed(path: &Path) -> impl FnOnce(io::Error) -> ArchiveError {
    let path = path.to_path_buf();
    move |source| ArchiveError::File { path, source }
}

/// Refuses the directory of a journal, and that of the folders of runs in `data`, as an archive: its runs would
/// be said to be elsewhere.
///
/// # Errors
/// [`ArchiveError::NotApart`].
pub(crate) fn check_apart(root: &Path, data: &Path) -> Result<(), ArchiveError> {
    let runs = fs::canonicalize(run_files::root(data));
    let is_runs = || matches!((fs::canonicalize(root), runs), (Ok(root), Ok(runs)) if root == runs);
    if Reader::exists(root) || is_runs() {
        return Err(ArchiveError::NotApart { root: root.to_path_buf() });
    }
    Ok(())
}

/// An archive that is open to write. There is one writer at a time.
#[derive(Debug)]
pub(crate) struct Archive {
    root: PathBuf,
    _lock: File,
}

impl Archive {
    /// Opens an archive, which is made if it is missing.
    ///
    /// # Errors
    /// [`ArchiveError::InUse`], or the error of the system.
    pub(crate) fn open(root: &Path) -> Result<Self, ArchiveError> {
        make_directory(root).map_err(failed(root))?;
        // The journal keeps the place, and a path from the current directory means nothing later.
        let root = whole_path(root).map_err(failed(root))?;
        let path = root.join(LOCK);
        let lock = File::options().create(true).truncate(false).write(true).open(&path);
        let lock = lock.map_err(failed(&path))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(ArchiveError::InUse { root }),
            Err(TryLockError::Error(source)) => return Err(ArchiveError::File { path, source }),
        }
        Ok(Self { root, _lock: lock })
    }

    /// Where a run is or will be.
    pub(crate) fn place(&self, run: &Run) -> PathBuf {
        place(&self.root, run)
    }

    /// Copies a sealed run of the journal in `data` to the archive, and checks the copy. A copy that is
    /// there already is only checked. The journal is unchanged.
    ///
    /// # Errors
    /// [`ArchiveError`]; nothing is then in the place of the run, or what was there before.
    pub(crate) fn copy(&self, data: &Path, run: &Run) -> Result<Object, ArchiveError> {
        let expected = parts(&Reader::open(data)?, run.id)?;
        let place = self.place(run);
        if place.exists() {
            // A program that was killed behind its rename has not flushed it.
            object::flush_directory(&self.root)?;
            return Object::check(&place, &expected);
        }
        for (part, _) in &expected {
            sound(data, *part)?;
        }
        let name = place.file_name().unwrap_or_default().to_string_lossy();
        let part = self.root.join(format!(".{name}.part"));
        if part.exists() {
            fs::remove_dir_all(&part).map_err(failed(&part))?;
        }
        fs::create_dir(&part).map_err(failed(&part))?;
        rig_store::excerpt(data, run.id, &part)?;
        let (folder, copy) = (run_files::folder(data, run), run_files::folder(&part, run));
        if folder.is_dir() {
            let digest = expected[0].1.to_string();
            object::check_folder(&folder, run.id, &digest)?;
            let above = copy.parent().unwrap_or(&part);
            fs::create_dir_all(above).map_err(failed(above))?;
            run_files::copy_folder(&folder, &copy).map_err(failed(&copy))?;
        }
        object::list(&part, run, &expected)?;
        object::flush(&part)?;
        Object::check(&part, &expected)?;
        fs::rename(&part, &place).map_err(failed(&place))?;
        object::flush_directory(&self.root)?;
        Ok(Object { place })
    }

    /// Takes the readings of a copied run out of the journal in `data`, and removes its folder there.
    /// Returns whether the folder is gone; one with other files than the archive has stays.
    ///
    /// # Errors
    /// [`ArchiveError::ObjectDiffers`] if the run has changed since, such as by an amendment; or what the
    /// system or the journal reports.
    pub(crate) fn take_out(
        &self,
        store: &Store,
        data: &Path,
        run: &Run,
        who: &str,
    ) -> Result<bool, ArchiveError> {
        let reader = store.reader()?;
        let place = self.place(run);
        if reader.archive_of(run.id)?.is_none() {
            // With the journal open to write, nobody else can add to the run.
            Object::check(&place, &parts(&reader, run.id)?)?;
            store.archive(run.id, &place.to_string_lossy(), who)?;
        }
        let is_gone =
            object::remove_copied(&run_files::folder(data, run), &run_files::folder(&place, run))?;
        Ok(is_gone)
    }

    /// Whether this archive has a run that was taken out, and the journal's directory still has its folder.
    ///
    /// # Errors
    /// [`StoreError`] of the journal.
    pub(crate) fn is_unfinished(
        &self,
        reader: &Reader,
        data: &Path,
        run: &Run,
    ) -> Result<bool, StoreError> {
        let is_here = reader
            .archive_of(run.id)?
            .is_some_and(|note| Path::new(&note.place) == self.place(run));
        Ok(is_here && self.place(run).is_dir() && run_files::folder(data, run).is_dir())
    }
}

/// Where a run is or will be in an archive: the name of its folder, and its id, because runs of two journals
/// may have one name.
pub(crate) fn place(root: &Path, run: &Run) -> PathBuf {
    let folder = run_files::folder(Path::new(""), run);
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    root.join(format!("{name}_{}", run.id))
}

/// A run and its amendments that have ended, each with the digest of its last record.
fn parts(reader: &Reader, run: RunId) -> Result<Vec<(RunId, Digest)>, StoreError> {
    let amendments = reader.amendments(run)?;
    let digest = |id| Ok((id, reader.last_digest(id)?.unwrap_or(Digest::START)));
    [run].into_iter().chain(amendments).map(digest).collect()
}

/// The checker finds nothing in a run.
fn sound(data: &Path, run: RunId) -> Result<String, ArchiveError> {
    let verdict = rig_verify::verify(data, &run.to_string())?;
    if verdict.is_sound {
        Ok(verdict.digest)
    } else {
        Err(ArchiveError::NotSound { sentence: verdict.sentence() })
    }
}
