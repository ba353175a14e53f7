//! One line: its requests, the accepted answers, and the reaction to faults.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex},
    time::Duration,
};

use rig_link::{Clock, Durations, Endpoint, Health, LineError, Port, Transport};
use rig_model::{LineSettings, Parity, StopBits};
use rig_stage::{
    BusError, BusHandle, BusSettings, CheckRegisters, DeviceRefusal, Exception, Framing, LineFault,
    Reply, Request, Symptom,
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex},
    sync::mpsc::{UnboundedReceiver, unbounded_channel},
    time::{Instant, sleep, timeout},
};
use tokio_modbus::client::{Reader, Writer, rtu};
use tokio_serial::{SerialPort, SerialStream};

use crate::peer::{Action, FAULTS, Fault, echoing, faulty, hex, serve, truth, truthful, with_crc};

const LINE: LineSettings =
    LineSettings { baud: 115_200, parity: Parity::Even, stop_bits: StopBits::One };

fn bus_on(answer: impl FnMut(&[u8]) -> Vec<Action> + Send + 'static) -> BusHandle {
    let (host, device) = duplex(4096);
    tokio::spawn(serve(device, answer));
    BusHandle::open(Port::new("line 1", host, Some(LINE), Clock::start()), BusSettings::rtu())
}

fn bus_with(faults: impl IntoIterator<Item = (usize, Fault)>) -> BusHandle {
    bus_on(faulty(faults.into_iter().collect(), truthful(1)))
}

