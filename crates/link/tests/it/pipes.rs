//! The timing and the bytes of a port, on a paused clock.

use std::time::Duration;

use rig_link::{Clock, Endpoint, Flow, LineError, OpenError, Port, Transport};
use rig_model::{LineSettings, Parity, StopBits};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex},
    time::{Instant, sleep},
};

const LINE: LineSettings =
    LineSettings { baud: 19_200, parity: Parity::Even, stop_bits: StopBits::One };

fn port() -> (Port, DuplexStream) {
    let (host, device) = duplex(256);
    (Port::new("line 1", host, Some(LINE), Clock::start()), device)
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

#[tokio::test(start_paused = true)]
async fn an_exchange_waits_for_its_bytes_and_no_longer_than_its_deadline() {
    let (mut port, mut device) = port();
    let start = Instant::now();
    port.send(b"ping").await.unwrap();
    // Sending does not wait for the wire.
    assert_eq!(start.elapsed(), Duration::ZERO);
    tokio::spawn(async move {
        let mut buffer = [0; 4];
        device.read_exact(&mut buffer).await.unwrap();
        sleep(ms(30)).await;
        device.write_all(b"po").await.unwrap();
        sleep(ms(1000)).await;
        device.write_all(b"ng").await.unwrap();
    });
    let mut answer = Vec::new();
    port.receive(&mut answer, start, start + ms(100)).await.unwrap();
    assert_eq!((&answer[..], start.elapsed()), (&b"po"[..], ms(30)));
    let error = port.receive(&mut answer, start, start + ms(100)).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 1: no complete answer within 100 ms, 2 bytes arrived, the last after 30 ms: `po`"
    );
    assert_eq!(start.elapsed(), ms(100));
}

#[tokio::test(start_paused = true)]
async fn the_line_is_silent_between_frames_and_strays_are_thrown_away() {
    let (mut port, mut device) = port();
    let start = Instant::now();
    port.send(&[0x55; 8]).await.unwrap();
    // Eight characters of 11 bits, and 3.5 more of silence.
    assert_eq!(port.settle(port.frame_silence()).await.unwrap(), 0);
    let silent = start.elapsed();
    assert!((6_588..9_000).contains(&silent.as_micros()), "{silent:?}");
    device.write_all(b"stray").await.unwrap();
    assert_eq!(port.settle(port.frame_silence()).await.unwrap(), 5);
    device.write_all(b"again").await.unwrap();
    assert_eq!(port.drain().await.unwrap(), 5);
    let flows: Vec<Flow> = port.transcript().frames().iter().map(|frame| frame.flow).collect();
    assert_eq!(flows, [Flow::Sent, Flow::Discarded, Flow::Discarded]);
}

#[tokio::test(start_paused = true)]
async fn a_quarantine_hears_the_late_answer_out_and_chatter_ends_it() {
    let (mut port, mut device) = port();
    let start = Instant::now();
    tokio::spawn(async move {
        sleep(ms(400)).await;
        device.write_all(b"late").await.unwrap();
        sleep(ms(400)).await;
        loop {
            device.write_all(b"chatter").await.unwrap();
            sleep(ms(1)).await;
        }
    });
    assert_eq!(port.quarantine(ms(500)).await.unwrap(), 4);
    assert_eq!(start.elapsed(), ms(500));
    let error = port.quarantine(ms(500)).await.unwrap_err();
    assert!(matches!(error, LineError::NeverSilent { .. }), "{error}");
    assert_eq!(start.elapsed(), ms(5500));
}

#[tokio::test(start_paused = true)]
async fn a_pipe_that_is_full_blocks_no_longer_than_a_second() {
    let (mut port, _device) = port();
    let error = port.send(&[0; 257]).await.unwrap_err();
    assert_eq!(error.to_string(), "line 1: 257 bytes could not be sent within 1000 ms");
}

#[tokio::test(start_paused = true)]
async fn a_port_whose_other_side_is_gone_is_lost_until_it_is_opened_again() {
    let (sockets, mut plugs) = tokio::sync::mpsc::unbounded_channel();
    let mut left = 2;
    let plug = Box::new(move || {
        left -= 1;
        let (host, device) = duplex(256);
        sockets.send(device).unwrap();
        (0 <= left).then(|| Box::new(host) as Box<dyn Transport>)
    });
    let endpoint = Endpoint::Memory { name: "line 1".into(), line: Some(LINE), plug };
    let mut port = Port::open(endpoint, Clock::start()).await.unwrap();
    drop(plugs.recv().await.unwrap());
    let error = port.settle(port.frame_silence()).await.unwrap_err();
    assert_eq!(error.to_string(), "line 1: the port has disappeared");
    assert!(port.is_lost());
    assert!(matches!(port.send(b"x").await, Err(LineError::Lost { .. })));

    port.reopen().await.unwrap();
    let mut device = plugs.recv().await.unwrap();
    port.send(b"x").await.unwrap();
    assert_eq!(device.read_u8().await.unwrap(), b'x');

    // Found out by writing, too.
    drop(device);
    assert!(matches!(port.send(b"x").await, Err(LineError::Lost { .. })));
    assert!(matches!(port.reopen().await, Err(OpenError::Absent { .. })));
}
