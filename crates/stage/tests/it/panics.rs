//! A panic while the owner of a line speaks: one request fails, and the line stays in use.

use std::{
    collections::BTreeMap,
    io,
    pin::Pin,
    task::{Context, Poll},
};

use rig_link::{Clock, Port};
use rig_model::{LineSettings, Parity, StopBits};
use rig_stage::{BusError, BusHandle, BusSettings, LineFault, Reply, Request};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf, duplex};

use crate::peer::{faulty, serve, truth, truthful};

/// A transport that panics once, at one of its calls.
#[derive(Debug)]
struct Poisoned<T> {
    inner: T,
    calls_left: u32,
}

impl<T> Poisoned<T> {
    fn count(&mut self) {
        self.calls_left = self.calls_left.wrapping_sub(1);
        assert!(self.calls_left != 0, "injected");
    }
}

impl<T: AsyncRead + Unpin> AsyncRead for Poisoned<T> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.count();
        Pin::new(&mut self.inner).poll_read(cx, buffer)
    }
}

impl<T: AsyncWrite + Unpin> AsyncWrite for Poisoned<T> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.count();
        Pin::new(&mut self.inner).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_shutdown(cx)
    }
}

#[tokio::test(start_paused = true)]
async fn a_panic_of_the_owner_is_a_fault_of_one_request_and_the_next_one_is_answered() {
    let read = Request::ReadHolding { address: 0, count: 1 };
    let line = LineSettings { baud: 115_200, parity: Parity::Even, stop_bits: StopBits::One };
    for calls_left in 1..12 {
        let (inner, device) = duplex(4096);
        tokio::spawn(serve(device, faulty(BTreeMap::new(), truthful(1))));
        let transport = Poisoned { inner, calls_left };
        let port = Port::new("line 1", transport, Some(line), Clock::start());
        let bus = BusHandle::open(port, BusSettings::rtu());
        let mut panics = 0;
        for _ in 0..12 {
            match bus.request(1, read.clone()).await {
                Ok(reply) => assert_eq!(reply, Reply::Words(truth(0, 1))),
                Err(BusError::Failed(fault @ LineFault::Panicked { .. })) => {
                    panics += 1;
                    let said = fault.to_string();
                    let expected = "line 1: rigd itself failed during an exchange: ";
                    assert!(said.starts_with(expected) && said.contains("injected"), "{said}");
                }
                Err(other) => panic!("{calls_left}: {other}"),
            }
        }
        assert_eq!(panics, 1, "{calls_left}");
    }
}
