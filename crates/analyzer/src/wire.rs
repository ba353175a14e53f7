//! Messages to an instrument and answers from it.

use std::{sync::Arc, time::Duration};

use rig_link::{LineError, Port};
use rig_model::RigTime;
use tokio::time::Instant;

use crate::{AnalyzerError, dialect::Quirks};

/// How long an instrument may take to answer a question about its settings.
pub(crate) const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// An answer longer than this is noise.
const ANSWER_BYTES_MAX: usize = 1 << 20;

/// A port with an instrument at its end.
#[derive(Debug)]
pub(crate) struct Wire {
    port: Port,
    quirks: Quirks,
    received: Vec<u8>,
}

/// An answer, and when the question had left the host.
#[derive(Debug)]
pub(crate) struct Answered {
    pub(crate) text: String,
    pub(crate) asked_at: RigTime,
}

impl Wire {
    pub(crate) fn new(port: Port, quirks: Quirks) -> Self {
        Self { port, quirks, received: Vec::new() }
    }

    pub(crate) fn port(&self) -> &Port {
        &self.port
    }

    pub(crate) fn name(&self) -> Arc<str> {
        self.port.name().clone()
    }

    /// Sends a message that has no answer.
    pub(crate) async fn tell(&mut self, message: &str) -> Result<RigTime, AnalyzerError> {
        let bytes = [message, self.quirks.terminator].concat();
        self.port.send(bytes.as_bytes()).await.map_err(|error| line(message, error))?;
        Ok(self.port.clock().now() + self.port.duration_of(bytes.len()))
    }

    /// Sends a message and waits for the line that answers it.
    pub(crate) async fn ask(
        &mut self,
        message: &str,
        within: Duration,
    ) -> Result<Answered, AnalyzerError> {
        let surplus = self.port.drain().await.map_err(|error| line(message, error))?;
        if surplus + self.received.len() > 0 {
            // Nobody asked for it, so that the next answer may be that to an earlier question.
            self.received.clear();
            return Err(self.unexpected(message, "silence before the question", b"more answers"));
        }
        let asked_at = self.tell(message).await?;
        let asked = Instant::now();
        // The longest answers are some hundred characters.
        let deadline = asked + within + self.port.duration_of(message.len() + 256);
        loop {
            if let Some(end) = self.received.iter().position(|&byte| byte == b'\n') {
                let answer: Vec<u8> = self.received.drain(..=end).collect();
                let answer = answer.strip_suffix(b"\n").unwrap_or(&answer);
                let answer = answer.strip_suffix(b"\r").unwrap_or(answer);
                let is_text = answer.iter().all(|byte| (b' '..=b'~').contains(byte));
                if !is_text {
                    return Err(self.unexpected(message, "a line of text", answer));
                }
                let text = answer.iter().map(|&byte| char::from(byte)).collect();
                return Ok(Answered { text, asked_at });
            }
            if ANSWER_BYTES_MAX <= self.received.len() {
                return Err(self.unexpected(message, "a line of text", b"an endless line"));
            }
            let received = self.port.receive(&mut self.received, asked, deadline).await;
            received.map_err(|error| line(message, error))?;
        }
    }

    /// Forgets everything that is or may be on its way.
    pub(crate) async fn quarantine(&mut self, at_least: Duration) -> Result<(), AnalyzerError> {
        self.received.clear();
        self.port.quarantine(at_least).await.map_err(|error| line("", error))?;
        Ok(())
    }

    /// An answer that does not answer.
    pub(crate) fn unexpected(
        &self,
        asked: &str,
        expected: &'static str,
        found: &[u8],
    ) -> AnalyzerError {
        let found = found.escape_ascii().to_string().into();
        AnalyzerError::Answer { port: self.name(), asked: asked.into(), expected, found }
    }
}

fn line(asked: &str, source: LineError) -> AnalyzerError {
    AnalyzerError::Line { asked: asked.into(), source }
}
