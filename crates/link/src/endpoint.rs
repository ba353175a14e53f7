//! The address of a port, and how it is opened and reopened.

use std::{fmt, io, path::Path, sync::Arc, time::Duration};

use tokio::{net::TcpStream, time::timeout};
use tokio_serial::SerialPortBuilderExt;

use crate::{
    OpenError, Transport, attached,
    device::{device_of, is_pseudo_terminal, is_there, what_it_is},
    transport::Carrier,
};
use rig_model::{LineSettings, Parity, PortKind, StopBits};

/// Time limit of a TCP connection attempt.
const CONNECT_WITHIN: Duration = Duration::from_secs(3);

/// Time limit for an instrument on USB to be free and to give its status byte. The driver waits for 5 s for a
/// request that an instrument does not answer.
#[cfg(target_os = "linux")]
const USBTMC_OPENS_WITHIN: Duration = Duration::from_secs(11);

/// What a serial port is called in a message.
const SERIAL_PORT: &str = if cfg!(windows) { "one such as COM3" } else { "a serial port" };

/// Where a port is.
pub enum Endpoint {
    /// A serial port of this computer. A path below `/dev/serial/by-id` stays the same when the
    /// adapter is plugged in elsewhere.
    Serial {
        /// The device file; on Windows the name, such as `COM3`.
        path: String,
        /// Speed and format of the characters.
        line: LineSettings,
    },
    /// A port of the network.
    Tcp {
        /// `host:port`.
        address: String,
    },
    /// An instrument on USB, behind the driver `usbtmc` of Linux; or a socket that stands for one, as the
    /// program `rig-sim` serves it.
    Usbtmc {
        /// The device file, such as `/dev/usbtmc0`, or a link to it, or the socket.
        path: String,
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
            Self::Serial { path, .. } | Self::Usbtmc { path } => path.as_str().into(),
            Self::Tcp { address } => address.as_str().into(),
            Self::Memory { name, .. } => name.clone(),
        }
    }

    /// The settings of the line on which characters take their time, if there is one. A
    /// pseudo-terminal has settings, but no line.
    pub fn line(&self) -> Option<LineSettings> {
        match self {
            Self::Serial { path, line } => (!is_pseudo_terminal(path)).then_some(*line),
            Self::Tcp { .. } | Self::Usbtmc { .. } => None,
            Self::Memory { line, .. } => *line,
        }
    }

    /// What kind of port it is, or stands for.
    pub const fn kind(&self) -> PortKind {
        match self {
            Self::Serial { .. } | Self::Memory { line: Some(_), .. } => PortKind::Serial,
            Self::Tcp { .. } | Self::Memory { line: None, .. } => PortKind::Network,
            Self::Usbtmc { .. } => PortKind::Usb,
        }
    }

    /// The file of the operating system, if it is one.
    pub(crate) fn file(&self) -> Option<&Path> {
        match self {
            Self::Serial { path, .. } | Self::Usbtmc { path } => Some(Path::new(path)),
            Self::Tcp { .. } | Self::Memory { .. } => None,
        }
    }

    /// Opens it, for this program alone where that can be had.
    pub(crate) async fn connect(&mut self) -> Result<Carrier, OpenError> {
        let port = self.name();
        let carrier = match self {
            Self::Serial { path, line } => Carrier::Bytes(open_serial(&port, path, *line)?),
            Self::Tcp { address } => Carrier::Bytes(connect_tcp(&port, address).await?),
            Self::Usbtmc { path } => open_usbtmc(port, path.clone()).await?,
            Self::Memory { plug, .. } => Carrier::Bytes(plug().ok_or(OpenError::Absent { port })?),
        };
        // The name of the adapter or instrument itself finds it again at another place.
        if let Self::Serial { path, .. } | Self::Usbtmc { path } = self
            && let Some(own) = attached::own_name(Path::new(path))
        {
            *path = own;
        }
        Ok(carrier)
    }
}

impl fmt::Debug for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Endpoint({})", self.name())
    }
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
    let device = device_of(Path::new(path)).unwrap_or_else(|| path.into());
    if let Some(what) = what_it_is(&device) {
        return Err(OpenError::NotAPort { port: port.clone(), what, wanted: SERIAL_PORT });
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

/// Opens an instrument on USB in a thread of its own: its driver may wait, and the end of the program must not.
#[cfg(target_os = "linux")]
async fn open_usbtmc(port: Arc<str>, path: String) -> Result<Carrier, OpenError> {
    let (done, opened) = tokio::sync::oneshot::channel();
    let name = port.clone();
    // What is opened too late is closed again.
    let open = move || _ = done.send(crate::usbtmc::open(&name, &path));
    let thread = std::thread::Builder::new().name("usbtmc-open".to_owned()).spawn(open);
    thread.map_err(|source| OpenError::Io { port: port.clone(), source })?;
    match timeout(USBTMC_OPENS_WITHIN, opened).await {
        Ok(Ok(opened)) => opened.map(Carrier::Messages),
        Ok(Err(ended)) => Err(OpenError::Io { port, source: io::Error::other(ended) }),
        Err(_) => Err(OpenError::Io { port, source: io::ErrorKind::TimedOut.into() }),
    }
}

#[cfg(not(target_os = "linux"))]
#[expect(clippy::unused_async, reason = "the same signature as on Linux")]
async fn open_usbtmc(port: Arc<str>, _: String) -> Result<Carrier, OpenError> {
    Err(OpenError::Io { port, source: io::ErrorKind::Unsupported.into() })
}

fn explain(port: Arc<str>, device: &Path, error: tokio_serial::Error) -> OpenError {
    use io::ErrorKind::{NotFound, PermissionDenied};
    use tokio_serial::ErrorKind::{Io, NoDevice};
    match error.kind() {
        Io(PermissionDenied) => OpenError::Permission { port },
        Io(NotFound) => OpenError::Absent { port },
        // The library reports the same when another program holds the lock.
        NoDevice if is_there(device) => {
            OpenError::Busy { port, holders: attached::holders(device) }
        }
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
