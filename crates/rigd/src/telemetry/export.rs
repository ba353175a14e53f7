//! Exports spans by OTLP over HTTP, as JSON.
//!
//! The variables of the specification name the collector (`OTEL_EXPORTER_OTLP_ENDPOINT`), headers, resource and
//! sampling. Spans are sent by a thread of their own, in batches; a collector that is slow or gone costs spans and
//! nothing else.
//!
//! # Source
//! [OTLP 1](https://opentelemetry.io/docs/specs/otlp/); [trace context](https://www.w3.org/TR/trace-context/) for
//! the spans of clients.

use std::{
    env,
    fmt::{self, Debug},
    io,
    pin::Pin,
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use axum::{
    body::Bytes,
    http::{HeaderMap, Request, Response, Uri, header},
};
use http_body_util::{BodyExt, Full, Limited};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use opentelemetry::{propagation::TextMapPropagator, trace::TracerProvider};
use opentelemetry_http::{HeaderExtractor, HttpClient, HttpError};
use opentelemetry_otlp::{
    ExporterBuildError, Protocol, SpanExporter, WithExportConfig, WithHttpConfig,
};
use opentelemetry_sdk::{
    Resource,
    propagation::TraceContextPropagator,
    trace::{SdkTracer, SdkTracerProvider},
};
use tokio::{net::TcpStream, runtime::Runtime, task::JoinSet, time::timeout};
use tracing::Span;
use tracing_opentelemetry::{OpenTelemetryLayer, OpenTelemetrySpanExt};
use tracing_subscriber::registry::LookupSpan;

/// A collector that has not taken a batch by then does not get it.
const ATTEMPT_TIME: Duration = Duration::from_secs(5);
/// The end of the program waits so long for the last batch.
const LAST_TIME: Duration = Duration::from_secs(2);
/// The largest answer of a collector that is read.
const ANSWER_MAX: usize = 64 << 10;
/// One of them names a collector.
const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT"];

/// Why spans cannot be exported.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TelemetryError {
    #[error(
        "{variable}={value} is not an address of http; a collector on this computer can send spans on by TLS"
    )]
    Scheme { variable: &'static str, value: String },
    #[error("the settings in the variables of OpenTelemetry")]
    Settings(#[from] ExporterBuildError),
    #[error("the runtime of the export")]
    Runtime(#[from] io::Error),
}

/// Exports the spans of this program until it is dropped.
pub(crate) struct Exported {
    provider: SdkTracerProvider,
}

impl Exported {
    /// What gives the spans of `tracing` to the exporter.
    pub(crate) fn layer<S: tracing::Subscriber + for<'a> LookupSpan<'a>>(
        &self,
    ) -> OpenTelemetryLayer<S, SdkTracer> {
        tracing_opentelemetry::layer().with_tracer(self.provider.tracer("rigd"))
    }
}

impl Debug for Exported {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Exported")
    }
}

impl Drop for Exported {
    fn drop(&mut self) {
        // A batch that was not taken has been told.
        _ = self.provider.shutdown_with_timeout(LAST_TIME);
    }
}

/// Begins to export, if a variable names a collector.
///
/// # Errors
/// [`TelemetryError`] for a collector that rigd cannot reach, and for wrong settings.
pub(crate) fn start() -> Result<Option<Exported>, TelemetryError> {
    let named = |variable| Some((variable, env::var(variable).ok().filter(|at| !at.is_empty())?));
    let Some((variable, value)) = ENDPOINTS.into_iter().find_map(named) else { return Ok(None) };
    if value.parse::<Uri>().ok().and_then(|uri| uri.scheme_str().map(|scheme| scheme == "http"))
        != Some(true)
    {
        return Err(TelemetryError::Scheme { variable, value });
    }
    let exporter = SpanExporter::builder()
        .with_http()
        .with_http_client(Client::new()?)
        .with_protocol(Protocol::HttpJson)
        .with_timeout(ATTEMPT_TIME)
        .build()?;
    let mut resource = Resource::builder();
    if env::var_os("OTEL_SERVICE_NAME").is_none() {
        resource = resource.with_service_name("rigd");
    }
    let version = opentelemetry::KeyValue::new("service.version", env!("CARGO_PKG_VERSION"));
    let provider = SdkTracerProvider::builder()
        .with_batch_exporter(exporter)
        .with_resource(resource.with_attribute(version).build())
        .build();
    Ok(Some(Exported { provider }))
}

/// Puts the span of a request under that of its client, if the request names it.
pub(crate) fn adopt(span: &Span, headers: &HeaderMap) {
    let context = TraceContextPropagator::new().extract(&HeaderExtractor(headers));
    // A span that nobody follows has no parent.
    _ = span.set_parent(context);
}

/// Sends batches, each over a connection of its own. It is used by the thread of the exporter alone.
struct Client {
    runtime: Runtime,
    /// The last batch was not taken, which has been told.
    is_failing: AtomicBool,
}

impl Debug for Client {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Client")
    }
}

impl Client {
    fn new() -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        Ok(Self { runtime, is_failing: AtomicBool::new(false) })
    }

    fn send(&self, request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
        let collector = request.uri().clone();
        let sent = self.runtime.block_on(async {
            timeout(ATTEMPT_TIME, exchange(request)).await.unwrap_or_else(|late| Err(late.into()))
        });
        let trouble = match &sent {
            Ok(answer) if answer.status().is_success() => None,
            Ok(answer) => Some(answer.status().to_string()),
            Err(error) => Some(error.to_string()),
        };
        let was_failing = self.is_failing.swap(trouble.is_some(), Ordering::Relaxed);
        if let Some(trouble) = trouble.filter(|_| !was_failing) {
            tracing::warn!(%collector, trouble, "spans cannot be exported; they are lost until it works again");
        }
        sent
    }
}

type Sent<'a> = Pin<Box<dyn Future<Output = Result<Response<Bytes>, HttpError>> + Send + 'a>>;

impl HttpClient for Client {
    fn send_bytes<'a, 'b>(&'a self, request: Request<Bytes>) -> Sent<'b>
    where
        'a: 'b,
        Self: 'b,
    {
        Box::pin(async { self.send(request) })
    }
}

async fn exchange(request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
    let (mut head, body) = request.into_parts();
    let authority = head.uri.authority().cloned().ok_or("the address has no host")?;
    let host = authority.host().trim_matches(['[', ']']);
    let stream = TcpStream::connect((host, authority.port_u16().unwrap_or(80))).await?;
    head.headers.insert(header::HOST, authority.as_str().parse()?);
    head.uri = head.uri.path_and_query().map_or("/", |path| path.as_str()).parse()?;
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await?;
    // It ends with this function.
    let mut connections = JoinSet::new();
    connections.spawn(connection);
    let answer = sender.send_request(Request::from_parts(head, Full::new(body))).await?;
    let (head, body) = answer.into_parts();
    let body = Limited::new(body, ANSWER_MAX).collect().await?.to_bytes();
    Ok(Response::from_parts(head, body))
}
