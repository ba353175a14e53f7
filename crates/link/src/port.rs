//! One port and its only user.

use std::{
    io,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll, ready},
    time::Duration,
};

use tokio::{
    io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf},
    time::{Instant, timeout, timeout_at},
};

use crate::{
    Clock, Endpoint, Flow, Holder, LineError, OpenError, PartialAnswer, Transcript, Transport,
    attached::others, device::device_of, transport::Carrier,
};
use rig_model::{LineSettings, PortKind};

/// Number of frames in the black box: some seconds of a busy line.
const TRANSCRIPT_FRAMES: usize = 256;

/// Time limit for the operating system to accept a request.
const SEND_WITHIN: Duration = Duration::from_secs(1);

/// A quarantine lasts at most this multiple of its requested time.
const QUARANTINE_PATIENCE: u32 = 10;

/// Time limit of a device clear, which begins after the request before it: the driver waits for 5 s for an
/// instrument that does not answer, and for a second for a transfer.
const CLEARED_WITHIN: Duration = Duration::from_secs(7);

/// A serial line, a TCP connection, an instrument on USB or a pipe in memory, and what went over it last.
#[derive(Debug)]
pub struct Port {
    name: Arc<str>,
    /// The endpoint for opening it again.
    endpoint: Option<Endpoint>,
    /// `None` after the other side has closed. It is closed at once, because an adapter that is
    /// plugged in again gets another name while the old one is open.
    transport: Option<Carrier>,
    line: Option<LineSettings>,
    clock: Clock,
    transcript: Transcript,
    /// Time of the last byte in either direction, as far as the host knows.
    last_activity: Instant,
    /// It does not wait for further bytes.
    is_discarding: bool,
}

impl Port {
    /// Opens a port.
    ///
    /// # Errors
    /// [`OpenError`], by its reason: absent, held by another program, not permitted, no answer.
    pub async fn open(mut endpoint: Endpoint, clock: Clock) -> Result<Self, OpenError> {
        let (name, line) = (endpoint.name(), endpoint.line());
        let transport = endpoint.connect().await?;
        let port = Self::assemble(name, transport, line, clock);
        Ok(Self { endpoint: Some(endpoint), ..port })
    }

    /// A port over a transport that is open already. A serial line, real or simulated, has
    /// settings; a network connection has none. Once lost, it stays so.
    pub fn new(
        name: impl Into<Arc<str>>,
        transport: impl Transport,
        line: Option<LineSettings>,
        clock: Clock,
    ) -> Self {
        Self::assemble(name.into(), Carrier::Bytes(Box::new(transport)), line, clock)
    }

    fn assemble(
        name: Arc<str>,
        transport: Carrier,
        line: Option<LineSettings>,
        clock: Clock,
    ) -> Self {
        Self {
            name,
            endpoint: None,
            transport: Some(transport),
            line,
            clock,
            transcript: Transcript::new(TRANSCRIPT_FRAMES),
            last_activity: Instant::now(),
            is_discarding: false,
        }
    }

    /// Closes the port if it is open, and opens it where it was, or where the same adapter is now.
    /// The device there may be another one and has to be identified.
    ///
    /// # Errors
    /// [`OpenError`]; [`OpenError::Absent`] for a port that was made over a given transport.
    pub async fn reopen(&mut self) -> Result<(), OpenError> {
        self.transport = None;
        let Some(endpoint) = &mut self.endpoint else {
            return Err(OpenError::Absent { port: self.name.clone() });
        };
        self.transport = Some(endpoint.connect().await?);
        self.last_activity = Instant::now();
        Ok(())
    }

    /// Whether the other side has closed.
    pub const fn is_lost(&self) -> bool {
        self.transport.is_none()
    }

    /// Whether it can be opened once more.
    pub const fn can_reopen(&self) -> bool {
        self.endpoint.is_some()
    }

    /// The name that people read, such as `/dev/ttyUSB0`.
    pub fn name(&self) -> &Arc<str> {
        &self.name
    }

    /// The rig's clock.
    pub const fn clock(&self) -> Clock {
        self.clock
    }

    /// The last frames; the value stays connected to the port.
    pub fn transcript(&self) -> Transcript {
        self.transcript.clone()
    }

    /// Other programs that have this device file open and may take its answers, as far as this user may
    /// know.
    pub fn intruders(&self) -> Vec<Holder> {
        let file = self.endpoint.as_ref().and_then(Endpoint::file);
        let device = file.and_then(device_of);
        device.map(|device| others(&device)).unwrap_or_default()
    }

    /// What kind of port it is, or stands for.
    pub const fn kind(&self) -> PortKind {
        match &self.endpoint {
            Some(endpoint) => endpoint.kind(),
            None if self.line.is_some() => PortKind::Serial,
            None => PortKind::Network,
        }
    }

