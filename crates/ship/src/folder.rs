//! A folder as an object store.
//!
//! An object is written and flushed under another name, which begins with a dot, and then gets its own. Objects
//! are read-only files.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

use bytes::Bytes;
use rig_system::files::sync_folder;

use crate::StorageError;

/// Held while a program puts an object in a directory.
const LOCK: &str = ".ship.lock";
/// Directories in directories; names of objects have three.
const DEPTH_MAX: usize = 8;

#[derive(Debug)]
pub(crate) struct Folder {
    root: PathBuf,
}

/// The error of the system at a path.
fn failed(path: &Path) -> impl FnOnce(io::Error) -> StorageError {
    let path = path.display().to_string();
    move |source| StorageError::File { path, source }
}

impl Folder {
    pub(crate) fn new(root: PathBuf) -> Self {
        Self { root }
    }

    pub(crate) fn list(&self, below: &str) -> Result<Vec<String>, StorageError> {
        let mut names = Vec::new();
        list(&self.root.join(below), below, 0, &mut names)?;
        names.sort();
        Ok(names)
    }

    pub(crate) fn get(&self, name: &str) -> Result<Bytes, StorageError> {
        let path = self.root.join(name);
        fs::read(&path).map(Bytes::from).map_err(failed(&path))
    }

    pub(crate) fn put_new(&self, name: &str, object: &[u8]) -> Result<bool, StorageError> {
        let path = self.root.join(name);
        let directory = path.parent().unwrap_or(&self.root);
        make(directory)?;
        let lock = directory.join(LOCK);
        let file = File::options().create(true).truncate(false).write(true).open(&lock);
        // Until the end of this function: two programs must not write one file beside the object.
        let locked = file.and_then(|file| file.lock().map(|()| file)).map_err(failed(&lock))?;
        if path.try_exists().map_err(failed(&path))? {
            return Ok(false);
        }
        let file_name = path.file_name().unwrap_or_default().to_string_lossy();
        let beside = path.with_file_name(format!(".{file_name}.part"));
        write(&beside, object).map_err(failed(&beside))?;
        fs::rename(&beside, &path).map_err(failed(&path))?;
        flush(directory)?;
        drop(locked);
        Ok(true)
    }
}

/// Writes a read-only file, and waits for the disk.
fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    match fs::remove_file(path) {
        // Of a program that was killed while it wrote.
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut file = File::create_new(path)?;
    file.write_all(bytes)?;
    let mut permissions = file.metadata()?.permissions();
    permissions.set_readonly(true);
    file.set_permissions(permissions)?;
    file.sync_all()
}

/// Makes a directory with those above it, each on the disk before the next.
fn make(directory: &Path) -> Result<(), StorageError> {
    if directory.as_os_str().is_empty() || directory.is_dir() {
        return Ok(());
    }
    let above = directory.parent().unwrap_or(Path::new(""));
    make(above)?;
    match fs::create_dir(directory) {
        // Another program has made it just now.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists && directory.is_dir() => {}
        made => made.map_err(failed(directory))?,
    }
    flush(above)
}

fn flush(directory: &Path) -> Result<(), StorageError> {
    sync_folder(directory).map_err(failed(directory))
}

/// Adds the names of the files below a directory, without those that begin with a dot.
fn list(
    directory: &Path,
    prefix: &str,
    depth: usize,
    names: &mut Vec<String>,
) -> Result<(), StorageError> {
    if depth > DEPTH_MAX {
        let error = io::Error::other(format!("more than {DEPTH_MAX} directories in each other"));
        return Err(failed(directory)(error));
    }
    let entries = match fs::read_dir(directory) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(failed(directory))?,
    };
    for entry in entries {
        let entry = entry.map_err(failed(directory))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        if entry.file_type().map_err(failed(directory))?.is_dir() {
            list(&entry.path(), &format!("{prefix}{name}/"), depth + 1, names)?;
        } else {
            names.push(format!("{prefix}{name}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_is_put_once_and_stays() {
        let root = tempfile::TempDir::new().unwrap();
        let folder = Folder::new(root.path().join("a"));
        assert_eq!(folder.list("").unwrap(), Vec::<String>::new());
        assert!(folder.put_new("x=1/y.parquet", b"one").unwrap());
        assert!(!folder.put_new("x=1/y.parquet", b"two").unwrap());
        assert_eq!(folder.get("x=1/y.parquet").unwrap(), &b"one"[..]);
        let path = root.path().join("a/x=1/y.parquet");
        assert!(fs::metadata(&path).unwrap().permissions().readonly());
        assert!(folder.get("x=1/z.parquet").is_err());

        // A program was killed while it wrote another one.
        fs::write(root.path().join("a/x=1/.z.parquet.part"), b"hal").unwrap();
        assert_eq!(folder.list("").unwrap(), ["x=1/y.parquet"]);
        assert!(folder.put_new("x=1/z.parquet", b"whole").unwrap());
        assert_eq!(folder.list("x=1/").unwrap(), ["x=1/y.parquet", "x=1/z.parquet"]);
        assert!(!root.path().join("a/x=1/.z.parquet.part").exists());
    }

    #[test]
    fn many_programs_put_one_object_once() {
        let root = tempfile::TempDir::new().unwrap();
        let folder = Folder::new(root.path().to_path_buf());
        let made = std::thread::scope(|scope| {
            let put = |byte: u8| {
                let folder = &folder;
                scope.spawn(move || folder.put_new("m/o.parquet", &vec![byte; 100_000]).unwrap())
            };
            let all: Vec<_> = (0..8).map(put).collect();
            all.into_iter().map(|one| one.join().unwrap()).filter(|is| *is).count()
        });
        assert_eq!(made, 1);
        let object = folder.get("m/o.parquet").unwrap();
        assert!(object.len() == 100_000 && object.iter().all(|byte| *byte == object[0]));
    }
}
