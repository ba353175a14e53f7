//! The owner of a descriptor against a driver that follows a script.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard},
};

use tokio::io::{AsyncReadExt, AsyncWriteExt};

use super::*;

const ETIMEDOUT: i32 = 110;
const EPROTO: i32 = 71;
const EPIPE: i32 = 32;
const ENODEV: i32 = 19;

/// A piece of an answer and whether it is the last one, or the error of a read.
type Step = Result<(&'static [u8], bool), i32>;

#[derive(Debug, Default)]
struct Script {
    /// Messages and clears, in their order.
    seen: Vec<String>,
    answers: VecDeque<Step>,
    write_error: Option<i32>,
    clear_error: Option<i32>,
    is_closed: bool,
}

/// Both the driver and what a test sees of it.
#[derive(Debug, Clone, Default)]
struct Bench(Arc<Mutex<Script>>);

impl Bench {
    fn script(&self) -> MutexGuard<'_, Script> {
        self.0.lock().unwrap()
    }

    fn with<const N: usize>(answers: [Step; N]) -> Self {
        let bench = Self::default();
        bench.script().answers.extend(answers);
        bench
    }

    fn link(&self) -> MessageLink {
        MessageLink::start(Driver(self.clone())).unwrap()
    }

    fn seen(&self) -> Vec<String> {
        self.script().seen.clone()
    }
}

struct Driver(Bench);

impl Drop for Driver {
    fn drop(&mut self) {
        self.0.script().is_closed = true;
    }
}

fn check(error: Option<i32>) -> io::Result<()> {
    error.map_or(Ok(()), |number| Err(io::Error::from_raw_os_error(number)))
}

impl MessageDevice for Driver {
    fn write(&mut self, message: &[u8]) -> io::Result<()> {
        let mut script = self.0.script();
        script.seen.push(message.escape_ascii().to_string());
        check(script.write_error)
    }

    fn has_answer(&mut self) -> io::Result<bool> {
        Ok(!self.0.script().answers.is_empty())
    }

    fn read(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        let step = self.0.script().answers.pop_front().unwrap();
        let (bytes, is_last) = step.map_err(io::Error::from_raw_os_error)?;
        piece.extend_from_slice(bytes);
        Ok(is_last)
    }

    fn clear(&mut self) -> io::Result<()> {
        let mut script = self.0.script();
        script.seen.push("clear".to_owned());
        check(script.clear_error)
    }
}

#[tokio::test]
async fn a_write_is_one_message_and_the_pieces_of_an_answer_are_one_stream() {
    let long: &[u8] = &[b'7'; 4080];
    let bench = Bench::with([Ok((long, false)), Ok((b"", false)), Ok((b"end\n", true))]);
    let mut link = bench.link();
    link.write_all(b":FREQ 140;:FETC?\n").await.unwrap();
    let mut answer = vec![0; long.len() + 4];
    link.read_exact(&mut answer).await.unwrap();
    assert!(answer.starts_with(long) && answer.ends_with(b"7end\n"));
    assert_eq!(bench.seen(), [":FREQ 140;:FETC?\\n"]);
}

#[tokio::test]
async fn after_an_error_the_device_is_cleared_and_the_link_goes_on() {
    // What a device does that stalls is no sign that it is gone.
    for (error, kind) in
        [(ETIMEDOUT, ErrorKind::TimedOut), (EPROTO, ErrorKind::Other), (EPIPE, ErrorKind::Other)]
    {
        let bench = Bench::with([Ok((b"1.4", false)), Err(error)]);
        let mut link = bench.link();
        link.write_all(b"*IDN?\n").await.unwrap();
        let mut answer = [0; 3];
        link.read_exact(&mut answer).await.unwrap();
        let found = link.read(&mut [0; 8]).await.unwrap_err();
        assert_eq!(found.kind(), kind, "{found}");
        bench.script().answers.push_back(Ok((b"0\n", true)));
        link.write_all(b"*ESR?\n").await.unwrap();
        link.read_exact(&mut answer[..2]).await.unwrap();
        assert_eq!(&answer[..2], b"0\n");
        assert_eq!(bench.seen(), ["*IDN?\\n", "clear", "*ESR?\\n"]);
    }
}

