//! Instruments on USB, behind a socket that keeps the bounds of messages as the driver of Linux does.

use std::{
    path::PathBuf,
    sync::mpsc::{Receiver, Sender, channel},
    thread::JoinHandle,
    time::Duration,
};

use rig_link::{Clock, Endpoint, Flow, LineError, OpenError, Port};
use rig_model::PortKind;
use rustix::{
    fd::OwnedFd,
    net::{
        AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketFlags, SocketType, accept, bind,
        listen, recv, send, socket_with,
    },
};
use tokio::time::Instant;

/// Longer than anything here takes, on a machine that is busy with other things.
const PATIENCE: Duration = Duration::from_secs(20);

/// The place of an instrument, which is removed after the test.
struct Bench {
    directory: PathBuf,
    listener: OwnedFd,
}

impl Bench {
    fn new(name: &str) -> Self {
        let name = format!("rig-link-usbtmc-{}-{name}", std::process::id());
        let directory = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&directory).unwrap();
        let flags = SocketFlags::CLOEXEC;
        let listener =
            socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).unwrap();
        bind(&listener, &SocketAddrUnix::new(directory.join("usbtmc0")).unwrap()).unwrap();
        listen(&listener, 1).unwrap();
        Self { directory, listener }
    }

    fn endpoint(&self) -> Endpoint {
        Endpoint::Usbtmc { path: self.directory.join("usbtmc0").to_str().unwrap().to_owned() }
    }

    async fn port(&self) -> Port {
        Port::open(self.endpoint(), Clock::start()).await.unwrap()
    }

    /// Plugs an instrument in. It answers to each message with these packets, and to a device clear as it
    /// should. It is unplugged when there is no answer left, or by the test.
    fn plug_in(&self, answers: &[&[&[u8]]]) -> Instrument {
        let answers: Vec<Vec<Vec<u8>>> = answers
            .iter()
            .map(|answer| answer.iter().map(|packet| packet.to_vec()).collect())
            .collect();
        let socket = accept(&self.listener).unwrap();
        let (heard, hears) = channel();
        let serving = std::thread::spawn(move || serve(&socket, answers, &heard));
        Instrument { hears, serving }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        _ = std::fs::remove_dir_all(&self.directory);
    }
}

struct Instrument {
    hears: Receiver<String>,
    serving: JoinHandle<()>,
}

impl Instrument {
    fn hears(&self) -> String {
        self.hears.recv_timeout(PATIENCE).expect("something is said to the instrument")
    }

    fn unplugged(self) {
        self.serving.join().unwrap();
    }
}

fn serve(socket: &OwnedFd, answers: Vec<Vec<Vec<u8>>>, heard: &Sender<String>) {
    let mut answers = answers.into_iter();
    let mut packet = [0; 4096];
    let say = |packet: &[u8]| send(socket, packet, SendFlags::NOSIGNAL).is_ok();
    while let Ok((received, _)) = recv(socket, &mut packet[..], RecvFlags::empty())
        && received > 0
    {
        _ = heard.send(packet[..received].escape_ascii().to_string());
        if packet[0] == b'!' {
            if !say(b"!") {
                return;
            }
            continue;
        }
        let Some(answer) = answers.next() else { return };
        if !answer.iter().all(|packet| say(packet)) {
            return;
        }
    }
}

async fn line(port: &mut Port, within: Duration) -> Result<Vec<u8>, LineError> {
    let (mut answer, asked) = (Vec::new(), Instant::now());
    while !answer.ends_with(b"\n") {
        port.receive(&mut answer, asked, asked + within).await?;
    }
    Ok(answer)
}

