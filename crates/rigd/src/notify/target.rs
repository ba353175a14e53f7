//! A target: how a message reaches it, and why it does not.
//!
//! Nothing here names the path of a URL in an error: it may be a secret.

use std::{io, path::PathBuf, process::Stdio, sync::Arc, time::Duration};

use axum::http::{Request, StatusCode, Uri, header};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use rig_files::service_file::{Address, EventKind, NotificationsFile, TargetFile, Url, Via};
use tokio::{
    io::{AsyncRead, AsyncWrite, AsyncWriteExt},
    net::TcpStream,
    process::Command,
    task::JoinSet,
    time::timeout,
};
use tokio_rustls::{
    TlsConnector,
    rustls::{
        self, ClientConfig, RootCertStore,
        crypto::ring,
        pki_types::{CertificateDer, InvalidDnsNameError, ServerName, pem, pem::PemObject},
    },
};

use super::{mail, outbox::Message, words};
use crate::http::access::{Token, TokenError};

/// One who is told.
#[derive(Debug)]
pub(super) struct Target {
    pub(super) name: String,
    events: Vec<EventKind>,
    /// Attempts in a minute at most.
    pub(super) per_minute: u32,
    /// Time limit of an attempt.
    limit: Duration,
    channel: Channel,
}

#[derive(Debug)]
enum Channel {
    Http { form: Form, url: Url, token_file: Option<PathBuf>, tls: Option<Arc<ClientConfig>> },
    Mail { to: Vec<String>, from: String, sendmail: PathBuf },
}

/// The form of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Webhook,
    Ntfy,
}

/// Why targets cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TargetError {
    /// A file with a secret.
    #[error("target {name} of the notifications")]
    Secret {
        /// Name of the target.
        name: String,
        /// What is wrong with the file.
        source: TokenError,
    },
    /// A file without a URL.
    #[error("target {name} of the notifications: {} has no URL of http or https", path.display())]
    NoUrl {
        /// Name of the target.
        name: String,
        /// The file.
        path: PathBuf,
    },
    /// The certificates that `https` targets are checked against.
    #[error("{}, which https targets are checked against, has no certificates in the form of PEM", path.display())]
    Certificates {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: pem::Error,
    },
    /// The library refuses to speak TLS.
    #[error("TLS to targets of the notifications")]
    Tls(#[from] rustls::Error),
}

