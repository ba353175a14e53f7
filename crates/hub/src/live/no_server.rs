//! No nats-server of its own on Windows.

use std::{convert::Infallible, path::Path};

use super::LiveSetup;
use crate::TrialError;

/// There is none. The functions are those of Unix.
#[derive(Debug)]
pub struct NatsServer(Infallible);

impl NatsServer {
    /// Refuses.
    ///
    /// # Errors
    /// [`TrialError::OnWindows`].
    pub const fn start(_: &Path, _: &LiveSetup) -> Result<Self, TrialError> {
        Err(TrialError::OnWindows)
    }

    /// Refuses.
    ///
    /// # Errors
    /// [`TrialError::OnWindows`].
    pub const fn with(_: &Path, _: &str) -> Result<Self, TrialError> {
        Err(TrialError::OnWindows)
    }

    /// Refuses.
    ///
    /// # Errors
    /// [`TrialError::OnWindows`].
    pub const fn free_port() -> Result<u16, TrialError> {
        Err(TrialError::OnWindows)
    }

    /// Makes the server stand still.
    ///
    /// # Errors
    /// [`TrialError`].
    pub const fn freeze(&self) -> Result<(), TrialError> {
        match self.0 {}
    }

    /// Lets a server that stands still go on.
    ///
    /// # Errors
    /// [`TrialError`].
    pub const fn thaw(&self) -> Result<(), TrialError> {
        match self.0 {}
    }
}
