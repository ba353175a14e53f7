//! The file of `--token-file`: one secret for every client.

use std::{
    fmt, fs,
    io::{self, Read},
    path::{Path, PathBuf},
};

use rig_system::files::forbidden_mode;
use subtle::ConstantTimeEq;

/// A shorter secret could be guessed over the network.
const TOKEN_MIN: usize = 16;
/// A longer one would not fit a request beside its other headers.
const TOKEN_MAX: usize = 4096;
/// Permissions that the file of the token must not have: writing by the group, and any access by
/// others. The group may read it.
const MODE_FORBIDDEN: u32 = 0o037;

/// The secret that a client sends as `Authorization: Bearer`.
pub struct Token(String);

/// Why a token cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file cannot be read.
    #[error("token file {}", path.display())]
    File {
        /// Path of the token file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// Other users could read or change it.
    #[error(
        "token file {} has mode {mode:03o}: other users could read or change it; run \
         `chmod 600 {}`",
        path.display(), path.display()
    )]
    Open {
        /// Path of the token file.
        path: PathBuf,
        /// Permission bits of the file.
        mode: u32,
    },
    /// Its content is not a token.
    #[error(
        "token file {} must hold one line of {TOKEN_MIN} to {TOKEN_MAX} visible ASCII characters, \
         such as `openssl rand -hex 32` writes",
        path.display()
    )]
    Unusable {
        /// Path of the token file.
        path: PathBuf,
    },
}

impl Token {
    /// Reads the file of a token.
    ///
    /// # Errors
    /// [`TokenError`] with the fault of the file and advice.
    pub fn read(path: &Path) -> Result<Self, TokenError> {
        let failed = |source| TokenError::File { path: path.to_path_buf(), source };
        let file = fs::File::open(path).map_err(failed)?;
        // Of the open file, even if the path now names another one.
        let metadata = file.metadata().map_err(failed)?;
        if let Some(mode) = forbidden_mode(&metadata, MODE_FORBIDDEN) {
            return Err(TokenError::Open { path: path.to_path_buf(), mode });
        }
        let mut bytes = Vec::new();
        // One byte more than allowed shows that there are too many; the line may end in CR LF.
        file.take(TOKEN_MAX as u64 + 3).read_to_end(&mut bytes).map_err(failed)?;
        let text = String::from_utf8(bytes).unwrap_or_default();
        let token = text.trim_end_matches(['\r', '\n']);
        let is_token = (TOKEN_MIN..=TOKEN_MAX).contains(&token.len())
            && token.bytes().all(|byte| byte.is_ascii_graphic());
        if !is_token {
            return Err(TokenError::Unusable { path: path.to_path_buf() });
        }
        Ok(Self(token.to_owned()))
    }

    /// The secret itself.
    pub(crate) fn reveal(&self) -> &str {
        &self.0
    }

    /// The value of `Authorization` that a client sends.
    pub(crate) fn bearer(&self) -> String {
        format!("Bearer {}", self.0)
    }

    /// Whether a client knows the token. The time of the comparison depends only on its length.
    pub(super) fn is(&self, given: &str) -> bool {
        self.0.as_bytes().ct_eq(given.as_bytes()).into()
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

// Modes of files are of Unix.
#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_token_is_taken_from_a_file_that_others_cannot_read() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("token");
        let read = |text: &[u8], mode: u32| {
            _ = fs::remove_file(&path);
            fs::write(&path, text).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            Token::read(&path)
        };
        let secret = b"0123456789abcdef\n";
        for mode in [0o600, 0o400, 0o640] {
            let token = read(secret, mode).unwrap();
            assert!(token.is("0123456789abcdef"), "{mode:o}");
            assert!(!token.is("0123456789abcdeg") && !token.is("") && !token.is("0123456789abcde"));
            assert_eq!(format!("{token:?}"), "Token");
        }
        for mode in [0o644, 0o604, 0o660, 0o666, 0o777] {
            let error = read(secret, mode).unwrap_err();
            assert!(
                matches!(error, TokenError::Open { mode: found, .. } if found == mode),
                "{error}"
            );
        }
        let long = [b'a'; TOKEN_MAX + 1];
        let bad: [&[u8]; 6] = [
            b"",
            b"short",
            b"one two three four five",
            b"0123456789abcdef\nmore",
            b"\xff\xfe",
            &long,
        ];
        for text in bad {
            assert!(matches!(read(text, 0o600), Err(TokenError::Unusable { .. })), "{text:?}");
        }
        assert!(read(&long[1..], 0o600).is_ok() && read(b"0123456789abcdef\r\n", 0o600).is_ok());
        assert!(matches!(Token::read(&path.join("gone")), Err(TokenError::File { .. })));
    }
}
