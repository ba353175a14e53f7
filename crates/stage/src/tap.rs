//! The port as the Modbus library sees it.

use std::{
    io,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
};

use rig_link::Port;
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    sync::{Mutex, MutexGuard},
};

/// Lends the port to one context of the library, so that the context can be dropped after a fault
/// and the port stays.
#[derive(Debug, Clone)]
pub(crate) struct Tap {
    port: Arc<Mutex<Port>>,
}

impl Tap {
    pub(crate) fn new(port: Port) -> Self {
        Self { port: Arc::new(Mutex::new(port)) }
    }

    /// The port itself, between two exchanges.
    pub(crate) fn port(&self) -> MutexGuard<'_, Port> {
        self.port.try_lock().expect("the owner of the line does one thing at a time")
    }
}

impl AsyncRead for Tap {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut *self.port()).poll_read(cx, buffer)
    }
}

impl AsyncWrite for Tap {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut *self.port()).poll_write(cx, bytes)
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut *self.port()).poll_flush(cx)
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut *self.port()).poll_shutdown(cx)
    }
}
