//! Connections to PostgreSQL.

use tokio::task::JoinHandle;
use tokio_postgres::{Client, Config, NoTls, config::SslMode};

use crate::tls::Identity;

/// Why there is no connection.
#[derive(Debug, thiserror::Error)]
#[error("PostgreSQL cannot be reached, or refuses")]
pub struct ConnectError(#[from] tokio_postgres::Error);

/// Connects, under TLS if there is an identity. The task carries the messages and ends with the client.
///
/// # Errors
/// [`ConnectError`] of the network, of TLS, or of the server.
pub async fn connect(
    config: &Config,
    identity: Option<&Identity>,
) -> Result<(Client, JoinHandle<()>), ConnectError> {
    let mut config = config.clone();
    config.application_name("rigd");
    // The error of a connection is that of the request that waits for it.
    if let Some(identity) = identity {
        config.ssl_mode(SslMode::Require);
        let (client, connection) = config.connect(identity.clone()).await?;
        return Ok((client, tokio::spawn(async { drop(connection.await) })));
    }
    let (client, connection) = config.connect(NoTls).await?;
    Ok((client, tokio::spawn(async { drop(connection.await) })))
}
