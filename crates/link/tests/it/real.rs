//! Ports of the operating system: pseudo-terminals and sockets, in real time.

use std::time::Duration;

use rig_link::{Clock, Endpoint, Holder, LineError, OpenError, Port};
use rig_model::{LineSettings, Parity, StopBits};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpListener,
    time::Instant,
};
use tokio_serial::{SerialPort, SerialStream};

// A pseudo-terminal has no parity.
const LINE: LineSettings =
    LineSettings { baud: 115_200, parity: Parity::None, stop_bits: StopBits::One };

/// A terminal that is not open yet, and its other side.
fn terminal() -> (SerialStream, String) {
    let (device, host) = SerialStream::pair().unwrap();
    let path = host.name().unwrap();
    (device, path)
}

fn serial(path: &str) -> Endpoint {
    Endpoint::Serial { path: path.to_owned(), line: LINE }
}

async fn receive(port: &mut Port, bytes: usize) -> Result<Vec<u8>, LineError> {
    let (mut answer, asked) = (Vec::new(), Instant::now());
    while answer.len() < bytes {
        port.receive(&mut answer, asked, asked + Duration::from_secs(5)).await?;
    }
    Ok(answer)
}

#[tokio::test]
async fn a_serial_port_is_opened_once_and_its_unplugging_is_seen() {
    let (mut device, path) = terminal();
    let mut port = Port::open(serial(&path), Clock::start()).await.unwrap();
    let error = Port::open(serial(&path), Clock::start()).await.unwrap_err();
    assert!(matches!(error, OpenError::Busy { .. }), "{error}");

    // There is no wire on which characters would take time.
    assert_eq!(port.duration_of(100), Duration::ZERO);
    port.send(b"*IDN?\r\n").await.unwrap();
    let mut heard = [0; 7];
    device.read_exact(&mut heard).await.unwrap();
    assert_eq!(&heard, b"*IDN?\r\n");
    // Bytes that the kernel holds already are drained.
    device.write_all(b"stale").await.unwrap();
    let mut drained = 0;
    while drained < 5 {
        drained += port.drain().await.unwrap();
    }
    device.write_all(b"fresh").await.unwrap();
    assert_eq!(receive(&mut port, 5).await.unwrap(), b"fresh");

    drop(device);
    let error = receive(&mut port, 1).await.unwrap_err();
    assert!(matches!(error, LineError::Lost { .. }), "{error}");
    assert!(matches!(port.reopen().await, Err(OpenError::Absent { .. })));
}

#[tokio::test]
async fn a_port_that_is_not_there_is_said_to_be_absent() {
    let error = Port::open(serial("/dev/no-such-port"), Clock::start()).await.unwrap_err();
    assert_eq!(error.to_string(), "/dev/no-such-port: no such port");
}

#[tokio::test]
async fn a_socket_is_reopened_where_it_was() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let endpoint = Endpoint::Tcp { address };
    let mut port = Port::open(endpoint, Clock::start()).await.unwrap();
    drop(listener.accept().await.unwrap());
    let error = receive(&mut port, 1).await.unwrap_err();
    assert!(matches!(error, LineError::Lost { .. }), "{error}");
    port.reopen().await.unwrap();
    let (mut device, _) = listener.accept().await.unwrap();
    device.write_all(b"hello").await.unwrap();
    assert_eq!(receive(&mut port, 5).await.unwrap(), b"hello");
}

#[tokio::test]
async fn another_program_on_the_port_is_named() {
    let (_device, path) = terminal();
    let file = std::fs::File::open(&path).unwrap();
    let sleep = std::process::Command::new("sleep").arg("60").stdin(file).spawn();
    // Without such a program there is nothing to be seen.
    let Ok(mut sleep) = sleep else { return };
    let port = Port::open(serial(&path), Clock::start()).await.unwrap();
    let intruders = port.intruders();
    sleep.kill().unwrap();
    sleep.wait().unwrap();
    assert_eq!(intruders, [Holder { pid: sleep.id(), name: "sleep".to_owned() }]);
}