/// Why an attempt has failed.
#[derive(Debug, thiserror::Error)]
pub(super) enum SendError {
    #[error("no answer within {} s", limit.as_secs_f64())]
    Late { limit: Duration },
    #[error("the file with its secret cannot be used")]
    Secret(#[source] TokenError),
    #[error("its URL has no host, or is not of http or https")]
    Url,
    #[error("no connection to {host}")]
    Connect { host: String, source: io::Error },
    #[error("{host} cannot be named in TLS")]
    Name { host: String, source: InvalidDnsNameError },
    #[error("{host} did not answer in HTTP")]
    Http { host: String, source: hyper::Error },
    #[error("the request cannot be written")]
    Request(#[from] axum::http::Error),
    #[error("{host} answered {status}")]
    Refused { host: String, status: StatusCode },
    #[error("{} cannot be run", program.display())]
    Program { program: PathBuf, source: io::Error },
    #[error("{} ended with {status}", program.display())]
    Ended { program: PathBuf, status: std::process::ExitStatus },
}

/// All targets of a service file, whose secrets can be read.
///
/// # Errors
/// [`TargetError`] names the target or the file.
pub(super) fn all(file: &NotificationsFile) -> Result<Vec<Target>, TargetError> {
    let mut trusted = None;
    let limit = Duration::from_secs_f64(file.attempt_s);
    file.targets.iter().map(|target| Target::new(target, limit, file, &mut trusted)).collect()
}

impl Target {
    fn new(
        file: &TargetFile,
        limit: Duration,
        all: &NotificationsFile,
        trusted: &mut Option<Arc<ClientConfig>>,
    ) -> Result<Self, TargetError> {
        let TargetFile { name, via, events, per_minute } = file.clone();
        let mut http = |form, Address { url, token_file }| {
            let secret = |source| TargetError::Secret { name: name.clone(), source };
            token_file.as_deref().map(Token::read).transpose().map_err(secret)?;
            let read = read_url(&url).map_err(secret)?;
            let no_url = || match &url {
                Url::File(path) => path.clone(),
                Url::Text(_) => PathBuf::new(),
            };
            let (_, is_secure) = host_of(&read)
                .map_err(|_| TargetError::NoUrl { name: name.clone(), path: no_url() })?;
            let tls = match (is_secure, &trusted) {
                (false, _) => None,
                (true, Some(known)) => Some(Arc::clone(known)),
                (true, None) => {
                    let made = trusting(&all.certificates)?;
                    Some(Arc::clone(trusted.insert(made)))
                }
            };
            Ok::<_, TargetError>(Channel::Http { form, url, token_file, tls })
        };
        let channel = match via {
            Via::Webhook(address) => http(Form::Webhook, address)?,
            Via::Ntfy(address) => http(Form::Ntfy, address)?,
            Via::Mail { to, from, sendmail } => Channel::Mail { to, from, sendmail },
        };
        Ok(Self { name: file.name.clone(), events, per_minute, limit, channel })
    }

    /// Whether it is told such things.
    pub(super) fn wants(&self, event: EventKind) -> bool {
        self.events.contains(&event)
    }

    /// Sends a message, once.
    ///
    /// # Errors
    /// [`SendError`], at the latest after the time limit.
    pub(super) async fn send(&self, message: &Message) -> Result<(), SendError> {
        let sending = async {
            match &self.channel {
                Channel::Http { form, url, token_file, tls } => {
                    // Read each time: a new secret is used without a restart.
                    let url = read_url(url).map_err(SendError::Secret)?;
                    let token = token_file.as_deref().map(Token::read).transpose();
                    let token = token.map_err(SendError::Secret)?;
                    let (url, body) = match form {
                        Form::Webhook => (url, words::webhook(message)),
                        Form::Ntfy => words::ntfy(&url, message).ok_or(SendError::Url)?,
                    };
                    post(&url, token.as_ref(), body.to_string(), tls.as_ref()).await
                }
                Channel::Mail { to, from, sendmail } => {
                    submit(sendmail, from, to, &mail::text(message, from, to)).await
                }
            }
        };
        let limit = self.limit;
        timeout(limit, sending).await.unwrap_or(Err(SendError::Late { limit }))
    }
}

/// The URL, from its file if it has one.
fn read_url(url: &Url) -> Result<String, TokenError> {
    match url {
        Url::Text(text) => Ok(text.clone()),
        Url::File(path) => Token::read(path).map(|text| text.reveal().to_owned()),
    }
}

/// The host with its port, and whether it is spoken to by TLS.
fn host_of(url: &str) -> Result<(Uri, bool), SendError> {
    let uri: Uri = url.parse().map_err(|_| SendError::Url)?;
    let is_secure = match uri.scheme_str() {
        Some("http") => false,
        Some("https") => true,
        _ => return Err(SendError::Url),
    };
    if uri.host().is_none_or(str::is_empty) {
        return Err(SendError::Url);
    }
    Ok((uri, is_secure))
}

/// TLS with hosts that the certificates of a file confirm.
fn trusting(path: &std::path::Path) -> Result<Arc<ClientConfig>, TargetError> {
    let bad = |source| TargetError::Certificates { path: path.to_path_buf(), source };
    let mut roots = RootCertStore::empty();
    let read: Result<Vec<_>, _> = CertificateDer::pem_file_iter(path).map_err(bad)?.collect();
    let (added, _) = roots.add_parsable_certificates(read.map_err(bad)?);
    if added == 0 {
        return Err(bad(pem::Error::NoItemsFound));
    }
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(Arc::new(config))
}

/// Posts JSON. Another address to which the answer points is not followed.
async fn post(
    url: &str,
    token: Option<&Token>,
    body: String,
    tls: Option<&Arc<ClientConfig>>,
) -> Result<(), SendError> {
    let (uri, is_secure) = host_of(url)?;
    let host = uri.host().unwrap_or_default().trim_matches(['[', ']']).to_owned();
    let port = uri.port_u16().unwrap_or(if is_secure { 443 } else { 80 });
    let authority = uri.authority().map_or_else(
        || host.clone(),
        |all| {
            // Names and passwords have no place in a header that others log.
            all.as_str().rsplit('@').next().unwrap_or_default().to_owned()
        },
    );
    let path = uri.path_and_query().map_or("/", |path| path.as_str());
    let mut request = Request::post(path)
        .header(header::HOST, authority)
        .header(header::CONTENT_TYPE, "application/json")
        .header(header::USER_AGENT, concat!("rigd/", env!("CARGO_PKG_VERSION")));
    if let Some(token) = token {
        request = request.header(header::AUTHORIZATION, token.bearer());
    }
    let request = request.body(body)?;
    let connect = |source| SendError::Connect { host: host.clone(), source };
    let stream = TcpStream::connect((host.as_str(), port)).await.map_err(connect)?;
    let status = match (is_secure, tls) {
        (false, _) => exchange(&host, stream, request).await?,
        (true, Some(tls)) => {
            let name = ServerName::try_from(host.clone())
                .map_err(|source| SendError::Name { host: host.clone(), source })?;
            let connector = TlsConnector::from(Arc::clone(tls));
            let stream = connector.connect(name, stream).await.map_err(connect)?;
            exchange(&host, stream, request).await?
        }
        // The file with the URL has changed from http to https since the start.
        (true, None) => return Err(SendError::Url),
    };
    if status.is_success() { Ok(()) } else { Err(SendError::Refused { host, status }) }
}

/// Sends one request over a connection of its own, and reads the head of the answer.
async fn exchange(
    host: &str,
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    request: Request<String>,
) -> Result<StatusCode, SendError> {
    let failed = |source| SendError::Http { host: host.to_owned(), source };
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(failed)?;
    // It ends with this function, also when that is cut short.
    let mut connections = JoinSet::new();
    connections.spawn(connection);
    Ok(sender.send_request(request).await.map_err(failed)?.status())
}

/// Hands a mail to the program that delivers mail on this computer.
async fn submit(
    program: &std::path::Path,
    from: &str,
    to: &[String],
    text: &str,
) -> Result<(), SendError> {
    let failed = |source| SendError::Program { program: program.to_path_buf(), source };
    let mut child = Command::new(program)
        // A line with a dot alone does not end the mail.
        .args(["-i", "-f", from, "--"])
        .args(to)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .kill_on_drop(true)
        .spawn()
        .map_err(failed)?;
    let written = match child.stdin.take() {
        Some(mut stdin) => stdin.write_all(text.as_bytes()).await,
        None => Ok(()),
    };
    let status = child.wait().await.map_err(failed)?;
    if !status.success() {
        return Err(SendError::Ended { program: program.to_path_buf(), status });
    }
    written.map_err(failed)
}
