//! The analyzer on USB, as a socket that keeps the bounds of messages.
//!
//! It stands for the driver `usbtmc` of Linux, which gives a file with one message in each write. It is a Unix
//! socket of whole packets (`SOCK_SEQPACKET`), and the first byte of a packet says what it is: from the host
//! `>` a message and `!` a device clear; to the host `+` a piece of an answer, `.` its last piece, and `!` after a
//! device clear. A device that hangs up closes the socket, as one that is unplugged.

use std::{
    io,
    os::unix::fs::FileTypeExt,
    path::{Path, PathBuf},
};

use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, listen, socket_with,
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{UnixListener, UnixStream, unix::OwnedReadHalf},
    task::JoinSet,
};

use super::{ServeError, Server};
use crate::{PortId, SimHandle, SimPort};

const MESSAGE: u8 = b'>';
const CLEAR: u8 = b'!';
const PIECE: u8 = b'+';
const LAST_PIECE: u8 = b'.';

/// The longest message.
const MESSAGE_BYTES: usize = 65_536;

/// The longest piece of an answer: what a driver reads at a time.
const PIECE_BYTES: usize = 4080;

/// Clients that wait to be served.
const BACKLOG: i32 = 4;

/// A socket that clients connect to. Its file is removed when it is dropped.
#[derive(Debug)]
pub(super) struct Socket {
    path: PathBuf,
    /// The system reads and writes whole packets on it, as its type of socket says.
    listener: UnixListener,
}

impl Server {
    /// Serves the analyzer on a socket of whole packets at this path, in place of the device file of an instrument on
    /// USB. [`SOCK_SEQPACKET`](https://man7.org/linux/man-pages/man7/unix.7.html) is of Linux.
    ///
    /// # Errors
    /// [`ServeError::Socket`].
    pub fn open_usbtmc(&mut self, path: &Path) -> Result<(), ServeError> {
        let fail = |source| ServeError::Socket { path: path.to_owned(), source };
        let socket = Socket::open(path).map_err(fail)?;
        let handle = self.handle.clone();
        self.tasks.spawn(async move { socket.serve(&handle).await });
        Ok(())
    }
}

impl Socket {
    /// Makes the socket. One that an earlier run left behind is replaced; another file is not.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let is_socket = |file: std::fs::Metadata| file.file_type().is_socket();
        if path.symlink_metadata().is_ok_and(is_socket) {
            std::fs::remove_file(path)?;
        }
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let listener = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        bind(&listener, &SocketAddrUnix::new(path)?)?;
        listen(&listener, BACKLOG)?;
        Ok(Self { path: path.to_owned(), listener: UnixListener::from_std(listener.into())? })
    }

    /// Serves the clients that connect.
    pub(super) async fn serve(self, handle: &SimHandle) {
        let mut clients = JoinSet::new();
        loop {
            match self.listener.accept().await {
                Ok((client, _)) => {
                    tracing::info!(path = %self.path.display(), "client");
                    let handle = handle.clone();
                    clients.spawn(async move { serve_client(&handle, client).await });
                }
                Err(error) => {
                    tracing::error!(%error, "no further clients");
                    return;
                }
            }
            while clients.try_join_next().is_some() {}
        }
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        // It may have been removed already.
        _ = std::fs::remove_file(&self.path);
    }
}

/// Serves a client until either side hangs up. A device clear is a new connection to the instrument, which keeps
/// its settings and forgets what it was to say.
async fn serve_client(handle: &SimHandle, client: UnixStream) {
    let Some(mut port) = handle.plug(PortId::Analyzer) else { return };
    let (from, mut to) = client.into_split();
    let (mut packet, mut answer) = (vec![0; MESSAGE_BYTES], vec![0; PIECE_BYTES]);
    loop {
        let said = tokio::select! {
            received = receive(&from, &mut packet) => match received {
                Ok([MESSAGE, message @ ..]) => port.write_all(message).await,
                Ok([CLEAR]) => {
                    let Some(cleared) = handle.plug(PortId::Analyzer) else { return };
                    port = cleared;
                    to.write_all(&[CLEAR]).await
                }
                Ok(_) | Err(_) => return,
            },
            answered = read_piece(&mut port, &mut answer) => match answered {
                Ok((kind, piece)) => to.write_all(&[&[kind], piece].concat()).await,
                Err(error) => Err(error),
            },
        };
        if said.is_err() {
            return;
        }
    }
}

/// The next packet; an empty one at the end. A read of the runtime would take the end of a packet for the end of all
/// that has arrived.
async fn receive<'a>(client: &OwnedReadHalf, packet: &'a mut [u8]) -> io::Result<&'a [u8]> {
    loop {
        client.readable().await?;
        match client.try_read(packet) {
            Ok(read) => return Ok(&packet[..read]),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
    }
}

/// A piece of an answer. A line feed ends the answers of every analyzer.
async fn read_piece<'a>(port: &mut SimPort, answer: &'a mut [u8]) -> io::Result<(u8, &'a [u8])> {
    let read = port.read(answer).await?;
    let piece = &answer[..read];
    match piece.last() {
        None => Err(io::ErrorKind::UnexpectedEof.into()),
        Some(b'\n') => Ok((LAST_PIECE, piece)),
        Some(_) => Ok((PIECE, piece)),
    }
}
