//! Browsers: a token, or a link that works once, becomes a cookie that scripts of the page cannot read.

use std::{
    collections::BTreeMap,
    io,
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use axum::{
    Extension, Json,
    extract::{Path, State},
    http::{HeaderMap, HeaderValue, StatusCode, header, uri::Authority},
    response::{IntoResponse, Response},
};
use schemars::JsonSchema;
use serde::Serialize;
use tokio::time::Instant;

use super::{Problem, Shared, access::Client, guard::Called};
use crate::tokens::{Role, Secret, fingerprint};

/// A working day.
const SESSION_TIME: Duration = Duration::from_secs(12 * 3600);
/// Time for a person to open the link.
const LINK_TIME: Duration = Duration::from_secs(300);
/// Beyond these the oldest one ends; first of all of one client, so that none ends those of the others.
const SESSIONS: Bounds = Bounds { of_a_client: 32, of_all: 256 };
const LINKS: Bounds = Bounds { of_a_client: 4, of_all: 64 };

/// How many entries are kept.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    of_a_client: usize,
    of_all: usize,
}

/// The clients with a cookie, and the links that have not been opened, by fingerprint.
#[derive(Debug, Default)]
pub(super) struct Sessions {
    sessions: Mutex<Entries>,
    links: Mutex<Entries>,
}

type Entries = BTreeMap<String, (Client, Instant)>;

impl Sessions {
    /// The client to whom this cookie was given.
    pub(super) fn find(&self, secret: &str) -> Option<Client> {
        live(&self.sessions).get(&fingerprint(secret)).map(|(client, _)| client.clone())
    }

    fn begin(&self, client: Client) -> io::Result<Secret> {
        keep(&self.sessions, client, SESSION_TIME, SESSIONS)
    }

    fn link(&self, client: Client) -> io::Result<Secret> {
        keep(&self.links, client, LINK_TIME, LINKS)
    }

    fn open(&self, secret: &str) -> Option<Client> {
        live(&self.links).remove(&fingerprint(secret)).map(|(client, _)| client)
    }

    /// Ends the cookies and the links of clients without a token of their own.
    pub(super) fn end_nameless(&self) {
        for entries in [&self.sessions, &self.links] {
            live(entries).retain(|_, (client, _)| client.is_named());
        }
    }

    fn end(&self, secret: &str) {
        live(&self.sessions).remove(&fingerprint(secret));
    }
}

/// The entries whose time is not over.
fn live(entries: &Mutex<Entries>) -> MutexGuard<'_, Entries> {
    // Nothing that holds it panics.
    let mut entries = entries.lock().unwrap_or_else(PoisonError::into_inner);
    let now = Instant::now();
    entries.retain(|_, (_, until)| *until > now);
    entries
}

fn keep(
    entries: &Mutex<Entries>,
    client: Client,
    time: Duration,
    bounds: Bounds,
) -> io::Result<Secret> {
    let secret = Secret::new()?;
    let mut entries = live(entries);
    remove_beyond(&mut entries, bounds.of_a_client, |other| other.has_token_of(&client));
    remove_beyond(&mut entries, bounds.of_all, |_| true);
    entries.insert(fingerprint(secret.reveal()), (client, Instant::now() + time));
    Ok(secret)
}

/// Removes the oldest of these entries until there is room for one more.
fn remove_beyond(entries: &mut Entries, most: usize, is_one: impl Fn(&Client) -> bool) {
    let mut ends: Vec<_> = entries
        .iter()
        .filter(|(_, (client, _))| is_one(client))
        .map(|(key, (_, until))| (*until, key.clone()))
        .collect();
    ends.sort();
    let beyond = (ends.len() + 1).saturating_sub(most);
    for (_, key) in ends.into_iter().take(beyond) {
        entries.remove(&key);
    }
}

/// Name of the cookie. Browsers send cookies to every port of a host, where another daemon may be.
fn cookie_name(host: &Authority) -> String {
    format!("rigd_{}", host.port_u16().unwrap_or_default())
}

/// The cookie of a request.
pub(super) fn cookie<'a>(headers: &'a HeaderMap, host: &Authority) -> Option<&'a str> {
    let name = cookie_name(host);
    let values = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs =
        values.flat_map(|value| value.split(';')).filter_map(|pair| pair.split_once('='));
    pairs.find_map(|(key, value)| (key.trim() == name).then(|| value.trim()))
}

fn set_cookie(called: &Called, value: &str, time: Duration) -> Result<HeaderValue, Problem> {
    let (name, seconds) = (cookie_name(&called.host), time.as_secs());
    let secure = if called.is_tls { "; Secure" } else { "" };
    let text =
        format!("{name}={value}; Path=/; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}");
    HeaderValue::from_str(&text).map_err(|_| Problem::internal("the cookie cannot be made"))
}

fn no_random(error: &io::Error) -> Problem {
    Problem::internal(&format!("the system gives no random number: {error}"))
}

/// The client, as the daemon knows it.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct ClientView {
    /// Name in the journal.
    name: String,
    role: Role,
    /// Whether clients of this daemon must have a token.
    has_token: bool,
}

impl From<&Client> for ClientView {
    fn from(client: &Client) -> Self {
        Self { name: client.name.to_string(), role: client.role, has_token: client.has_token }
    }
}

