//! A folder that is there as a whole or not at all.
//!
//! Its files are written beside it and flushed to the disk, and then take its place in one step. A
//! program that is killed leaves the old folder or the new one. Files that a person has added stay.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

use rig_system::files::{FolderTurn, exchange, sync_file, sync_folder};

/// Files that take the place of a folder.
#[derive(Debug)]
pub(super) struct StagedFolder {
    to: PathBuf,
    staged: PathBuf,
    names: Vec<String>,
    /// One program at a time writes folders beside this one.
    parent: FolderTurn,
}

impl StagedFolder {
    /// An empty folder beside `to`. Waits until no other program writes there.
    pub(super) fn new(to: &Path) -> io::Result<Self> {
        let name = to.file_name().unwrap_or_default().to_string_lossy();
        let (staged, above) = (to.with_file_name(format!(".{name}.new")), parent(to));
        fs::create_dir_all(above)?;
        let parent = FolderTurn::take(above)?;
        // Of a program that was killed while it wrote.
        remove(&staged)?;
        fs::create_dir(&staged)?;
        Ok(Self { to: to.to_path_buf(), staged, names: Vec::new(), parent })
    }

    /// Writes a file.
    pub(super) fn write(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let mut file = File::create_new(self.staged.join(name))?;
        file.write_all(bytes)?;
        file.sync_all()?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Puts the files in the place of the folder. `own` says which files of the folder before it were
    /// written by this program; the others are kept.
    pub(super) fn put_in_place(self, own: impl Fn(&str) -> bool) -> io::Result<()> {
        let Self { to, staged, names, parent } = self;
        if to.is_dir() {
            for entry in fs::read_dir(&to)? {
                let name = entry?.file_name();
                let known = name.to_string_lossy();
                if !own(&known) && !names.iter().any(|name| *name == known) {
                    // A copy, so that the folder before stays whole until the exchange.
                    copy(&to.join(&name), &staged.join(&name))?;
                }
            }
        }
        sync_folder(&staged)?;
        exchange(&staged, &to)?;
        parent.sync()?;
        remove(&staged)
    }
}

fn parent(path: &Path) -> &Path {
    path.parent().unwrap_or(path)
}

fn remove(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Copies a file, or a folder with everything in it. Links are left out.
pub(crate) fn copy(from: &Path, to: &Path) -> io::Result<()> {
    let kind = fs::symlink_metadata(from)?.file_type();
    if kind.is_dir() {
        fs::create_dir(to)?;
        fs::read_dir(from)?.try_for_each(|entry| {
            let name = entry?.file_name();
            copy(&from.join(&name), &to.join(&name))
        })
    } else if kind.is_file() {
        fs::copy(from, to)?;
        sync_file(to)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;

    fn contents(folder: &Path) -> Vec<(String, String)> {
        let entries = fs::read_dir(folder).unwrap().map(Result::unwrap);
        let read = |entry: fs::DirEntry| {
            let text = fs::read_to_string(entry.path()).unwrap_or_else(|_| "folder".to_owned());
            (entry.file_name().into_string().unwrap(), text)
        };
        let mut all: Vec<_> = entries.map(read).collect();
        all.sort();
        all
    }

    #[test]
    fn files_appear_together_and_notes_of_a_person_stay() {
        let above = TempDir::new().unwrap();
        let to = above.path().join("runs").join("a");
        let mut first = StagedFolder::new(&to).unwrap();
        first.write("one.csv", b"1").unwrap();
        first.write("old.csv", b"1").unwrap();
        assert!(!to.exists(), "not before all of them are written");
        first.put_in_place(|_| false).unwrap();
        fs::write(to.join("notes.txt"), "by hand").unwrap();
        fs::create_dir(to.join("pictures")).unwrap();
        fs::write(to.join("pictures/1.jpg"), "picture").unwrap();

        let mut killed = StagedFolder::new(&to).unwrap();
        killed.write("one.csv", b"half").unwrap();
        drop(killed);
        assert_eq!(contents(&to)[2].1, "1", "a program that is killed changes nothing");

        let mut second = StagedFolder::new(&to).unwrap();
        second.write("one.csv", b"2").unwrap();
        second.put_in_place(|name| name == "old.csv").unwrap();
        let expected = [("notes.txt", "by hand"), ("one.csv", "2"), ("pictures", "folder")];
        assert_eq!(contents(&to), expected.map(|(name, text)| (name.to_owned(), text.to_owned())));
        assert_eq!(fs::read_to_string(to.join("pictures/1.jpg")).unwrap(), "picture");
        assert_eq!(contents(to.parent().unwrap()).len(), 1, "nothing is left beside the folder");
    }
}
