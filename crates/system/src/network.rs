//! Connections and ports of the network.

use std::{io, time::Duration};

use rustix::fd::AsFd;

/// Whether the port of a program that has just ended may be asked for at once (`SO_REUSEADDR`).
///
/// On Unix that is all it does. On Windows it would let two programs listen on one port at the same time, and Windows gives the
/// port of an ended program without it.
pub const TAKES_PORT_OF_ENDED_PROGRAM: bool = cfg!(unix);

/// Where a program of the same computer reaches PostgreSQL: its socket on Debian. Windows has no such sockets for it.
pub const POSTGRESQL: &str = if cfg!(unix) { "/var/run/postgresql" } else { "localhost" };

/// Makes the system close a connection whose client has vanished.
///
/// Linux closes also that of a client that does not read for so long (`TCP_USER_TIMEOUT`). macOS and Windows have no such limit:
/// they ask the client three times within that time whether it is there, and one that is there and never reads keeps its
/// connection.
///
/// # Errors
/// [`io::Error`] of the socket.
pub fn limit_silence(stream: &impl AsFd, within: Duration) -> io::Result<()> {
    crate::system::limit_silence(stream, within)
}

/// Asks a client that says nothing whether it is there, and closes the connection after the time.
#[cfg(not(target_os = "linux"))]
pub(crate) fn ask_whether_it_is_there(stream: &impl AsFd, within: Duration) -> io::Result<()> {
    use rustix::net::sockopt;
    /// Questions, and parts of the time: the first one is asked after two of them.
    const QUESTIONS: u32 = 3;
    let stream = stream.as_fd();
    let part = (within / (QUESTIONS + 2)).max(Duration::from_secs(1));
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, 2 * part)?;
    sockopt::set_tcp_keepintvl(stream, part)?;
    Ok(sockopt::set_tcp_keepcnt(stream, QUESTIONS)?)
}
