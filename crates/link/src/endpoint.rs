//! The address of a port, and how it is opened and reopened.

use std::{fmt, io, os::unix::fs::FileTypeExt, path::Path, sync::Arc, time::Duration};

use tokio::{net::TcpStream, time::timeout};
use tokio_serial::SerialPortBuilderExt;

use crate::{OpenError, Transport, attached};
use rig_model::{LineSettings, Parity, StopBits};

/// Time limit of a TCP connection attempt.
const CONNECT_WITHIN: Duration = Duration::from_secs(3);

/// Where a port is.
pub enum Endpoint {
    /// A serial port of this computer. A path below `/dev/serial/by-id` stays the same when the
    /// adapter is plugged in elsewhere.
    Serial {
        /// The device file.
        path: String,
        /// Speed and format of the characters.
        line: LineSettings,
    },
    /// A port of the network.
    Tcp {
        /// `host:port`.
        address: String,
    },
    /// A pipe in memory, to a simulated device.
    Memory {
        /// The name that people read.
        name: Arc<str>,
        /// The settings of the serial line that the pipe represents, if any.
        line: Option<LineSettings>,
        /// Lays the next pipe. None when there is no more.
        plug: Plug,
    },
}

/// Connects a pipe to a simulated device, and another one after a loss.
pub type Plug = Box<dyn FnMut() -> Option<Box<dyn Transport>> + Send>;

impl Endpoint {
    /// The name that people read.
    pub fn name(&self) -> Arc<str> {
        match self {
            Self::Serial { path, .. } => path.as_str().into(),
            Self::Tcp { address } => address.as_str().into(),
            Self::Memory { name, .. } => name.clone(),
        }
    }

    /// The settings of the line on which characters take their time, if there is one. A
    /// pseudo-terminal has settings, but no line.
    pub fn line(&self) -> Option<LineSettings> {
        match self {
            Self::Serial { path, line } => (!is_pseudo_terminal(path)).then_some(*line),
            Self::Tcp { .. } => None,
            Self::Memory { line, .. } => *line,
        }
    }

    /// Opens it, for this program alone where that can be had.
    pub(crate) async fn connect(&mut self) -> Result<Box<dyn Transport>, OpenError> {
        let port = self.name();
        match self {
            Self::Serial { path, line } => {
                let transport = open_serial(&port, path, *line)?;
                // The name of the adapter itself finds it again at another place.
                if let Some(stable) = attached::stable_name(Path::new(path)) {
                    *path = stable;
                }
                Ok(transport)
            }
            Self::Tcp { address } => connect_tcp(&port, address).await,
            Self::Memory { plug, .. } => plug().ok_or(OpenError::Absent { port }),
        }
    }
}

impl fmt::Debug for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Endpoint({})", self.name())
    }
}

fn is_pseudo_terminal(path: &str) -> bool {
    std::fs::canonicalize(path).is_ok_and(|device| device.starts_with("/dev/pts"))
}

fn open_serial(
    port: &Arc<str>,
    path: &str,
    line: LineSettings,
) -> Result<Box<dyn Transport>, OpenError> {
    let parity = match line.parity {
        Parity::None => tokio_serial::Parity::None,
        Parity::Even => tokio_serial::Parity::Even,
        Parity::Odd => tokio_serial::Parity::Odd,
    };
    let stop_bits = match line.stop_bits {
        StopBits::One => tokio_serial::StopBits::One,
        StopBits::Two => tokio_serial::StopBits::Two,
    };
    // The device file behind any symbolic links: the lock of the library is on it.
    let device = std::fs::canonicalize(path).unwrap_or_else(|_| path.into());
    if let Some(what) = what_it_is(&device) {
        return Err(OpenError::NotAPort { port: port.clone(), what });
    }
    let stream = tokio_serial::new(device.to_string_lossy(), line.baud)
        .parity(parity)
        .stop_bits(stop_bits)
        .open_native_async();
    match stream {
        Ok(stream) => Ok(Box::new(stream)),
        Err(error) => Err(explain(port.clone(), &device, error)),
    }
}

/// The kind of a file that is not a character device. A missing file shows when it is opened.
fn what_it_is(path: &Path) -> Option<&'static str> {
    let kind = std::fs::metadata(path).ok()?.file_type();
    if kind.is_char_device() {
        None
    } else if kind.is_dir() {
        Some("a directory")
    } else if kind.is_file() {
        Some("a file")
    } else {
        Some("a pipe, a socket or a disk")
    }
}

fn explain(port: Arc<str>, device: &Path, error: tokio_serial::Error) -> OpenError {
    use io::ErrorKind::{NotFound, PermissionDenied};
    use tokio_serial::ErrorKind::{Io, NoDevice};
    match error.kind() {
        Io(PermissionDenied) => OpenError::Permission { port },
        Io(NotFound) => OpenError::Absent { port },
        // The library reports the same when another program holds the lock.
        NoDevice if device.exists() => OpenError::Busy { port, holders: attached::holders(device) },
        NoDevice => OpenError::Absent { port },
        _ => OpenError::Io { port, source: error.into() },
    }
}

async fn connect_tcp(port: &Arc<str>, address: &str) -> Result<Box<dyn Transport>, OpenError> {
    let (waited, port) = (CONNECT_WITHIN, port.clone());
    let Ok(connected) = timeout(waited, TcpStream::connect(address)).await else {
        return Err(OpenError::TimedOut { port, waited });
    };
    // Requests are small and each waits for its answer, so that collecting them would only delay
    // them.
    let stream = connected.and_then(|stream| stream.set_nodelay(true).map(|()| stream));
    match stream {
        Ok(stream) => Ok(Box::new(stream)),
        Err(source) => Err(OpenError::Unconnected { port, source }),
    }
}