    /// Transfer time of `bytes` characters; zero on a network.
    pub fn duration_of(&self, bytes: usize) -> Duration {
        self.line.map_or(Duration::ZERO, |line| line.duration_of(bytes))
    }

    /// The silence that the standard wants between two frames; none on a network.
    pub fn frame_silence(&self) -> Duration {
        self.line.map_or(Duration::ZERO, |line| line.frame_silence())
    }

    /// Waits until the line has been silent for this time, and discards the bytes that still
    /// arrive. Returns their number.
    ///
    /// # Errors
    /// [`LineError::NeverSilent`] when bytes keep coming for a second, [`LineError::Lost`].
    pub async fn settle(&mut self, silence: Duration) -> Result<usize, LineError> {
        self.settle_within(silence, Duration::from_secs(1).max(10 * silence)).await
    }

    /// The same with this much patience.
    ///
    /// # Errors
    /// [`LineError::NeverSilent`] when bytes keep coming for so long, [`LineError::Lost`].
    pub async fn settle_within(
        &mut self,
        silence: Duration,
        patience: Duration,
    ) -> Result<usize, LineError> {
        self.discard_until_silent(silence, Instant::now(), patience).await
    }

    /// Discards the bytes that have arrived, without waiting for more. Returns their number.
    ///
    /// # Errors
    /// As [`settle`](Self::settle).
    pub async fn drain(&mut self) -> Result<usize, LineError> {
        self.settle(Duration::ZERO).await
    }

    /// Reads and discards bytes for at least this time, and then until the line is silent. Returns
    /// the number of bytes discarded. An instrument on USB is cleared instead: it sends nothing late.
    ///
    /// # Errors
    /// [`LineError::NeverSilent`] when bytes keep coming for ten times as long,
    /// [`LineError::NotCleared`], [`LineError::Lost`].
    pub async fn quarantine(&mut self, at_least: Duration) -> Result<usize, LineError> {
        if let Some(Carrier::Messages(link)) = &mut self.transport {
            let cleared = timeout(CLEARED_WITHIN, link.cleared()).await;
            let (port, waited) = (self.name.clone(), CLEARED_WITHIN);
            let cleared = cleared.map_err(|_| LineError::NotCleared { port, waited })?;
            return self.notice(cleared).map(|()| 0).map_err(|error| self.explain(error));
        }
        let end = Instant::now() + at_least;
        let patience = at_least * QUARANTINE_PATIENCE;
        self.discard_until_silent(self.frame_silence(), end, patience).await
    }

    async fn discard_until_silent(
        &mut self,
        silence: Duration,
        not_before: Instant,
        patience: Duration,
    ) -> Result<usize, LineError> {
        let give_up = Instant::now() + patience;
        let mut discarded = 0;
        let mut buffer = [0; 256];
        self.transcript.cut();
        self.is_discarding = true;
        // Bytes that have arrived become visible only after the runtime has polled the port.
        tokio::task::yield_now().await;
        let result = loop {
            let silent_at = (self.last_activity + silence).max(not_before);
            let outcome = if silent_at <= Instant::now() {
                // A timer that is over already would still wait for its next tick.
                poll_once(self.read(&mut buffer)).await
            } else {
                timeout_at(silent_at, self.read(&mut buffer)).await.ok()
            };
            match outcome {
                None => break Ok(discarded),
                Some(Err(error)) => break Err(self.explain(error)),
                Some(Ok(n)) => discarded += n,
            }
            if give_up <= Instant::now() {
                let port = self.name.clone();
                break Err(LineError::NeverSilent { port, waited: patience, discarded });
            }
        };
        self.is_discarding = false;
        result
    }

