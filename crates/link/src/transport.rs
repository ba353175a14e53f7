//! The transports of a port.

use std::fmt;

use tokio::io::{AsyncRead, AsyncWrite};

/// Anything that carries bytes both ways: a serial port, a TCP connection, a pipe in memory.
pub trait Transport: AsyncRead + AsyncWrite + fmt::Debug + Send + Unpin + 'static {}

impl<T: AsyncRead + AsyncWrite + fmt::Debug + Send + Unpin + 'static> Transport for T {}
