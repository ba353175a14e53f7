//! A client of the daemon that serves a data directory.

use std::{io, net::SocketAddr, path::Path, time::Duration};

use axum::{
    body::Body,
    http::{HeaderValue, Method, Request, Response, header},
};
use http_body_util::{BodyExt, Limited};
use hyper::{body::Incoming, client::conn::http1};
use hyper_util::rt::TokioIo;
use serde::{Deserialize, de::DeserializeOwned};
use tokio::{net::TcpStream, time::timeout};

use crate::{
    endpoint::{Endpoint, EndpointError},
    http::access::{Token, TokenError},
    operator::Operator,
};

/// A daemon of this computer answers in milliseconds.
const ANSWER_TIME: Duration = Duration::from_secs(10);
/// The results of a run of thousands of touches have some MB.
const ANSWER_MAX: usize = 64 << 20;
/// The stream of events has an event each second.
const SILENCE_MAX: Duration = Duration::from_secs(5);

/// Speaks to a daemon.
pub(super) struct Client {
    address: SocketAddr,
    authorization: Option<HeaderValue>,
    operator: HeaderValue,
}

/// Why a daemon did not do what it was asked for.
#[derive(Debug, thiserror::Error)]
pub(super) enum DaemonError {
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    #[error(transparent)]
    Token(#[from] TokenError),
    #[error("no answer from the daemon at {address}")]
    Unreachable { address: SocketAddr, source: io::Error },
    #[error("the daemon refuses: {}{}", .0.detail, .0.hint.as_ref().map(|hint| format!("\n→ {}", in_commands(hint))).unwrap_or_default())]
    Refused(Problem),
    #[error("no run is under way")]
    NoRun,
    #[error("no prompt is open")]
    NothingAsked,
    #[error("{0}")]
    WrongAnswer(&'static str),
}

/// A problem document of the daemon.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Problem {
    detail: String,
    hint: Option<String>,
}

/// Advice of the HTTP interface, in commands.
pub(super) fn in_commands(advice: &str) -> String {
    let words = [
        ("POST /api/v1/lease with {\"take_over\": true}", "`rigd lease --take-over`"),
        (
            "POST /api/v1/home with {\"nothing_below_probe\": true}",
            "`rigd acknowledge --nothing-below-probe`",
        ),
        ("POST /api/v1/acknowledge", "`rigd acknowledge`"),
        ("POST /api/v1/stop", "`rigd stop`"),
        (
            "POST /api/v1/commission asks for one step after the other, as `rigd commission` does after \
             this daemon has ended",
            "end this daemon, and `rigd commission` asks for one step after the other",
        ),
        ("GET /api/v1/rig", "`rigd status`"),
    ];
    words.iter().fold(advice.to_owned(), |text, (from, to)| text.replace(from, to))
}

impl Client {
    /// Finds the daemon of a data directory. Requests name this operator.
    pub(super) fn find(data: &Path, operator: &Operator) -> Result<Self, DaemonError> {
        let endpoint = Endpoint::find(data)?;
        let bearer = match &endpoint.secret {
            Some(secret) => Some(format!("Bearer {secret}")),
            None => endpoint
                .token_file
                .as_deref()
                .map(Token::read)
                .transpose()?
                .map(|token| token.bearer()),
        };
        let header = |text: &str| HeaderValue::from_bytes(text.as_bytes());
        let failed = |error| Self::unreachable(endpoint.address, error);
        Ok(Self {
            address: endpoint.address,
            authorization: bearer
                .map(|bearer| header(&bearer))
                .transpose()
                .map_err(|error| failed(io::Error::other(error)))?,
            operator: header(operator.as_str()).map_err(|error| failed(io::Error::other(error)))?,
        })
    }

    /// Asks for a resource.
    pub(super) async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, DaemonError> {
        let bytes = self.ask(Method::GET, path, None).await?;
        serde_json::from_slice(&bytes).map_err(|error| self.failed(error.into()))
    }

