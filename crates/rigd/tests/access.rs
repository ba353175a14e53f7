//! Requests that the daemon must refuse.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "access/named.rs"]
mod named;

use std::{fs, net::Ipv4Addr, os::unix::fs::PermissionsExt, path::Path};

use axum::{
    Router,
    body::{Body, to_bytes},
    http::{Request, Response, StatusCode},
};
use rig_engine::RigState;
use rigd::{
    http::{
        Shared,
        access::{Access, Token},
        router,
    },
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, RigHandle},
    tokens::{Secret, Tokens},
};
use rustix::process::{Resource, getrlimit};
use serde_json::Value;
use tempfile::TempDir;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

const SECRET: &str = "0123456789abcdef";

/// The routes of a daemon on `127.0.0.1` that also answers to `bench.lab`, with a protocol loaded.
struct Daemon {
    router: Router,
    handle: RigHandle,
    data: TempDir,
}

impl Daemon {
    async fn start(has_token: bool) -> Self {
        Self::start_with(has_token, false).await
    }

    async fn start_with(has_token: bool, has_names: bool) -> Self {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let rig = LoadedRig::load(&config.join("rigs/simulated.toml")).unwrap();
        let (data, facts) = (TempDir::new().unwrap(), rig.facts());
        let smoke = LoadedProtocol::load(&config.join("protocols/smoke.toml"), &facts).unwrap();
        let (handle, _) = rig::open(rig, data.path().to_owned()).unwrap();
        let token = has_token.then(|| {
            let path = data.path().join("token");
            fs::write(&path, SECRET).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
            Token::read(&path).unwrap()
        });
        let (allowed, operator) = (["bench.lab".parse().unwrap()], "ada".parse().unwrap());
        let mut access = Access::new(Ipv4Addr::LOCALHOST.into(), allowed, token, operator);
        if has_names {
            access =
                access.with_tokens(Tokens::open(data.path()).unwrap(), &Secret::new().unwrap());
        }
        let (folder, closing) = (data.path().to_owned(), CancellationToken::new());
        let shared = Shared::new(
            handle.clone(),
            facts,
            Some(smoke),
            folder,
            access,
            tokio::runtime::Handle::current(),
            closing,
        );
        let daemon = Self { router: router(shared), handle, data };
        daemon.reaches(RigState::Idle).await;
        daemon
    }

