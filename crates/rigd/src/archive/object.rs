//! A run in an archive: its folder, the list of its files, and the check of both.

use std::{
    cmp::Reverse,
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
};

use rig_store::{Digest, Reader, Run, RunId, StoreError};
use rig_system::files::{sync_file, sync_folder};
use serde::{Deserialize, Serialize};
use sha2::Digest as _;

use super::{ArchiveError, failed, sound};
use crate::run_files;

/// The list of the files of a run in an archive.
const LIST: &str = "object.json";
/// Version of the list.
const FORMAT: u32 = 1;
/// Folders in folders; rigd writes one level below the folder of a run, and a person may add some.
const DEPTH_MAX: u32 = 16;

/// A run in an archive.
#[derive(Debug)]
pub(crate) struct Object {
    /// Its folder, a data directory that is never written.
    pub(crate) place: PathBuf,
}

/// What the list says.
#[derive(Debug, Serialize, Deserialize)]
struct List {
    format: u32,
    run_id: String,
    name: String,
    status: String,
    started_at: String,
    finished_at: Option<String>,
    /// The run, and then its amendments.
    parts: Vec<Part>,
    software: String,
    files: Vec<Listed>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Part {
    run_id: String,
    /// Digest of the last record, in hexadecimal.
    digest: String,
}

#[derive(Debug, Serialize, Deserialize)]
struct Listed {
    path: String,
    bytes: u64,
    sha256: String,
}

impl Part {
    fn of((run, digest): &(RunId, Digest)) -> Self {
        Self { run_id: run.to_string(), digest: digest.to_string() }
    }
}

impl Object {
    /// Checks a run of an archive: every file against the list, the journal and the folder of the run by the
    /// checker, and its digests against `expected`, those of the run and its amendments.
    ///
    /// # Errors
    /// [`ArchiveError`] names the first difference.
    pub(super) fn check(place: &Path, expected: &[(RunId, Digest)]) -> Result<Self, ArchiveError> {
        let differs = |what: String| ArchiveError::ObjectDiffers { object: place.into(), what };
        let list = read_list(place)?;
        if list.parts != expected.iter().map(Part::of).collect::<Vec<_>>() {
            let what = "the run has other records or amendments than this copy; move the copy away, \
                        and archive the run again";
            return Err(differs(what.to_owned()));
        }
        for Listed { path, bytes, sha256 } in &list.files {
            let file = place.join(path);
            let (found, digest) = digest_of(&file).map_err(failed(&file))?;
            if (found, &digest) != (*bytes, sha256) {
                return Err(differs(format!("{path} is not the file in {LIST}")));
            }
        }
        for (run, digest) in expected {
            let found = sound(place, *run)?;
            if found != digest.to_string() {
                return Err(differs(format!("the last record of run {run} is another one")));
            }
        }
        let (run, digest) = &expected[0];
        let reader = Reader::open(place)?;
        let folder = run_files::folder(place, &reader.run(*run)?);
        if folder.is_dir() {
            check_folder(&folder, *run, &digest.to_string())?;
        }
        Ok(Self { place: place.to_path_buf() })
    }
}

fn read_list(place: &Path) -> Result<List, ArchiveError> {
    let path = place.join(LIST);
    let text = fs::read(&path).map_err(failed(&path))?;
    let list: List = serde_json::from_slice(&text)
        .map_err(|error| failed(&path)(io::Error::new(io::ErrorKind::InvalidData, error)))?;
    if list.format != FORMAT {
        let what = format!("{LIST} has format {}, and this rigd reads {FORMAT}", list.format);
        return Err(ArchiveError::ObjectDiffers { object: place.to_path_buf(), what });
    }
    Ok(list)
}

/// Compares the folder of a run with its manifest.
pub(super) fn check_folder(folder: &Path, run: RunId, digest: &str) -> Result<(), ArchiveError> {
    let found = rig_verify::verify_folder(folder, &run.to_string(), digest);
    match found.map_err(failed(folder))?.into_iter().next() {
        Some(finding) => {
            Err(ArchiveError::FolderDiffers { file: folder.join(finding.file), what: finding.what })
        }
        None => Ok(()),
    }
}

/// Writes the list of the files in `place`, and takes the right to write them away.
pub(super) fn list(place: &Path, run: &Run, parts: &[(RunId, Digest)]) -> Result<(), ArchiveError> {
    let mut files = Vec::new();
    for path in files_in(place)? {
        let (bytes, sha256) = digest_of(&path).map_err(failed(&path))?;
        let relative = path.strip_prefix(place).unwrap_or(&path);
        files.push(Listed { path: relative.to_string_lossy().into_owned(), bytes, sha256 });
    }
    let list = List {
        format: FORMAT,
        run_id: run.id.to_string(),
        name: run.short_name(),
        status: run.status.name().to_owned(),
        started_at: run.started_at.clone(),
        finished_at: run.finished_at.clone(),
        parts: parts.iter().map(Part::of).collect(),
        software: concat!("rigd ", env!("CARGO_PKG_VERSION")).to_owned(),
        files,
    };
    let path = place.join(LIST);
    let write = || {
        let mut file = File::create_new(&path)?;
        file.write_all(&serde_json::to_vec_pretty(&list)?)
    };
    write().map_err(failed(&path))?;
    for path in files_in(place)? {
        let read_only = || {
            let mut permissions = fs::metadata(&path)?.permissions();
            permissions.set_readonly(true);
            fs::set_permissions(&path, permissions)
        };
        read_only().map_err(failed(&path))?;
    }
    Ok(())
}

/// Puts every file and directory below a directory on the disk.
pub(super) fn flush(place: &Path) -> Result<(), ArchiveError> {
    for path in files_in(place)? {
        sync_file(&path).map_err(failed(&path))?;
        let within = path.ancestors().skip(1).take_while(|above| above.starts_with(place));
        within.into_iter().try_for_each(flush_directory)?;
    }
    flush_directory(place)
}

pub(super) fn flush_directory(directory: &Path) -> Result<(), ArchiveError> {
    sync_folder(directory).map_err(failed(directory))
}

/// Removes a folder if each of its files has a copy with the same bytes. Returns whether it is gone.
pub(super) fn remove_copied(folder: &Path, copy: &Path) -> Result<bool, ArchiveError> {
    if !folder.is_dir() {
        return Ok(true);
    }
    for path in files_in(folder)? {
        let copied = copy.join(path.strip_prefix(folder).unwrap_or(&path));
        // A link, or a file that a person has added since.
        if fs::symlink_metadata(&path).map_err(failed(&path))?.is_symlink() || !copied.is_file() {
            return Ok(false);
        }
        let same = digest_of(&path).map_err(failed(&path))?
            == digest_of(&copied).map_err(failed(&copied))?;
        if !same {
            return Ok(false);
        }
    }
    fs::remove_dir_all(folder).map_err(failed(folder))?;
    Ok(true)
}

/// Every file below a directory, in the order of the names.
fn files_in(directory: &Path) -> Result<Vec<PathBuf>, ArchiveError> {
    let (mut files, mut directories) = (Vec::new(), vec![(directory.to_path_buf(), 0)]);
    while let Some((directory, depth)) = directories.pop() {
        if depth > DEPTH_MAX {
            let error = io::Error::other(format!("more than {DEPTH_MAX} folders in each other"));
            return Err(failed(&directory)(error));
        }
        for entry in fs::read_dir(&directory).map_err(failed(&directory))? {
            let entry = entry.map_err(failed(&directory))?;
            let kind = entry.file_type().map_err(failed(&directory))?;
            if kind.is_dir() {
                directories.push((entry.path(), depth + 1));
            } else {
                files.push(entry.path());
            }
        }
    }
    files.sort();
    Ok(files)
}

/// Size and SHA-256 of a file.
fn digest_of(path: &Path) -> io::Result<(u64, String)> {
    let (mut file, mut hash, mut bytes) = (File::open(path)?, sha2::Sha256::new(), 0);
    let mut part = vec![0; 1 << 16];
    loop {
        let read = file.read(&mut part)?;
        if read == 0 {
            break;
        }
        hash.update(&part[..read]);
        bytes += read as u64;
    }
    Ok((bytes, Digest::from_bytes(hash.finalize().into()).to_string()))
}

/// The runs of an archive, the latest first, and behind them those whose list cannot be read; none for a directory that is
/// no archive.
///
/// # Errors
/// [`ArchiveError`] of the system.
pub(crate) fn objects(root: &Path) -> Result<Vec<Object>, ArchiveError> {
    Ok(lists(root)?.into_iter().map(|(place, _)| Object { place }).collect())
}

/// The list of a run, if it can be read.
type FoundList = Result<List, ArchiveError>;

/// The folders of runs with their lists. One that cannot be read hides no other.
fn lists(root: &Path) -> Result<Vec<(PathBuf, FoundList)>, ArchiveError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(root).map_err(failed(root))? {
        let place = entry.map_err(failed(root))?.path();
        let is_hidden =
            place.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if !is_hidden && place.join(LIST).is_file() {
            let list = read_list(&place);
            found.push((place, list));
        }
    }
    let started_at = |list: &FoundList| list.as_ref().ok().map(|list| list.started_at.clone());
    found.sort_by_cached_key(|(_, list)| Reverse(started_at(list)));
    Ok(found)
}

