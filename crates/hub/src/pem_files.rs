//! Certificates and keys in files of PEM, for the hub and for the server of rigd.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use rig_system::files::forbidden_mode;
use tokio_rustls::rustls::{
    self,
    pki_types::{CertificateDer, PrivateKeyDer, pem, pem::PemObject},
};

/// Permissions that the file of a key must not have: writing by the group, and any access by others.
const MODE_FORBIDDEN: u32 = 0o037;

/// Why a certificate and its key cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A file is not PEM, or has no certificate or key.
    #[error("{} has no certificate or no key in the form of PEM", path.display())]
    Pem {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with it.
        source: pem::Error,
    },
    /// Other users could read or change the key.
    #[error(
        "{} has mode {mode:03o}: other users could read or change the key; run `chmod 600 {}`",
        path.display(), path.display()
    )]
    Open {
        /// Path of the file.
        path: PathBuf,
        /// Permission bits of the file.
        mode: u32,
    },
    /// The certificate and the key cannot be used together.
    #[error("{} and its key cannot be used together", path.display())]
    Unusable {
        /// Path of the certificate.
        path: PathBuf,
        /// The error of the library.
        source: rustls::Error,
    },
}

/// The certificates of a file, in their order: one or more.
///
/// # Errors
/// [`TlsError`] names the file and its fault.
pub fn read_certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let all: Vec<_> =
        CertificateDer::pem_file_iter(path).and_then(Iterator::collect).map_err(of(path))?;
    if all.is_empty() { Err(of(path)(pem::Error::NoItemsFound)) } else { Ok(all) }
}

/// The key of a file that other users can neither read nor change.
///
/// # Errors
/// [`TlsError`] names the file and its fault.
pub fn read_key(path: &Path) -> Result<PrivateKeyDer<'static>, TlsError> {
    let failed = |source| TlsError::File { path: path.to_path_buf(), source };
    let metadata = fs::metadata(path).map_err(failed)?;
    if let Some(mode) = forbidden_mode(&metadata, MODE_FORBIDDEN) {
        return Err(TlsError::Open { path: path.to_path_buf(), mode });
    }
    PrivateKeyDer::from_pem_file(path).map_err(of(path))
}

fn of(path: &Path) -> impl FnOnce(pem::Error) -> TlsError {
    let path = path.to_path_buf();
    move |source| match source {
        pem::Error::Io(source) => TlsError::File { path, source },
        source => TlsError::Pem { path, source },
    }
}
