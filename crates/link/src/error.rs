//! What goes wrong between the host and a device, as far as a port can tell.

use std::{io, sync::Arc, time::Duration};

use crate::Holder;

/// The line failed: what the device heard or did is not known.
///
/// That a device understood and refused is never one of these; the drivers have types for it.
#[derive(Debug, Clone, thiserror::Error)]
pub enum LineError {
    /// Nothing, or not all of it, arrived in time.
    #[error("{port}: no complete answer within {} ms, {received} bytes arrived", waited.as_millis())]
    TimedOut {
        /// Name of the port.
        port: Arc<str>,
        /// How long it was waited for.
        waited: Duration,
        /// How much arrived.
        received: usize,
    },
    /// The other side takes no bytes.
    #[error("{port}: {bytes} bytes could not be sent within {} ms", waited.as_millis())]
    Blocked {
        /// Name of the port.
        port: Arc<str>,
        /// How many bytes were to be sent.
        bytes: usize,
        /// How long it was tried.
        waited: Duration,
    },
    /// Bytes keep coming that nobody asked for.
    #[error("{port}: not silent after {} ms, {discarded} bytes discarded", waited.as_millis())]
    NeverSilent {
        /// Name of the port.
        port: Arc<str>,
        /// How long silence was waited for.
        waited: Duration,
        /// How much was thrown away.
        discarded: usize,
    },
    /// The adapter was unplugged, or the other side closed the connection.
    #[error("{port}: unplugged, or closed by the other side")]
    Lost {
        /// Name of the port.
        port: Arc<str>,
    },
    /// The operating system reports an error.
    #[error("{port}: input or output failed")]
    Io {
        /// Name of the port.
        port: Arc<str>,
        /// What it reports.
        #[source]
        source: Arc<io::Error>,
    },
}

/// A port could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is no such device.
    #[error("{port}: no such port; is it plugged in?")]
    Absent {
        /// Name of the port.
        port: Arc<str>,
    },
    /// Another program has it.
    #[error("{port}: held by {}", names(holders))]
    Busy {
        /// Name of the port.
        port: Arc<str>,
        /// Which, as far as this user may know.
        holders: Vec<Holder>,
    },
    /// This user may not.
    #[error("{port}: permission denied; serial ports usually belong to the group dialout")]
    Permission {
        /// Name of the port.
        port: Arc<str>,
    },
    /// Nobody answered at the address in time.
    #[error("{port}: no connection within {} ms", waited.as_millis())]
    TimedOut {
        /// Name of the port.
        port: Arc<str>,
        /// How long it was tried.
        waited: Duration,
    },
    /// The operating system reports another error.
    #[error("{port}: cannot be opened")]
    Io {
        /// Name of the port.
        port: Arc<str>,
        /// What it reports.
        #[source]
        source: io::Error,
    },
}

/// The programs by name, or that there is one.
fn names(holders: &[Holder]) -> String {
    if holders.is_empty() {
        return "another program".to_owned();
    }
    holders.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}
