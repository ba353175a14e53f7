//! Opens the files that a person names.

use std::{
    fs::File,
    io::{self, Read},
    path::{Path, PathBuf},
};

use rig_files::{Faults, FileKind};

/// An unusable file.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// No file has this name.
    #[error("{}: {instead}", path.display())]
    Missing {
        /// Name that the person gave.
        path: PathBuf,
        /// Files with similar names, or the missing directory.
        instead: String,
    },
    /// The file cannot be read.
    #[error("{}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The file is too large to be one of its kind.
    #[error(
        "{}: larger than {} MB, the limit for a {}", path.display(), limit_bytes(*kind) / MEGABYTE,
        kind.name()
    )]
    TooLarge {
        /// The file, or `stdin`.
        path: PathBuf,
        /// The expected kind.
        kind: FileKind,
    },
    /// The file has faults.
    #[error(transparent)]
    Faults(Faults),
}

/// The name of a file for its faults, and its text of the expected kind.
pub(crate) fn read(path: &Path, kind: FileKind) -> Result<(String, String), FileError> {
    let (name, bytes) = read_bytes(path, kind)?;
    let text = rig_files::settings::text(&name, &bytes).map_err(FileError::Faults)?.to_owned();
    kind.expect(&name, &text).map_err(FileError::Faults)?;
    Ok((name, text))
}

const MEGABYTE: u64 = 1_000_000;

/// Largest accepted size of a file, bytes. A person writes settings of some kilobytes; the readings of a
/// run of weeks take some tens of megabytes.
const fn limit_bytes(kind: FileKind) -> u64 {
    match kind {
        FileKind::Sweep => 100 * MEGABYTE,
        FileKind::Rig
        | FileKind::Protocol
        | FileKind::Scene
        | FileKind::Service
        | FileKind::Analyzer
        | FileKind::Drive => MEGABYTE,
    }
}

/// The name of a file for its faults, and its bytes.
pub(crate) fn read_bytes(path: &Path, kind: FileKind) -> Result<(String, Vec<u8>), FileError> {
    match File::open(path).and_then(|file| read_to_limit(file, kind)) {
        Ok(Some(bytes)) => Ok((path.display().to_string(), bytes)),
        Ok(None) => Err(FileError::TooLarge { path: path.to_path_buf(), kind }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Err(FileError::Missing { path: path.to_path_buf(), instead: instead(path) })
        }
        Err(error) if error.kind() == io::ErrorKind::IsADirectory => {
            let instead = format!("a directory, no file; {}", listed(path, None));
            Err(FileError::Missing { path: path.to_path_buf(), instead })
        }
        Err(source) => Err(FileError::Unreadable { path: path.to_path_buf(), source }),
    }
}

/// The bytes on the standard input, under the name `stdin`.
pub(crate) fn read_stdin(kind: FileKind) -> Result<(String, Vec<u8>), FileError> {
    let name = "stdin";
    match read_to_limit(io::stdin().lock(), kind) {
        Ok(Some(bytes)) => Ok((name.to_owned(), bytes)),
        Ok(None) => Err(FileError::TooLarge { path: name.into(), kind }),
        Err(source) => Err(FileError::Unreadable { path: name.into(), source }),
    }
}

/// All bytes, or `None` if there are more than a file of this kind has.
fn read_to_limit(source: impl Read, kind: FileKind) -> io::Result<Option<Vec<u8>>> {
    let limit = limit_bytes(kind);
    let mut bytes = Vec::new();
    source.take(limit + 1).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= limit).then_some(bytes))
}

/// The existing files beside a missing one.
fn instead(path: &Path) -> String {
    let folder = match path.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => return "no such file".to_owned(),
    };
    if !folder.is_dir() {
        return format!("no such file; there is no directory {}", folder.display());
    }
    format!("no such file; {}", listed(folder, path.extension()))
}

/// The names in a directory: all of them, or those of files with this extension.
fn listed(folder: &Path, extension: Option<&std::ffi::OsStr>) -> String {
    /// A person reads so short a list.
    const SHOWN: usize = 8;
    let entries =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_like = |path: &PathBuf| {
        extension.is_none_or(|extension| path.is_file() && path.extension() == Some(extension))
    };
    let name = |path: PathBuf| {
        let name = path.file_name()?.to_string_lossy().into_owned();
        Some(if path.is_dir() { name + "/" } else { name })
    };
    let mut names: Vec<String> = entries.filter(is_like).filter_map(name).collect();
    names.sort();
    if names.is_empty() {
        return format!("{} has no files of this kind", folder.display());
    }
    let more = names.len().saturating_sub(SHOWN);
    names.truncate(SHOWN);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    format!("{} holds {}{more}", folder.display(), names.join(", "))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_that_is_not_there_is_told_with_those_that_are() {
        let scratch = tempfile::TempDir::new().unwrap();
        let path = |name: &str| scratch.path().join(name);
        for name in ["b.toml", "a.toml", "notes.txt"] {
            fs::write(path(name), "").unwrap();
        }
        let said = |name: &str| {
            let error = read(&path(name), FileKind::Rig).unwrap_err().to_string();
            error.replace(&scratch.path().display().to_string(), "DIR")
        };
        assert_eq!(said("c.toml"), "DIR/c.toml: no such file; DIR holds a.toml, b.toml");
        assert_eq!(said("c.csv"), "DIR/c.csv: no such file; DIR has no files of this kind");
        assert_eq!(said("x/c.toml"), "DIR/x/c.toml: no such file; there is no directory DIR/x");
        assert_eq!(said(""), "DIR/: a directory, no file; DIR/ holds a.toml, b.toml, notes.txt");
        for (kind, limit) in [(FileKind::Protocol, MEGABYTE), (FileKind::Sweep, 100 * MEGABYTE)] {
            // A sparse file takes no space.
            File::create(path("large.txt")).unwrap().set_len(limit + 1).unwrap();
            let error = read_bytes(&path("large.txt"), kind).unwrap_err().to_string();
            let limit =
                format!("larger than {} MB, the limit for a {}", limit / MEGABYTE, kind.name());
            assert!(error.ends_with(&limit), "{error}");
            File::create(path("large.txt")).unwrap().set_len(1000).unwrap();
            assert_eq!(read_bytes(&path("large.txt"), kind).unwrap().1.len(), 1000);
        }
        for n in 0..20 {
            fs::write(path(&format!("n{n}.toml")), "").unwrap();
        }
        assert!(
            said("c.toml").ends_with(", n12.toml, n13.toml, and 14 more"),
            "{}",
            said("c.toml")
        );
    }
}
