//! The transports of a port.

use std::{
    fmt, io,
    pin::Pin,
    task::{Context, Poll},
};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use crate::messages::MessageLink;

/// Anything that carries bytes both ways: a serial port, a TCP connection, a pipe in memory.
pub trait Transport: AsyncRead + AsyncWrite + fmt::Debug + Send + Unpin + 'static {}

impl<T: AsyncRead + AsyncWrite + fmt::Debug + Send + Unpin + 'static> Transport for T {}

/// What an open port has.
#[derive(Debug)]
pub(crate) enum Carrier {
    /// A stream of bytes.
    Bytes(Box<dyn Transport>),
    /// Messages, each with its bounds, and a device clear beside them.
    #[cfg_attr(not(target_os = "linux"), expect(dead_code, reason = "its driver is of Linux"))]
    Messages(MessageLink),
}

impl Carrier {
    fn as_transport(&mut self) -> Pin<&mut dyn Transport> {
        match self {
            Self::Bytes(transport) => Pin::new(transport),
            Self::Messages(link) => Pin::new(link),
        }
    }
}

impl AsyncRead for Carrier {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.as_transport().poll_read(cx, buffer)
    }
}

impl AsyncWrite for Carrier {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.as_transport().poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.as_transport().poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.as_transport().poll_shutdown(cx)
    }
}
