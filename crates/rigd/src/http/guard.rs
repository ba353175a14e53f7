//! The checks before every handler, and the form of every error.
//!
//! | check | otherwise |
//! |---|---|
//! | one `Host`, and a name of this daemon | 400, 421 |
//! | no `Origin` but our own; `Sec-Fetch-Site` says nothing of another site | 403 |
//! | the token, if one is set; not too many wrong ones | 401, 429 |
//! | the role of the client allows it | 403 |
//! | a connection of its own, or a stop | 503 |
//! | a name that the journal takes, or none | 400 |
//! | a body of JSON or TOML, small, and in time | 415, 413, 408 |
//! | a command: nobody else has the lease | 409 |
//! | with `If-Match`, the rig as the client saw it | 412 |
//!
//! A page of another site can make a browser send requests here. It cannot give them our name as
//! host, and it cannot hide where they come from.

use std::net::IpAddr;

use axum::{
    body::{Body, HttpBody, to_bytes},
    extract::{Request, State},
    http::{
        HeaderMap, HeaderValue, Method, Uri, header,
        uri::{Authority, Scheme},
    },
    middleware::Next,
    response::{IntoResponse, Response},
};
use http_body_util::{BodyExt, LengthLimitError, Limited};

use super::{
    Problem, Shared,
    access::{Access, Client, HostName, role_for},
    lease,
    limits::{BODY_MAX, BODY_TIME},
    page,
    problem::PROBLEM_JSON,
    tag,
};
use crate::operator::Operator;

/// The media types of a body.
const BODY_TYPES: [&str; 3] = ["application/json", "application/toml", "text/x-toml"];

/// Facts about the connection of a request.
#[derive(Debug, Clone, Copy)]
pub(super) struct Connection {
    /// The address on which it arrived.
    pub(super) arrived_at: Option<IpAddr>,
    /// The address from which it came.
    pub(super) peer: Option<IpAddr>,
    pub(super) is_tls: bool,
    /// Whether it is one of the few that are kept for a stop while all others are taken.
    pub(super) is_spare: bool,
}

/// How a client has called the daemon.
#[derive(Debug, Clone)]
pub(super) struct Called {
    pub(super) host: Authority,
    pub(super) is_tls: bool,
    pub(super) peer: Option<IpAddr>,
}

/// What a page of another site is told.
pub(crate) const FOREIGN_PAGE: &str = "the request comes from a page of another site";