/// The folder of the run that a person means in an archive: `latest`, a short name, an id, or enough of the
/// beginning or the end of one.
///
/// # Errors
/// [`StoreError::NoSuchRun`], [`ArchiveError::Ambiguous`], a list that cannot be read if no other is that of the run, or
/// the error of the system.
pub(crate) fn find(root: &Path, wanted: &str) -> Result<PathBuf, ArchiveError> {
    let (mut all, mut unreadable) = (Vec::new(), None);
    for (place, list) in lists(root)? {
        match list {
            Ok(list) => all.push((place, list)),
            Err(error) => unreadable = Some(error),
        }
    }
    if wanted == "latest" {
        all.truncate(1);
    } else {
        all.retain(|(_, list)| {
            list.name == wanted || list.run_id.starts_with(wanted) || list.run_id.ends_with(wanted)
        });
    }
    match all.len() {
        0 => Err(unreadable
            .unwrap_or_else(|| StoreError::NoSuchRun { wanted: wanted.to_owned() }.into())),
        1 => Ok(all.remove(0).0),
        count => Err(ArchiveError::Ambiguous { wanted: wanted.to_owned(), count }),
    }
}

/// Whether a directory has runs of an archive, and no journal of its own.
pub(crate) fn is_archive(root: &Path) -> bool {
    !root.join("rigd.db").exists() && objects(root).is_ok_and(|objects| !objects.is_empty())
}