    /// Gives a command.
    pub(super) async fn post(&self, path: &str) -> Result<(), DaemonError> {
        self.ask(Method::POST, path, None).await.map(|_| ())
    }

    /// Gives a command with a statement, as JSON.
    pub(super) async fn post_json(
        &self,
        path: &str,
        body: &'static str,
    ) -> Result<(), DaemonError> {
        self.ask(Method::POST, path, Some(body.into())).await.map(|_| ())
    }

    /// Gives an order that is answered with a resource.
    pub(super) async fn order<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: Option<String>,
    ) -> Result<T, DaemonError> {
        let bytes = self.ask(method, path, body).await?;
        serde_json::from_slice(&bytes).map_err(|error| self.failed(error.into()))
    }

    /// Asks for something that the daemon makes.
    pub(super) async fn make<T: DeserializeOwned>(&self, path: &str) -> Result<T, DaemonError> {
        let bytes = self.ask(Method::POST, path, None).await?;
        serde_json::from_slice(&bytes).map_err(|error| self.failed(error.into()))
    }

    /// Takes something away.
    pub(super) async fn delete(&self, path: &str) -> Result<(), DaemonError> {
        self.ask(Method::DELETE, path, None).await.map(|_| ())
    }

    /// The beginning of every address of the daemon.
    pub(super) fn origin(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Follows the events from now on.
    pub(super) async fn events(&self) -> Result<Events, DaemonError> {
        let answer = self.send(Method::GET, "/api/v1/events?live=true", None).await?;
        if !answer.status().is_success() {
            return Err(self.refusal(answer).await);
        }
        Ok(Events { body: answer.into_body(), text: Vec::new(), address: self.address })
    }

    async fn ask(
        &self,
        method: Method,
        path: &str,
        body: Option<String>,
    ) -> Result<Vec<u8>, DaemonError> {
        let answer = self.send(method, path, body).await?;
        if !answer.status().is_success() {
            return Err(self.refusal(answer).await);
        }
        self.content(answer).await
    }

    async fn refusal(&self, answer: Response<Incoming>) -> DaemonError {
        let status = answer.status();
        match self.content(answer).await {
            Ok(bytes) => {
                DaemonError::Refused(serde_json::from_slice(&bytes).unwrap_or_else(|_| Problem {
                    detail: status.to_string(),
                    ..Problem::default()
                }))
            }
            Err(error) => error,
        }
    }

    async fn content(&self, answer: Response<Incoming>) -> Result<Vec<u8>, DaemonError> {
        let collected = Limited::new(answer.into_body(), ANSWER_MAX).collect();
        let collected =
            timeout(ANSWER_TIME, collected).await.map_err(|late| self.failed(late.into()))?;
        Ok(collected.map_err(|error| self.failed(io::Error::other(error)))?.to_bytes().to_vec())
    }

    async fn send(
        &self,
        method: Method,
        path: &str,
        body: Option<String>,
    ) -> Result<Response<Incoming>, DaemonError> {
        let mut request = Request::builder()
            .method(method)
            .uri(path)
            .header(header::HOST, self.address.to_string())
            .header("x-operator", &self.operator);
        if let Some(authorization) = &self.authorization {
            request = request.header(header::AUTHORIZATION, authorization);
        }
        if body.is_some() {
            request = request.header(header::CONTENT_TYPE, "application/json");
        }
        let exchange = async {
            let request = request
                .body(body.map_or_else(Body::empty, Body::from))
                .map_err(io::Error::other)?;
            let stream = TcpStream::connect(self.address).await?;
            let handshake = http1::handshake(TokioIo::new(stream)).await;
            let (mut sender, connection) = handshake.map_err(io::Error::other)?;
            // The connection ends with the answer.
            tokio::spawn(connection);
            sender.send_request(request).await.map_err(io::Error::other)
        };
        let answer =
            timeout(ANSWER_TIME, exchange).await.map_err(|late| self.failed(late.into()))?;
        answer.map_err(|error| self.failed(error))
    }

    fn failed(&self, source: io::Error) -> DaemonError {
        Self::unreachable(self.address, source)
    }

    fn unreachable(address: SocketAddr, source: io::Error) -> DaemonError {
        DaemonError::Unreachable { address, source }
    }
}

/// The events of a daemon.
pub(super) struct Events {
    body: Incoming,
    /// Received and not yet given out.
    text: Vec<u8>,
    address: SocketAddr,
}

/// An event.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Event {
    /// Kind of the event, such as `rig`.
    pub(super) kind: String,
    /// Its content, as JSON.
    pub(super) data: String,
}

