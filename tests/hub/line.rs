//! A line between a bench and PostgreSQL that is slow, or is cut after a drawn number of bytes.

use std::{net::SocketAddr, time::Duration};

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{
        TcpListener, TcpStream,
        tcp::{OwnedReadHalf, OwnedWriteHalf},
    },
    task::JoinHandle,
    time::sleep,
};

/// How the line is bad.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fault {
    /// It is cut behind this many bytes from the bench.
    pub(crate) cut_up: usize,
    /// The same of the bytes to the bench.
    pub(crate) cut_down: usize,
    /// It keeps every part of a message for so long.
    pub(crate) delay: Duration,
    /// Bytes of a part at most.
    pub(crate) part: usize,
}

/// The line of one connection. It ends with the value.
pub(crate) struct Line {
    /// Where the bench finds PostgreSQL.
    pub(crate) port: u16,
    task: JoinHandle<()>,
}

impl Line {
    /// A line to PostgreSQL on this port of the loopback.
    pub(crate) async fn to(port: u16, fault: Fault) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let task = tokio::spawn(async move {
            let Ok((bench, _)) = listener.accept().await else { return };
            let there = SocketAddr::from(([127, 0, 0, 1], port));
            let Ok(hub) = TcpStream::connect(there).await else { return };
            let ((from_bench, to_bench), (from_hub, to_hub)) =
                (bench.into_split(), hub.into_split());
            // The end of one direction is that of both.
            tokio::select! {
                () = carry(from_bench, to_hub, fault.cut_up, fault) => {}
                () = carry(from_hub, to_bench, fault.cut_down, fault) => {}
            }
        });
        Self { port: address.port(), task }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.task.abort();
    }
}

async fn carry(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, cut: usize, fault: Fault) {
    let (mut left, mut part) = (cut, vec![0; fault.part]);
    while left > 0 {
        let most = part.len().min(left);
        let Ok(read @ 1..) = from.read(&mut part[..most]).await else { return };
        if !fault.delay.is_zero() {
            sleep(fault.delay).await;
        }
        if to.write_all(&part[..read]).await.is_err() {
            return;
        }
        left -= read;
    }
}
