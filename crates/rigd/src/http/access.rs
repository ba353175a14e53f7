//! Access to the daemon: its host names, the tokens of the clients, and the operator of requests
//! without one.
//!
//! A client has the token of a person or program (`tokens.json`), the secret in the file of
//! `--token-file`, the secret that a daemon makes for commands on its own computer, or the cookie of a
//! browser that had one of them.

use std::{
    collections::BTreeSet,
    fmt,
    net::IpAddr,
    str::FromStr,
    sync::{PoisonError, RwLock, RwLockReadGuard},
};

use axum::http::{HeaderMap, Method, header, uri::Authority};

pub use super::token_file::{Token, TokenError};
use super::{
    Problem,
    guesses::Guesses,
    session::{self, Sessions},
};
use crate::{
    operator::Operator,
    tokens::{Role, Secret, Tokens, fingerprint},
};

/// The rules of access.
#[derive(Debug)]
pub struct Access {
    rules: RwLock<Rules>,
    listen: IpAddr,
    tokens: Option<Tokens>,
    /// Of the secret for commands on this computer.
    local: Option<String>,
    /// Whether other computers can reach the daemon.
    is_shared: bool,
    operator: Operator,
    pub(super) sessions: Sessions,
    pub(super) guesses: Guesses,
}

/// What a reload of the configuration can change.
#[derive(Debug)]
struct Rules {
    hosts: BTreeSet<HostName>,
    /// The secret for everybody.
    token: Option<Token>,
}

impl Rules {
    fn new(
        listen: IpAddr,
        allowed: impl IntoIterator<Item = HostName>,
        token: Option<Token>,
    ) -> Self {
        let loopback = ["localhost", "127.0.0.1", "::1"].map(HostName::of).into_iter();
        let hosts = loopback.chain([HostName::of_address(listen)]).chain(allowed).collect();
        Self { hosts, token }
    }
}

/// A client that may come in.
#[derive(Debug, Clone)]
pub(super) struct Client {
    /// Name in the journal.
    pub(super) name: Operator,
    pub(super) role: Role,
    /// Whether it had to have a token.
    pub(super) has_token: bool,
    /// Fingerprint of its named token; the name and the role are those of the token.
    token: Option<String>,
}

impl Client {
    /// A client with a token of this name, or with a secret without a name.
    pub(super) const fn of(name: Operator, role: Role, token: Option<String>) -> Self {
        Self { name, role, has_token: true, token }
    }

    /// Whether its token has a name, so that the name is not only claimed.
    pub(super) const fn is_named(&self) -> bool {
        self.token.is_some()
    }

    /// Fingerprint of its named token.
    pub(super) fn token(&self) -> Option<&str> {
        self.token.as_deref()
    }

    /// Whether both have the same named token, or neither has one.
    pub(super) fn has_token_of(&self, other: &Self) -> bool {
        self.token == other.token
    }

    /// A client without a named token has the name that it gives.
    pub(super) fn named(self, name: Operator) -> Self {
        if self.token.is_some() { self } else { Self { name, ..self } }
    }
}

/// The request to read the configuration again.
pub(super) const RELOAD: &str = "/api/v1/config/reload";

/// The role that a request needs. What is not known to be harmless leads the rig.
pub(super) fn role_for(method: &Method, path: &str) -> Role {
    /// They move nothing, and stopping must be possible for everybody.
    const HARMLESS: [&str; 4] =
        ["/api/v1/stop", "/api/v1/protocols/check", "/api/v1/session", "/api/v1/links"];
    let is_read = matches!(*method, Method::GET | Method::HEAD);
    if is_read || HARMLESS.contains(&path) {
        Role::View
    } else if path == RELOAD {
        Role::Admin
    } else {
        Role::Operate
    }
}

impl Access {
    /// Admits requests to a loopback name, to the address on which the daemon listens or to one of
    /// the names `allowed`, with the token, if there is one. Requests without an operator get
    /// `operator`.
    pub fn new(
        listen: IpAddr,
        allowed: impl IntoIterator<Item = HostName>,
        token: Option<Token>,
        operator: Operator,
    ) -> Self {
        Self {
            rules: RwLock::new(Rules::new(listen, allowed, token)),
            listen,
            tokens: None,
            local: None,
            is_shared: !listen.to_canonical().is_loopback(),
            operator,
            sessions: Sessions::default(),
            guesses: Guesses::default(),
        }
    }

