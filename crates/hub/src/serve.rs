//! The page of the laboratory and its JSON, over HTTP. It reads the hub and changes nothing.

use std::{io, net::SocketAddr, sync::Arc};

use axum::{
    Json, Router,
    extract::{Query, Request, State},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    middleware::{Next, from_fn_with_state},
    response::{Html, IntoResponse, Response},
    routing::get,
};
use rig_model::with_causes;
use tokio::net::TcpListener;

use crate::{
    catalogue::{Catalogue, CatalogueError, FoundRun, Rig, Wanted},
    compare::Reference,
    page,
};

/// Runs on the page of the rigs.
const LATEST: u32 = 20;

/// What the handlers share.
#[derive(Debug)]
struct Shared {
    catalogue: Catalogue,
    /// Names by which clients may call this computer.
    hosts: Vec<String>,
}

/// Serves a catalogue on a listener until the program ends.
///
/// # Errors
/// The error of the system.
pub async fn serve(
    listener: TcpListener,
    catalogue: Catalogue,
    hosts: Vec<String>,
) -> io::Result<()> {
    axum::serve(listener, router(catalogue, hosts)).await
}

/// Whether an address is of this computer alone: the page knows no persons, and who may read it is decided by what
/// stands before it.
pub fn is_local(address: SocketAddr) -> bool {
    address.ip().to_canonical().is_loopback()
}

fn router(catalogue: Catalogue, hosts: Vec<String>) -> Router {
    let shared = Arc::new(Shared { catalogue, hosts });
    Router::new()
        .route("/", get(show_rigs))
        .route("/runs", get(show_runs))
        .route("/compare", get(show_references))
        .route("/api/v1/rigs", get(rigs))
        .route("/api/v1/references", get(references))
        .route("/api/v1/runs", get(runs))
        .route("/healthz", get(|| async { "ok" }))
        .layer(from_fn_with_state(Arc::clone(&shared), guard))
        .with_state(shared)
}

/// Refuses clients that call this computer by a name of another one, as a page of another site can make a browser do.
async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    if !is_known(&shared.hosts, request.headers()) {
        let told = "call this computer by a name of --allow-host, or by 127.0.0.1";
        return (StatusCode::FORBIDDEN, told).into_response();
    }
    let mut response = next.run(request).await;
    let policy =
        "default-src 'none'; style-src 'unsafe-inline'; form-action 'self'; frame-ancestors 'none'";
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(policy));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    response
}

fn is_known(hosts: &[String], headers: &HeaderMap) -> bool {
    let Some(host) = headers.get(header::HOST).and_then(|host| host.to_str().ok()) else {
        return false;
    };
    let is_port = |port: &str| !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit());
    let name =
        host.rsplit_once(':').filter(|(_, port)| is_port(port)).map_or(host, |(name, _)| name);
    ["localhost", "127.0.0.1", "[::1]"].contains(&name)
        || hosts.iter().any(|known| known.eq_ignore_ascii_case(name))
}

async fn show_rigs(State(shared): State<Arc<Shared>>) -> Response {
    let read = async {
        let latest = Wanted { limit: Some(LATEST), ..Wanted::default() };
        let (rigs, runs) = (shared.catalogue.rigs().await?, shared.catalogue.runs(&latest).await?);
        Ok(page::rigs(&rigs, &runs))
    };
    answer(read.await)
}

async fn show_runs(State(shared): State<Arc<Shared>>, Query(wanted): Query<Wanted>) -> Response {
    let read = async {
        let (rigs, runs) = (shared.catalogue.rigs().await?, shared.catalogue.runs(&wanted).await?);
        Ok(page::runs(&rigs, &runs, &wanted))
    };
    answer(read.await)
}

async fn show_references(State(shared): State<Arc<Shared>>) -> Response {
    answer(shared.catalogue.references().await.map(|references| page::references(&references)))
}

fn answer(read: Result<String, CatalogueError>) -> Response {
    match read {
        Ok(page) => Html(page).into_response(),
        Err(error) => {
            let told = page::trouble(&with_causes(&error));
            (StatusCode::SERVICE_UNAVAILABLE, Html(told)).into_response()
        }
    }
}

async fn rigs(State(shared): State<Arc<Shared>>) -> Result<Json<Vec<Rig>>, Trouble> {
    Ok(Json(shared.catalogue.rigs().await?))
}

async fn runs(
    State(shared): State<Arc<Shared>>,
    Query(wanted): Query<Wanted>,
) -> Result<Json<Vec<FoundRun>>, Trouble> {
    Ok(Json(shared.catalogue.runs(&wanted).await?))
}

async fn references(State(shared): State<Arc<Shared>>) -> Result<Json<Vec<Reference>>, Trouble> {
    Ok(Json(shared.catalogue.references().await?))
}

/// The hub cannot be read.
#[derive(Debug)]
struct Trouble(CatalogueError);

impl From<CatalogueError> for Trouble {
    fn from(error: CatalogueError) -> Self {
        Self(error)
    }
}

impl IntoResponse for Trouble {
    fn into_response(self) -> Response {
        let told = serde_json::json!({ "title": "the hub cannot be read", "detail": with_causes(&self.0) });
        let kind = [(header::CONTENT_TYPE, "application/problem+json")];
        (StatusCode::SERVICE_UNAVAILABLE, kind, told.to_string()).into_response()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_must_call_this_computer_by_its_name() {
        let hosts = ["hub.lab.example".to_owned()];
        let is_known = |host: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, host.parse().unwrap());
            is_known(&hosts, &headers)
        };
        for host in ["localhost", "127.0.0.1:8138", "[::1]:8138", "[::1]", "HUB.lab.example:443"] {
            assert!(is_known(host), "{host}");
        }
        for host in
            ["evil.example", "evil.example:8138", "", "localhost.evil.example", "127.0.0.1:x"]
        {
            assert!(!is_known(host), "{host}");
        }
    }
}
