//! Any bytes, cut at any place, are the same messages and leave the same answers and errors.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/meter/mod.rs"]
mod meter;

use meter::{Host, standard};
use rig_scpi::Dialect;

fuzz_target!(|input: (u8, u8, &[u8])| {
    let (flags, at, bytes) = input;
    let dialect = Dialect { strings_span_lines: flags & 1 == 0, ..standard() };
    let answers = |pieces: &[&[u8]]| {
        let mut host = Host::new(dialect.clone());
        let mut answers: Vec<u8> = pieces.iter().flat_map(|piece| host.say(piece)).collect();
        host.instrument.end_of_message();
        answers.extend(host.say(b"SYST:ERR:ALL?;*STB?\n"));
        answers
    };
    let (head, tail) = bytes.split_at(usize::from(at).min(bytes.len()));
    assert_eq!(answers(&[head, tail]), answers(&[bytes]));
});
