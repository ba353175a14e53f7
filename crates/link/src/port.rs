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
    net::TcpStream,
    time::{Instant, timeout, timeout_at},
};
use tokio_serial::SerialPortBuilderExt;

use crate::{
    Clock, Flow, LineError, LineSettings, OpenError, Parity, StopBits, Transcript, Transport,
};

/// How many frames the black box holds: some seconds of a busy line.
const TRANSCRIPT_FRAMES: usize = 256;

/// How long a TCP connection may take to come up.
const CONNECT_WITHIN: Duration = Duration::from_secs(3);

/// How long the operating system may take to accept a request.
const SEND_WITHIN: Duration = Duration::from_secs(1);

/// A quarantine ends at the latest after this many times the time asked for.
const QUARANTINE_PATIENCE: u32 = 10;

/// A serial line, a TCP connection or a pipe in memory, and what went over it last.
#[derive(Debug)]
pub struct Port {
    name: Arc<str>,
    transport: Box<dyn Transport>,
    line: Option<LineSettings>,
    clock: Clock,
    transcript: Transcript,
    /// When a byte last went either way, as far as the host knows.
    last_activity: Instant,
    /// Bytes that arrive now are not waited for.
    is_discarding: bool,
    is_lost: bool,
}

impl Port {
    /// A port over any transport. A serial line, real or simulated, has settings; a network
    /// connection has none.
    pub fn new(
        name: impl Into<Arc<str>>,
        transport: impl Transport,
        line: Option<LineSettings>,
        clock: Clock,
    ) -> Self {
        Self {
            name: name.into(),
            transport: Box::new(transport),
            line,
            clock,
            transcript: Transcript::new(TRANSCRIPT_FRAMES),
            last_activity: Instant::now(),
            is_discarding: false,
            is_lost: false,
        }
    }

    /// Opens a serial port for this program alone.
    ///
    /// # Errors
    /// [`OpenError`], with the reason told apart: absent, held by another program, not permitted.
    pub fn open_serial(path: &str, line: LineSettings, clock: Clock) -> Result<Self, OpenError> {
        let parity = match line.parity {
            Parity::None => tokio_serial::Parity::None,
            Parity::Even => tokio_serial::Parity::Even,
            Parity::Odd => tokio_serial::Parity::Odd,
        };
        let stop_bits = match line.stop_bits {
            StopBits::One => tokio_serial::StopBits::One,
            StopBits::Two => tokio_serial::StopBits::Two,
        };
        let name: Arc<str> = path.into();
        let stream = tokio_serial::new(path, line.baud)
            .parity(parity)
            .stop_bits(stop_bits)
            .open_native_async()
            .map_err(|error| explain_open(&name, path, error))?;
        Ok(Self::new(name, stream, Some(line), clock))
    }

