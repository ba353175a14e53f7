//! The ports on which the daemon answers.

use std::{
    io,
    net::{Ipv4Addr, SocketAddr},
};

use axum::Router;
use listenfd::ListenFd;
use rig_system::network::TAKES_PORT_OF_ENDED_PROGRAM;
use tokio::{
    net::{TcpListener, TcpSocket},
    task::JoinHandle,
};
use tokio_util::sync::CancellationToken;

use super::{Failure, screen::say, settings::Settings};
use crate::{
    endpoint::{Announced, Endpoint},
    http::{self, tls::Tls},
    tokens::Secret,
};

/// Where the daemon is to listen.
#[derive(Debug)]
pub(super) enum Listening {
    /// At an address that is not bound yet.
    At(SocketAddr),
    /// On a socket that the service manager has opened, and its address: `LISTEN_FDS` and `LISTEN_PID` name it, as systemd
    /// and `systemd-socket-activate` write them.
    On(std::net::TcpListener, SocketAddr),
}

impl Listening {
    /// The socket that is given to this program, or the address of the settings without one. It is asked for once, before
    /// there are threads.
    ///
    /// # Errors
    /// [`Failure::Sockets`] if there are several, [`Failure::Socket`] for one that is no TCP socket.
    pub(super) fn of(settings: SocketAddr) -> Result<Self, Failure> {
        let mut given = ListenFd::from_env();
        match given.len() {
            0 => return Ok(Self::At(settings)),
            1 => {}
            count => return Err(Failure::Sockets { count }),
        }
        let failed = |source| Failure::Socket { source };
        let Some(listener) = given.take_tcp_listener(0).map_err(failed)? else {
            return Ok(Self::At(settings));
        };
        listener.set_nonblocking(true).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        Ok(Self::On(listener, address))
    }

    /// The address; its port may be 0 for any that is free.
    pub(super) const fn address(&self) -> SocketAddr {
        match self {
            Self::At(address) | Self::On(_, address) => *address,
        }
    }
}

/// The ports on which the daemon answers.
pub(super) struct Door {
    listener: TcpListener,
    address: SocketAddr,
    tls: Option<Tls>,
    /// With TLS, for commands of this computer: their bytes stay on it.
    local: Option<(TcpListener, SocketAddr)>,
}

impl Door {
    /// The TLS of the listener.
    pub(super) const fn tls(&self) -> Option<&Tls> {
        self.tls.as_ref()
    }

    /// Takes the socket of the service manager, or binds the wanted address.
    ///
    /// # Errors
    /// [`Failure::Listen`] names an address that cannot be bound.
    pub(super) fn open(listening: Listening, tls: Option<Tls>) -> Result<Self, Failure> {
        let wanted = listening.address();
        let bound = |wanted: SocketAddr| {
            let listener = listen(wanted)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        let failed = |source: io::Error| {
            let advice = advice(source.kind());
            Failure::Listen { address: wanted, advice, source }
        };
        let (listener, address) = match listening {
            Listening::At(address) => bound(address),
            Listening::On(socket, address) => {
                TcpListener::from_std(socket).map(|listener| (listener, address))
            }
        }
        .map_err(failed)?;
        let local = tls.as_ref().map(|_| bound((Ipv4Addr::LOCALHOST, 0).into())).transpose();
        if tls.is_none() && !address.ip().to_canonical().is_loopback() {
            say("rigd: without --tls, others on that network can read tokens and data on the way");
        }
        Ok(Self { listener, address, tls, local: local.map_err(failed)? })
    }

    /// Writes the file by which commands of this computer find the daemon.
    pub(super) fn announce(&self, settings: &Settings, secret: &Secret) -> Option<Announced> {
        let address = self.local.as_ref().map_or(self.address, |(_, address)| *address);
        let endpoint = Endpoint::of(address, settings.token_file.value.as_deref(), Some(secret));
        match endpoint.and_then(|endpoint| endpoint.announce(&settings.data.value)) {
            Ok(announced) => Some(announced),
            Err(error) => {
                say(&format!(
                    "rigd: `rigd status` and the like will not find this daemon: {error}"
                ));
                None
            }
        }
    }

    /// Its address for a person.
    pub(super) fn name(&self) -> String {
        called(self.address, self.tls.is_some())
    }

    /// Answers until the daemon closes.
    pub(super) fn serve(self, router: Router, closing: &CancellationToken) -> JoinHandle<()> {
        if let Some((local, _)) = self.local {
            tokio::spawn(http::serve(local, None, router.clone(), closing.clone()));
        }
        tokio::spawn(http::serve(self.listener, self.tls, router, closing.clone()))
    }
}

/// Connections that the system holds until they are accepted. Beyond this number a client waits for
/// a second before it tries again, even to stop the rig.
const BACKLOG: u32 = 4096;

fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    // The port of a daemon that has just ended can be taken again.
    socket.set_reuseaddr(TAKES_PORT_OF_ENDED_PROGRAM)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

const fn advice(kind: io::ErrorKind) -> &'static str {
    match kind {
        io::ErrorKind::AddrInUse => {
            "another program has this port: end it, such as another rigd, or choose another port with \
             --listen"
        }
        io::ErrorKind::AddrNotAvailable => "choose an address of this computer with --listen",
        io::ErrorKind::PermissionDenied => "choose a port from 1024 on with --listen",
        _ => "choose another address with --listen",
    }
}

/// Address of the daemon for a browser on this computer.
fn called(address: SocketAddr, has_tls: bool) -> String {
    let scheme = if has_tls { "https" } else { "http" };
    if address.ip().is_unspecified() {
        format!("{scheme}://localhost:{}/, and on every address of this computer", address.port())
    } else {
        format!("{scheme}://{address}/")
    }
}
