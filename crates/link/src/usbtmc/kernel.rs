//! The device file of the driver `usbtmc`.

use std::{
    fs::File,
    io::{self, ErrorKind, Read, Write},
};

use rig_usbtmc::{MESSAGE_AVAILABLE, clear, has_message_ended, status_byte};

use crate::messages::MessageDevice;

/// Bytes that are asked for at a time. With the header of 12 bytes they are less than the buffer of the
/// driver, 4096, and no whole number of packets of USB, so that one transfer carries them.
const PIECE_BYTES: usize = 4080;

/// An instrument behind the driver, whose time limit is set.
#[derive(Debug)]
pub(super) struct KernelDevice(pub(super) File);

impl MessageDevice for KernelDevice {
    fn write(&mut self, message: &[u8]) -> io::Result<()> {
        // A second write would be a second message.
        let sent = self.0.write(message)?;
        if sent == message.len() { Ok(()) } else { Err(ErrorKind::WriteZero.into()) }
    }

    fn has_answer(&mut self) -> io::Result<bool> {
        Ok(status_byte(&self.0)? & MESSAGE_AVAILABLE != 0)
    }

    /// The driver returns no bytes for a transfer that it cannot read. The answer ends with it: nothing more
    /// comes, and the port clears the device when it has waited for long enough.
    fn read(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        piece.resize(PIECE_BYTES, 0);
        let received = self.0.read(piece)?;
        piece.truncate(received);
        Ok(received == 0 || has_message_ended(&self.0)?)
    }

    fn clear(&mut self) -> io::Result<()> {
        clear(&self.0)
    }
}