#[tokio::test]
async fn messages_keep_their_bounds_and_a_long_answer_is_put_together() {
    let bench = Bench::new("bounds");
    let mut port = bench.port().await;
    let first = [b"+".as_slice(), &[b'7'; 4080]].concat();
    let instrument = bench.plug_in(&[&[&first, b"+8", b".9\n"], &[b".0\n"]]);
    assert_eq!(port.kind(), PortKind::Usb);
    port.send(b":FREQ 140;:FETC?\n").await.unwrap();
    assert_eq!(line(&mut port, PATIENCE).await.unwrap().len(), 4080 + 3);
    // An answer that was left unread is drained.
    port.send(b"*ESR?\n").await.unwrap();
    let mut drained = 0;
    while drained < 2 {
        drained += port.drain().await.unwrap();
    }
    assert_eq!([instrument.hears(), instrument.hears()], [">:FREQ 140;:FETC?\\n", ">*ESR?\\n"]);
    let frames = port.transcript().frames();
    let flows: Vec<Flow> = frames.iter().map(|frame| frame.flow).collect();
    assert_eq!((flows[0], flows.last()), (Flow::Sent, Some(&Flow::Discarded)));
}

#[tokio::test]
async fn an_answer_that_stays_away_ends_in_a_device_clear() {
    let bench = Bench::new("clear");
    let mut port = bench.port().await;
    let instrument = bench.plug_in(&[&[b"+1.4"], &[b".0\n"]]);
    port.send(b":FETC?\n").await.unwrap();
    let error = line(&mut port, Duration::from_millis(50)).await.unwrap_err();
    assert!(matches!(error, LineError::TimedOut { .. }), "{error}");
    // It is cleared at once, and not once more when silence is wanted.
    assert_eq!([instrument.hears(), instrument.hears()], [">:FETC?\\n", "!"]);
    assert_eq!(port.quarantine(Duration::from_millis(500)).await.unwrap(), 0);
    port.send(b"*ESR?\n").await.unwrap();
    assert_eq!(line(&mut port, PATIENCE).await.unwrap(), b"0\n");
    assert_eq!(instrument.hears(), ">*ESR?\\n");
}

#[tokio::test]
async fn an_instrument_is_found_again_where_it_was() {
    let bench = Bench::new("again");
    let mut port = bench.port().await;
    let instrument = bench.plug_in(&[]);
    port.send(b"*IDN?\n").await.unwrap();
    let error = line(&mut port, PATIENCE).await.unwrap_err();
    assert!(matches!(error, LineError::Lost { kind: PortKind::Usb, .. }), "{error}");
    assert!(error.to_string().ends_with("usbtmc0: the port has disappeared"), "{error}");
    instrument.unplugged();
    assert!(port.is_lost() && port.can_reopen());
    port.reopen().await.unwrap();
    let _instrument = bench.plug_in(&[&[b".E4980A\n"]]);
    port.quarantine(Duration::from_millis(500)).await.unwrap();
    port.send(b"*IDN?\n").await.unwrap();
    assert_eq!(line(&mut port, PATIENCE).await.unwrap(), b"E4980A\n");
}

/// An instrument that takes nothing, and does not even answer to a device clear.
#[tokio::test]
async fn an_instrument_that_cannot_be_cleared_is_lost() {
    let bench = Bench::new("deaf");
    let mut port = bench.port().await;
    let _socket = accept(&bench.listener).unwrap();
    let error = port.quarantine(Duration::from_millis(500)).await.unwrap_err();
    assert!(matches!(error, LineError::Lost { .. }), "{error}");
    assert!(port.is_lost());
}

#[tokio::test]
async fn what_is_no_instrument_on_usb_is_refused() {
    let bench = Bench::new("refused");
    std::fs::write(bench.directory.join("file"), "").unwrap();
    let rows = [
        (bench.directory.join("none"), "no such port"),
        (bench.directory.join("file"), "a file, not an instrument on USB"),
        (bench.directory.clone(), "a directory, not an instrument on USB"),
        ("/dev/null".into(), "a device of another driver, not an instrument on USB"),
    ];
    for (path, expected) in rows {
        let path = path.to_str().unwrap().to_owned();
        let opened = Port::open(Endpoint::Usbtmc { path: path.clone() }, Clock::start()).await;
        assert_eq!(opened.unwrap_err().to_string(), format!("{path}: {expected}"));
    }
    let (path, listener) = (bench.endpoint(), &bench.listener);
    rustix::net::shutdown(listener, rustix::net::Shutdown::Both).unwrap();
    let error = Port::open(path, Clock::start()).await.unwrap_err();
    assert!(matches!(error, OpenError::Absent { .. }), "{error}");
}
