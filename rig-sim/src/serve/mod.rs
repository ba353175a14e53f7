//! Serves the ports of a rig to any program, in real time: pseudo-terminals, TCP, a socket that stands for an
//! instrument on USB, and a control connection beside them.
//!
//! Several clients may be connected at once, so that a client that vanished does not keep others
//! out.

#[cfg(target_os = "linux")]
mod pty;
// They are watched by inotify.
#[cfg(target_os = "linux")]
mod terminals;
#[cfg(target_os = "linux")]
mod usbtmc;

use std::{io, net::SocketAddr, path::PathBuf, sync::Arc, time::Duration};

use tokio::{
    io::{AsyncBufReadExt, AsyncWriteExt, BufReader},
    net::{TcpListener, TcpStream},
    sync::Notify,
    task::JoinSet,
};

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
    #[cfg_attr(not(target_os = "linux"), expect(dead_code, reason = "of pseudo-terminals"))]
    free: Arc<Notify>,
}

impl Server {
    /// Serves no port yet.
    pub fn new(handle: SimHandle) -> Self {
        Self { handle, tasks: JoinSet::new(), free: Arc::default() }
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

fn connect(handle: &SimHandle, role: Role) -> Connection {
    match role {
        Role::Analyzer => handle.with(|_, rig| rig.connect(PortId::Analyzer)),
        Role::Bus(transport) => Rig::connect_bus(transport, PATIENCE),
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