pub(super) async fn show(Extension(client): Extension<Client>) -> Json<ClientView> {
    Json((&client).into())
}

/// Gives a browser a cookie for the token that it has sent.
pub(super) async fn begin(
    State(shared): State<Shared>,
    Extension(client): Extension<Client>,
    Extension(called): Extension<Called>,
) -> Result<Response, Problem> {
    let view = ClientView::from(&client);
    let secret = shared.inner.access.sessions.begin(client).map_err(|error| no_random(&error))?;
    let cookie = set_cookie(&called, secret.reveal(), SESSION_TIME)?;
    Ok(([(header::SET_COOKIE, cookie)], Json(view)).into_response())
}

/// Ends the cookie.
pub(super) async fn end(
    State(shared): State<Shared>,
    Extension(called): Extension<Called>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    if let Some(secret) = cookie(&headers, &called.host) {
        shared.inner.access.sessions.end(secret);
    }
    let cookie = set_cookie(&called, "", Duration::ZERO)?;
    Ok((StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response())
}

/// A link for a browser.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LinkView {
    /// Path of the link below the address of the daemon. It works once.
    path: String,
    /// For how long it works, s.
    valid_s: u64,
}

/// Makes a link that gives a browser what the client may do.
pub(super) async fn link(
    State(shared): State<Shared>,
    Extension(client): Extension<Client>,
) -> Result<Json<LinkView>, Problem> {
    let secret = shared.inner.access.sessions.link(client).map_err(|error| no_random(&error))?;
    let path = format!("/open/{}", secret.reveal());
    Ok(Json(LinkView { path, valid_s: LINK_TIME.as_secs() }))
}

/// Opens a link: the browser gets a cookie and goes to the page.
pub(super) async fn open(
    State(shared): State<Shared>,
    Extension(called): Extension<Called>,
    Path(secret): Path<String>,
) -> Result<Response, Problem> {
    let access = &shared.inner.access;
    let Some(client) = access.sessions.open(&secret) else {
        access.guesses.was_wrong(called.peer);
        return Err(Problem::link_is_over());
    };
    let secret = access.sessions.begin(access.kept(client)?).map_err(|error| no_random(&error))?;
    let cookie = set_cookie(&called, secret.reveal(), SESSION_TIME)?;
    let to_page = [(header::LOCATION, HeaderValue::from_static("/")), (header::SET_COOKIE, cookie)];
    Ok((StatusCode::SEE_OTHER, to_page).into_response())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client() -> Client {
        Client::of("ada".parse().unwrap(), Role::View, None)
    }

    #[tokio::test(start_paused = true)]
    async fn a_link_works_once_and_not_for_long_and_a_cookie_for_a_day() {
        let sessions = Sessions::default();
        let link = sessions.link(client()).unwrap();
        assert_eq!(sessions.open(link.reveal()).unwrap().role, Role::View);
        assert!(sessions.open(link.reveal()).is_none());
        let late = sessions.link(client()).unwrap();
        let cookie = sessions.begin(client()).unwrap();
        assert!(sessions.find(late.reveal()).is_none() && sessions.open(cookie.reveal()).is_none());
        tokio::time::advance(LINK_TIME).await;
        assert!(sessions.open(late.reveal()).is_none());
        assert!(sessions.find(cookie.reveal()).is_some());
        tokio::time::advance(SESSION_TIME).await;
        assert!(sessions.find(cookie.reveal()).is_none());
    }

    #[tokio::test(start_paused = true)]
    async fn links_and_cookies_are_bounded_and_nobody_ends_those_of_another() {
        let sessions = Sessions::default();
        let of = |name: &str| Client::of(name.parse().unwrap(), Role::View, Some(name.to_owned()));
        let (other, link) = (sessions.begin(of("eve")).unwrap(), sessions.link(of("eve")).unwrap());
        let first = sessions.begin(of("ada")).unwrap();
        tokio::time::advance(Duration::from_secs(1)).await;
        for _ in 0..SESSIONS.of_all {
            sessions.begin(of("ada")).unwrap();
            sessions.link(of("ada")).unwrap();
        }
        assert!(sessions.find(first.reveal()).is_none());
        assert_eq!(live(&sessions.sessions).len(), SESSIONS.of_a_client + 1);
        assert_eq!(live(&sessions.links).len(), LINKS.of_a_client + 1);
        assert!(sessions.find(other.reveal()).is_some() && sessions.open(link.reveal()).is_some());
        for number in 0..SESSIONS.of_all {
            sessions.begin(of(&format!("client {number}"))).unwrap();
        }
        assert_eq!(live(&sessions.sessions).len(), SESSIONS.of_all);
        assert!(sessions.find(other.reveal()).is_none());
    }

    #[test]
    fn the_cookie_of_another_daemon_on_this_host_is_not_taken() {
        let mut headers = HeaderMap::new();
        headers.insert(header::COOKIE, HeaderValue::from_static("a=b; rigd_8137=x; rigd_9=y"));
        let of = |host: &'static str| cookie(&headers, &Authority::from_static(host));
        assert_eq!((of("localhost:8137"), of("localhost:9")), (Some("x"), Some("y")));
        assert_eq!((of("localhost"), of("localhost:8")), (None, None));
    }
}