    async fn send(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Response<Body> {
        let mut request = Request::builder().method(method).uri(path);
        if headers.iter().all(|(name, _)| *name != "host") {
            request = request.header("host", "localhost:8137");
        }
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.router.clone().oneshot(request.body(body.into()).unwrap()).await.unwrap()
    }

    /// Sends a request that is refused, and checks the form of the answer.
    async fn refused(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
        expected: (StatusCode, &str),
    ) -> Response<Value> {
        let answer = self.send(method, path, headers, body).await;
        let what = format!("{method} {path} {headers:?}");
        assert_eq!(answer.status(), expected.0, "{what}");
        assert_eq!(answer.headers()["content-type"], "application/problem+json", "{what}");
        let (parts, body) = answer.into_parts();
        let bytes = to_bytes(body, usize::MAX).await.unwrap();
        let problem: Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!(problem["status"], expected.0.as_u16(), "{what}: {problem}");
        assert_eq!(problem["title"], expected.1, "{what}: {problem}");
        assert!(!problem["detail"].as_str().unwrap().is_empty(), "{what}: {problem}");
        Response::from_parts(parts, problem)
    }

    /// Nothing has been begun.
    async fn is_untouched(&self) {
        let status = self.handle.status().borrow().clone();
        assert_eq!((status.snapshot.state, status.sweeps), (RigState::Idle, 0));
        let answer = self.send("GET", "/api/v1/runs", &[], "").await;
        assert_eq!(to_bytes(answer.into_body(), 9).await.unwrap(), "[]");
    }
}

/// Requests that would each do or tell something.
const REQUESTS: [(&str, &str); 6] = [
    ("POST", "/api/v1/runs"),
    ("POST", "/api/v1/stop"),
    ("GET", "/api/v1/rig"),
    ("GET", "/api/v1/events"),
    ("GET", "/"),
    ("GET", "/nothing"),
];

#[tokio::test]
async fn only_by_its_own_names_is_the_daemon_called() {
    const MISDIRECTED: (StatusCode, &str) =
        (StatusCode::MISDIRECTED_REQUEST, "misdirected request");
    const BAD: (StatusCode, &str) = (StatusCode::BAD_REQUEST, "bad request");
    let daemon = Daemon::start(false).await;
    for (method, path) in REQUESTS {
        // The host of a page whose name was rebound to this address.
        for host in ["evil.example", "evil.example:8137", "localhost.evil.example", "192.0.2.1"] {
            daemon.refused(method, path, &[("host", host)], "", MISDIRECTED).await;
        }
        for hosts in [&[("host", "")][..], &[("host", "a@localhost")], &[("host", "local host")]] {
            daemon.refused(method, path, hosts, "", BAD).await;
        }
        let two = [("host", "localhost"), ("host", "evil.example")];
        daemon.refused(method, path, &two, "", BAD).await;
        let absolute = format!("http://evil.example{path}");
        daemon.refused(method, &absolute, &[], "", MISDIRECTED).await;
    }
    for host in ["localhost", "LOCALHOST:9", "127.0.0.1:8137", "[::1]:8137", "bench.lab"] {
        let answer = daemon.send("GET", "/api/v1/rig", &[("host", host)], "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{host}");
    }
    daemon.is_untouched().await;
}

#[tokio::test]
async fn a_page_of_another_site_begins_nothing_and_reads_nothing() {
    const FORBIDDEN: (StatusCode, &str) = (StatusCode::FORBIDDEN, "forbidden");
    let daemon = Daemon::start(false).await;
    for (method, path) in REQUESTS {
        let origins = [
            "http://evil.example",
            "null",
            "http://localhost:3000",
            "http://localhost",
            "ftp://localhost:8137",
            "http://127.0.0.1:8137",
            "",
        ];
        for origin in origins {
            daemon.refused(method, path, &[("origin", origin)], "", FORBIDDEN).await;
        }
        for site in ["cross-site", "same-site", "Same-Origin", ""] {
            daemon.refused(method, path, &[("sec-fetch-site", site)], "", FORBIDDEN).await;
        }
        let hidden = [("origin", "http://localhost:8137"), ("origin", "http://evil.example")];
        daemon.refused(method, path, &hidden, "", FORBIDDEN).await;
    }
    // Requests that an HTML form can send.
    for content_type in ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data"] {
        let headers = [("content-type", content_type), ("origin", "http://evil.example")];
        daemon.refused("POST", "/api/v1/sweeps", &headers, "{}", FORBIDDEN).await;
    }
    for site in ["same-origin", "none"] {
        let own = [("origin", "http://localhost:8137"), ("sec-fetch-site", site)];
        let answer = daemon.send("GET", "/api/v1/rig", &own, "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{site}");
    }
    // Behind a proxy that speaks TLS.
    let proxied = [("host", "bench.lab"), ("origin", "https://bench.lab")];
    assert_eq!(daemon.send("GET", "/", &proxied, "").await.status(), StatusCode::OK);
    daemon.is_untouched().await;
}

