//! Messages to an instrument and answers from it.

use std::{sync::Arc, time::Duration};

use rig_link::{LineError, Port};
use rig_model::RigTime;
use rig_scpi::{Ending, Expect, Framing, Response, ResponseDecoder};
use tokio::time::Instant;

use crate::{
    AnalyzerError,
    dialect::{Handshake, Quirks},
    message::Message,
};

/// How long an instrument may take to answer a question about its settings.
pub(crate) const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// How long an instrument may take to echo a character.
const ECHO_WITHIN: Duration = Duration::from_millis(200);

/// Answers are some hundred characters long, or twenty for each number of a trace.
const ANSWER_BYTES: usize = 256;

/// A port with an instrument at its end.
#[derive(Debug)]
pub(crate) struct Wire {
    port: Port,
    quirks: Quirks,
    decoder: ResponseDecoder,
    /// A question is out whose answer has not come. Whoever asked may have stopped waiting.
    owes_an_answer: bool,
}

/// An answer, and when the question had left the host.
#[derive(Debug)]
pub(crate) struct Answered {
    pub(crate) response: Response,
    pub(crate) asked_at: RigTime,
}

impl Wire {
    pub(crate) fn new(port: Port, quirks: Quirks) -> Self {
        // Whatever a dialect sends as its ending, they all answer with a line feed last.
        let framing = Framing { ending: Ending::Lf, ..Framing::default() };
        Self { port, quirks, decoder: ResponseDecoder::new(framing), owes_an_answer: false }
    }

    pub(crate) const fn port(&self) -> &Port {
        &self.port
    }

    pub(crate) fn name(&self) -> Arc<str> {
        self.port.name().clone()
    }

    /// Sends a message and waits for the line that answers it.
    pub(crate) async fn ask(
        &mut self,
        message: &Message,
        expect: Expect,
        within: Duration,
    ) -> Result<Answered, AnalyzerError> {
        let failed = |error| line(message, error);
        let surplus = self.port.drain().await.map_err(failed)? + self.decoder.n_buffered();
        self.decoder.reset();
        if surplus > 0 || self.owes_an_answer {
            // The next answer may be that to an earlier question.
            return Err(AnalyzerError::Strays { port: self.name(), bytes: surplus });
        }
        self.decoder.expect(expect);
        self.owes_an_answer = true;
        self.send(message).await?;
        let asked = Instant::now();
        let bytes = message.bytes(self.quirks.ending).len();
        let asked_at = self.port.clock().at(asked) + self.port.duration_of(bytes);
        let deadline = asked + within + self.port.duration_of(bytes + ANSWER_BYTES);
        let mut received = Vec::new();
        loop {
            match self.decoder.poll() {
                Ok(Some(response)) => {
                    self.owes_an_answer = false;
                    return Ok(Answered { response, asked_at });
                }
                Ok(None) => {}
                Err(fault) => {
                    return Err(AnalyzerError::Frame {
                        port: self.name(),
                        asked: message.to_string().into(),
                        source: fault,
                    });
                }
            }
            received.clear();
            let more = self.port.receive(&mut received, asked, deadline).await;
            more.map_err(|error| line(message, error))?;
            self.decoder.push(&received);
        }
    }

    async fn send(&mut self, message: &Message) -> Result<(), AnalyzerError> {
        let bytes = message.bytes(self.quirks.ending);
        match self.quirks.handshake {
            Handshake::None => self.port.send(&bytes).await.map_err(|error| line(message, error)),
            Handshake::EchoEachCharacter => self.send_slowly(message, &bytes).await,
        }
    }

    /// Sends no character before the last one has come back: while it is busy, the instrument
    /// drops characters without a word.
    async fn send_slowly(&mut self, message: &Message, bytes: &[u8]) -> Result<(), AnalyzerError> {
        let mut echo = Vec::new();
        for (n, &byte) in bytes.iter().enumerate() {
            echo.clear();
            self.port.send(&[byte]).await.map_err(|error| line(message, error))?;
            let sent = Instant::now();
            let deadline = sent + ECHO_WITHIN + self.port.duration_of(2);
            let received = self.port.receive(&mut echo, sent, deadline).await;
            received.map_err(|error| line(message, error))?;
            let is_last = n + 1 == bytes.len();
            match echo.split_first() {
                // The answer may be right behind the last echo.
                Some((&back, answer)) if back == byte && (is_last || answer.is_empty()) => {
                    self.decoder.push(answer);
                }
                _ => return Err(self.unexpected(message, "an echo of each character", &echo)),
            }
        }
        Ok(())
    }

    /// Opens a lost port again, and waits until nothing is on its way any more.
    pub(crate) async fn put_in_order(&mut self, at_least: Duration) -> Result<(), AnalyzerError> {
        self.decoder.reset();
        if self.port.is_lost() {
            let reopened = self.port.reopen().await;
            reopened.map_err(|source| AnalyzerError::Reopen { source: Arc::new(source) })?;
        }
        let quiet = self.port.quarantine(at_least).await;
        self.owes_an_answer = false;
        quiet.map(drop).map_err(|source| AnalyzerError::Unquiet { source })
    }

    /// An answer that does not answer.
    pub(crate) fn unexpected(
        &self,
        asked: &Message,
        expected: &'static str,
        found: &[u8],
    ) -> AnalyzerError {
        AnalyzerError::Answer {
            port: self.name(),
            asked: asked.to_string().into(),
            expected,
            found: found.escape_ascii().to_string().into(),
        }
    }
}

fn line(asked: &Message, source: LineError) -> AnalyzerError {
    AnalyzerError::Line { asked: asked.to_string().into(), intruders: Vec::new(), source }
}