    /// Connects to `host:port`.
    ///
    /// # Errors
    /// [`OpenError`] when nobody answers there.
    pub async fn connect_tcp(address: &str, clock: Clock) -> Result<Self, OpenError> {
        let name: Arc<str> = address.into();
        let waited = CONNECT_WITHIN;
        let io_error = |source| OpenError::Io { port: name.clone(), source };
        let stream = match timeout(waited, TcpStream::connect(address)).await {
            Err(_) => return Err(OpenError::TimedOut { port: name.clone(), waited }),
            Ok(connected) => connected.map_err(io_error)?,
        };
        // Requests are small and the answer is waited for; coalescing would only delay them.
        stream.set_nodelay(true).map_err(io_error)?;
        Ok(Self::new(name.clone(), stream, None, clock))
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

    /// How long `bytes` characters occupy the line; nothing on a network.
    pub fn duration_of(&self, bytes: usize) -> Duration {
        self.line.map_or(Duration::ZERO, |line| line.duration_of(bytes))
    }

    /// The silence between two frames; none on a network.
    pub fn frame_silence(&self) -> Duration {
        self.line.map_or(Duration::ZERO, |line| line.frame_silence())
    }

    /// Waits until the line has been silent for the time between two frames, and throws away
    /// whatever still arrives. Returns how much that was.
    ///
    /// # Errors
    /// [`LineError::NeverSilent`] when bytes keep coming for a second, [`LineError::Lost`].
    pub async fn settle(&mut self) -> Result<usize, LineError> {
        let silence = self.frame_silence();
        self.discard_until_silent(silence, Instant::now(), Duration::from_secs(1)).await
    }

    /// Throws away what has already arrived, without waiting for more. Returns how much that was.
    ///
    /// # Errors
    /// As [`settle`](Self::settle).
    pub async fn drain(&mut self) -> Result<usize, LineError> {
        let patience = Duration::from_secs(1);
        self.discard_until_silent(Duration::ZERO, Instant::now(), patience).await
    }

    /// Reads and throws away for at least this long, and then until the line is silent. Returns
    /// how much was thrown away.
    ///
    /// # Errors
    /// [`LineError::NeverSilent`] when bytes keep coming for ten times as long,
    /// [`LineError::Lost`].
    pub async fn quarantine(&mut self, at_least: Duration) -> Result<usize, LineError> {
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
        // Bytes that have arrived are only seen after the runtime has looked at the port.
        tokio::task::yield_now().await;
        let result = loop {
            let silent_at = (self.last_activity + silence).max(not_before);
            match timeout_at(silent_at, self.read(&mut buffer)).await {
                Err(_) => break Ok(discarded),
                Ok(Err(error)) => break Err(self.explain(error)),
                Ok(Ok(n)) => discarded += n,
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
        match timeout(SEND_WITHIN, self.write_all(request)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => Err(self.explain(error)),
            Err(_) => Err(LineError::Blocked {
                port: self.name.clone(),
                bytes: request.len(),
                waited: SEND_WITHIN,
            }),
        }
    }

    /// Waits for more bytes of an answer and appends them to `answer`.
    ///
    /// # Errors
    /// [`LineError::TimedOut`] at the deadline, [`LineError::Lost`], [`LineError::Io`].
    pub async fn receive(
        &mut self,
        answer: &mut Vec<u8>,
        asked: Instant,
        deadline: Instant,
    ) -> Result<(), LineError> {
        match timeout_at(deadline, self.read_buf(answer)).await {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(error)) => Err(self.explain(error)),
            Err(_) => Err(LineError::TimedOut {
                port: self.name.clone(),
                waited: deadline - asked,
                received: answer.len(),
            }),
        }
    }

    /// What an error of the operating system means for this port.
    pub fn explain(&mut self, error: io::Error) -> LineError {
        use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
        /// A terminal whose other side is gone reports an input or output error.
        const EIO: i32 = 5;
        let is_gone = matches!(
            error.kind(),
            BrokenPipe | ConnectionAborted | ConnectionReset | UnexpectedEof
        ) || error.raw_os_error() == Some(EIO);
        let port = self.name.clone();
        if is_gone {
            self.is_lost = true;
            return LineError::Lost { port };
        }
        LineError::Io { port, source: Arc::new(error) }
    }
}

/// Every byte passes here, also those of a library that is given the port as a transport.
impl AsyncRead for Port {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        ready!(Pin::new(&mut this.transport).poll_read(cx, buffer))?;
        let received = &buffer.filled()[before..];
        if received.is_empty() && buffer.remaining() > 0 {
            // An unplugged adapter reads as an endless stream of nothing.
            return Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into()));
        }
        this.last_activity = Instant::now();
        let flow = if this.is_discarding { Flow::Discarded } else { Flow::Received };
        this.transcript.record(this.clock.at(this.last_activity), flow, received);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for Port {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let sent = ready!(Pin::new(&mut this.transport).poll_write(cx, bytes))?;
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
        Pin::new(&mut self.get_mut().transport).poll_shutdown(cx)
    }
}

fn explain_open(name: &Arc<str>, path: &str, error: tokio_serial::Error) -> OpenError {
    let port = name.clone();
    match error.kind() {
        tokio_serial::ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
            OpenError::Permission { port }
        }
        // The library reports a lost race for the lock as a missing device.
        tokio_serial::ErrorKind::NoDevice if std::path::Path::new(path).exists() => {
            OpenError::Busy { port }
        }
        tokio_serial::ErrorKind::NoDevice
        | tokio_serial::ErrorKind::Io(io::ErrorKind::NotFound) => OpenError::Absent { port },
        _ => OpenError::Io { port, source: error.into() },
    }
}
