//! Gives the program the commit that it was built from.

use std::{path::Path, process::Command};

fn main() {
    let root = Path::new("../..");
    println!("cargo:rerun-if-changed={}", root.join("Cargo.lock").display());
    for sources in ["crates", "rig-sim/src"] {
        watch(&root.join(sources));
    }
    let git = |args: &[&str]| {
        let output = Command::new("git").args(args).output().ok()?;
        let text = output.status.success().then(|| String::from_utf8(output.stdout).ok())?;
        text.map(|text| text.trim().to_owned())
    };
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={log}");
    }
    // Outside of a clone of the repository there is no commit to tell.
    let is_own = git(&["ls-files", "--error-unmatch", "build.rs"]).is_some();
    let commit = git(&["rev-parse", "--short=10", "HEAD"]).filter(|_| is_own);
    let changed = git(&[
        "status",
        "--porcelain",
        "--untracked-files=no",
        "--",
        "../../crates",
        "../../rig-sim",
    ]);
    let mark = if changed.is_some_and(|files| !files.is_empty()) { ", changed" } else { "" };
    let commit = commit.map_or_else(String::new, |commit| format!(" ({commit}{mark})"));
    println!("cargo:rustc-env=RIGD_COMMIT={commit}");
}

/// Has this program run again when a source file changes.
fn watch(directory: &Path) {
    if directory.ends_with("src") {
        println!("cargo:rerun-if-changed={}", directory.display());
        return;
    }
    let Ok(entries) = directory.read_dir() else { return };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        if path.is_dir() && path.parent().is_some_and(|parent| parent.ends_with("crates")) {
            watch(&path.join("src"));
        }
    }
}
