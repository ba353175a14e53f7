//! The cost of a transaction on the host, without line and device: `cargo bench -p rig-stage`.
//!
//! A pseudo-terminal is the line, and a thread that answers at once is the device. A loop of plain
//! blocking writes and reads over the same terminal shows the share of the operating system.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a measurement for people")]

use std::{
    fs::OpenOptions,
    io::{Read, Write},
    time::{Duration, Instant},
};

use rig_link::{Clock, Endpoint, Port};
use rig_model::{LineSettings, Parity, StopBits};
use rig_stage::{BusHandle, BusSettings};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{SerialPort, SerialStream};

const ROUNDS: u32 = 5000;

/// A read of three registers of unit 1, and its answer.
const REQUEST: [u8; 8] = [1, 3, 0, 0x7F, 0, 3, 0x34, 0x13];
const REPLY: [u8; 11] = [1, 3, 6, 0, 0, 0, 0, 0, 0, 0x21, 0x75];

/// A terminal with a device at its other end, which answers from a thread of its own.
fn device() -> String {
    let (path, named) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
        runtime.block_on(async move {
            let (mut device, host) = SerialStream::pair().unwrap();
            path.send(host.name().unwrap()).unwrap();
            let mut request = [0; REQUEST.len()];
            while AsyncReadExt::read_exact(&mut device, &mut request).await.is_ok() {
                AsyncWriteExt::write_all(&mut device, &REPLY).await.unwrap();
            }
        });
    });
    named.recv().unwrap()
}

fn plain() -> Duration {
    let path = device();
    let mut file = OpenOptions::new().read(true).write(true).open(path).unwrap();
    let mut reply = [0; REPLY.len()];
    let started = Instant::now();
    for _ in 0..ROUNDS {
        file.write_all(&REQUEST).unwrap();
        file.read_exact(&mut reply).unwrap();
    }
    started.elapsed() / ROUNDS
}

async fn ours(silence: Option<Duration>, rounds: u32) -> Duration {
    let endpoint = Endpoint::Serial {
        path: device(),
        line: LineSettings { baud: 115_200, parity: Parity::None, stop_bits: StopBits::One },
    };
    let port = Port::open(endpoint, Clock::start()).await.unwrap();
    let bus = BusHandle::open(port, BusSettings { silence, ..BusSettings::rtu() });
    let started = Instant::now();
    for _ in 0..rounds {
        assert_eq!(bus.read(1, 0x7F, 3).await.unwrap(), [0, 0, 0]);
    }
    started.elapsed() / rounds
}

fn main() {
    println!("plain write and read          {:>8.1?}", plain());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let silence = LineSettings { baud: 115_200, parity: Parity::None, stop_bits: StopBits::One }
        .frame_silence();
    runtime.block_on(async {
        println!("bus                           {:>8.1?}", ours(None, ROUNDS).await);
        println!("bus, silence of the standard  {:>8.1?}", ours(Some(silence), 500).await);
    });
}
