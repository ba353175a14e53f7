//! The key of a bench, which signs the seals of its runs.

use std::{
    fmt::Write as _,
    fs::{self, File},
    io::{self, Write as _},
    path::{Path, PathBuf},
    str::FromStr,
};

use rcgen::{KeyPair, PKCS_ED25519, SigningKey as _};
use rig_report::export::Signature;
use rig_store::Digest;
use rig_system::files::{forbidden_mode, with_mode};

/// Reading and writing by the owner.
const MODE: u32 = 0o600;
/// Permissions that the file must not have: writing by the group, and any access by others. The group may read it.
const MODE_FORBIDDEN: u32 = 0o037;
/// What is signed is this and the seal in hexadecimal.
const SIGNED: &str = "rigd seal ";

/// The Ed25519 key of a bench.
#[derive(Debug)]
pub struct BenchKey(KeyPair);

/// Why the key of a bench cannot be used or made.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// The file.
    #[error("key file {}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// Other users could read or change it.
    #[error(
        "key file {} has mode {mode:03o}: other users could read or change it; run `chmod 600 {}`",
        path.display(), path.display()
    )]
    Open {
        /// Path of the file.
        path: PathBuf,
        /// Permission bits of the file.
        mode: u32,
    },
    /// It has no key for Ed25519.
    #[error(
        "key file {} has no Ed25519 key in the form of PEM: `rigd bench-key new FILE` makes one",
        path.display()
    )]
    Unusable {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with it.
        source: rcgen::Error,
    },
    /// The key cannot be made, or does not sign.
    #[error("the Ed25519 key cannot be made, or does not sign")]
    Ed25519(#[from] rcgen::Error),
}

impl BenchKey {
    /// Makes a key and writes it to a new file, PKCS #8 in PEM, for the owner alone.
    ///
    /// # Errors
    /// [`KeyError::File`], also if the file exists.
    pub fn make(path: &Path) -> Result<Self, KeyError> {
        let key = KeyPair::generate_for(&PKCS_ED25519)?;
        let write = || {
            let mut options = File::options();
            let mut file = with_mode(options.create_new(true).write(true), MODE).open(path)?;
            file.write_all(key.serialize_pem().as_bytes())?;
            file.sync_all()
        };
        write().map_err(|source| KeyError::File { path: path.to_path_buf(), source })?;
        Ok(Self(key))
    }

    /// Reads the file of a key.
    ///
    /// # Errors
    /// [`KeyError`] with the fault of the file and advice.
    pub fn read(path: &Path) -> Result<Self, KeyError> {
        let failed = |source| KeyError::File { path: path.to_path_buf(), source };
        let metadata = fs::metadata(path).map_err(failed)?;
        if let Some(mode) = forbidden_mode(&metadata, MODE_FORBIDDEN) {
            return Err(KeyError::Open { path: path.to_path_buf(), mode });
        }
        let text = fs::read_to_string(path).map_err(failed)?;
        KeyPair::from_pkcs8_pem_and_sign_algo(&text, &PKCS_ED25519)
            .map(Self)
            .map_err(|source| KeyError::Unusable { path: path.to_path_buf(), source })
    }

    /// The public key in hexadecimal.
    pub fn public(&self) -> String {
        hex(self.0.public_key_raw())
    }

    /// Signs a seal. The same seal gives the same signature.
    pub(crate) fn sign(&self, seal: Digest) -> Result<Signature, KeyError> {
        let signature = self.0.sign(format!("{SIGNED}{seal}").as_bytes())?;
        Ok(Signature { public_key: self.public(), ed25519: hex(&signature) })
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string cannot fail.
        _ = write!(text, "{byte:02x}");
        text
    })
}

/// The public key of a bench.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PublicKey([u8; 32]);

/// A text that is no public key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a public key has 64 hexadecimal digits, as `rigd bench-key show FILE` prints it")]
pub struct PublicKeyError;

impl PublicKey {
    /// Its 32 bytes.
    pub const fn bytes(&self) -> &[u8] {
        &self.0
    }
}

impl FromStr for PublicKey {
    type Err = PublicKeyError;

    fn from_str(text: &str) -> Result<Self, PublicKeyError> {
        if text.len() != 64 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return Err(PublicKeyError);
        }
        let mut bytes = [0; 32];
        for (byte, pair) in bytes.iter_mut().zip(text.as_bytes().chunks(2)) {
            let pair = str::from_utf8(pair).map_err(|_| PublicKeyError)?;
            *byte = u8::from_str_radix(pair, 16).map_err(|_| PublicKeyError)?;
        }
        Ok(Self(bytes))
    }
}

// Modes of files are of Unix.
#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_key_is_made_once_and_read_only_by_its_owner() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("bench.key");
        let made = BenchKey::make(&path).unwrap();
        assert!(matches!(BenchKey::make(&path), Err(KeyError::File { .. })), "it is there");
        let read = BenchKey::read(&path).unwrap();
        assert_eq!(read.public(), made.public());
        assert!(read.public().parse::<PublicKey>().is_ok());
        let seal = Digest::START;
        assert_eq!(read.sign(seal).unwrap().ed25519, made.sign(seal).unwrap().ed25519);
        fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).unwrap();
        let refused = BenchKey::read(&path).unwrap_err().to_string();
        assert!(refused.contains("has mode 644"), "{refused}");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        fs::write(&path, "no key").unwrap();
        assert!(matches!(BenchKey::read(&path), Err(KeyError::Unusable { .. })));
    }

    #[test]
    fn a_public_key_is_64_digits() {
        for wrong in ["", "00", &"g".repeat(64), &"é".repeat(32)] {
            assert!(wrong.parse::<PublicKey>().is_err(), "{wrong}");
        }
        assert_eq!("0f".repeat(32).parse::<PublicKey>().unwrap().bytes(), [15; 32]);
    }
}
