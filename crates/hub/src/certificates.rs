//! The certificates of a hub: an authority of its own, which signs those of the server and of the benches.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};
use rig_system::files::with_mode;

/// Files of the authority, in the directory of the certificates.
const AUTHORITY: &str = "ca.pem";
const AUTHORITY_KEY: &str = "ca.key";
/// Its name in the certificates that it signs.
const AUTHORITY_NAME: &str = "rigd-hub";

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
pub enum CertificateError {
    /// A file cannot be read or written. Files that are there are not written again.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A certificate cannot be made, or the key of the authority not be read.
    #[error("a certificate cannot be made with {}", path.display())]
    Made {
        /// Path of the key of the authority.
        path: PathBuf,
        /// The error of the library.
        source: rcgen::Error,
    },
}

/// The authority of a hub, in a directory.
#[derive(Debug)]
pub struct Authority {
    directory: PathBuf,
    key: KeyPair,
}

impl Authority {
    /// Makes an authority in `directory`, or opens the one that is there.
    ///
    /// # Errors
    /// [`CertificateError`] names the file.
    pub fn open_or_make(directory: &Path) -> Result<Self, CertificateError> {
        if directory.join(AUTHORITY_KEY).exists() {
            return Self::open(directory);
        }
        let key_path = directory.join(AUTHORITY_KEY);
        let made = |source| CertificateError::Made { path: key_path.clone(), source };
        fs::create_dir_all(directory)
            .map_err(|source| CertificateError::File { path: directory.to_path_buf(), source })?;
        let key = KeyPair::generate().map_err(made)?;
        let certificate = authority().self_signed(&key).map_err(made)?;
        write_new(&directory.join(AUTHORITY), &certificate.pem(), 0o644)?;
        write_new(&key_path, &key.serialize_pem(), 0o600)?;
        Ok(Self { directory: directory.to_path_buf(), key })
    }

    /// Opens the authority in `directory`.
    ///
    /// # Errors
    /// [`CertificateError`] names the file.
    pub fn open(directory: &Path) -> Result<Self, CertificateError> {
        let path = directory.join(AUTHORITY_KEY);
        let text = fs::read_to_string(&path)
            .map_err(|source| CertificateError::File { path: path.clone(), source })?;
        let key =
            KeyPair::from_pem(&text).map_err(|source| CertificateError::Made { path, source })?;
        Ok(Self { directory: directory.to_path_buf(), key })
    }

    /// File of its certificate, which every client and the server trust.
    pub fn certificate(&self) -> PathBuf {
        self.directory.join(AUTHORITY)
    }

    /// Writes `STEM.pem` and `STEM.key` for these names and addresses of a server into the directory of the authority.
    ///
    /// # Errors
    /// [`CertificateError`] names the file.
    pub fn sign_server(
        &self,
        names: Vec<String>,
        stem: &str,
    ) -> Result<[PathBuf; 2], CertificateError> {
        let mut params = CertificateParams::new(names).map_err(|source| self.made(source))?;
        params.extended_key_usages.push(ExtendedKeyUsagePurpose::ServerAuth);
        params.distinguished_name.push(DnType::CommonName, "rigd-hub server");
        self.sign(&params, &self.directory, stem)
    }

    /// Writes `STEM.pem`, `STEM.key` and the certificate of the authority into `directory`, for a client with this
    /// common name.
    ///
    /// # Errors
    /// [`CertificateError`] names the file.
    pub fn sign_client(
        &self,
        name: &str,
        directory: &Path,
        stem: &str,
    ) -> Result<[PathBuf; 2], CertificateError> {
        fs::create_dir_all(directory)
            .map_err(|source| CertificateError::File { path: directory.to_path_buf(), source })?;
        let mut params = CertificateParams::default();
        params.extended_key_usages.push(ExtendedKeyUsagePurpose::ClientAuth);
        params.distinguished_name.push(DnType::CommonName, name);
        let files = self.sign(&params, directory, stem)?;
        let (from, to) = (self.certificate(), directory.join(AUTHORITY));
        if from != to {
            fs::copy(&from, &to).map_err(|source| CertificateError::File { path: to, source })?;
        }
        Ok(files)
    }

    fn sign(
        &self,
        params: &CertificateParams,
        directory: &Path,
        stem: &str,
    ) -> Result<[PathBuf; 2], CertificateError> {
        let key = KeyPair::generate().map_err(|source| self.made(source))?;
        let authority = authority();
        let issuer = Issuer::from_params(&authority, &self.key);
        let certificate = params.signed_by(&key, &issuer).map_err(|source| self.made(source))?;
        let (pem, key_path) =
            (directory.join(format!("{stem}.pem")), directory.join(format!("{stem}.key")));
        write_new(&key_path, &key.serialize_pem(), 0o600)?;
        write_new(&pem, &certificate.pem(), 0o644)?;
        Ok([pem, key_path])
    }

    fn made(&self, source: rcgen::Error) -> CertificateError {
        CertificateError::Made { path: self.directory.join(AUTHORITY_KEY), source }
    }
}

/// What an authority says of itself. It must stay the same: certificates name it.
fn authority() -> CertificateParams {
    let mut params = CertificateParams::default();
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    params.distinguished_name = rcgen::DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, AUTHORITY_NAME);
    params
}

fn write_new(path: &Path, text: &str, mode: u32) -> Result<(), CertificateError> {
    let write = || {
        let mut options = File::options();
        let mut file = with_mode(options.write(true).create_new(true), mode).open(path)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()
    };
    write().map_err(|source| CertificateError::File { path: path.to_path_buf(), source })
}
