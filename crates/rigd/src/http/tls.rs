//! TLS: a certificate from files, read again when they change, or one that the daemon makes for itself.

use std::{
    fmt,
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use jiff::Timestamp;
use rcgen::{CertificateParams, DnType, KeyPair};
use rig_hub::{read_certificates, read_key};
use rig_system::files::{self, with_mode};
use tokio::{net::TcpStream, time::timeout};
use tokio_rustls::{
    TlsAcceptor,
    rustls::{
        ServerConfig,
        crypto::{CryptoProvider, ring},
        server::{ClientHello, ResolvesServerCert},
        sign::CertifiedKey,
    },
    server::TlsStream,
};

use super::expiry;

/// Files of the daemon's own certificate, in its data directory.
const OWN_CERTIFICATE: &str = "tls-certificate.pem";
const OWN_KEY: &str = "tls-key.pem";

/// Why there is no TLS.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A certificate or a key cannot be used.
    #[error(transparent)]
    Files(#[from] rig_hub::TlsError),
    /// A file cannot be written.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// No certificate could be made.
    #[error("a certificate of its own")]
    Own(#[from] rcgen::Error),
}

/// The TLS of a listener.
#[derive(Clone)]
pub struct Tls {
    acceptor: TlsAcceptor,
    certificate: PathBuf,
    renewed: Arc<Renewed>,
}

impl fmt::Debug for Tls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tls").field("certificate", &self.certificate).finish_non_exhaustive()
    }
}

impl Tls {
    /// Uses a certificate chain and its key, in files of PEM. Files that change are read again.
    ///
    /// # Errors
    /// [`TlsError`] names the file and its fault.
    pub fn open(certificate: &Path, key: &Path) -> Result<Self, TlsError> {
        let provider = Arc::new(ring::default_provider());
        let files = Files { certificate: certificate.to_path_buf(), key: key.to_path_buf() };
        let known = (files.stamp(), files.read(&provider)?);
        let unusable =
            |source| rig_hub::TlsError::Unusable { path: certificate.to_path_buf(), source };
        let renewed = Renewed { files, provider: Arc::clone(&provider), known: Mutex::new(known) };
        let renewed = Arc::new(renewed);
        let mut config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(unusable)?
            .with_no_client_auth()
            .with_cert_resolver(Arc::<Renewed>::clone(&renewed));
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        let acceptor = TlsAcceptor::from(Arc::new(config));
        Ok(Self { acceptor, certificate: certificate.to_path_buf(), renewed })
    }

    /// Uses the daemon's own certificate in a data directory, and makes it if there is none, for these
    /// names and addresses.
    ///
    /// # Errors
    /// [`TlsError`] names the file and its fault.
    pub fn own(data: &Path, names: Vec<String>) -> Result<Self, TlsError> {
        let (certificate, key) = (data.join(OWN_CERTIFICATE), data.join(OWN_KEY));
        if !certificate.exists() {
            let pair = KeyPair::generate()?;
            let mut params = CertificateParams::new(names)?;
            params.distinguished_name.push(DnType::CommonName, "rigd");
            let made = params.self_signed(&pair)?;
            let failed = |path: &Path| {
                let path = path.to_path_buf();
                move |source| TlsError::File { path, source }
            };
            fs::create_dir_all(data).map_err(failed(data))?;
            write(&key, &pair.serialize_pem(), 0o600).map_err(failed(&key))?;
            write(&certificate, &made.pem(), 0o644).map_err(failed(&certificate))?;
        }
        Self::open(&certificate, &key)
    }

    /// File of the certificate.
    pub fn certificate(&self) -> &Path {
        &self.certificate
    }

    /// When the certificate expires, the first of its chain; `None` if it does not say so. Renewed files are read.
    pub(crate) fn expires(&self) -> Option<Timestamp> {
        let chain = &self.renewed.present().cert;
        chain.iter().filter_map(|certificate| expiry::expires(certificate)).min()
    }

    /// Shakes hands with a client within a time.
    pub(super) async fn accept(
        &self,
        stream: TcpStream,
        within: Duration,
    ) -> io::Result<TlsStream<TcpStream>> {
        timeout(within, self.acceptor.accept(stream)).await?
    }
}

fn write(path: &Path, text: &str, mode: u32) -> io::Result<()> {
    _ = fs::remove_file(path);
    let mut options = File::options();
    let mut file = with_mode(options.create_new(true).write(true), mode).open(path)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

/// Tells one state of the two files from another.
type Stamp = [Option<files::Stamp>; 2];

#[derive(Debug)]
struct Files {
    certificate: PathBuf,
    key: PathBuf,
}

impl Files {
    fn stamp(&self) -> Stamp {
        let stamp = |path: &PathBuf| Some(files::Stamp::of(&fs::metadata(path).ok()?));
        [stamp(&self.certificate), stamp(&self.key)]
    }

    fn read(&self, provider: &CryptoProvider) -> Result<Arc<CertifiedKey>, TlsError> {
        let (chain, key) = (read_certificates(&self.certificate)?, read_key(&self.key)?);
        let unusable =
            |source| rig_hub::TlsError::Unusable { path: self.certificate.clone(), source };
        Ok(CertifiedKey::from_der(chain, key, provider).map(Arc::new).map_err(unusable)?)
    }
}

/// The certificate, read again when its files have changed.
#[derive(Debug)]
struct Renewed {
    files: Files,
    provider: Arc<CryptoProvider>,
    known: Mutex<(Stamp, Arc<CertifiedKey>)>,
}

impl ResolvesServerCert for Renewed {
    fn resolve(&self, _hello: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        Some(self.present())
    }
}

impl Renewed {
    /// The certificate that clients get now.
    fn present(&self) -> Arc<CertifiedKey> {
        // Nothing that holds it panics.
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let stamp = self.files.stamp();
        if stamp != known.0 {
            match self.files.read(&self.provider) {
                Ok(renewed) => *known = (stamp, renewed),
                // One of the two files may be written first: the other one changes the stamp again.
                Err(error) => {
                    let error = rig_model::with_causes(&error);
                    tracing::warn!(error, "the old certificate is used on");
                    known.0 = stamp;
                }
            }
        }
        Arc::clone(&known.1)
    }
}
