//! Output files of a study.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::outcome::StudyError;

/// An output folder.
#[derive(Debug)]
pub(crate) struct Folder(PathBuf);

impl Folder {
    /// Opens the folder, and creates it if necessary.
    pub(crate) fn at(path: &Path) -> Result<Self, StudyError> {
        fs::create_dir_all(path)
            .map_err(|source| StudyError::File { path: path.to_owned(), source })?;
        Ok(Self(path.to_owned()))
    }

    /// The path of a file in the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a file.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<(), StudyError> {
        let path = self.path(name);
        fs::write(&path, text).map_err(|source| StudyError::File { path, source })
    }

    /// Writes a file at once, in the place of the one that may be there: other programs see one of both.
    pub(crate) fn replace(&self, name: &str, text: &str) -> Result<(), StudyError> {
        let begun = format!(".{name}.{}", std::process::id());
        self.write(&begun, text)?;
        let path = self.path(name);
        fs::rename(self.path(&begun), &path).map_err(|source| StudyError::File { path, source })
    }
}

/// A table in CSV.
#[derive(Debug)]
pub(crate) struct Csv(String);

impl Csv {
    /// A table with these columns.
    pub(crate) fn new(columns: &[&str]) -> Self {
        Self(columns.join(",") + "\n")
    }

    /// Adds a row. No cell may hold a comma.
    pub(crate) fn row<C: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = C>) {
        let mut is_first = true;
        for cell in cells {
            debug_assert!(!cell.as_ref().contains([',', '\n']), "{}", cell.as_ref());
            if !is_first {
                self.0.push(',');
            }
            self.0.push_str(cell.as_ref());
            is_first = false;
        }
        self.0.push('\n');
    }

    /// The table as text.
    pub(crate) fn text(&self) -> &str {
        &self.0
    }
}