    /// Begins an exchange: sends a whole request. Returns without waiting for the last character
    /// to leave the wire; [`duration_of`](Self::duration_of) says how long that takes.
    ///
    /// # Errors
    /// [`LineError::Blocked`], [`LineError::Lost`], [`LineError::Io`].
    pub async fn send(&mut self, request: &[u8]) -> Result<(), LineError> {
        self.transcript.cut();
        self.is_discarding = false;
        let begun = Instant::now();
        let blocked = |port: &Self, waited| LineError::Blocked {
            port: port.name.clone(),
            bytes: request.len(),
            waited,
        };
        match timeout(SEND_WITHIN, self.write_all(request)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) if self.is_late(&error) => Err(blocked(self, begun.elapsed())),
            Ok(Err(error)) => Err(self.explain(error)),
            Err(_) => {
                self.give_up();
                Err(blocked(self, SEND_WITHIN))
            }
        }
    }

    /// Waits for more bytes of an answer and appends them to `answer`, which has the part that has
    /// arrived so far. An instrument on USB is cleared at the deadline, or when its driver gives up before.
    ///
    /// # Errors
    /// [`LineError::TimedOut`] at the deadline, [`LineError::Lost`], [`LineError::Io`].
    pub async fn receive(
        &mut self,
        answer: &mut Vec<u8>,
        asked: Instant,
        deadline: Instant,
    ) -> Result<(), LineError> {
        let waited = match timeout_at(deadline, self.read_buf(answer)).await {
            Ok(Ok(_)) => return Ok(()),
            Ok(Err(error)) if self.is_late(&error) => asked.elapsed(),
            Ok(Err(error)) => return Err(self.explain(error)),
            Err(_) => {
                self.give_up();
                deadline - asked
            }
        };
        Err(LineError::TimedOut {
            port: self.name.clone(),
            waited,
            arrived: Box::new(PartialAnswer {
                bytes: answer.clone(),
                last_after: self.last_activity.saturating_duration_since(asked),
            }),
        })
    }

    /// Whether the driver of an instrument on USB has given up waiting. It is cleared then.
    fn is_late(&self, error: &io::Error) -> bool {
        matches!(self.transport, Some(Carrier::Messages(_)))
            && error.kind() == io::ErrorKind::TimedOut
    }

    /// Lets an instrument on USB be cleared, without a wait for it. On a line there is nothing to be done.
    fn give_up(&mut self) {
        if let Some(Carrier::Messages(link)) = &mut self.transport {
            link.give_up();
        }
    }

    /// Translates an error of the operating system.
    pub fn explain(&self, error: io::Error) -> LineError {
        let port = self.name.clone();
        if is_gone(&error) {
            return LineError::Lost { port, kind: self.kind() };
        }
        LineError::Io { port, source: Arc::new(error) }
    }

    /// Drops the transport when the other side has closed.
    fn notice<T>(&mut self, outcome: io::Result<T>) -> io::Result<T> {
        if outcome.as_ref().is_err_and(is_gone) {
            self.transport = None;
        }
        outcome
    }
}

/// The result of a future, if it is ready now.
async fn poll_once<T>(future: impl Future<Output = T>) -> Option<T> {
    let mut future = std::pin::pin!(future);
    std::future::poll_fn(|cx| match future.as_mut().poll(cx) {
        Poll::Ready(value) => Poll::Ready(Some(value)),
        Poll::Pending => Poll::Ready(None),
    })
    .await
}

/// Whether an error means that the other side has closed.
fn is_gone(error: &io::Error) -> bool {
    use io::ErrorKind::{
        BrokenPipe, ConnectionAborted, ConnectionReset, NotConnected, UnexpectedEof,
    };
    /// The error of a terminal whose other side has closed.
    const EIO: i32 = 5;
    /// The error of a terminal whose hardware has disappeared.
    const ENXIO: i32 = 6;
    matches!(
        error.kind(),
        BrokenPipe | ConnectionAborted | ConnectionReset | NotConnected | UnexpectedEof
    ) || matches!(error.raw_os_error(), Some(EIO | ENXIO))
}

/// Every byte passes here, also those of a library that is given the port as a transport.
impl AsyncRead for Port {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let Some(transport) = &mut this.transport else {
            return Poll::Ready(Err(io::ErrorKind::NotConnected.into()));
        };
        let before = buffer.filled().len();
        let mut outcome = ready!(Pin::new(transport).poll_read(cx, buffer));
        let received = &buffer.filled()[before..];
        if outcome.is_ok() && received.is_empty() && buffer.remaining() > 0 {
            // An unplugged adapter reads as an endless stream of nothing.
            outcome = Err(io::ErrorKind::UnexpectedEof.into());
        }
        if !received.is_empty() {
            this.last_activity = Instant::now();
            let flow = if this.is_discarding { Flow::Discarded } else { Flow::Received };
            this.transcript.record(this.clock.at(this.last_activity), flow, received);
        }
        Poll::Ready(this.notice(outcome))
    }
}

impl AsyncWrite for Port {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let Some(transport) = &mut this.transport else {
            return Poll::Ready(Err(io::ErrorKind::NotConnected.into()));
        };
        let outcome = ready!(Pin::new(transport).poll_write(cx, bytes));
        let sent = this.notice(outcome)?;
        let now = Instant::now();
        this.transcript.record(this.clock.at(now), Flow::Sent, &bytes[..sent]);
        // The last character leaves the wire only after all of them had their time on it.
        this.last_activity = now.max(this.last_activity) + this.duration_of(sent);
        Poll::Ready(Ok(sent))
    }

    /// Does nothing: to flush a terminal is to block the thread until its last character has left
    /// the wire.
    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &mut self.get_mut().transport {
            Some(transport) => Pin::new(transport).poll_shutdown(cx),
            None => Poll::Ready(Ok(())),
        }
    }
}
