//! The connection to a nats-server.

use std::{io, path::PathBuf, time::Duration};

use async_nats::{Client, ConnectOptions, Event};
use rig_store::StoreError;
use tokio::{
    sync::watch,
    time::{error::Elapsed, timeout},
};

use crate::{Identity, TlsError, shipper::ADDRESS_TIME};

/// Time limit of a connection.
const CONNECT_TIME: Duration = Duration::from_secs(10);
/// A server that has not answered twice in this time is gone.
const PING_EVERY: Duration = Duration::from_secs(10);
/// Messages that wait for the line.
const WAITING_MAX: usize = 64;

/// A nats-server, and as whom it is reached.
#[derive(Debug, Clone)]
pub struct Broker {
    address: String,
    files: [PathBuf; 3],
}

/// Why there are no messages.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The certificate of the bench or the viewer.
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// No connection.
    #[error("the nats-server {address} cannot be reached, or refuses: {cause}")]
    Connect {
        /// Its address.
        address: String,
        /// The error of the library, whose text has those behind it.
        cause: async_nats::ConnectError,
    },
    /// No answer in time.
    #[error("the nats-server {address} has not answered within {} s", within.as_secs())]
    Silent {
        /// Its address.
        address: String,
        /// The time limit.
        within: Duration,
    },
    /// The connection has ended, or the server has refused a message.
    #[error("the nats-server {address}: {event}")]
    Trouble {
        /// Its address.
        address: String,
        /// What the library says.
        event: String,
    },
    /// A message cannot be sent.
    #[error("a message cannot be sent")]
    Send(#[from] async_nats::PublishError),
    /// The line.
    #[error("the messages cannot be sent")]
    Flush(#[from] async_nats::client::FlushError),
    /// Messages cannot be asked for.
    #[error("messages cannot be subscribed to")]
    Subscribe(#[from] async_nats::SubscribeError),
    /// The line takes nothing.
    #[error("the messages have not left in time")]
    Slow(#[from] Elapsed),
    /// The runtime of the connection.
    #[error("runtime")]
    Runtime(#[source] io::Error),
    /// The journal.
    #[error("the journal cannot be read")]
    Journal(#[from] StoreError),
}

/// An open connection. It is not opened again where it ends.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) client: Client,
    address: String,
    trouble: watch::Receiver<Option<String>>,
}

impl Broker {
    /// The server at this host and port by TLS, with these files of PEM: certificate, key of that, and the certificate of
    /// the authority of the server. They are read at each connection.
    pub fn new(address: (&str, u16), files: [PathBuf; 3]) -> Self {
        let (host, port) = address;
        // An address of IPv6 has brackets.
        let address =
            if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") };
        Self { address, files }
    }

    /// Host and port.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Reads the files.
    ///
    /// # Errors
    /// [`TlsError`] names the file and its fault.
    pub fn check(&self) -> Result<(), TlsError> {
        let [certificate, key, authority] = &self.files;
        Identity::read(certificate, key, authority).map(drop)
    }

    /// Connects, and ends the connection again.
    ///
    /// # Errors
    /// [`LiveError`].
    pub async fn try_out(&self) -> Result<(), LiveError> {
        self.connect().await.map(drop)
    }

    pub(super) async fn connect(&self) -> Result<Line, LiveError> {
        self.check()?;
        let [certificate, key, authority] = self.files.clone();
        let (sender, trouble) = watch::channel(None);
        let options = ConnectOptions::new()
            .name("rigd")
            .require_tls(true)
            // With these, and not with a finished configuration, the library leaves the authorities of the system out.
            .add_root_certificates(authority)
            .add_client_certificate(certificate, key)
            .connection_timeout(ADDRESS_TIME)
            .ping_interval(PING_EVERY)
            .client_capacity(WAITING_MAX)
            .max_reconnects(1)
            .ignore_discovered_servers()
            .event_callback(move |event| {
                if is_trouble(&event) {
                    sender.send_replace(Some(event.to_string()));
                }
                async {}
            });
        let address = self.address.clone();
        let connected = timeout(CONNECT_TIME, options.connect(format!("tls://{address}"))).await;
        match connected {
            Ok(Ok(client)) => Ok(Line { client, address, trouble }),
            Ok(Err(cause)) => Err(LiveError::Connect { address, cause }),
            Err(_) => Err(LiveError::Silent { address, within: CONNECT_TIME }),
        }
    }
}

impl Line {
    /// Waits until the connection ends or the server refuses a message.
    pub(super) async fn trouble(&mut self) -> LiveError {
        let event = match self.trouble.wait_for(Option::is_some).await {
            Ok(event) => event.clone(),
            Err(_) => None,
        };
        let event = event.unwrap_or_else(|| "the connection has ended".to_owned());
        LiveError::Trouble { address: self.address.clone(), event }
    }
}

/// Whether a connection is of no use any more.
const fn is_trouble(event: &Event) -> bool {
    match event {
        Event::Disconnected
        | Event::Closed
        | Event::LameDuckMode
        | Event::ServerError(_)
        | Event::ClientError(_) => true,
        Event::Connected | Event::Draining | Event::SlowConsumer(_) => false,
    }
}
