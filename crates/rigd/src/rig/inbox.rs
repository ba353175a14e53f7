//! Requests on their way to the rig thread. A stop goes before all others.
//!
//! What was asked before a stop, and is taken after it, meets a rig that retracts or is latched, and is refused. An abort keeps
//! its place: it ends what was begun before it.

use std::time::Instant;

use rig_engine::Command;
use tokio::sync::mpsc;

use super::Request;

/// Requests wait here while the rig thread is busy for a moment. One person and one program together never have as many
/// outstanding.
const REQUESTS_MAX: usize = 64;

/// A request and when it came.
#[derive(Debug)]
pub(super) struct Asked {
    pub(super) at: Instant,
    pub(super) request: Request,
}

/// The end of the callers.
#[derive(Debug, Clone)]
pub(super) struct Outbox {
    stops: mpsc::Sender<Asked>,
    requests: mpsc::Sender<Asked>,
}

/// The end of the rig thread.
#[derive(Debug)]
pub(super) struct Inbox {
    stops: mpsc::Receiver<Asked>,
    requests: mpsc::Receiver<Asked>,
}

/// The rig thread has ended.
#[derive(Debug)]
pub(super) struct Closed;

pub(super) fn inbox() -> (Outbox, Inbox) {
    let (stops, stops_asked) = mpsc::channel(REQUESTS_MAX);
    let (requests, asked) = mpsc::channel(REQUESTS_MAX);
    (Outbox { stops, requests }, Inbox { stops: stops_asked, requests: asked })
}

impl Outbox {
    pub(super) async fn send(&self, request: Request) -> Result<(), Closed> {
        let is_stop = matches!(request, Request::Command { command: Command::Stop, .. });
        let way = if is_stop { &self.stops } else { &self.requests };
        way.send(Asked { at: Instant::now(), request }).await.map_err(|_| Closed)
    }

    pub(super) fn is_closed(&self) -> bool {
        self.requests.is_closed()
    }
}

impl Inbox {
    /// The next request; `None` if all callers have gone. May be dropped at any time.
    pub(super) async fn recv(&mut self) -> Option<Asked> {
        tokio::select! {
            biased;
            Some(stop) = self.stops.recv() => Some(stop),
            asked = self.requests.recv() => asked,
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::sync::oneshot;

    use super::*;

    fn request(command: Command) -> Request {
        let (reply, _) = oneshot::channel();
        Request::Command { command, run: None, by: "test".to_owned(), reply }
    }

    #[tokio::test]
    async fn a_stop_goes_before_what_was_asked_earlier_and_an_abort_does_not() {
        let (outbox, mut inbox) = inbox();
        for command in [Command::Pause, Command::Abort, Command::Stop, Command::Resume] {
            outbox.send(request(command)).await.expect("it is open");
        }
        drop(outbox);
        let mut names = Vec::new();
        while let Some(Asked { request: Request::Command { command, .. }, .. }) = inbox.recv().await
        {
            names.push(command.name());
        }
        assert_eq!(names, ["stop", "pause", "abort", "resume"]);
        drop(inbox);
    }

    #[tokio::test]
    async fn nothing_is_sent_to_a_thread_that_has_ended() {
        let (outbox, inbox) = inbox();
        drop(inbox);
        assert!(outbox.is_closed());
        assert!(outbox.send(request(Command::Stop)).await.is_err());
    }
}
