//! The page at `/`: its files are inside the program, so that it asks no other host for anything.
//!
//! They are built from `crates/rigd/page` by its `build.sh`.

use std::sync::LazyLock;

use axum::{
    Router,
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
    response::{IntoResponse, Response},
    routing::get,
};

use super::{Shared, tag};

/// A file of the page.
struct File {
    path: &'static str,
    content_type: &'static str,
    bytes: &'static [u8],
}

const FILES: [File; 4] = [
    File {
        path: "/",
        content_type: "text/html; charset=utf-8",
        bytes: include_bytes!("../../page/dist/index.html"),
    },
    File {
        path: "/page.js",
        content_type: "text/javascript; charset=utf-8",
        bytes: include_bytes!("../../page/dist/page.js"),
    },
    File {
        path: "/page.css",
        content_type: "text/css; charset=utf-8",
        bytes: include_bytes!("../../page/dist/page.css"),
    },
    File {
        path: "/icon.svg",
        content_type: "image/svg+xml",
        bytes: include_bytes!("../../page/dist/icon.svg"),
    },
];

/// The content security policy: the page uses its own files and calls this daemon only.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; \
    frame-ancestors 'none'";

/// Tells one build of the page from another, by all of its files.
static TAG: LazyLock<String> =
    LazyLock::new(|| tag::of(FILES.iter().flat_map(|file| file.bytes.iter().copied())));

/// Whether a client is a browser that is to show a page.
pub(super) fn is_wanted(headers: &HeaderMap) -> bool {
    let accept = headers.get(header::ACCEPT).and_then(|accept| accept.to_str().ok());
    accept.is_some_and(|accept| accept.contains("text/html"))
}

/// Whether a request needs no token: the files of the page, which contain nothing about the rig, a link that is
/// a secret itself, and the health of the service.
pub(super) fn is_public(method: &Method, path: &str, headers: &HeaderMap) -> bool {
    let is_file = FILES.iter().any(|file| file.path == path);
    let is_page = is_file && (path != "/" || is_wanted(headers));
    *method == Method::GET
        && (is_page || path.starts_with("/open/") || matches!(path, "/healthz" | "/readyz"))
}

/// The page at `/` for a browser.
pub(super) fn start(headers: &HeaderMap) -> Response {
    serve(&FILES[0], headers)
}

/// The routes of its other files.
pub(super) fn routes() -> Router<Shared> {
    FILES.iter().skip(1).fold(Router::new(), |router, file| {
        router.route(file.path, get(async move |headers: HeaderMap| serve(file, &headers)))
    })
}

fn serve(file: &File, headers: &HeaderMap) -> Response {
    let tag: &str = &TAG;
    let fixed = [
        (header::CONTENT_TYPE, file.content_type),
        (header::CACHE_CONTROL, "no-cache"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ];
    let status = tag::status(headers, tag);
    let body = if status == StatusCode::OK { file.bytes } else { &[] };
    let mut response = (status, fixed, body).into_response();
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}
