//! Libraries that stand between the program and the system.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// Compiles a source of these tests to a library for `LD_PRELOAD`.
pub(crate) fn library(source: &str, folder: &Path) -> PathBuf {
    let library = folder.join("preload.so");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(source);
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let built = Command::new(compiler)
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .args([&library, &source])
        .arg("-ldl")
        .status();
    assert!(built.unwrap().success());
    library
}
