//! Messages to an instrument and answers from it.

use std::{sync::Arc, time::Duration};

use rig_files::instrument::dialect::{Handshake, TransportRules};
use rig_link::{HealthMeter, LineError, Port, escaped};
use rig_model::{PortKind, RigTime, Terminator};
use rig_scpi::{Ending, ExpectedResponse, Framing, Response, ResponseDecoder};
use tokio::time::Instant;

use crate::{AnalyzerError, UnexpectedTerminator, message::Message};

/// Settings of the transport that can be changed on an instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransportSettings {
    /// Terminator of messages, in both directions; `None` for that of the dialect. The answers of
    /// all dialects end in a line feed.
    pub terminator: Option<Terminator>,
    /// Time limit for the answer to a query about settings, and for a measurement beyond its delay
    /// and integration.
    pub reply_within: Duration,
}

impl Default for TransportSettings {
    fn default() -> Self {
        Self { terminator: None, reply_within: Duration::from_secs(1) }
    }
}

/// Time limit for the echo of a character.
const ECHO_WITHIN: Duration = Duration::from_millis(200);

/// Longest time between the last character of a message and the note of its time. A free computer takes
/// some microseconds; the fit of a free decay assumes half a millisecond.
const NOTED_WITHIN: Duration = Duration::from_millis(2);

/// The same with an echo, which the instrument and its adapter send when they like.
const ECHO_NOTED_WITHIN: Duration = Duration::from_millis(25);

/// The same on USB, where the instrument takes a message when it likes. Not measured on an instrument.
const USB_NOTED_WITHIN: Duration = Duration::from_millis(25);

/// Answers are some hundred characters long, or twenty for each number of a trace.
const ANSWER_BYTES: usize = 256;

/// A port with an instrument at its end.
#[derive(Debug)]
pub(crate) struct InstrumentPort {
    port: Port,
    /// Terminator of messages to the instrument.
    ending: Ending,
    handshake: Handshake,
    settings: TransportSettings,
    decoder: ResponseDecoder,
    /// A question was sent, and its answer has not come. The caller may have stopped waiting.
    is_answer_pending: bool,
    health: HealthMeter,
}

/// An answer, and when the question had left the host.
#[derive(Debug)]
pub(crate) struct TimedAnswer {
    pub(crate) response: Response,
    pub(crate) asked_at: RigTime,
}

impl InstrumentPort {
    pub(crate) fn new(port: Port, transport: &TransportRules, settings: TransportSettings) -> Self {
        let sent = match settings.terminator.unwrap_or(transport.terminator) {
            Terminator::Lf => Ending::Lf,
            Terminator::CrLf => Ending::CrLf,
            Terminator::Cr => Ending::Cr,
        };
        let ending = if sent == Ending::Cr { Ending::Cr } else { Ending::Lf };
        let decoder = ResponseDecoder::new(Framing { ending, ..Framing::default() });
        let health = HealthMeter::default();
        // The echo is one of the serial interface. On USB, each character would be a message.
        let handshake =
            if port.kind() == PortKind::Usb { Handshake::None } else { transport.handshake };
        Self { port, ending: sent, handshake, settings, decoder, is_answer_pending: false, health }
    }

    /// Time limit for the answer to a query about settings.
    pub(crate) const fn reply_within(&self) -> Duration {
        self.settings.reply_within
    }

    pub(crate) const fn link(&self) -> &Port {
        &self.port
    }

    pub(crate) fn name(&self) -> Arc<str> {
        self.port.name().clone()
    }

    /// The counts of the instrument.
    pub(crate) const fn health(&self) -> &HealthMeter {
        &self.health
    }

    /// Sends a message and waits for the line that answers it.
    pub(crate) async fn ask(
        &mut self,
        message: &Message,
        expect: ExpectedResponse,
        within: Duration,
    ) -> Result<TimedAnswer, AnalyzerError> {
        let asked = Instant::now();
        let answer = self.exchange(message, expect, within).await;
        self.health.note(|health| {
            health.requests += 1;
            match &answer {
                Ok(_) => health.answered(asked.elapsed()),
                Err(AnalyzerError::Line {
                    source: LineError::TimedOut { arrived, .. }, ..
                }) if arrived.bytes.is_empty() => {
                    health.late += 1;
                }
                Err(AnalyzerError::Line { source: LineError::TimedOut { .. }, .. }) => {
                    health.corrupt += 1;
                }
                Err(_) => {}
            }
        });
        answer
    }

