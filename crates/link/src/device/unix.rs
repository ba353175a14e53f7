//! Device files.

use std::{
    fs,
    os::unix::fs::FileTypeExt,
    path::{Path, PathBuf},
};

pub(super) fn device_of(name: &Path) -> Option<PathBuf> {
    fs::canonicalize(name).ok()
}

pub(super) fn what_it_is(device: &Path) -> Option<&'static str> {
    let kind = fs::metadata(device).ok()?.file_type();
    if kind.is_char_device() {
        None
    } else if kind.is_dir() {
        Some("a directory")
    } else if kind.is_file() {
        Some("a file")
    } else {
        Some("a pipe, a socket or a disk")
    }
}

pub(super) fn is_there(device: &Path) -> bool {
    device.exists()
}
