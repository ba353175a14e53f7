//! Ports over pipes, terminals and sockets.
#![expect(clippy::unwrap_used, reason = "all of it is a test")]

mod pipes;
mod real;
#[cfg(target_os = "linux")]
mod usbtmc;
