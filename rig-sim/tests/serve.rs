//! The ports of a served rig, as programs of any maker see them: through the operating system.

// Pseudo-terminals are those of Linux.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may fail, also in what its tests share")]

use std::{
    fs::{File, OpenOptions},
    io::{Read, Write},
    path::Path,
    time::Duration,
};

use rig_sim::{
    LineTransport, PortId, SimRig, Wiring,
    faults::{Fault, FaultKind, FaultTrigger, ReplyFault},
    scene,
    serve::{Role, Server},
};
use rustix::termios::{LocalModes, OptionalActions, ioctl_tiocexcl, tcgetattr, tcsetattr};
use tokio::{
    io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader},
    net::TcpStream,
    task::spawn_blocking,
    time::timeout,
};

const SERIAL: LineTransport = LineTransport::Serial { baud: 115_200 };

/// Longer than anything here takes, on a machine that is busy with other things.
const PATIENCE: Duration = Duration::from_secs(20);

fn start() -> (SimRig, Server) {
    let rig = SimRig::start(scene::matched(), &Wiring::paper(SERIAL), 1).unwrap();
    let server = Server::new(rig.handle());
    (rig, server)
}

fn open(path: &Path) -> File {
    OpenOptions::new().read(true).write(true).open(path).unwrap()
}

/// Does something that blocks, but not for ever.
async fn client<T: Send + 'static>(act: impl FnOnce() -> T + Send + 'static) -> T {
    timeout(PATIENCE, spawn_blocking(act)).await.expect("the port answers").unwrap()
}

/// Waits until a terminal is ready for its next client.
async fn free(server: &Server) {
    timeout(PATIENCE, server.port_is_free()).await.expect("a terminal becomes free");
}

fn line(port: &mut File, request: &str) -> String {
    port.write_all(request.as_bytes()).unwrap();
    let mut said = Vec::new();
    while !said.ends_with(b"\n") {
        let mut byte = [0];
        port.read_exact(&mut byte).unwrap();
        said.push(byte[0]);
    }
    String::from_utf8(said).unwrap()
}

const IDENTITY: &str = "HIOKI,IM3536,190512345,V1.21\r\n";

/// Reads the present alarm of unit 1, with its checksum.
const ASK: [u8; 8] = [0x01, 0x03, 0x00, 0x80, 0x00, 0x02, 0xC5, 0xE3];
const ANSWER: [u8; 9] = [0x01, 0x03, 0x04, 0x00, 0x00, 0x00, 0x00, 0xFA, 0x33];

#[tokio::test]
async fn clients_of_a_terminal_come_and_go_whatever_they_do_to_it() {
    let (_rig, mut server) = start();
    let path = server.open_pty(Role::Analyzer, None).unwrap();
    for round in 0..3 {
        let name = path.clone();
        client(move || {
            let mut port = open(&name);
            // The instrument may still wait for the end of the last message.
            assert_eq!(line(&mut port, "\r\n*IDN?\r\n"), IDENTITY, "round {round}");
            // It opens the port exclusively, makes it echo, and closes in the middle of a message.
            ioctl_tiocexcl(&port).unwrap();
            let mut settings = tcgetattr(&port).unwrap();
            settings.local_modes |= LocalModes::ECHO;
            tcsetattr(&port, OptionalActions::Now, &settings).unwrap();
            port.write_all(b":FREQ 2").unwrap();
        })
        .await;
        free(&server).await;
        let name = path.clone();
        let modes = client(move || tcgetattr(open(&name)).unwrap().local_modes).await;
        assert!(!modes.contains(LocalModes::ECHO), "round {round}");
        // Looking was a client as well.
        free(&server).await;
    }
}

#[tokio::test]
async fn a_frame_may_arrive_in_pieces_and_a_link_lives_as_long_as_its_port() {
    let (_rig, mut server) = start();
    let link = std::env::temp_dir().join(format!("rig-sim-test-{}", std::process::id()));
    server.open_pty(Role::Bus(SERIAL), Some(&link)).unwrap();
    let path = link.clone();
    let said = client(move || {
        let mut port = open(&path);
        for byte in ASK {
            port.write_all(&[byte]).unwrap();
        }
        let mut said = [0; ANSWER.len()];
        port.read_exact(&mut said).unwrap();
        said
    })
    .await;
    assert_eq!(said, ANSWER);
    drop(server);
    let gone = async {
        while link.symlink_metadata().is_ok() {
            tokio::task::yield_now().await;
        }
    };
    timeout(PATIENCE, gone).await.expect("the link is removed");
}

#[tokio::test]
async fn a_link_never_replaces_a_file_of_somebody_else() {
    let (_rig, mut server) = start();
    let file = std::env::temp_dir().join(format!("rig-sim-file-{}", std::process::id()));
    std::fs::write(&file, "mine").unwrap();
    assert!(server.open_pty(Role::Analyzer, Some(&file)).is_err());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
    std::fs::remove_file(&file).unwrap();
}