    /// Also admits the tokens of persons and programs, and the secret of this computer.
    pub fn with_tokens(self, tokens: Tokens, local: &Secret) -> Self {
        Self { tokens: Some(tokens), local: Some(fingerprint(local.reveal())), ..self }
    }

    /// Whether this is the secret for everybody.
    pub(crate) fn has_token(&self, token: Option<&Token>) -> bool {
        match (&self.rules().token, token) {
            (None, None) => true,
            (Some(old), Some(new)) => old.is(new.reveal()),
            _ => false,
        }
    }

    /// Whether other computers could lead the rig without a token, if this were the secret for everybody.
    pub(crate) fn is_open_with(&self, token: Option<&Token>) -> bool {
        let has_tokens = self.tokens.as_ref().is_some_and(Tokens::is_in_use);
        self.is_shared && token.is_none() && !has_tokens
    }

    /// Changes the names and the secret for everybody. With another secret, browsers that came in without a
    /// token of their own must come in again.
    pub(crate) fn change(&self, allowed: impl IntoIterator<Item = HostName>, token: Option<Token>) {
        if !self.has_token(token.as_ref()) {
            self.sessions.end_nameless();
        }
        let rules = Rules::new(self.listen, allowed, token);
        *self.rules.write().unwrap_or_else(PoisonError::into_inner) = rules;
    }

    /// Nothing that holds them panics.
    fn rules(&self) -> RwLockReadGuard<'_, Rules> {
        self.rules.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the times at which tokens were last used, if there is news.
    pub fn keep_uses(&self) {
        if let Some(tokens) = &self.tokens {
            tokens.keep_uses();
        }
    }

    /// Whether a client may call the daemon by this name. An address is always right when it is the
    /// one on which the connection arrived: no page of another site is loaded from there.
    pub(super) fn knows(&self, host: &HostName, arrived_at: Option<IpAddr>) -> bool {
        let is_here = arrived_at.is_some_and(|address| HostName::of_address(address) == *host);
        is_here || self.rules().hosts.contains(host)
    }

    /// Whether clients must have a token.
    fn needs_token(&self) -> bool {
        self.is_shared
            || self.rules().token.is_some()
            || self.tokens.as_ref().is_some_and(Tokens::is_in_use)
    }

    /// The client of a request to `host`, from the address `peer`. Its name is still that of the daemon's
    /// operator, unless its token has a name.
    pub(super) fn client(
        &self,
        headers: &HeaderMap,
        host: &Authority,
        peer: Option<IpAddr>,
    ) -> Result<Client, Problem> {
        let nameless = Client::of(self.operator.clone(), Role::Admin, None);
        if !self.needs_token() {
            return Ok(Client { has_token: false, ..nameless });
        }
        if let Some(given) = headers.get(header::AUTHORIZATION) {
            let given = given.to_str().ok().and_then(|given| given.split_once(' '));
            let bearer = given.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"));
            let Some((_, given)) = bearer else { return Err(self.wrong(peer)) };
            return self.of_token(given.trim_start(), nameless, peer);
        }
        let cookie = session::cookie(headers, host).and_then(|secret| self.sessions.find(secret));
        match cookie {
            Some(client) => self.kept(client),
            None => Err(Problem::unauthorized("this daemon requires a token".to_owned())),
        }
    }

    /// The client to whom a cookie or a link was given, as it is now.
    ///
    /// # Errors
    /// 401: its token has been revoked since, or it had none and needs one now.
    pub(super) fn kept(&self, client: Client) -> Result<Client, Problem> {
        match &client.token {
            Some(token) => self.of_fingerprint(token).ok_or_else(Problem::session_is_over),
            None if client.has_token || !self.needs_token() => Ok(client),
            None => {
                let detail = "this browser came in before the daemon required a token";
                Err(Problem::unauthorized(detail.to_owned()))
            }
        }
    }