#[tokio::test]
async fn a_message_that_is_not_taken_is_reported_and_the_device_is_cleared() {
    let bench = Bench::default();
    bench.script().write_error = Some(ETIMEDOUT);
    let mut link = bench.link();
    let error = link.write_all(b"*IDN?\n").await.unwrap_err();
    assert_eq!(error.kind(), ErrorKind::TimedOut);
    assert_eq!(bench.seen(), ["*IDN?\\n", "clear"]);
}

#[tokio::test]
async fn an_unplugged_instrument_is_lost_and_its_file_is_closed_before_that_is_known() {
    let lost = |error: io::Error| assert_eq!(error.kind(), ErrorKind::NotConnected);
    // It is found missing by a message, by a read, and by a clear.
    let bench = Bench::default();
    bench.script().write_error = Some(ENODEV);
    bench.script().clear_error = Some(ENODEV);
    let mut link = bench.link();
    lost(link.write_all(b"*IDN?\n").await.unwrap_err());
    assert!(bench.script().is_closed);
    lost(link.write_all(b"*IDN?\n").await.unwrap_err());

    let bench = Bench::with([Err(ENODEV)]);
    bench.script().clear_error = Some(ENODEV);
    let mut link = bench.link();
    link.write_all(b"*IDN?\n").await.unwrap();
    lost(link.read(&mut [0; 8]).await.unwrap_err());
    assert!(bench.script().is_closed);

    let bench = Bench::default();
    bench.script().clear_error = Some(ENODEV);
    let mut link = bench.link();
    lost(link.cleared().await.unwrap_err());
    assert!(bench.script().is_closed);
}

#[tokio::test]
async fn what_was_answered_before_a_clear_is_discarded() {
    let bench = Bench::with([Ok((b"late\n", true))]);
    let mut link = bench.link();
    link.write_all(b"*IDN?\n").await.unwrap();
    // The answer has arrived, and was not taken.
    link.read_exact(&mut [0; 1]).await.unwrap();
    link.give_up();
    link.cleared().await.unwrap();
    bench.script().answers.push_back(Ok((b"0\n", true)));
    link.write_all(b"*ESR?\n").await.unwrap();
    let mut answer = [0; 2];
    link.read_exact(&mut answer).await.unwrap();
    assert_eq!(&answer, b"0\n");
    // One clear is enough; after a message there is another one.
    link.cleared().await.unwrap();
    assert_eq!(bench.seen(), ["*IDN?\\n", "clear", "*ESR?\\n", "clear"]);
}

/// A driver in which every call waits for the test.
struct Stuck(std::sync::mpsc::Receiver<()>);

impl Stuck {
    fn wait(&self) -> io::Result<()> {
        self.0.recv().map_err(|_| lost())
    }
}

impl MessageDevice for Stuck {
    fn write(&mut self, _: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn has_answer(&mut self) -> io::Result<bool> {
        self.wait().map(|()| true)
    }

    fn read(&mut self, _: &mut Vec<u8>) -> io::Result<bool> {
        self.wait().map(|()| true)
    }

    fn clear(&mut self) -> io::Result<()> {
        self.wait()
    }
}

#[tokio::test]
async fn nobody_waits_for_a_driver_that_waits() {
    let (let_go, stuck) = std::sync::mpsc::channel();
    let mut link = MessageLink::start(Stuck(stuck)).unwrap();
    link.write_all(b"*IDN?\n").await.unwrap();
    // Time stands still until everything waits.
    tokio::time::pause();
    let begun = tokio::time::Instant::now();
    let within = std::time::Duration::from_secs(60);
    assert!(tokio::time::timeout(within, link.read(&mut [0; 8])).await.is_err());
    link.give_up();
    assert!(tokio::time::timeout(within, link.cleared()).await.is_err());
    assert_eq!(begun.elapsed().as_secs(), 120);
    // To close it waits for nothing either.
    drop(link);
    drop(let_go);
}

#[tokio::test]
async fn a_file_is_closed_with_its_port() {
    let bench = Bench::default();
    let mut link = bench.link();
    link.write_all(b"*IDN?\n").await.unwrap();
    drop(link);
    while !bench.script().is_closed {
        tokio::task::yield_now().await;
    }
}