#[tokio::test]
async fn every_error_is_described_in_the_same_way() {
    let daemon = Daemon::start(false).await;
    let json = [("content-type", "application/json")];
    let sweep = r#"{"min_hz": 120, "max_hz": 165}"#;
    let check = async |method: &str, path: &str, headers: &[_], body: &str, status: u16, title| {
        let status = StatusCode::from_u16(status).unwrap();
        daemon.refused(method, path, headers, body.to_owned(), (status, title)).await
    };
    check("GET", "/nothing", &[], "", 404, "not found").await;
    check("GET", "/api/v1/runs/zzz", &[], "", 404, "not found").await;
    check("GET", "/api/v1/runs/%ff", &[], "", 400, "bad request").await;
    check("GET", "/api/v1/runs/x/export?format=pdf", &[], "", 404, "not found").await;
    let put = check("PUT", "/api/v1/rig", &[], "", 405, "method not allowed").await;
    assert_eq!(put.headers()["allow"], "GET,HEAD");
    let types = [None, Some("text/plain"), Some("application/xml"), Some("application/jsonp")];
    for content_type in types {
        let headers: Vec<_> =
            content_type.map(|value| ("content-type", value)).into_iter().collect();
        for (path, body) in [("/api/v1/sweeps", sweep), ("/api/v1/runs", "name = 'x'")] {
            check("POST", path, &headers, body, 415, "unsupported media type").await;
        }
    }
    let toml = [("content-type", "application/toml")];
    check("POST", "/api/v1/sweeps", &toml, sweep, 415, "unsupported media type").await;
    check("POST", "/api/v1/sweeps", &json, "{", 400, "bad request").await;
    check("POST", "/api/v1/sweeps", &json, r#"{"min": 1}"#, 422, "cannot be done").await;
    check("POST", "/api/v1/runs", &toml, "name = 1", 422, "cannot be done").await;
    let large = " ".repeat((256 << 10) + 1);
    for path in ["/api/v1/runs", "/api/v1/sweeps", "/api/v1/moves", "/nothing"] {
        check("POST", path, &json, &large, 413, "content too large").await;
        let chunks =
            large.as_bytes().chunks(1 << 10).map(|chunk| Ok::<_, std::io::Error>(chunk.to_vec()));
        let chunks = futures_util::stream::iter(chunks.collect::<Vec<_>>());
        let expected = (StatusCode::PAYLOAD_TOO_LARGE, "content too large");
        daemon.refused("POST", path, &json, Body::from_stream(chunks), expected).await;
    }
    daemon.is_untouched().await;
}

#[tokio::test]
async fn without_the_token_nobody_comes_in() {
    const UNAUTHORIZED: (StatusCode, &str) = (StatusCode::UNAUTHORIZED, "unauthorized");
    let mut daemon = Daemon::start(true).await;
    let values = [
        "Bearer 0123456789abcdeg",
        "Bearer 0123456789abcde",
        "Bearer ",
        "Bearer",
        "Basic 0123456789abcdef",
        "0123456789abcdef",
        "Bearer 0123456789abcdef0",
        "",
    ];
    for (method, path) in REQUESTS {
        let answer = daemon.refused(method, path, &[], "", UNAUTHORIZED).await;
        assert_eq!(answer.headers()["www-authenticate"], "Bearer realm=\"rigd\"");
        for value in values {
            daemon.refused(method, path, &[("authorization", value)], "", UNAUTHORIZED).await;
        }
        // More wrong tokens are refused in another way.
        daemon = Daemon::start(true).await;
    }
    for scheme in ["Bearer", "bearer", "BEARER "] {
        let value = format!("{scheme} {SECRET}");
        let answer = daemon.send("GET", "/api/v1/rig", &[("authorization", &value)], "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{value}");
    }
    // The files of the page tell nothing of the rig, and ask for the token.
    for path in ["/", "/page.js", "/page.css", "/icon.svg"] {
        let answer = daemon.send("GET", path, &[("accept", "text/html")], "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
    }
    // The token opens no door to a page of another site.
    let value = format!("Bearer {SECRET}");
    let evil = [("authorization", value.as_str()), ("host", "evil.example")];
    let expected = (StatusCode::MISDIRECTED_REQUEST, "misdirected request");
    daemon.refused("GET", "/api/v1/rig", &evil, "", expected).await;
}

#[tokio::test]
async fn event_streams_are_bounded_and_make_room_again() {
    let daemon = Daemon::start(false).await;
    // As many as the handles of this program leave room for.
    let handles = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    let most = usize::try_from(handles.saturating_sub(384).min(1024)).unwrap();
    let mut streams = Vec::new();
    let refused = loop {
        let answer = daemon.send("GET", "/api/v1/events", &[], "").await;
        if answer.status() != StatusCode::OK {
            break answer;
        }
        streams.push(answer);
        assert!(streams.len() <= most);
    };
    assert_eq!((refused.status(), streams.len()), (StatusCode::SERVICE_UNAVAILABLE, most));
    assert_eq!(refused.headers()["content-type"], "application/problem+json");
    assert_eq!(refused.headers()["retry-after"], "5");
    // One that could not begin has taken no place.
    let bad = [("last-event-id", "yesterday")];
    streams.pop();
    let expected = (StatusCode::BAD_REQUEST, "bad request");
    daemon.refused("GET", "/api/v1/events", &bad, "", expected).await;
    let answer = daemon.send("GET", "/api/v1/events", &[], "").await;
    assert_eq!(answer.status(), StatusCode::OK);
}

#[tokio::test]
async fn the_address_of_the_daemon_says_where_to_go() {
    let daemon = Daemon::start(false).await;
    let text = async |path: &str, accept: &str| {
        let answer = daemon.send("GET", path, &[("accept", accept)], "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
        assert_eq!(answer.headers()["x-content-type-options"], "nosniff");
        String::from_utf8(to_bytes(answer.into_body(), usize::MAX).await.unwrap().to_vec()).unwrap()
    };
    let page = text("/", "text/html,application/xhtml+xml,*/*;q=0.8").await;
    assert!(page.starts_with("<!doctype html>") && page.contains("src=\"/page.js\""), "{page}");
    let index: Value = serde_json::from_str(&text("/", "*/*").await).unwrap();
    let same: Value = serde_json::from_str(&text("/api/v1/", "*/*").await).unwrap();
    assert_eq!((&index["links"], &index["rig"]["state"]), (&same["links"], &same["rig"]["state"]));
    for link in index["links"].as_array().unwrap() {
        let path = link["href"].as_str().unwrap();
        let answer = daemon.send("GET", path, &[], "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
    }
    assert!(text("/docs/http", "*/*").await.contains("/api/v1/runs"));
}