#[tokio::test]
async fn tcp_carries_both_framings_to_several_clients_and_control_stands_beside_them() {
    let (_rig, mut server) = start();
    let any = "127.0.0.1:0".parse().unwrap();
    let modbus = server.listen(Role::Bus(LineTransport::Tcp), any).await.unwrap();
    let raw = server.listen(Role::Bus(SERIAL), any).await.unwrap();
    let control = server.listen_control(any).await.unwrap();

    let talk = async {
        let mut control = BufReader::new(TcpStream::connect(control).await.unwrap());
        let mut answer = String::new();
        for (said, expected) in
            [("place 3", "ok\n"), ("dance", "error: \"dance\" is no command; say help\n")]
        {
            control.write_all(format!("{said}\n").as_bytes()).await.unwrap();
            answer.clear();
            control.read_line(&mut answer).await.unwrap();
            assert_eq!(answer, expected);
        }
        let mut first = TcpStream::connect(modbus).await.unwrap();
        let mut second = TcpStream::connect(raw).await.unwrap();
        for transaction in 0..3 {
            first.write_all(&[0, transaction, 0, 0, 0, 6, 1, 3, 0, 0x80, 0, 2]).await.unwrap();
            second.write_all(&ASK).await.unwrap();
            let (mut said, mut raw) = ([0; 13], [0; ANSWER.len()]);
            first.read_exact(&mut said).await.unwrap();
            second.read_exact(&mut raw).await.unwrap();
            assert_eq!(said, [0, transaction, 0, 0, 0, 7, 1, 3, 4, 0, 0, 0, 0]);
            assert_eq!(raw, ANSWER);
        }
        // A connection that does not speak Modbus is closed, and others are not affected.
        first.write_all(b"GET / HTTP/1.1\r\n\r\n").await.unwrap();
        assert_eq!(first.read(&mut [0; 16]).await.unwrap_or(0), 0);
        second.write_all(&ASK).await.unwrap();
        let mut raw = [0; ANSWER.len()];
        second.read_exact(&mut raw).await.unwrap();
        assert_eq!(raw, ANSWER);
    };
    timeout(PATIENCE, talk).await.expect("everybody answers");
}

#[tokio::test]
async fn a_terminal_that_is_unplugged_comes_back_behind_its_link() {
    let (rig, mut server) = start();
    let link = std::env::temp_dir().join(format!("rig-sim-unplug-{}", std::process::id()));
    let first = server.open_pty(Role::Analyzer, Some(&link)).expect("a terminal is opened");
    rig.handle().with(|_, rig| {
        let kind = FaultKind::Reply(ReplyFault::Disconnect);
        rig.add_fault(Fault {
            port: PortId::Analyzer,
            unit: None,
            kind,
            trigger: FaultTrigger::Nth(1),
        });
    });
    client(move || {
        let mut port = open(&first);
        port.write_all(b"*IDN?\r\n").unwrap();
        // After the close: the end of the file or an error, but no answer.
        assert_eq!(port.read(&mut [0; 64]).unwrap_or(0), 0);
    })
    .await;
    free(&server).await;
    let path = link.clone();
    let said = client(move || line(&mut open(&path), "*IDN?\r\n")).await;
    assert_eq!(said, IDENTITY);
}

/// A socket of whole packets, connected to this path.
#[cfg(target_os = "linux")]
fn packets(path: &Path) -> std::os::unix::net::UnixStream {
    use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
    let flags = SocketFlags::CLOEXEC;
    let kind = SocketType::SEQPACKET;
    let socket = rustix::net::socket_with(AddressFamily::UNIX, kind, flags, None).unwrap();
    rustix::net::connect(&socket, &SocketAddrUnix::new(path).unwrap()).unwrap();
    socket.into()
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_socket_of_packets_stands_for_an_instrument_on_usb() {
    let (_rig, mut server) = start();
    let directory = std::env::temp_dir().join(format!("rig-sim-usbtmc-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let path = directory.join("usbtmc0");
    server.open_usbtmc(&path).unwrap();
    let name = path.clone();
    client(move || {
        let mut port = packets(&name);
        // Two packets at once are two messages, and after a clear the first one is forgotten.
        for packet in [b">:FREQ 150;*ID".as_slice(), b"!", b">*IDN?\r\n"] {
            assert_eq!(port.write(packet).unwrap(), packet.len());
        }
        for expected in ["!".to_owned(), format!(".{IDENTITY}")] {
            let mut packet = [0; 4096];
            let received = port.read(&mut packet).unwrap();
            assert_eq!(String::from_utf8_lossy(&packet[..received]), expected);
        }
        // Another packet is no USB.
        assert_eq!(port.write(b"*IDN?\r\n").unwrap(), 7);
        assert_eq!(port.read(&mut [0; 8]).unwrap(), 0);
    })
    .await;
    std::fs::write(directory.join("file"), "").unwrap();
    assert!(server.open_usbtmc(&directory.join("file")).is_err());
    std::fs::remove_dir_all(&directory).unwrap();
}