    fn of_token(
        &self,
        given: &str,
        nameless: Client,
        peer: Option<IpAddr>,
    ) -> Result<Client, Problem> {
        let fingerprint = fingerprint(given);
        if let Some(client) = self.of_fingerprint(&fingerprint) {
            return Ok(client);
        }
        if self.local.as_deref() == Some(&fingerprint) {
            return Ok(nameless);
        }
        let rules = self.rules();
        let Some(token) = &rules.token else { return Err(self.wrong(peer)) };
        if !self.guesses.may_try(peer) {
            return Err(Problem::too_many_guesses());
        }
        if !token.is(given) {
            return Err(self.wrong(peer));
        }
        self.guesses.was_right(peer);
        Ok(nameless)
    }

    fn of_fingerprint(&self, fingerprint: &str) -> Option<Client> {
        let (name, role) = self.tokens.as_ref()?.find(fingerprint)?;
        Some(Client::of(name, role, Some(fingerprint.to_owned())))
    }

    fn wrong(&self, peer: Option<IpAddr>) -> Problem {
        if self.guesses.was_wrong(peer) {
            Problem::unauthorized("the token is wrong".to_owned())
        } else {
            tracing::warn!(?peer, "an address has sent too many wrong tokens");
            Problem::too_many_guesses()
        }
    }

    /// Operator of requests that name none.
    pub(super) const fn operator(&self) -> &Operator {
        &self.operator
    }
}

/// A host without its port, in lower case and without the dot of the root.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct HostName(String);

impl HostName {
    /// The host of a URL or of a `Host` header.
    pub(super) fn of_authority(authority: &Authority) -> Self {
        Self::of(authority.host())
    }

    fn of(name: &str) -> Self {
        let name = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        match name.parse() {
            Ok(address) => Self::of_address(address),
            Err(_) => Self(name.strip_suffix('.').unwrap_or(name).to_ascii_lowercase()),
        }
    }

    fn of_address(address: IpAddr) -> Self {
        Self(address.to_canonical().to_string())
    }
}

impl fmt::Display for HostName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Not the name of a host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected the name or the address of a host, such as bench.lab.example, without port or path"
)]
pub struct HostNameError;

impl FromStr for HostName {
    type Err = HostNameError;

    fn from_str(name: &str) -> Result<Self, HostNameError> {
        let is_allowed = |letter: char| letter.is_ascii_alphanumeric() || "-._".contains(letter);
        let is_name = !name.is_empty() && name.chars().all(is_allowed);
        if is_name || name.parse::<IpAddr>().is_ok() {
            Ok(Self::of(name))
        } else {
            Err(HostNameError)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_names_of_this_daemon_are_its_names() {
        let allowed = ["Bench.lab.example".parse().unwrap()];
        let listen = "192.0.2.7".parse().unwrap();
        let access = Access::new(listen, allowed, None, Operator::login());
        let knows = |authority: &str, arrived_at: Option<&str>| {
            let authority: Authority = authority.parse().unwrap();
            let arrived_at = arrived_at.map(|address| address.parse().unwrap());
            access.knows(&HostName::of_authority(&authority), arrived_at)
        };
        let ours = [
            "localhost",
            "LOCALHOST:8137",
            "localhost.:1",
            "127.0.0.1:8137",
            "[::1]:8137",
            "[0:0:0:0:0:0:0:1]",
            "[::ffff:127.0.0.1]",
            "192.0.2.7",
            "bench.lab.example.:80",
        ];
        for name in ours {
            assert!(knows(name, None), "{name}");
        }
        let foreign = [
            "evil.example",
            "localhost.evil.example",
            "evillocalhost",
            "127.0.0.1.evil.example",
            "192.0.2.8",
            "127.0.0.2",
            "[::2]",
            "lab.example",
            "127.1",
            "2130706433",
            "0.0.0.0",
        ];
        for name in foreign {
            assert!(!knows(name, None), "{name}");
        }
        assert!(knows("192.0.2.8:8137", Some("192.0.2.8")) && knows("[fe80::1]", Some("fe80::1")));
        assert!(
            !knows("evil.example", Some("192.0.2.8")) && !knows("192.0.2.9", Some("192.0.2.8"))
        );
        for bad in ["", "a b", "http://a", "a:80", "*", "a/b", "[::1]"] {
            assert!(bad.parse::<HostName>().is_err(), "{bad}");
        }
    }
}
