//! No PostgreSQL of its own on Windows: what begins one there is refused.

use std::{
    convert::Infallible,
    path::{Path, PathBuf},
};

use tokio_postgres::Config;

use crate::{CertificateError, Identity, TlsError};

/// Why there is no server.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// It is of Unix.
    #[error(
        "servers for a trial are begun and ended by a shell of Unix, which Windows does not have: run `rigd-hub trial` on \
         Linux, or install PostgreSQL and call `rigd-hub init`"
    )]
    OnWindows,
    /// The certificates.
    #[error(transparent)]
    Certificate(#[from] CertificateError),
    /// The certificate of a bench.
    #[error(transparent)]
    Tls(#[from] TlsError),
}

/// There is none. The functions are those of Unix.
#[derive(Debug)]
pub struct Trial(Infallible);

impl Trial {
    /// Refuses.
    ///
    /// # Errors
    /// [`TrialError::OnWindows`].
    pub const fn start(_: &Path, _: bool) -> Result<Self, TrialError> {
        Err(TrialError::OnWindows)
    }

    /// How its superuser reaches this database.
    pub const fn admin(&self, _: &str) -> Config {
        match self.0 {}
    }

    /// How a role reaches this database over the network.
    pub const fn bench(&self, _: &str, _: &str) -> Config {
        match self.0 {}
    }

    /// A new certificate for this role, its key, and the certificate of the authority.
    ///
    /// # Errors
    /// [`TrialError`].
    pub const fn certify(&self, _: &str) -> Result<[PathBuf; 3], TrialError> {
        match self.0 {}
    }

    /// Makes the certificate of a role, and reads it with its key and that of the authority.
    ///
    /// # Errors
    /// [`TrialError`].
    pub const fn identity(&self, _: &str) -> Result<Identity, TrialError> {
        match self.0 {}
    }

    /// The directory of the database.
    pub const fn data(&self) -> PathBuf {
        match self.0 {}
    }

    /// The directory of the authority.
    pub const fn certificates(&self) -> PathBuf {
        match self.0 {}
    }

    /// Port on the loopback.
    pub const fn port(&self) -> u16 {
        match self.0 {}
    }

    /// Ends the server as a crash does, and starts it again: what was not committed is gone.
    ///
    /// # Errors
    /// [`TrialError`].
    pub const fn crash(&self) -> Result<(), TrialError> {
        match self.0 {}
    }

    /// Ends the server as a crash does.
    ///
    /// # Errors
    /// [`TrialError`].
    pub const fn stop(&self) -> Result<(), TrialError> {
        match self.0 {}
    }

    /// Starts the server again.
    ///
    /// # Errors
    /// [`TrialError`].
    pub const fn go_on(&self) -> Result<(), TrialError> {
        match self.0 {}
    }
}
