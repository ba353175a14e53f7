//! A socket in place of a driver, behind which a program plays the instrument.
//!
//! It is a Unix socket of whole packets (`SOCK_SEQPACKET`). The first byte of a packet says what it is:
//!
//! | from the host | meaning |
//! |---|---|
//! | `>` | a message, whole |
//! | `!` | device clear |
//!
//! | from the instrument | meaning |
//! |---|---|
//! | `+` | a piece of an answer, of which more comes |
//! | `.` | the last piece of an answer |
//! | `!` | the device is cleared |
//!
//! The instrument closes the socket as one that is unplugged.

use std::{
    io::{self, ErrorKind},
    path::Path,
    time::Duration,
};

use rustix::{
    fd::OwnedFd,
    io::Errno,
    net::{
        AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketFlags, SocketType, connect,
        recv, send, socket_with,
        sockopt::{Timeout, set_socket_timeout},
    },
};

use crate::messages::MessageDevice;

const MESSAGE: u8 = b'>';
const CLEAR: u8 = b'!';
const PIECE: u8 = b'+';
const LAST_PIECE: u8 = b'.';

/// The longest packet.
const PACKET_BYTES: usize = 65_536;

/// The end of the host.
#[derive(Debug)]
pub(crate) struct SocketDevice(OwnedFd);

impl SocketDevice {
    pub(super) fn connect(path: &Path, within: Duration) -> io::Result<Self> {
        let socket =
            socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, SocketFlags::CLOEXEC, None)?;
        connect(&socket, &SocketAddrUnix::new(path)?)?;
        Self::over(socket, within)
    }

    /// Sets the time limit of each packet, as the driver has one.
    pub(crate) fn over(socket: OwnedFd, within: Duration) -> io::Result<Self> {
        set_socket_timeout(&socket, Timeout::Send, Some(within))?;
        set_socket_timeout(&socket, Timeout::Recv, Some(within))?;
        Ok(Self(socket))
    }

    fn send(&self, packet: &[u8]) -> io::Result<()> {
        send(&self.0, packet, SendFlags::NOSIGNAL).map(drop).map_err(as_of_a_driver)
    }

    /// The kind of the next packet and its bytes.
    fn receive(&self, bytes: &mut Vec<u8>) -> io::Result<u8> {
        bytes.resize(PACKET_BYTES, 0);
        let (received, _) =
            recv(&self.0, bytes.as_mut_slice(), RecvFlags::empty()).map_err(as_of_a_driver)?;
        bytes.truncate(received);
        let kind = *bytes.first().ok_or(ErrorKind::UnexpectedEof)?;
        bytes.remove(0);
        Ok(kind)
    }
}

impl MessageDevice for SocketDevice {
    fn write(&mut self, message: &[u8]) -> io::Result<()> {
        self.send(&[&[MESSAGE], message].concat())
    }

    fn has_answer(&mut self) -> io::Result<bool> {
        let flags = RecvFlags::PEEK | RecvFlags::DONTWAIT;
        match recv(&self.0, &mut [0_u8; 1][..], flags) {
            // The end of the socket is found by reading it.
            Ok(_) => Ok(true),
            Err(Errno::AGAIN) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    fn read(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        match self.receive(piece)? {
            PIECE => Ok(false),
            LAST_PIECE => Ok(true),
            _ => Err(ErrorKind::InvalidData.into()),
        }
    }

    fn clear(&mut self) -> io::Result<()> {
        self.send(&[CLEAR])?;
        let mut late = Vec::new();
        while self.receive(&mut late)? != CLEAR {}
        Ok(())
    }
}

/// A packet that took longer than its time limit (`EAGAIN`) is what a driver calls `ETIMEDOUT`.
fn as_of_a_driver(error: Errno) -> io::Error {
    if error == Errno::AGAIN { ErrorKind::TimedOut.into() } else { error.into() }
}
