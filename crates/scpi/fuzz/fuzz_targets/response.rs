//! Any bytes, cut at any place, are the same answers and the same fault, and reading their data ends
//! in values or an error.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rig_scpi::{
    Ending, ErrorReport, ExpectedResponse, FrameError, Framing, Identity, Response, ResponseDecoder,
};

fuzz_target!(|input: (u8, u8, &[u8])| {
    let (flags, at, bytes) = input;
    let framing = Framing {
        ending: [Ending::Lf, Ending::CrLf, Ending::Cr][usize::from(flags) % 3],
        limit_bytes: if flags & 0x40 == 0 { 1024 } else { 16 },
        allows_indefinite_blocks: flags & 0x80 != 0,
    };
    let expect = if flags & 0x20 == 0 { ExpectedResponse::Data } else { ExpectedResponse::Line };
    let (head, tail) = bytes.split_at(usize::from(at).min(bytes.len()));
    let whole = decode(framing, expect, &[bytes]);
    assert_eq!(decode(framing, expect, &[head, tail]), whole);
    for response in &whole.0 {
        assert!(response.bytes().len() < framing.limit_bytes);
        if let Ok(units) = response.units() {
            for datum in units.iter().flat_map(|unit| &unit.data) {
                // No sentinel passes.
                assert!(
                    datum.number().is_ok_and(|value| value.abs() < 9.89e37)
                        || datum.number().is_err()
                );
            }
        }
        _ = Identity::parse(response);
        _ = ErrorReport::parse(response);
    }
});

fn decode(
    framing: Framing,
    expect: ExpectedResponse,
    pieces: &[&[u8]],
) -> (Vec<Response>, Option<FrameError>) {
    let mut decoder = ResponseDecoder::new(framing);
    decoder.expect(expect);
    let mut responses = Vec::new();
    for piece in pieces {
        decoder.push(piece);
        loop {
            match decoder.poll() {
                Ok(Some(response)) => responses.push(response),
                Ok(None) => break,
                Err(fault) => return (responses, Some(fault)),
            }
        }
    }
    (responses, None)
}
