//! An instrument at the level of bytes, written for these tests alone.

use std::{collections::BTreeMap, time::Duration};

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt, DuplexStream},
    time::sleep,
};

/// The reaction of an instrument to a message: a delay, and an answer or none.
#[derive(Debug, Default)]
pub(crate) struct Reaction {
    pub(crate) busy: Duration,
    pub(crate) answer: Option<String>,
}

/// What goes wrong with one message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    MessageLost,
    AnswerLost,
    AnswerLate {
        ms: u64,
    },
    AnswerTwice,
    AnswerGarbled,
    /// A bit of the last character is wrong; it is an answer all the same.
    AnswerWrong,
    AnswerCut,
    /// The line feed is missing.
    AnswerEndsInCr,
    /// A byte at a time, and slowly.
    AnswerDrips {
        ms: u64,
    },
    Restart,
}

pub(crate) const FAULTS: [Fault; 8] = [
    Fault::MessageLost,
    Fault::AnswerLost,
    Fault::AnswerLate { ms: 700 },
    Fault::AnswerLate { ms: 1700 },
    Fault::AnswerTwice,
    Fault::AnswerGarbled,
    Fault::AnswerCut,
    Fault::Restart,
];

/// The device at the other end of a port.
pub(crate) trait Instrument: Send + 'static {
    fn message(&mut self, message: &str) -> Reaction;
    fn restart(&mut self);
}

/// Serves messages that end in CR and LF until the other side closes.
pub(crate) async fn serve(
    io: DuplexStream,
    instrument: impl Instrument,
    faults: BTreeMap<usize, Fault>,
) {
    serve_ending_in(b"\r\n", io, instrument, faults).await;
}

/// The same with another ending, either way.
pub(crate) async fn serve_ending_in(
    ending: &[u8],
    mut io: DuplexStream,
    mut instrument: impl Instrument,
    faults: BTreeMap<usize, Fault>,
) {
    let mut buffer = Vec::new();
    let mut n = 0;
    loop {
        while let Some(end) = buffer.windows(ending.len()).position(|end| end == ending) {
            let message: Vec<u8> = buffer.drain(..end + ending.len()).collect();
            let message = String::from_utf8(message[..end].to_vec()).unwrap();
            let fault = faults.get(&n).copied();
            n += 1;
            if fault == Some(Fault::MessageLost) {
                continue;
            }
            if fault == Some(Fault::Restart) {
                instrument.restart();
            }
            let reaction = instrument.message(&message);
            sleep(reaction.busy).await;
            let Some(answer) = reaction.answer else { continue };
            let mut answer = [answer.as_bytes(), ending].concat();
            match fault {
                Some(Fault::AnswerLost) => answer.clear(),
                Some(Fault::AnswerLate { ms }) => sleep(Duration::from_millis(ms)).await,
                Some(Fault::AnswerTwice) => answer = answer.repeat(2),
                Some(Fault::AnswerGarbled) => answer[0] = 0xC3,
                Some(Fault::AnswerWrong) => {
                    let last = answer.len() - ending.len() - 1;
                    answer[last] ^= 1;
                }
                Some(Fault::AnswerEndsInCr) => answer.truncate(answer.len() - 1),
                Some(Fault::AnswerCut) => answer.truncate(answer.len() - 3),
                _ => {}
            }
            if let Some(Fault::AnswerDrips { ms }) = fault {
                for byte in &answer {
                    _ = io.write_all(&[*byte]).await;
                    sleep(Duration::from_millis(ms)).await;
                }
                continue;
            }
            _ = io.write_all(&answer).await;
        }
        if io.read_buf(&mut buffer).await.unwrap_or(0) == 0 {
            return;
        }
    }
}