    /// Sends a message and reads its answer, without counting it.
    pub(crate) async fn exchange(
        &mut self,
        message: &Message,
        expect: ExpectedResponse,
        within: Duration,
    ) -> Result<TimedAnswer, AnalyzerError> {
        let drained = self.port.drain().await.map_err(|error| self.failed(message, error))?;
        let surplus = drained + self.decoder.n_buffered();
        self.decoder.reset();
        if surplus > 0 || self.is_answer_pending {
            // The next answer may be that to an earlier question.
            return Err(AnalyzerError::Strays { port: self.name(), bytes: surplus });
        }
        self.decoder.expect(expect);
        self.is_answer_pending = true;
        let (last_at, noted_within) = self.send(message).await?;
        let asked = Instant::now();
        let bytes = self.bytes(message).len();
        let asked_at = self.port.clock().at(asked) + self.port.duration_of(bytes);
        let deadline = asked + within + self.port.duration_of(bytes + ANSWER_BYTES);
        let mut received = Vec::new();
        let mut n_pushed = 0;
        loop {
            match self.decoder.poll() {
                Ok(Some(response)) => {
                    self.is_answer_pending = false;
                    let took = asked - last_at;
                    if noted_within < took {
                        let (port, asked) = (self.name(), message.to_string().into());
                        return Err(AnalyzerError::HeldUp { port, asked, took, noted_within });
                    }
                    return Ok(TimedAnswer { response, asked_at });
                }
                Ok(None) => {}
                Err(fault) => {
                    return Err(AnalyzerError::Frame {
                        port: self.name(),
                        asked: message.to_string().into(),
                        found: escaped(&received).into(),
                        source: fault,
                    });
                }
            }
            let more = self.port.receive(&mut received, asked, deadline).await;
            more.map_err(|error| self.failed(message, error))?;
            self.decoder.push(&received[n_pushed..]);
            n_pushed = received.len();
        }
    }

    /// The bytes of a message as they go out.
    fn bytes(&self, message: &Message) -> Vec<u8> {
        match self.handshake {
            Handshake::None => message.bytes(self.ending),
            Handshake::EchoEachCharacter => message.short_bytes(self.ending),
        }
    }

    /// Sends a message. Returns when its last character was handed over at the earliest, and the longest
    /// time until that is noted.
    async fn send(&mut self, message: &Message) -> Result<(Instant, Duration), AnalyzerError> {
        let bytes = self.bytes(message);
        match self.handshake {
            Handshake::None => {
                let begun = Instant::now();
                let sent = self.port.send(&bytes).await;
                sent.map_err(|error| self.failed(message, error))?;
                let is_usb = self.port.kind() == PortKind::Usb;
                Ok((begun, if is_usb { USB_NOTED_WITHIN } else { NOTED_WITHIN }))
            }
            Handshake::EchoEachCharacter => {
                Ok((self.send_slowly(message, &bytes).await?, ECHO_NOTED_WITHIN))
            }
        }
    }

    /// Sends each character only after the echo of the one before: a busy instrument drops
    /// characters and reports no error. Returns the time of the last character.
    async fn send_slowly(
        &mut self,
        message: &Message,
        bytes: &[u8],
    ) -> Result<Instant, AnalyzerError> {
        let mut echo = Vec::new();
        let mut last_at = Instant::now();
        for (n, &byte) in bytes.iter().enumerate() {
            echo.clear();
            last_at = Instant::now();
            let sent = self.port.send(&[byte]).await;
            sent.map_err(|error| self.failed(message, error))?;
            let asked = Instant::now();
            let deadline = asked + ECHO_WITHIN + self.port.duration_of(2);
            let received = self.port.receive(&mut echo, asked, deadline).await;
            received.map_err(|error| self.failed(message, error))?;
            let is_last = n + 1 == bytes.len();
            match echo.split_first() {
                // The answer may be right behind the last echo.
                Some((&back, answer)) if back == byte && (is_last || answer.is_empty()) => {
                    self.decoder.push(answer);
                }
                _ => return Err(self.unexpected(message, "an echo of each character", &echo)),
            }
        }
        Ok(last_at)
    }

    /// Opens a lost port again, and waits until nothing is on its way any more.
    pub(crate) async fn wait_for_silence(
        &mut self,
        at_least: Duration,
    ) -> Result<(), AnalyzerError> {
        self.decoder.reset();
        if self.port.is_lost() {
            let reopened = self.port.reopen().await;
            reopened.map_err(|source| AnalyzerError::Reopen { source: Arc::new(source) })?;
        }
        let quiet = self.port.quarantine(at_least).await;
        self.is_answer_pending = false;
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
            found: escaped(found).into(),
        }
    }

    /// A question whose answer was lost.
    fn failed(&self, asked: &Message, source: LineError) -> AnalyzerError {
        let is_cr = self.ending == Ending::Cr;
        let unexpected_terminator = match &source {
            LineError::TimedOut { arrived, .. } => match arrived.bytes.last() {
                Some(b'\r') if !is_cr => Some(UnexpectedTerminator::CrForLf),
                Some(b'\n') if is_cr => Some(UnexpectedTerminator::LfForCr),
                _ => None,
            },
            _ => None,
        };
        let asked = asked.to_string().into();
        AnalyzerError::Line { asked, unexpected_terminator, intruders: Vec::new(), source }
    }
}
