//! The end of a program that a person or a service manager asks for.

use std::io;

/// Notices from now on that the program is to end.
///
/// On Unix: SIGINT and SIGTERM. On Windows: Ctrl-C, Ctrl-Break, a console that is closed, a user who logs off, and a computer
/// that shuts down. Windows waits for some seconds at most after the last three, and ends the program then.
#[derive(Debug)]
pub struct Ending(crate::system::Ending);

impl Ending {
    /// Begins to listen. Needs the runtime.
    ///
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn listen() -> io::Result<Self> {
        crate::system::Ending::listen().map(Self)
    }

    /// Waits for the next one. Cancel-safe.
    pub async fn asked_for(&mut self) {
        self.0.asked_for().await;
    }
}