impl Events {
    /// The next event; `None` after the end of the daemon. Cancel-safe.
    pub(super) async fn next(&mut self) -> Result<Option<Event>, DaemonError> {
        let failed = |source| Client::unreachable(self.address, source);
        loop {
            if let Some(event) = event(&mut self.text) {
                return Ok(Some(event));
            }
            let frame = timeout(SILENCE_MAX, self.body.frame()).await;
            let Some(frame) = frame.map_err(|late| failed(late.into()))? else { return Ok(None) };
            if let Ok(bytes) = frame.map_err(|error| failed(io::Error::other(error)))?.into_data() {
                self.text.extend_from_slice(&bytes);
            }
        }
    }
}

/// Takes the first whole event out of a text. The daemon writes each as lines of `name: value`, with an
/// empty line at its end.
fn event(text: &mut Vec<u8>) -> Option<Event> {
    loop {
        let end = text.windows(2).position(|two| two == b"\n\n")?;
        let whole: Vec<u8> = text.drain(..end + 2).collect();
        let whole = String::from_utf8_lossy(&whole);
        let field = |name: &str| {
            whole.lines().find_map(|line| Some(line.strip_prefix(name)?.trim_start().to_owned()))
        };
        // Comments, which keep a connection alive, have neither.
        if let (Some(kind), Some(data)) = (field("event:"), field("data:")) {
            return Some(Event { kind, data });
        }
    }
}

#[cfg(test)]
mod tests {
    use rig_engine::RigState;

    use super::*;
    use crate::hint;

    #[test]
    fn events_are_read_wherever_their_bytes_are_cut() {
        let stream = ":\n\nevent: rig\ndata: {\"a\":1}\n\nid: 7\nevent: moved\ndata: {}\n\n";
        let whole = |kind: &str, data: &str| Event { kind: kind.into(), data: data.into() };
        let expected = [whole("rig", "{\"a\":1}"), whole("moved", "{}")];
        for cut in 0..=stream.len() {
            let (first, rest) = stream.as_bytes().split_at(cut);
            let (mut text, mut events) = (first.to_vec(), Vec::new());
            events.extend(std::iter::from_fn(|| event(&mut text)));
            text.extend_from_slice(rest);
            events.extend(std::iter::from_fn(|| event(&mut text)));
            assert_eq!(events, expected, "{cut}");
            assert!(text.is_empty());
        }
    }

    #[test]
    fn advice_names_commands() {
        let advice = "read the fault in GET /api/v1/rig, then POST /api/v1/acknowledge";
        let commands = "read the fault in `rigd status`, then `rigd acknowledge`";
        assert_eq!(in_commands(advice), commands);
        let look =
            "see that it is clear; then POST /api/v1/home with {\"nothing_below_probe\": true}";
        let command = "see that it is clear; then `rigd acknowledge --nothing-below-probe`";
        assert_eq!(in_commands(look), command);
        // Another wording of a hint needs its command here.
        let while_in = [
            RigState::Latched,
            RigState::Running,
            RigState::WaitingForPerson,
            RigState::Paused,
            RigState::Preparing,
            RigState::Retracting,
        ]
        .map(|state| hint::while_in(state).unwrap().to_owned());
        let hints = hint::Hint::of_every_action().map(hint::Hint::over_http);
        for advice in while_in.iter().chain(&hints) {
            let said = in_commands(advice);
            assert!(!said.contains("/api/") && !said.contains("POST"), "{advice}: {said}");
        }
    }
}
