//! The port as the Modbus library sees it.

use std::{
    io,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll, ready},
};

use rig_link::Port;
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    sync::{Mutex, MutexGuard},
};

use crate::echo::EchoFilter;

/// Lends the port to one context of the library, so that the context can be dropped after a fault
/// and the port stays.
#[derive(Debug, Clone)]
pub(crate) struct PortLoan {
    inner: Arc<Mutex<Inner>>,
}

/// The port, and what of it passes to the library.
#[derive(Debug)]
pub(crate) struct Inner {
    pub(crate) port: Port,
    /// None where nothing echoes.
    echo: Option<EchoFilter>,
    /// Received and not yet taken by the library.
    passed: Vec<u8>,
    /// Bytes of the present exchange so far.
    n_passed: usize,
}

impl PortLoan {
    /// A port whose echoes are taken out, if it may have any.
    pub(crate) fn new(port: Port, may_echo: bool) -> Self {
        let echo = may_echo.then(EchoFilter::default);
        let inner = Inner { port, echo, passed: Vec::new(), n_passed: 0 };
        Self { inner: Arc::new(Mutex::new(inner)) }
    }

    /// The port itself, between two exchanges.
    pub(crate) fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.try_lock().expect("the owner of the line does one thing at a time")
    }
}

impl Inner {
    /// A new exchange begins.
    pub(crate) fn begin(&mut self) {
        self.passed.clear();
        self.n_passed = 0;
        if let Some(echo) = &mut self.echo {
            echo.begin();
        }
    }

    /// Bytes of the present exchange that are not its echo.
    pub(crate) const fn n_passed(&self) -> usize {
        self.n_passed
    }

    /// Whether the line was found to echo.
    pub(crate) fn is_echoing(&self) -> bool {
        self.echo.as_ref().is_some_and(EchoFilter::is_echoing)
    }

    fn poll_read(&mut self, cx: &mut Context<'_>, out: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        // An echo alone is not handed over.
        while self.passed.is_empty() {
            let mut bytes = [0; 256];
            let mut buffer = ReadBuf::new(&mut bytes);
            ready!(Pin::new(&mut self.port).poll_read(cx, &mut buffer))?;
            match &mut self.echo {
                Some(echo) => echo.filter(buffer.filled(), &mut self.passed),
                None => self.passed.extend_from_slice(buffer.filled()),
            }
            self.n_passed += self.passed.len();
        }
        let n = self.passed.len().min(out.remaining());
        out.put_slice(&self.passed[..n]);
        self.passed.drain(..n);
        Poll::Ready(Ok(()))
    }
}

impl AsyncRead for PortLoan {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.lock().poll_read(cx, buffer)
    }
}

impl AsyncWrite for PortLoan {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let mut inner = self.lock();
        let n = ready!(Pin::new(&mut inner.port).poll_write(cx, bytes))?;
        if let Some(echo) = &mut inner.echo {
            echo.sent(&bytes[..n]);
        }
        Poll::Ready(Ok(n))
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.lock().port).poll_flush(cx)
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.lock().port).poll_shutdown(cx)
    }
}
