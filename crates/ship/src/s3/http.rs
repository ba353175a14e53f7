//! The HTTP client of S3: one connection for each request.

use std::{env, io, path::PathBuf, sync::Arc, time::Duration};

use async_trait::async_trait;
use bytes::Bytes;
use http_body_util::{BodyExt as _, Full};
use hyper::{
    Response, Uri,
    body::Incoming,
    client::conn::http1,
    header::{HOST, HeaderValue},
};
use hyper_util::rt::TokioIo;
use object_store::{
    ClientConfigKey, ClientOptions,
    client::{
        HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpRequestBody,
        HttpResponse, HttpResponseBody, HttpService,
    },
};
use tokio::{
    io::{AsyncRead, AsyncWrite},
    net::TcpStream,
    task::JoinSet,
    time::{error::Elapsed, timeout},
};
use tokio_rustls::{
    TlsConnector,
    rustls::{
        self, ClientConfig, RootCertStore,
        crypto::ring,
        pki_types::{CertificateDer, InvalidDnsNameError, ServerName, pem, pem::PemObject as _},
    },
};

/// Time limit until an answer begins, beside that of the body of the request, and of each further part of the answer.
const LIMIT: Duration = Duration::from_secs(60);
/// The slowest link that a body may take, bytes a second.
const SLOWEST: f64 = 50_000.0;
/// The certificates of authorities, where the system keeps them.
const CERTIFICATES: &str = "/etc/ssl/certs/ca-certificates.crt";

/// Makes the client.
#[derive(Debug)]
pub(super) struct Connector;

#[derive(Debug)]
struct Client {
    allows_http: bool,
    tls: Result<Arc<ClientConfig>, (PathBuf, Arc<TrustError>)>,
}

/// Why no connection is made.
#[derive(Debug, thiserror::Error)]
enum ConnectError {
    #[error("{uri} has no host, or is not of http or https")]
    Uri { uri: Uri },
    #[error("{host} would be spoken to without encryption; AWS_ALLOW_HTTP=true allows it")]
    Open { host: String },
    #[error("the certificates of {} cannot be used", path.display())]
    Trust { path: PathBuf, source: Arc<TrustError> },
    #[error("{host} cannot be named in TLS")]
    Name { host: String, source: InvalidDnsNameError },
    #[error("no connection to {host}")]
    Io { host: String, source: io::Error },
}

/// Why no server can be trusted.
#[derive(Debug, thiserror::Error)]
enum TrustError {
    #[error("it has no certificates in the form of PEM")]
    Pem(#[from] pem::Error),
    #[error("the library refuses to speak TLS")]
    Tls(#[from] rustls::Error),
}

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let allowed = options.get_config_value(&ClientConfigKey::AllowHttp);
        let allows_http = allowed.as_deref() == Some("true");
        let path = env::var_os("AWS_CA_BUNDLE").map_or(CERTIFICATES.into(), PathBuf::from);
        let tls = trusting(&path).map_err(|error| (path, Arc::new(error)));
        Ok(HttpClient::new(Client { allows_http, tls }))
    }
}

/// TLS with servers that the certificates of a file confirm.
fn trusting(path: &std::path::Path) -> Result<Arc<ClientConfig>, TrustError> {
    let mut roots = RootCertStore::empty();
    let read: Result<Vec<_>, _> = CertificateDer::pem_file_iter(path)?.collect();
    let (added, _) = roots.add_parsable_certificates(read?);
    if added == 0 {
        return Err(pem::Error::NoItemsFound.into());
    }
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(Arc::new(config))
}

#[async_trait]
impl HttpService for Client {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let body_s = request.body().content_length() as f64 / SLOWEST;
        let limit = LIMIT + Duration::from_secs_f64(body_s);
        timeout(limit, self.exchange(request)).await.map_err(late)??.whole().await
    }
}

fn late(error: Elapsed) -> HttpError {
    HttpError::new(HttpErrorKind::Timeout, error)
}

/// An answer whose body is still to come.
struct Begun {
    answer: Response<Incoming>,
    /// It ends with this, also when that is cut short.
    _connection: JoinSet<hyper::Result<()>>,
}

impl Begun {
    /// The answer with all of its body.
    async fn whole(self) -> Result<HttpResponse, HttpError> {
        let failed = |error| HttpError::new(HttpErrorKind::Interrupted, error);
        let (parts, mut body) = self.answer.into_parts();
        let mut bytes = Vec::new();
        while let Some(frame) = timeout(LIMIT, body.frame()).await.map_err(late)? {
            if let Ok(data) = frame.map_err(failed)?.into_data() {
                bytes.extend_from_slice(&data);
            }
        }
        let body = Full::new(Bytes::from(bytes));
        let body = HttpResponseBody::new(body.map_err(|never| match never {}));
        Ok(HttpResponse::from_parts(parts, body))
    }
}

impl Client {
    async fn exchange(&self, request: HttpRequest) -> Result<Begun, HttpError> {
        let refused = |error| HttpError::new(HttpErrorKind::Unknown, error);
        let uri = request.uri().clone();
        let bad = || refused(ConnectError::Uri { uri: uri.clone() });
        let host = uri.host().ok_or_else(bad)?.trim_matches(['[', ']']).to_owned();
        let is_secure = match uri.scheme_str() {
            Some("https") => true,
            Some("http") if self.allows_http => false,
            Some("http") => return Err(refused(ConnectError::Open { host })),
            _ => return Err(bad()),
        };
        let failed = |source| {
            let host = host.clone();
            HttpError::new(HttpErrorKind::Connect, ConnectError::Io { host, source })
        };
        let port = uri.port_u16().unwrap_or(if is_secure { 443 } else { 80 });
        let stream = TcpStream::connect((host.as_str(), port)).await.map_err(failed)?;
        if !is_secure {
            return send(stream, request).await;
        }
        let tls = self.tls.as_ref().map_err(|(path, source)| {
            refused(ConnectError::Trust { path: path.clone(), source: Arc::clone(source) })
        })?;
        let name = ServerName::try_from(host.clone())
            .map_err(|source| refused(ConnectError::Name { host: host.clone(), source }))?;
        let connector = TlsConnector::from(Arc::clone(tls));
        send(connector.connect(name, stream).await.map_err(failed)?, request).await
    }
}

/// Sends a request over a connection, and reads the whole answer.
async fn send(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    mut request: HttpRequest,
) -> Result<Begun, HttpError> {
    let failed = |error| HttpError::new(HttpErrorKind::Interrupted, error);
    let uri = request.uri();
    let authority = uri.authority().map_or("", |authority| authority.as_str());
    let host = HeaderValue::from_str(authority)
        .map_err(|error| HttpError::new(HttpErrorKind::Unknown, error))?;
    let path = uri.path_and_query().map_or("/", |path| path.as_str());
    let path: Uri = path.parse().map_err(|error| HttpError::new(HttpErrorKind::Unknown, error))?;
    *request.uri_mut() = path;
    request.headers_mut().entry(HOST).or_insert(host);
    let handshake = http1::handshake::<_, HttpRequestBody>(TokioIo::new(stream));
    let (mut sender, connection) = handshake.await.map_err(failed)?;
    let mut connections = JoinSet::new();
    connections.spawn(connection);
    let answer = sender.send_request(request).await.map_err(failed)?;
    Ok(Begun { answer, _connection: connections })
}
