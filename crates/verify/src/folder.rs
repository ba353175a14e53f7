//! The folder of a run against its manifest.

use std::{fs, io, path::Path};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// A file of a folder that is not the one in the manifest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FileFinding {
    /// Name of the file.
    pub file: String,
    /// What is wrong.
    pub what: String,
}

#[derive(Debug, Deserialize)]
struct Manifest {
    run_id: String,
    digest: Option<String>,
    files: Vec<Listed>,
}

#[derive(Debug, Deserialize)]
struct Listed {
    name: String,
    bytes: u64,
    sha256: String,
}

const MANIFEST: &str = "manifest.json";

/// Compares every file in the folder of a run with its manifest, and the manifest with the run: its id and
/// the digest of its last record. Files that the manifest does not list are not looked at.
///
/// # Errors
/// Errors of the system other than a missing file.
pub fn verify_folder(folder: &Path, run: &str, digest: &str) -> io::Result<Vec<FileFinding>> {
    let finding = |file: &str, what: String| FileFinding { file: file.to_owned(), what };
    let Some(text) = read(&folder.join(MANIFEST))? else {
        return Ok(vec![finding(MANIFEST, "the file is missing".to_owned())]);
    };
    let manifest: Manifest = match serde_json::from_slice(&text) {
        Ok(manifest) => manifest,
        Err(error) => return Ok(vec![finding(MANIFEST, format!("it cannot be read: {error}"))]),
    };
    let mut found = Vec::new();
    if manifest.run_id != run {
        found.push(finding(MANIFEST, format!("it is that of run {}", manifest.run_id)));
    } else if manifest.digest.as_deref() != Some(digest) {
        found.push(finding(
            MANIFEST,
            "the journal has changed since; `rigd report RUN` writes the folder again".to_owned(),
        ));
    }
    for Listed { name, bytes, sha256 } in &manifest.files {
        let Some(contents) = read(&folder.join(name))? else {
            found.push(finding(name, "the file is missing".to_owned()));
            continue;
        };
        if contents.len() as u64 != *bytes {
            let what = format!("it has {} bytes, and the manifest says {bytes}", contents.len());
            found.push(finding(name, what));
            continue;
        }
        let digest = Sha256::digest(&contents);
        let hex = crate::chain::hex(&digest);
        if hex != *sha256 {
            found.push(finding(
                name,
                format!("its SHA-256 is {hex}, and the manifest says {sha256}"),
            ));
        }
    }
    Ok(found)
}

/// The contents of a file; `None` without one.
fn read(path: &Path) -> io::Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}
