//! The program that runs, by its file: what it computes may rest on every byte of it.

use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use sha2::{Digest, Sha256};

/// The file of this program cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{}", path.display())]
pub struct ProgramError {
    path: PathBuf,
    source: io::Error,
}

/// The first digits of the digest of this program's file, which is read once.
///
/// # Errors
/// Those of the system.
pub fn digest() -> Result<String, ProgramError> {
    static DIGEST: OnceLock<String> = OnceLock::new();
    if let Some(digest) = DIGEST.get() {
        return Ok(digest.clone());
    }
    let error = |path: &Path| {
        let path = path.to_owned();
        |source| ProgramError { path, source }
    };
    let path = std::env::current_exe().map_err(error(Path::new("this program")))?;
    let bytes = fs::read(&path).map_err(error(&path))?;
    Ok(DIGEST.get_or_init(|| head_of(bytes)).clone())
}

/// The first 16 digits of a SHA-256.
pub fn head_of(bytes: impl AsRef<[u8]>) -> String {
    let digest = Sha256::digest(bytes);
    let head = digest.iter().take(8).fold(0, |head, byte| head << 8 | u64::from(*byte));
    format!("{head:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NIST's example of SHA-256, and that of no bytes.
    #[test]
    fn the_head_of_a_digest_is_its_first_eight_bytes() {
        assert_eq!(head_of("abc"), "ba7816bf8f01cfea");
        assert_eq!(head_of(""), "e3b0c44298fc1c14");
        assert_eq!(digest().unwrap(), digest().unwrap());
    }
}
