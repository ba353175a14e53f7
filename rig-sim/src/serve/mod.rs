//! Serves the ports of a rig to any program, in real time: pseudo-terminals, TCP, a socket that stands for an
//! instrument on USB, and a control connection beside them.
//!
//! Several clients may be connected at once, so that a client that vanished does not keep others
//! out.

mod pty;
#[cfg(target_os = "linux")]
mod usbtmc;

use std::{
    io,
    net::SocketAddr,
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use tokio::{
    io::{AsyncBufReadExt, AsyncWriteExt, BufReader},
    net::{TcpListener, TcpStream},
    sync::Notify,
    task::JoinSet,
};

use self::pty::Pty;
use crate::{Connection, LineTransport, PortId, Rig, SimHandle, control};

/// Longest gap that an operating system may put inside one frame.
const PATIENCE: Duration = Duration::from_millis(20);

/// Why a port cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// A pseudo-terminal cannot be opened.
    #[error("pseudo-terminal")]
    Pty(#[source] io::Error),
    /// A link to a pseudo-terminal cannot be made.
    #[error("link {}", link.display())]
    Link {
        /// Path of the link.
        link: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A socket cannot be made.
    #[error("socket {}", path.display())]
    Socket {
        /// Path of the socket.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// An address cannot be listened on.
    #[error("{address}")]
    Listen {
        /// Address of the listener.
        address: SocketAddr,
        /// The error of the system.
        source: io::Error,
    },
}

/// A port of the rig and how its frames are carried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The analyzer: messages of text.
    Analyzer,
    /// The line of the drives.
    Bus(LineTransport),
}

/// The ports that are served. They close when it is dropped.
#[derive(Debug)]
pub struct Server {
    handle: SimHandle,
    tasks: JoinSet<()>,
    free: Arc<Notify>,
}

impl Server {
    /// Serves no port yet.
    pub fn new(handle: SimHandle) -> Self {
        Self { handle, tasks: JoinSet::new(), free: Arc::default() }
    }

    /// Serves a port on a new pseudo-terminal, to which `link` points, if given. Returns the path
    /// of the terminal. When the device hangs up, that path goes away and the link points to a new
    /// one, as when an adapter is unplugged and plugged in again.
    ///
    /// # Errors
    /// [`ServeError::Pty`], [`ServeError::Link`].
    pub fn open_pty(&mut self, role: Role, link: Option<&Path>) -> Result<PathBuf, ServeError> {
        let (pty, link) = plug_in(link)?;
        let path = pty.path().to_owned();
        let (handle, free) = (self.handle.clone(), self.free.clone());
        self.tasks.spawn(async move { serve_ptys(&handle, role, pty, link, &free).await });
        Ok(path)
    }

    /// Waits until a pseudo-terminal is ready for its next client: the last one has closed and the
    /// settings of the terminal were restored, or the terminal was plugged in again. Events since
    /// the last call count once.
    pub async fn port_is_free(&self) {
        self.free.notified().await;
    }

    /// Serves a port on TCP. Returns the address, with the port that was chosen where it was 0.
    ///
    /// # Errors
    /// [`ServeError::Listen`].
    pub async fn listen(
        &mut self,
        role: Role,
        address: SocketAddr,
    ) -> Result<SocketAddr, ServeError> {
        let (listener, address) = bind(address).await?;
        let handle = self.handle.clone();
        self.tasks.spawn(async move { serve_tcp(&handle, role, listener).await });
        Ok(address)
    }

    /// Serves the analyzer on a socket of whole packets at this path, in place of the device file of an instrument on
    /// USB. [`SOCK_SEQPACKET`](https://man7.org/linux/man-pages/man7/unix.7.html) is of Linux.
    ///
    /// # Errors
    /// [`ServeError::Socket`].
    #[cfg(target_os = "linux")]
    pub fn open_usbtmc(&mut self, path: &Path) -> Result<(), ServeError> {
        let fail = |source| ServeError::Socket { path: path.to_owned(), source };
        let socket = usbtmc::Socket::open(path).map_err(fail)?;
        let handle = self.handle.clone();
        self.tasks.spawn(async move { socket.serve(&handle).await });
        Ok(())
    }

    /// Serves the control connection on TCP.
    ///
    /// # Errors
    /// [`ServeError::Listen`].
    pub async fn listen_control(&mut self, address: SocketAddr) -> Result<SocketAddr, ServeError> {
        let (listener, address) = bind(address).await?;
        let handle = self.handle.clone();
        self.tasks.spawn(async move {
            let mut clients = JoinSet::new();
            while let Some((stream, peer)) = accept(&listener).await {
                tracing::info!(%peer, "control");
                let handle = handle.clone();
                clients.spawn(async move { serve_control(&handle, stream).await });
                while clients.try_join_next().is_some() {}
            }
        });
        Ok(address)
    }
}

/// A symbolic link that is removed when it is dropped.
#[derive(Debug)]
struct Link(PathBuf);

impl Link {
    fn make(target: &Path, link: &Path) -> Result<Self, ServeError> {
        let fail = |source| ServeError::Link { link: link.to_owned(), source };
        // A link that an earlier run left behind is replaced; anything else is not.
        if link.symlink_metadata().is_ok_and(|metadata| metadata.is_symlink()) {
            std::fs::remove_file(link).map_err(fail)?;
        }
        std::os::unix::fs::symlink(target, link).map_err(fail)?;
        Ok(Self(link.to_owned()))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // The receiver may have been dropped already.
        _ = std::fs::remove_file(&self.0);
    }
}

fn connect(handle: &SimHandle, role: Role) -> Connection {
    match role {
        Role::Analyzer => handle.with(|_, rig| rig.connect(PortId::Analyzer)),
        Role::Bus(transport) => Rig::connect_bus(transport, PATIENCE),
    }
}

/// A new pseudo-terminal with the link that points to it.
fn plug_in(link: Option<&Path>) -> Result<(Pty, Option<Link>), ServeError> {
    let pty = Pty::open().map_err(ServeError::Pty)?;
    let link = link.map(|link| Link::make(pty.path(), link)).transpose()?;
    Ok((pty, link))
}

/// Serves one terminal after the other: a new one each time that the device hangs up.
async fn serve_ptys(
    handle: &SimHandle,
    role: Role,
    mut pty: Pty,
    mut link: Option<Link>,
    free: &Notify,
) {
    loop {
        let served = serve_pty(handle, role, &mut pty, free).await;
        if let Err(error) = served {
            tracing::error!(path = %pty.path().display(), %error, "clients cannot be watched");
            return;
        }
        let place = link.take().map(|link| link.0.clone());
        let gone = pty.path().to_owned();
        drop(pty);
        (pty, link) = match plug_in(place.as_deref()) {
            Ok(plugged) => plugged,
            Err(error) => {
                tracing::error!(%error, "the terminal did not come back");
                return;
            }
        };
        tracing::info!(gone = %gone.display(), path = %pty.path().display(), "plugged in again");
        free.notify_one();
    }
}

/// Serves a terminal until the device hangs up. It does not notice clients: like a device on a
/// cable it sees only bytes.
async fn serve_pty(handle: &SimHandle, role: Role, pty: &mut Pty, free: &Notify) -> io::Result<()> {
    let (terminal, line, clients) = pty.parts();
    let mut serving = std::pin::pin!(handle.serve(connect(handle, role), terminal));
    loop {
        tokio::select! {
            biased;
            () = &mut serving => return Ok(()),
            gone = clients.gone() => {
                gone?;
                line.refresh().await?;
                free.notify_one();
            }
        }
    }
}

async fn serve_tcp(handle: &SimHandle, role: Role, listener: TcpListener) {
    let mut clients = JoinSet::new();
    while let Some((stream, peer)) = accept(&listener).await {
        tracing::info!(%peer, ?role, "client");
        let (handle, connection) = (handle.clone(), connect(handle, role));
        clients.spawn(async move { handle.serve(connection, stream).await });
        while clients.try_join_next().is_some() {}
    }
}

async fn serve_control(handle: &SimHandle, stream: TcpStream) {
    let mut stream = BufReader::new(stream);
    let mut line = String::new();
    loop {
        line.clear();
        match stream.read_line(&mut line).await {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let answer = match handle.with(|now, rig| control::execute(now, rig, &line)) {
            Ok(answer) => answer,
            Err(error) => format!("error: {error}"),
        };
        if stream.write_all(format!("{answer}\n").as_bytes()).await.is_err() {
            return;
        }
    }
}

async fn bind(address: SocketAddr) -> Result<(TcpListener, SocketAddr), ServeError> {
    let fail = |source| ServeError::Listen { address, source };
    let listener = TcpListener::bind(address).await.map_err(fail)?;
    let address = listener.local_addr().map_err(fail)?;
    Ok((listener, address))
}

/// The next client; `None` when there will be none any more.
async fn accept(listener: &TcpListener) -> Option<(TcpStream, SocketAddr)> {
    loop {
        match listener.accept().await {
            Ok((stream, peer)) => {
                // Answers are small and the client waits for them, so that collecting them would
                // only delay them.
                if stream.set_nodelay(true).is_ok() {
                    return Some((stream, peer));
                }
            }
            // A client that went away while it waited, or too many open files for a moment.
            Err(error) => {
                tracing::warn!(%error, "a client could not be accepted");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}
