//! A Modbus RTU device at the level of bytes, written for these tests alone, so that the driver is
//! not tested against its own library.

use std::{collections::BTreeMap, time::Duration};

use tokio::{
    io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt},
    time::sleep,
};

/// The reaction of a peer to a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Action {
    Send(Vec<u8>),
    Wait(Duration),
}

pub(crate) fn crc(bytes: &[u8]) -> [u8; 2] {
    let mut crc = 0xFFFF_u16;
    for &byte in bytes {
        crc ^= u16::from(byte);
        for _ in 0..8 {
            let carry = crc & 1;
            crc >>= 1;
            if carry == 1 {
                crc ^= 0xA001;
            }
        }
    }
    crc.to_le_bytes()
}

pub(crate) fn with_crc(bytes: &[u8]) -> Vec<u8> {
    [bytes, &crc(bytes)].concat()
}

/// Bytes as manuals print them.
pub(crate) fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

/// Serves whole requests until the other side closes.
pub(crate) async fn serve(
    mut io: impl AsyncRead + AsyncWrite + Unpin,
    mut answer: impl FnMut(&[u8]) -> Vec<Action> + Send + 'static,
) {
    let mut buffer = Vec::new();
    loop {
        while let Some(length) = request_len(&buffer).filter(|&length| length <= buffer.len()) {
            let request: Vec<u8> = buffer.drain(..length).collect();
            assert_eq!(crc(&request[..length - 2]), request[length - 2..], "{request:02x?}");
            for action in answer(&request) {
                match action {
                    Action::Send(bytes) => _ = io.write_all(&bytes).await,
                    Action::Wait(duration) => sleep(duration).await,
                }
            }
        }
        if io.read_buf(&mut buffer).await.unwrap_or(0) == 0 {
            return;
        }
    }
}

fn request_len(buffer: &[u8]) -> Option<usize> {
    match buffer.get(1)? {
        1..=6 => Some(8),
        0x0F | 0x10 => Some(9 + usize::from(*buffer.get(6)?)),
        other => panic!("function {other} is not one these drivers use"),
    }
}

/// What goes wrong with one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    RequestLost,
    ReplyLost,
    ReplyLate {
        ms: u64,
    },
    ReplyTwice {
        ms_apart: u64,
    },
    ReplyCorrupted,
    ReplyTruncated,
    WrongUnit,
    Echoed,
    NoiseBefore {
        bytes: usize,
    },
    /// What another speed makes of an answer.
    Garbled,
    Exception(u8),
}

/// Every kind of fault, late replies on either side of the driver's patience.
pub(crate) const FAULTS: [Fault; 17] = [
    Fault::RequestLost,
    Fault::ReplyLost,
    Fault::ReplyLate { ms: 60 },
    Fault::ReplyLate { ms: 130 },
    Fault::ReplyLate { ms: 400 },
    Fault::ReplyTwice { ms_apart: 0 },
    Fault::ReplyTwice { ms_apart: 1 },
    Fault::ReplyCorrupted,
    Fault::ReplyTruncated,
    Fault::WrongUnit,
    Fault::Echoed,
    Fault::NoiseBefore { bytes: 5 },
    Fault::NoiseBefore { bytes: 40 },
    Fault::Garbled,
    Fault::Exception(4),
    Fault::Exception(5),
    Fault::Exception(6),
];

/// Lets faults happen to the n-th requests, counted from zero.
pub(crate) fn faulty(
    faults: BTreeMap<usize, Fault>,
    mut device: impl FnMut(&[u8]) -> Vec<u8> + Send + 'static,
) -> impl FnMut(&[u8]) -> Vec<Action> + Send + 'static {
    let mut n = 0;
    move |request| {
        let fault = faults.get(&n).copied();
        n += 1;
        if fault == Some(Fault::RequestLost) {
            return vec![];
        }
        if let Some(Fault::Exception(code)) = fault {
            return vec![Action::Send(with_crc(&[request[0], request[1] | 0x80, code]))];
        }
        let mut reply = device(request);
        let wait = |ms| Action::Wait(Duration::from_millis(ms));
        match fault {
            Some(Fault::ReplyLost) => return vec![],
            Some(Fault::ReplyLate { ms }) => return vec![wait(ms), Action::Send(reply)],
            Some(Fault::ReplyTwice { ms_apart }) => {
                return vec![Action::Send(reply.clone()), wait(ms_apart), Action::Send(reply)];
            }
            Some(Fault::ReplyCorrupted) => reply[2] ^= 0x10,
            Some(Fault::ReplyTruncated) => reply.truncate(reply.len() - 3),
            Some(Fault::WrongUnit) => {
                reply[0] ^= 4;
                reply = with_crc(&reply[..reply.len() - 2]);
            }
            Some(Fault::Echoed) => reply = [request, &reply].concat(),
            Some(Fault::NoiseBefore { bytes }) => reply = [&vec![0x5A; bytes], &reply[..]].concat(),
            Some(Fault::Garbled) => {
                reply = reply.iter().step_by(2).map(|byte| byte.reverse_bits() | 0xC0).collect();
            }
            _ => {}
        }
        vec![Action::Send(reply)]
    }
}

/// Registers that hold a function of their address, so that a stale answer shows.
pub(crate) fn truth(address: u16, count: u16) -> Vec<u16> {
    (address..address + count).map(|address| address.wrapping_mul(0x9E37)).collect()
}

/// A device whose registers hold the [`truth`], and that takes every write.
pub(crate) fn truthful(unit: u8) -> impl FnMut(&[u8]) -> Vec<u8> + Send + 'static {
    move |request| {
        if request[0] != unit {
            return vec![];
        }
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let mut reply = match request[1] {
            3 => vec![unit, 3, 2 * request[5]],
            5 | 6 | 16 => return with_crc(&request[..6]),
            other => panic!("function {other}"),
        };
        if request[1] == 3 {
            reply.extend(truth(word(2), word(4)).into_iter().flat_map(u16::to_be_bytes));
        }
        with_crc(&reply)
    }
}

/// The device behind an adapter that receives its own bytes.
pub(crate) fn echoing(
    mut device: impl FnMut(&[u8]) -> Vec<u8> + Send + 'static,
) -> impl FnMut(&[u8]) -> Vec<Action> + Send + 'static {
    move |request| {
        let wait = Action::Wait(Duration::from_millis(3));
        vec![Action::Send(request.to_vec()), wait, Action::Send(device(request))]
    }
}
