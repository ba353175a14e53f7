//! A computer that is held up while a message leaves.

use std::{
    collections::BTreeMap,
    io,
    pin::Pin,
    task::{Context, Poll, ready},
    time::Duration,
};

use rig_analyzer::Analyzer;
use rig_files::instrument::HIOKI_IM3536;
use rig_link::{Clock, Port};
use rig_model::{LineSettings, Parity, StopBits};
use tokio::{
    io::{AsyncRead, AsyncWrite, DuplexStream, ReadBuf},
    time::{Sleep, sleep},
};

use crate::{
    im3536::Im3536,
    measurements::{analyzer_on, assert_true_at, sweep},
    peer::serve,
};

/// A transport that accepts messages late, the last of these first.
#[derive(Debug)]
struct Late {
    inner: DuplexStream,
    by: Vec<Duration>,
    waiting: Option<Pin<Box<Sleep>>>,
}

impl AsyncRead for Late {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_read(cx, buffer)
    }
}

impl AsyncWrite for Late {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let this = &mut *self;
        if this.waiting.is_none() {
            let by = this.by.pop().filter(|by| !by.is_zero());
            this.waiting = by.map(|by| Box::pin(sleep(by)));
        }
        if let Some(waiting) = &mut this.waiting {
            ready!(waiting.as_mut().poll(cx));
        }
        this.waiting = None;
        Pin::new(&mut this.inner).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_shutdown(cx)
    }
}

#[tokio::test(start_paused = true)]
async fn a_reading_whose_time_is_unknown_is_measured_again() {
    for (late_ms, count) in [(1, 1), (10, 2), (300, 2)] {
        let instrument = Im3536::new();
        let (host, device) = tokio::io::duplex(4096);
        tokio::spawn(serve(device, instrument.clone(), BTreeMap::new()));
        // The number of messages before the second point.
        let mut counted = analyzer_on(&instrument, []);
        sweep(&mut counted, &[190.0]).await.unwrap();
        let before = instrument.seen().len();
        let mut by = vec![Duration::from_millis(late_ms)];
        by.extend(vec![Duration::ZERO; before]);
        let transport = Late { inner: host, by, waiting: None };
        let line = LineSettings { baud: 57_600, parity: Parity::None, stop_bits: StopBits::One };
        let port = Port::new("line 2", transport, Some(line), Clock::start());
        let mut analyzer = Analyzer::open(port, &HIOKI_IM3536);
        let readings = sweep(&mut analyzer, &[190.0, 200.25]).await.unwrap();
        let triggers = |seen: &[String]| {
            seen.iter().filter(|message| message.contains(":FREQuency 200.25")).count()
        };
        assert_eq!(triggers(&instrument.seen()[before..]), count, "{late_ms} ms");
        assert_eq!(readings.len(), 2);
        assert_true_at(&readings[1], 200.25);
        let has_settled_again = readings[1].settle_s >= 2.0;
        assert_eq!(has_settled_again, count == 2, "{late_ms} ms: {:?}", readings[1]);
    }
}
