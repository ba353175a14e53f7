//! Faults between the host and a device, as a port sees them.

use std::{fmt, io, sync::Arc, time::Duration};

use rig_model::PortKind;

use crate::Holder;

/// The line failed: it is unknown whether the device received or did anything.
///
/// That a device understood and refused is never one of these; the drivers have types for it.
#[derive(Debug, Clone, thiserror::Error)]
pub enum LineError {
    /// Nothing, or not all of it, arrived in time.
    #[error("{port}: no complete answer within {} ms, {arrived}", waited.as_millis())]
    TimedOut {
        /// Name of the port.
        port: Arc<str>,
        /// Duration of the wait.
        waited: Duration,
        /// The incomplete answer.
        arrived: Box<PartialAnswer>,
    },
    /// The other side takes no bytes.
    #[error("{port}: {bytes} bytes could not be sent within {} ms", waited.as_millis())]
    Blocked {
        /// Name of the port.
        port: Arc<str>,
        /// Number of bytes to send.
        bytes: usize,
        /// Duration of the attempts.
        waited: Duration,
    },
    /// Unexpected bytes keep arriving.
    #[error("{port}: not silent after {} ms, {discarded} bytes discarded", waited.as_millis())]
    NeverSilent {
        /// Name of the port.
        port: Arc<str>,
        /// Duration of the wait for silence.
        waited: Duration,
        /// Number of discarded bytes.
        discarded: usize,
    },
    /// The adapter has disappeared, or the other side has closed the connection.
    #[error("{port}: {}", match kind {
        PortKind::Serial | PortKind::Usb => "the port has disappeared",
        PortKind::Network => "closed by the other side",
    })]
    Lost {
        /// Name of the port.
        port: Arc<str>,
        /// What the port is to this computer.
        kind: PortKind,
    },
    /// A device clear does not end.
    #[error("{port}: the device is not cleared within {} ms", waited.as_millis())]
    NotCleared {
        /// Name of the port.
        port: Arc<str>,
        /// Duration of the wait.
        waited: Duration,
    },
    /// The operating system reports an error.
    #[error("{port}: input or output failed")]
    Io {
        /// Name of the port.
        port: Arc<str>,
        /// The error of the operating system.
        #[source]
        source: Arc<io::Error>,
    },
}

/// The bytes of an incomplete answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PartialAnswer {
    /// All of it.
    pub bytes: Vec<u8>,
    /// From the end of the question to the last byte.
    pub last_after: Duration,
}

impl fmt::Display for PartialAnswer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let n = self.bytes.len();
        if n == 0 {
            return f.write_str("nothing arrived");
        }
        let bytes = if n == 1 { "byte" } else { "bytes" };
        let (last, shown) = (self.last_after.as_millis(), escaped(&self.bytes));
        write!(f, "{n} {bytes} arrived, the last after {last} ms: `{shown}`")
    }
}

/// Bytes in readable form. The middle of a long text is left out.
pub fn escaped(bytes: &[u8]) -> String {
    /// Bytes that are shown of the beginning and of the end.
    const SHOWN: usize = 40;
    if bytes.len() <= 2 * SHOWN {
        return bytes.escape_ascii().to_string();
    }
    let (begin, end) = (&bytes[..SHOWN], &bytes[bytes.len() - SHOWN..]);
    format!("{}…{}", begin.escape_ascii(), end.escape_ascii())
}

/// A port could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is no such device.
    #[error("{port}: no such port")]
    Absent {
        /// Name of the port.
        port: Arc<str>,
    },
    /// The file with this name is not such a port.
    #[error("{port}: {what}, not {wanted}")]
    NotAPort {
        /// The name given.
        port: Arc<str>,
        /// Kind of the file.
        what: &'static str,
        /// Kind of the port.
        wanted: &'static str,
    },
    /// The driver of instruments on USB does not give the status byte, which says when there is an answer.
    #[error(
        "{port}: the driver usbtmc of this Linux does not give the status byte of the instrument"
    )]
    NoStatusByte {
        /// Name of the port.
        port: Arc<str>,
    },
    /// A program has it, perhaps this one as another port.
    #[error("{port}: held by {}", names(holders))]
    Busy {
        /// Name of the port.
        port: Arc<str>,
        /// Which, as far as this user may know.
        holders: Vec<Holder>,
    },
    /// This user may not.
    #[error("{port}: permission denied")]
    Permission {
        /// Name of the port.
        port: Arc<str>,
    },
    /// No answer came from the address in time.
    #[error("{port}: no connection within {} ms", waited.as_millis())]
    TimedOut {
        /// Name of the port.
        port: Arc<str>,
        /// Duration of the attempts.
        waited: Duration,
    },
    /// The connection was refused, or there is no way to the address.
    #[error("{port}: cannot be connected to")]
    Unconnected {
        /// Name of the port.
        port: Arc<str>,
        /// The error of the operating system.
        #[source]
        source: io::Error,
    },
    /// The operating system reports another error.
    #[error("{port}: cannot be opened")]
    Io {
        /// Name of the port.
        port: Arc<str>,
        /// The error of the operating system.
        #[source]
        source: io::Error,
    },
}

/// The programs by name, or that there is one.
fn names(holders: &[Holder]) -> String {
    if holders.is_empty() {
        return "a program that this user may not see".to_owned();
    }
    holders.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}