fn symptom(error: BusError) -> Symptom {
    match error {
        BusError::Failed(LineFault::NoAnswer { symptom, .. }) => symptom,
        other => panic!("{other:?}"),
    }
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Frames that manuals print. They must not change.
#[tokio::test(start_paused = true)]
async fn frames_are_those_of_the_manuals() {
    let write = |address, value| Request::WriteRegister { address, value };
    let rows = [
        // IAI, Modbus operation manual: write DRG1, write DRG2, coil 0426, read the system status.
        (write(0x0D03, 0x0001), "01 06 0D 03 00 01 BA A6", "01 06 0D 03 00 01 BA A6"),
        (write(0x0D00, 0x1008), "01 06 0D 00 10 08 87 60", "01 06 0D 00 10 08 87 60"),
        (
            Request::WriteCoil { address: 0x0426, is_on: true },
            "01 05 04 26 FF 00 6C C1",
            "01 05 04 26 FF 00 6C C1",
        ),
        (
            Request::ReadHolding { address: 0x900E, count: 2 },
            "01 03 90 0E 00 02 88 C8",
            "01 03 04 00 00 00 0B BB F4",
        ),
    ];
    for (request, golden, reply) in rows {
        let (golden, reply) = (hex(golden), hex(reply));
        let bus = bus_on(move |frame| {
            assert_eq!(frame, golden);
            vec![Action::Send(reply.clone())]
        });
        let answer = bus.request(1, request.clone()).await.unwrap();
        let expected = match request {
            Request::ReadHolding { .. } => Reply::Words(vec![0, 0x000B]),
            _ => Reply::Written,
        };
        assert_eq!(answer, expected);
    }
}

/// The effect of a late answer on the library, and on this driver.
#[tokio::test(start_paused = true)]
async fn a_late_answer_is_taken_by_the_library_and_never_here() {
    let late = || faulty(BTreeMap::from([(0, Fault::ReplyLate { ms: 300 })]), truthful(1));

    let (host, device) = duplex(4096);
    tokio::spawn(serve(device, late()));
    let mut library = rtu::attach_slave(host, tokio_modbus::Slave(1));
    let first = timeout(ms(100), library.read_holding_registers(0x00CC, 2)).await;
    assert!(first.is_err());
    sleep(ms(250)).await;
    // A position is taken for an alarm.
    let second = library.read_holding_registers(0x0080, 2).await.unwrap().unwrap();
    assert_eq!(second, truth(0x00CC, 2));

    let bus = bus_on(late());
    assert_eq!(bus.read(1, 0x00CC, 2).await.unwrap(), truth(0x00CC, 2));
    assert_eq!(bus.read(1, 0x0080, 2).await.unwrap(), truth(0x0080, 2));

    // A device that is recognised may even be later than anybody waits for.
    let mut answered = 0;
    for late_by in (90..2000).step_by(23) {
        for n_late in 1..6 {
            let bus = bus_with((1..=n_late).map(|n| (n, Fault::ReplyLate { ms: late_by })));
            recognise(&bus).await;
            for address in [0x00CC, 0x0080, 0x0120, 0x007E] {
                if let Ok(words) = bus.read(1, address, 2).await {
                    assert_eq!(words, truth(address, 2), "{n_late} late by {late_by} ms");
                    answered += 1;
                }
            }
        }
    }
    assert!(answered > 1000, "{answered}");
}

/// Reads known values of the device, which identify it.
async fn recognise(bus: &BusHandle) {
    let request = Request::ReadHolding { address: 0x0386, count: 6 };
    let expected = Some(bus.request(1, request.clone()).await.unwrap());
    bus.set_check_registers(1, Some(CheckRegisters { request, expected })).await.unwrap();
}

/// What was asked for was not sent.
#[tokio::test(start_paused = true)]
async fn a_refusal_of_the_registers_that_identify_a_device_names_them() {
    let bus = bus_with([(1, Fault::ReplyLost), (2, Fault::Exception(4))]);
    recognise(&bus).await;
    let error = bus.read(1, 0x00CC, 2).await.unwrap_err();
    let BusError::Refused(DeviceRefusal { request, .. }) = &error else { panic!("{error:?}") };
    assert_eq!(*request, Request::ReadHolding { address: 0x0386, count: 6 });
}

/// The effect of a wrong echo on the library, and on this driver.
#[tokio::test(start_paused = true)]
async fn an_answer_to_another_write_is_taken_by_the_library_and_never_here() {
    let stray = |reply: &[u8]| {
        let reply = with_crc(reply);
        move |_: &[u8]| vec![Action::Send(reply.clone())]
    };
    let (host, device) = duplex(4096);
    tokio::spawn(serve(device, stray(&[1, 6, 0, 0x20, 0, 9])));
    let call = tokio::spawn(async move {
        let mut library = rtu::attach_slave(host, tokio_modbus::Slave(1));
        library.write_single_register(0x10, 1).await
    });
    // A debug build of the library panics over it; a release build takes it.
    match call.await {
        Err(panic) => assert!(cfg!(debug_assertions) && panic.is_panic()),
        Ok(answer) => assert!(!cfg!(debug_assertions) && matches!(answer, Ok(Ok(())))),
    }

    let one = Request::WriteRegister { address: 0x10, value: 1 };
    let many = Request::WriteRegisters { address: 0x10, values: vec![1, 2] };
    let coil = Request::WriteCoil { address: 0x10, is_on: true };
    let read = Request::ReadHolding { address: 0x10, count: 2 };
    let bits = Request::ReadCoils { address: 0x10, count: 9 };
    let other = Symptom::OtherAnswer;
    let wrong = |found, expected| Symptom::WrongCount { found, expected };
    let rows: [(&Request, &[u8], Symptom); 12] = [
        (&one, &[1, 6, 0, 0x20, 0, 1], other),
        (&one, &[1, 6, 0, 0x10, 0, 2], other),
        (&one, &[1, 16, 0, 0x10, 0, 1], other),
        (&many, &[1, 16, 0, 0x20, 0, 2], other),
        (&many, &[1, 16, 0, 0x10, 0, 1], other),
        (&coil, &[1, 5, 0, 0x11, 0xFF, 0], other),
        (&coil, &[1, 5, 0, 0x10, 0, 0], other),
        (&read, &[1, 3, 2, 0, 1], wrong(2, 4)),
        (&read, &[1, 3, 8, 0, 1, 0, 2, 0, 3, 0, 4], wrong(8, 4)),
        (&read, &[1, 4, 4, 0, 1, 0, 2], other),
        (&bits, &[1, 1, 1, 0xFF], wrong(1, 2)),
        (&bits, &[1, 1, 3, 0xFF, 0xFF, 0xFF], wrong(3, 2)),
    ];
    for (request, reply, expected) in rows {
        let error = bus_on(stray(reply)).request(1, request.clone()).await.unwrap_err();
        assert_eq!(symptom(error), expected, "{request}: {reply:02X?}");
    }
    let error = bus_on(stray(&[2, 6, 0, 0x10, 0, 1])).request(1, one).await.unwrap_err();
    assert_eq!(symptom(error), Symptom::ForeignUnit(2));
}

#[tokio::test(start_paused = true)]
async fn whatever_happens_to_a_frame_an_answer_is_the_truth() {
    let reads = [(0x7F, 3), (0x120, 4), (0x7F, 3), (0x386, 6), (0x80, 2), (0x7F, 3)];
    for first in FAULTS {
        for second in FAULTS {
            for gap in 1..4 {
                let bus = bus_with([(1, first), (1 + gap, second)]);
                for (address, count) in reads {
                    if let Ok(words) = bus.read(1, address, count).await {
                        let context = (first, second, gap, address);
                        assert_eq!(words, truth(address, count), "{context:?}");
                    }
                }
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn what_is_wrong_with_a_line_is_said_in_words() {
    let always = |fault| (0..9).map(move |n| (n, fault));
    let rows = [
        (
            Fault::ReplyLost,
            "line 1: unit 1: read 2 holding registers at 0x0080: no answer (3 attempts)",
        ),
        (
            Fault::ReplyCorrupted,
            "line 1: unit 1: read 2 holding registers at 0x0080: the checksum of the answer is \
             wrong (3 attempts), 9 bytes arrived: 01 03 ",
        ),
        (
            Fault::ReplyTruncated,
            "line 1: unit 1: read 2 holding registers at 0x0080: the answer broke off (3 \
             attempts), \
             6 bytes arrived: 01 03 04 ",
        ),
        (
            Fault::WrongUnit,
            "line 1: unit 1: read 2 holding registers at 0x0080: unit 5 answered \
             (3 attempts), 9 bytes arrived: 05 03 04 ",
        ),
        (
            Fault::ReplyTwice { ms_apart: 0 },
            "line 1: unit 1: read 2 holding registers at 0x0080: more than one answer arrived (3 \
             attempts), 18 bytes arrived: 01 03 04 ",
        ),
        (
            Fault::Garbled,
            "line 1: unit 1: read 2 holding registers at 0x0080: the bytes are not a Modbus frame \
             (3 attempts), 5 bytes arrived: ",
        ),
        (
            Fault::Exception(2),
            "line 1: unit 1 refused to read 2 holding registers at 0x0080: illegal address (2)",
        ),
        (
            Fault::Exception(6),
            "line 1: unit 1 refused to read 2 holding registers at 0x0080: busy (6)",
        ),
    ];
    for (fault, message) in rows {
        let faults: Vec<_> = (0..200).map(|n| (n, fault)).collect();
        let bus = bus_with(faults);
        let error = bus.read(1, 0x80, 2).await.unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with(message), "{text}");
        assert_eq!(text.len() > message.len(), text.contains("arrived"), "{text}");
        // The device that refuses and the line that fails are counted apart.
        let health = bus.health(1).read();
        let Health { requests, retries, refusals, faults, .. } = health;
        let is_refusal = matches!(fault, Fault::Exception(_));
        assert_eq!((requests, refusals), (1, u64::from(is_refusal)), "{fault:?}");
        let expected = if is_refusal { (0, 0) } else { (2, 1) };
        assert_eq!((retries, faults), expected, "{fault:?}");
        let unanswered = if is_refusal { 0 } else { 3 };
        assert_eq!(health.late + health.corrupt, unanswered, "{fault:?}");
        assert_eq!(health.late > 0, matches!(fault, Fault::ReplyLost), "{fault:?}");
        assert_eq!(health.last_round_trip.is_some(), is_refusal, "{fault:?}");
    }
    let bus = bus_with(always(Fault::Exception(3)));
    let error = bus.read(1, 0x80, 2).await.unwrap_err();
    let BusError::Refused(DeviceRefusal { exception, .. }) = error else { panic!("{error}") };
    assert_eq!(exception, Exception::IllegalValue);
}

#[tokio::test(start_paused = true)]
async fn a_busy_device_is_asked_again_until_it_is_free() {
    let bus = bus_with((0..20).map(|n| (n, Fault::Exception(6))));
    assert_eq!(bus.read(1, 0x80, 2).await.unwrap(), truth(0x80, 2));
}

#[tokio::test(start_paused = true)]
async fn an_adapter_that_echoes_is_lived_with_and_a_dead_device_behind_it_is_seen() {
    let bus = bus_on(echoing(truthful(1)));
    for _ in 0..3 {
        assert_eq!(bus.read(1, 0x80, 2).await.unwrap(), truth(0x80, 2));
        let write = Request::WriteRegister { address: 0x7D, value: 0x20 };
        assert_eq!(bus.request(1, write).await.unwrap(), Reply::Written);
        let write = Request::WriteRegisters { address: 0x58, values: vec![1, 2, 3] };
        assert_eq!(bus.request(1, write).await.unwrap(), Reply::Written);
    }
    assert_eq!(bus.health(1).read().retries, 0);
    // Unit 2 is not there: the echo alone is no answer, not even to a write.
    let write = Request::WriteRegister { address: 0x7D, value: 0x20 };
    assert_eq!(symptom(bus.request(2, write).await.unwrap_err()), Symptom::OnlyEcho);
    assert_eq!(bus.read(1, 0x80, 2).await.unwrap(), truth(0x80, 2));
}

#[tokio::test(start_paused = true)]
async fn two_users_of_a_line_wait_for_each_other_and_for_its_silence() {
    let (host, mut device) = duplex(4096);
    let port = Port::new("line 1", host, Some(LINE), Clock::start());
    let bus = BusHandle::open(port, BusSettings::rtu());
    // Answers one frame at a time, and notes when each was whole and when it was answered.
    let times = Arc::new(Mutex::new(Vec::new()));
    let noted = times.clone();
    tokio::spawn(async move {
        let (mut drives, mut frame) = ([truthful(1), truthful(2)], [0; 8]);
        while device.read_exact(&mut frame).await.is_ok() {
            noted.lock().unwrap().push(Instant::now());
            sleep(ms(4)).await;
            let reply = drives[usize::from(frame[0]) - 1](&frame);
            device.write_all(&reply).await.unwrap();
            noted.lock().unwrap().push(Instant::now());
        }
    });
    let read_all = |unit: u8| {
        let bus = bus.clone();
        tokio::spawn(async move {
            for address in 0x80..0xA0 {
                let words = bus.read(unit, address, 2).await.unwrap();
                assert_eq!(words, truth(address, 2));
            }
        })
    };
    let (one, two) = (read_all(1), read_all(2));
    one.await.unwrap();
    two.await.unwrap();
    let times = times.lock().unwrap();
    assert_eq!(times.len(), 2 * 2 * 0x20);
    for pair in times[1..].chunks_exact(2) {
        let silence = pair[1] - pair[0];
        assert!(Duration::from_micros(1750) <= silence, "{silence:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn an_exchange_is_finished_when_nobody_waits_for_it() {
    let bus = bus_with([(0, Fault::ReplyLate { ms: 50 })]);
    let abandoned = timeout(ms(10), bus.read(1, 0x80, 2)).await;
    assert!(abandoned.is_err());
    assert_eq!(bus.read(1, 0x90, 2).await.unwrap(), truth(0x90, 2));
    let health =
        Health { last_round_trip: None, round_trips: Durations::default(), ..bus.health(1).read() };
    assert_eq!(health, Health { requests: 2, ..Health::default() });
    assert_eq!(bus.health(2).read(), Health::default());
}

/// A line that can be plugged in again, and the sockets that the devices get.
fn pluggable(framing: Framing) -> (Endpoint, UnboundedReceiver<DuplexStream>) {
    let (sockets, plugged) = unbounded_channel();
    let plug = Box::new(move || {
        let (host, device) = duplex(4096);
        sockets.send(device).ok()?;
        Some(Box::new(host) as Box<dyn Transport>)
    });
    let line = (framing == Framing::Rtu).then_some(LINE);
    (Endpoint::Memory { name: "line 1".into(), line, plug }, plugged)
}

#[tokio::test(start_paused = true)]
async fn a_line_that_was_unplugged_fails_once_and_is_opened_again() {
    let (endpoint, mut plugged) = pluggable(Framing::Rtu);
    let port = Port::open(endpoint, Clock::start()).await.unwrap();
    let bus = BusHandle::open(port, BusSettings::rtu());
    drop(plugged.recv().await.unwrap());
    let error = bus.read(1, 0x80, 2).await.unwrap_err();
    assert_eq!(error.to_string(), "line 1: the port has disappeared");
    tokio::spawn(async move {
        serve(plugged.recv().await.unwrap(), faulty(BTreeMap::new(), truthful(1))).await;
    });
    assert_eq!(bus.read(1, 0x80, 2).await.unwrap(), truth(0x80, 2));
}

/// Serves Modbus TCP from an RTU device.
async fn serve_tcp(
    mut io: DuplexStream,
    mut device: impl FnMut(&[u8]) -> Vec<u8>,
    late_ms: impl Fn(u16) -> u64,
) {
    let mut header = [0; 6];
    let mut n = 0;
    while io.read_exact(&mut header).await.is_ok() {
        let length = usize::from(u16::from_be_bytes([header[4], header[5]]));
        let mut request = vec![0; length];
        io.read_exact(&mut request).await.unwrap();
        let reply = device(&with_crc(&request));
        let reply = &reply[..reply.len() - 2];
        let length = u16::try_from(reply.len()).unwrap().to_be_bytes();
        sleep(ms(late_ms(n))).await;
        n += 1;
        if io.write_all(&[&header[..4], &length, reply].concat()).await.is_err() {
            return;
        }
    }
}

#[tokio::test(start_paused = true)]
async fn modbus_tcp_begins_a_new_connection_after_a_late_answer() {
    let (endpoint, mut plugged) = pluggable(Framing::Tcp);
    let port = Port::open(endpoint, Clock::start()).await.unwrap();
    let connections = Arc::new(Mutex::new(0));
    let counted = connections.clone();
    tokio::spawn(async move {
        while let Some(device) = plugged.recv().await {
            *counted.lock().unwrap() += 1;
            // The second answer of each connection is late.
            let late_ms = |n| if n == 1 { 700 } else { 0 };
            tokio::spawn(serve_tcp(device, truthful(1), late_ms));
        }
    });
    let bus = BusHandle::open(port, BusSettings::tcp());
    for address in 0x80..0x90 {
        assert_eq!(bus.read(1, address, 2).await.unwrap(), truth(address, 2));
    }
    let write = Request::WriteRegister { address: 0x7D, value: 0x20 };
    assert_eq!(bus.request(1, write).await.unwrap(), Reply::Written);
    assert!(*connections.lock().unwrap() > 10);
}

/// The library reports such an answer as the end of the stream, like a lost port.
#[tokio::test(start_paused = true)]
async fn an_answer_that_is_shorter_than_it_says_is_no_lost_port() {
    let (endpoint, mut plugged) = pluggable(Framing::Tcp);
    let port = Port::open(endpoint, Clock::start()).await.unwrap();
    tokio::spawn(async move {
        while let Some(device) = plugged.recv().await {
            // It announces six bytes of data and sends four, all within the length of its frame.
            let short = |_: &[u8]| vec![1, 3, 6, 0, 0, 0, 1, 0, 0];
            tokio::spawn(serve_tcp(device, short, |_| 0));
        }
    });
    let bus = BusHandle::open(port, BusSettings::tcp());
    let error = bus.read(1, 0x80, 2).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 1: unit 1: read 2 holding registers at 0x0080: the answer announces 6 bytes of data instead of 4 (3 attempts), 13 bytes arrived: 00 00 00 00 00 07 01 03 06 00 00 \
         00 \
         01"
    );
}

/// In real time, through the serial layer of the operating system.
#[tokio::test]
async fn a_terminal_is_a_line_like_any_other() {
    let (device, host) = SerialStream::pair().unwrap();
    let path = host.name().unwrap();
    drop(host);
    let line = LineSettings { baud: 115_200, parity: Parity::None, stop_bits: StopBits::One };
    let endpoint = Endpoint::Serial { path, line };
    let port = Port::open(endpoint, Clock::start()).await.unwrap();
    let faults = [(3, Fault::ReplyCorrupted), (9, Fault::ReplyLost), (12, Fault::Echoed)];
    let device = tokio::spawn(serve(device, faulty(BTreeMap::from(faults), truthful(1))));
    let settings = BusSettings { quarantine: ms(30), ..BusSettings::rtu() };
    let bus = BusHandle::open(port, settings);
    recognise(&bus).await;
    for address in 0x80..0x90 {
        assert_eq!(bus.read(1, address, 2).await.unwrap(), truth(address, 2));
    }
    let write = Request::WriteRegisters { address: 0x58, values: vec![1, 2, 3] };
    assert_eq!(bus.request(1, write).await.unwrap(), Reply::Written);
    // Unplugged, and nothing is there to be opened again.
    device.abort();
    _ = device.await;
    assert!(matches!(
        bus.read(1, 0x80, 2).await,
        Err(BusError::Failed(LineFault::Port(LineError::Lost { .. })))
    ));
    assert!(matches!(bus.read(1, 0x80, 2).await, Err(BusError::Failed(LineFault::Reopen { .. }))));
}
