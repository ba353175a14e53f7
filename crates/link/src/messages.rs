//! Messages to an instrument behind a file descriptor that keeps their bounds and may block.
//!
//! A thread of its own owns the descriptor, so that nothing else waits for the driver:
//!
//! ```text
//!   port ── messages, device clear ──▶ owner (thread) ──▶ driver
//!        ◀──── pieces of answers ─────
//! ```
//!
//! The owner reads when the instrument has said that it has an answer, and never before: a read that waits in
//! the kernel cannot be ended, and some instruments hang after one that was given up. After every error it
//! clears the device; an instrument that cannot be cleared is lost, and its descriptor is closed.

mod owner;

#[cfg(test)]
mod tests;

use std::{
    io::{self, ErrorKind},
    pin::Pin,
    sync::mpsc,
    task::{Context, Poll, ready},
};

use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    sync::{
        mpsc::{UnboundedReceiver, unbounded_channel},
        oneshot,
    },
};

use owner::{Command, Owner};

/// A descriptor that keeps the bounds of messages, and the instrument behind it. Each call may block, for
/// the time limit of the driver.
pub(crate) trait MessageDevice: Send + 'static {
    /// Sends one whole message.
    fn write(&mut self, message: &[u8]) -> io::Result<()>;

    /// Whether the instrument has an answer, or a further piece of one.
    fn has_answer(&mut self) -> io::Result<bool>;

    /// Reads a piece of an answer, and returns whether the answer ends with it.
    fn read(&mut self, piece: &mut Vec<u8>) -> io::Result<bool>;

    /// Discards all that was sent and all that was to be read, on both sides.
    fn clear(&mut self) -> io::Result<()>;
}

/// The end of the port: bytes to and from the owner of a descriptor.
#[derive(Debug)]
pub(crate) struct MessageLink {
    commands: mpsc::Sender<Command>,
    pieces: UnboundedReceiver<Piece>,
    /// The part of a piece that was not taken yet.
    rest: Vec<u8>,
    /// The message that the owner is sending.
    writing: Option<oneshot::Receiver<io::Result<()>>>,
    /// The last device clear, if no message was sent after it.
    clearing: Option<oneshot::Receiver<io::Result<()>>>,
    /// Number of device clears. Pieces from before the last one are discarded.
    epoch: u64,
}

/// A piece of an answer, or the error in its place.
#[derive(Debug)]
struct Piece {
    /// Number of device clears before it.
    epoch: u64,
    outcome: io::Result<Vec<u8>>,
}

impl MessageLink {
    /// Gives a descriptor to an owner of its own.
    ///
    /// # Errors
    /// The system has no thread for it.
    pub(crate) fn start(device: impl MessageDevice) -> io::Result<Self> {
        let (commands, to_do) = mpsc::channel();
        let (found, pieces) = unbounded_channel();
        let owner = Owner::new(device, to_do, found);
        std::thread::Builder::new().name("usbtmc".to_owned()).spawn(move || owner.run())?;
        Ok(Self { commands, pieces, rest: Vec::new(), writing: None, clearing: None, epoch: 0 })
    }

    /// Gives up the message and the answer that are on their way: the device is cleared, without a wait here.
    pub(crate) fn give_up(&mut self) {
        self.epoch += 1;
        self.rest.clear();
        self.writing = None;
        let (done, cleared) = oneshot::channel();
        // An owner that has ended shows when the end of this is awaited.
        _ = self.commands.send(Command::Clear { epoch: self.epoch, done });
        self.clearing = Some(cleared);
    }

    /// Waits until the device has been cleared, since the last message at the latest. May be dropped at any
    /// time.
    ///
    /// # Errors
    /// [`ErrorKind::NotConnected`] when the instrument is lost.
    pub(crate) async fn cleared(&mut self) -> io::Result<()> {
        if self.clearing.is_none() {
            self.give_up();
        }
        if let Some(cleared) = &mut self.clearing {
            let outcome = cleared.await.unwrap_or_else(|_| Err(lost()));
            self.clearing = None;
            outcome?;
        }
        Ok(())
    }
}

/// An instrument that is there no more.
fn lost() -> io::Error {
    ErrorKind::NotConnected.into()
}

impl AsyncRead for MessageLink {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        while this.rest.is_empty() {
            match ready!(this.pieces.poll_recv(cx)) {
                None => return Poll::Ready(Err(lost())),
                Some(Piece { epoch, .. }) if epoch != this.epoch => {}
                Some(Piece { outcome, .. }) => this.rest = outcome?,
            }
        }
        let taken = this.rest.len().min(buffer.remaining());
        buffer.put_slice(&this.rest[..taken]);
        this.rest.drain(..taken);
        Poll::Ready(Ok(()))
    }
}

/// A write is one message.
impl AsyncWrite for MessageLink {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let mut writing = if let Some(writing) = this.writing.take() {
            writing
        } else {
            let (done, writing) = oneshot::channel();
            let message = Command::Write { message: bytes.to_vec(), done };
            this.commands.send(message).map_err(|_| lost())?;
            this.clearing = None;
            writing
        };
        match Pin::new(&mut writing).poll(cx) {
            Poll::Pending => {
                this.writing = Some(writing);
                Poll::Pending
            }
            Poll::Ready(Ok(outcome)) => Poll::Ready(outcome.map(|()| bytes.len())),
            Poll::Ready(Err(_)) => Poll::Ready(Err(lost())),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    /// The descriptor is closed when this end is dropped.
    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}