/// Lets a request pass to its handler, or answers it.
pub(super) async fn check(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    let admitted = admit(&shared, request).await.and_then(|request| {
        let status = shared.inner.rig.status();
        tag::check(request.method(), request.uri().path(), request.headers(), &status.borrow())?;
        Ok(request)
    });
    let answer = match admitted {
        Ok(request) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    let mut answer = described(answer).await;
    let headers = answer.headers_mut();
    for (name, value) in HEADERS {
        // The page has a policy of its own.
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
    answer
}

/// Content policy of answers: a browser may only show them.
const HEADERS: [(header::HeaderName, &str); 6] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'",
    ),
    (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (header::HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (header::CACHE_CONTROL, "no-store"),
];

async fn admit(shared: &Shared, mut request: Request) -> Result<Request, Problem> {
    let access = &shared.inner.access;
    let connection = request.extensions().get::<Connection>().copied();
    let headers = request.headers();
    let host = host(headers, request.uri())?;
    let arrived_at = connection.and_then(|connection| connection.arrived_at);
    if !access.knows(&HostName::of_authority(&host), arrived_at) {
        return Err(Problem::misdirected(format!("{host} is not a name of this daemon")));
    }
    if let Some(from) = elsewhere(headers, &host) {
        return Err(Problem::forbidden(format!("{FOREIGN_PAGE}: {from}")));
    }
    let (method, path) = (request.method(), request.uri().path());
    let peer = connection.and_then(|connection| connection.peer);
    let is_tls = connection.is_some_and(|connection| connection.is_tls);
    let is_stop = *method == Method::POST && path == "/api/v1/stop";
    let named = operator(headers, access);
    if !page::is_public(method, path, headers) {
        let client = access.client(headers, &host, peer)?;
        check_cookie(method, headers)?;
        let needed = role_for(method, path);
        if client.role < needed {
            return Err(Problem::not_allowed(client.role, needed));
        }
        // A stop needs neither a name nor a body.
        let name = match named.as_ref() {
            Err(_) if is_stop => Some(access.operator()),
            named => named.ok(),
        };
        let client = match name {
            Some(name) => client.named(name.clone()),
            None => client,
        };
        request.extensions_mut().insert(client.name.clone());
        request.extensions_mut().insert(client);
    }
    request.extensions_mut().insert(Called { host, is_tls, peer });
    if is_stop {
        return Ok(request);
    }
    if connection.is_some_and(|connection| connection.is_spare) {
        return Err(Problem::busy("all connections are in use".to_owned()));
    }
    named?;
    let (parts, body) = request.into_parts();
    let body = read(&parts.headers, body).await?;
    if let Some(client) = parts.extensions.get::<Client>() {
        // While the body came, its token may have been revoked, and another client may have taken the lease over.
        access.kept(client.clone())?;
        if lease::needs_lease(&parts.method, parts.uri.path()) {
            shared.check_lease(client)?;
        }
    }
    Ok(Request::from_parts(parts, body))
}

/// Browsers say where a command comes from. A cookie without that counts for reading only.
fn check_cookie(method: &Method, headers: &HeaderMap) -> Result<(), Problem> {
    let is_by_cookie =
        headers.contains_key(header::COOKIE) && !headers.contains_key(header::AUTHORIZATION);
    let has_source = headers.contains_key(header::ORIGIN) || headers.contains_key("sec-fetch-site");
    if is_by_cookie && !has_source && *method != Method::GET {
        let what = "a command with a cookie must have the header Origin; send a token instead";
        return Err(Problem::forbidden(what.to_owned()));
    }
    Ok(())
}

/// The host in the request.
fn host(headers: &HeaderMap, uri: &Uri) -> Result<Authority, Problem> {
    let mut hosts = headers.get_all(header::HOST).iter();
    let (Some(host), None) = (hosts.next(), hosts.next()) else {
        return Err(Problem::bad_request("a request must have exactly one Host".to_owned()));
    };
    let host: Option<Authority> = host.to_str().ok().and_then(|host| host.parse().ok());
    match host {
        // A URI can have a user name before the host; it is refused.
        Some(host) if !host.as_str().contains('@') => {
            // A host in the request line takes precedence over the header.
            Ok(uri.authority().cloned().unwrap_or(host))
        }
        _ => Err(Problem::bad_request("the header Host is not a host name".to_owned())),
    }
}

/// The other site that had a browser send this, when one did.
fn elsewhere(headers: &HeaderMap, host: &Authority) -> Option<String> {
    let text = |value: &HeaderValue| value.to_str().unwrap_or("unreadable").to_owned();
    let origins = headers.get_all(header::ORIGIN).iter().map(text);
    if let Some(origin) = origins.into_iter().find(|origin| !is_same_origin(origin, host)) {
        return Some(format!("Origin: {origin}"));
    }
    let sites = headers.get_all("sec-fetch-site").iter().map(text);
    let other = sites.into_iter().find(|site| site != "same-origin" && site != "none")?;
    Some(format!("Sec-Fetch-Site: {other}"))
}

/// Whether an origin is the address of the request. A proxy before the daemon may use TLS.
fn is_same_origin(origin: &str, host: &Authority) -> bool {
    let Ok(origin) = origin.parse::<Uri>() else { return false };
    let default_port = match origin.scheme() {
        Some(scheme) if *scheme == Scheme::HTTP => 80,
        Some(scheme) if *scheme == Scheme::HTTPS => 443,
        _ => return false,
    };
    let place = |authority: &Authority| {
        (HostName::of_authority(authority), authority.port_u16().unwrap_or(default_port))
    };
    origin.authority().is_some_and(|origin| place(origin) == place(host))
}

fn operator(headers: &HeaderMap, access: &Access) -> Result<Operator, Problem> {
    let Some(name) = headers.get("x-operator") else { return Ok(access.operator().clone()) };
    let name = std::str::from_utf8(name.as_bytes()).unwrap_or_default();
    name.parse().map_err(|error| Problem::bad_request(format!("X-Operator: {error}")))
}

/// The whole body, so that no handler waits for a client.
async fn read(headers: &HeaderMap, body: Body) -> Result<Body, Problem> {
    let least = body.size_hint().lower();
    if least > BODY_MAX as u64 {
        return Err(Problem::too_large());
    }
    let content_type = headers.get(header::CONTENT_TYPE).map(HeaderValue::to_str);
    let essence = content_type.and_then(Result::ok).and_then(|value| value.split(';').next());
    let is_readable =
        essence.is_some_and(|essence| BODY_TYPES.contains(&essence.trim().to_lowercase().as_str()));
    let refusal = || {
        Problem::unsupported_media_type(format!(
            "the body must be application/json or application/toml, not {}",
            essence.unwrap_or("nothing named")
        ))
    };
    if least > 0 && !is_readable {
        return Err(refusal());
    }
    match tokio::time::timeout(BODY_TIME, Limited::new(body, BODY_MAX).collect()).await {
        Ok(Ok(body)) => {
            let bytes = body.to_bytes();
            if bytes.is_empty() || is_readable { Ok(Body::from(bytes)) } else { Err(refusal()) }
        }
        Ok(Err(error)) if error.is::<LengthLimitError>() => Err(Problem::too_large()),
        Ok(Err(error)) => Err(Problem::bad_request(format!("the body cannot be read: {error}"))),
        Err(_) => Err(Problem::too_slow()),
    }
}

/// Turns every error answer into a problem document, whichever layer made it.
async fn described(answer: Response) -> Response {
    let status = answer.status();
    let is_error = status.is_client_error() || status.is_server_error();
    let content_type = answer.headers().get(header::CONTENT_TYPE);
    if !is_error || content_type.is_some_and(|value| value == PROBLEM_JSON) {
        return answer;
    }
    let (parts, body) = answer.into_parts();
    let text = to_bytes(body, DETAIL_MAX).await.unwrap_or_default();
    let detail = String::from_utf8_lossy(&text).into_owned();
    let mut answer = Problem::of(status, detail).into_response();
    // Such as `Allow`, which belongs to a 405.
    for (name, value) in &parts.headers {
        if name != header::CONTENT_TYPE && name != header::CONTENT_LENGTH {
            answer.headers_mut().insert(name, value.clone());
        }
    }
    answer
}

/// More than any sentence of the HTTP library has.
const DETAIL_MAX: usize = 4096;

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use axum::http::StatusCode;
    use futures_util::stream;

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_body_that_does_not_come_is_not_waited_for() {
        let mut headers = HeaderMap::new();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/json"));
        let began = tokio::time::Instant::now();
        let drip = stream::unfold((), async |()| {
            tokio::time::sleep(Duration::from_secs(1)).await;
            Some((Ok::<_, std::convert::Infallible>("x"), ()))
        });
        let refusal = read(&headers, Body::from_stream(drip)).await.unwrap_err();
        assert_eq!(refusal.into_response().status(), StatusCode::REQUEST_TIMEOUT);
        assert_eq!(began.elapsed(), BODY_TIME);
    }
}
