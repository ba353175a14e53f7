//! TLS, by a client that trusts one certificate.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{fs, os::unix::fs::PermissionsExt, path::Path, sync::Arc};

use axum::{Router, routing::get};
use rig_hub::TlsError as Cause;
use rigd::http::{
    serve,
    tls::{Tls, TlsError},
};
use tempfile::TempDir;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
};
use tokio_rustls::{
    TlsConnector,
    rustls::{
        ClientConfig, RootCertStore,
        crypto::ring,
        pki_types::{CertificateDer, ServerName, pem::PemObject},
    },
};
use tokio_util::sync::CancellationToken;

const REQUEST: &[u8] = b"GET / HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n";

fn names() -> Vec<String> {
    vec!["localhost".to_owned(), "127.0.0.1".to_owned()]
}

/// Asks by TLS, trusting one certificate.
async fn ask(port: u16, name: &'static str, trusted: &[u8]) -> std::io::Result<String> {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(trusted).unwrap()).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let stream = TcpStream::connect(("127.0.0.1", port)).await?;
    let name = ServerName::try_from(name).unwrap();
    let mut stream = TlsConnector::from(Arc::new(config)).connect(name, stream).await?;
    stream.write_all(REQUEST).await?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await?;
    Ok(answer)
}

async fn serving(tls: Tls) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let router = Router::new().route("/", get(async || "well"));
    tokio::spawn(serve(listener, Some(tls), router, CancellationToken::new()));
    port
}

#[tokio::test]
async fn a_client_that_trusts_the_certificate_is_answered_and_a_renewed_one_is_used_at_once() {
    let (data, other) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let tls = Tls::own(data.path(), names()).unwrap();
    let first = fs::read(tls.certificate()).unwrap();
    let port = serving(tls).await;
    for name in ["localhost", "127.0.0.1"] {
        let answer = ask(port, name, &first).await.unwrap();
        assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("well"), "{answer}");
    }
    assert!(ask(port, "bench.lab", &first).await.is_err());
    // A client without TLS gets nothing that it could take for an answer.
    let mut plain = TcpStream::connect(("127.0.0.1", port)).await.unwrap();
    plain.write_all(REQUEST).await.unwrap();
    let mut bytes = Vec::new();
    _ = plain.read_to_end(&mut bytes).await;
    assert!(!bytes.starts_with(b"HTTP"), "{bytes:?}");
    // Files that do not belong together leave the old certificate in use.
    let second = Tls::own(other.path(), names()).unwrap();
    let renewed = fs::read(second.certificate()).unwrap();
    assert!(ask(port, "localhost", &renewed).await.is_err());
    let copy = |file: &str| fs::copy(other.path().join(file), data.path().join(file)).unwrap();
    copy("tls-certificate.pem");
    assert!(ask(port, "localhost", &first).await.is_ok());
    copy("tls-key.pem");
    assert!(ask(port, "localhost", &renewed).await.unwrap().ends_with("well"));
    assert!(ask(port, "localhost", &first).await.is_err());
}

#[test]
fn a_key_that_others_can_read_and_files_without_one_are_refused() {
    let data = TempDir::new().unwrap();
    let certificate = Tls::own(data.path(), names()).unwrap().certificate().to_owned();
    let key = data.path().join("tls-key.pem");
    // It is made once.
    let made = fs::read(&certificate).unwrap();
    Tls::own(data.path(), Vec::new()).unwrap();
    assert_eq!(fs::read(&certificate).unwrap(), made);
    fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).unwrap();
    assert!(matches!(Tls::open(&certificate, &key), Err(TlsError::Files(Cause::Open { .. }))));
    fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).unwrap();
    let missing = Path::new("/nowhere/certificate.pem");
    assert!(matches!(Tls::open(missing, &key), Err(TlsError::Files(Cause::File { .. }))));
    fs::write(&certificate, "").unwrap();
    assert!(matches!(Tls::open(&certificate, &key), Err(TlsError::Files(Cause::Pem { .. }))));
}
