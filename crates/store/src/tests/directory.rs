//! Directories are made where they are missing.

use std::fs;

use super::sample::Directory;
use crate::make_directory;

#[test]
fn directories_are_made_where_they_are_missing_and_only_there() {
    let folder = Directory::new();
    let deep = folder.path().join("a/b/c");
    for _ in 0..2 {
        make_directory(&deep).unwrap();
        assert!(deep.is_dir());
    }
    fs::write(folder.path().join("file"), "").unwrap();
    assert!(make_directory(&folder.path().join("file/a")).is_err());
}
