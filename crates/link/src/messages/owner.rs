//! The owner of a descriptor: the only thread that may wait for it.

use std::{
    io::{self, ErrorKind},
    sync::mpsc::{Receiver, RecvTimeoutError},
    time::{Duration, Instant},
};

use tokio::sync::{mpsc::UnboundedSender, oneshot};

use super::{MessageDevice, Piece, lost};

/// Shortest time between two questions whether there is an answer. The answer to a question about settings
/// takes some milliseconds.
const ASK_EVERY_MIN: Duration = Duration::from_millis(1);

/// Longest such time, during a measurement of many seconds.
const ASK_EVERY_MAX: Duration = Duration::from_millis(20);

/// An answer waits to be found for at most this share of its time, within the limits above.
const ASK_EVERY_SHARE: u32 = 20;

/// A request of the port.
#[derive(Debug)]
pub(super) enum Command {
    /// To send a message.
    Write { message: Vec<u8>, done: oneshot::Sender<io::Result<()>> },
    /// To clear the device. Later pieces have this epoch.
    Clear { epoch: u64, done: oneshot::Sender<io::Result<()>> },
}

/// The owner and its descriptor.
pub(super) struct Owner<D> {
    device: D,
    commands: Receiver<Command>,
    pieces: UnboundedSender<Piece>,
    epoch: u64,
    /// Time of the last message or piece of an answer, while an answer may come.
    asked: Option<Instant>,
}

/// The descriptor can no longer be used.
struct Gone;

impl<D: MessageDevice> Owner<D> {
    pub(super) fn new(
        device: D,
        commands: Receiver<Command>,
        pieces: UnboundedSender<Piece>,
    ) -> Self {
        Self { device, commands, pieces, epoch: 0, asked: None }
    }

    /// Serves the port until it is closed or the instrument is lost. The descriptor is closed before the port
    /// learns of it: an instrument that is plugged in again gets another name while the old one is open.
    pub(super) fn run(mut self) {
        loop {
            let command = match self.asked {
                None => self.commands.recv().map_err(|_| RecvTimeoutError::Disconnected),
                Some(asked) => self.commands.recv_timeout(wait_after(asked.elapsed())),
            };
            match command {
                Ok(Command::Write { message, done }) => {
                    let outcome = match self.device.write(&message) {
                        Ok(()) => {
                            self.asked = Some(Instant::now());
                            Ok(Ok(()))
                        }
                        Err(error) => self.recover(error),
                    };
                    match outcome {
                        Ok(outcome) => _ = done.send(outcome),
                        Err(Gone) => return self.close(move || _ = done.send(Err(lost()))),
                    }
                }
                Ok(Command::Clear { epoch, done }) => {
                    (self.epoch, self.asked) = (epoch, None);
                    match self.device.clear() {
                        Ok(()) => _ = done.send(Ok(())),
                        Err(_) => return self.close(move || _ = done.send(Err(lost()))),
                    }
                }
                Err(RecvTimeoutError::Timeout) => {
                    if let Err(Gone) = self.fetch() {
                        return self.close(|| {});
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// Reads a piece of an answer, if there is one.
    fn fetch(&mut self) -> Result<(), Gone> {
        let mut piece = Vec::new();
        let found = match self.device.has_answer() {
            Ok(false) => return Ok(()),
            Ok(true) => self.device.read(&mut piece),
            Err(error) => Err(error),
        };
        let outcome = match found {
            Ok(is_last) => {
                self.asked = (!is_last).then(Instant::now);
                Ok(piece)
            }
            Err(error) => self.recover(error)?.map(|()| piece),
        };
        // The port may have been closed.
        _ = self.pieces.send(Piece { epoch: self.epoch, outcome });
        Ok(())
    }

    /// Clears the device after an error, of which it is unknown how much of a message went.
    fn recover(&mut self, error: io::Error) -> Result<io::Result<()>, Gone> {
        self.asked = None;
        self.device.clear().map_err(|_| Gone)?;
        // Another error than a time limit gets no kind that a port takes for a loss.
        let is_late = error.kind() == ErrorKind::TimedOut;
        Ok(Err(if is_late { error } else { io::Error::other(error) }))
    }

    /// Closes the descriptor, and tells it then.
    fn close(self, tell: impl FnOnce()) {
        let Self { device, commands, pieces, .. } = self;
        drop((device, commands));
        tell();
        drop(pieces);
    }
}

/// The wait for the next question whether there is an answer.
fn wait_after(waited: Duration) -> Duration {
    (waited / ASK_EVERY_SHARE).clamp(ASK_EVERY_MIN, ASK_EVERY_MAX)
}
