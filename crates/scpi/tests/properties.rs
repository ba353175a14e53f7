//! Properties of every input: nothing panics, the cuts of a stream have no effect, and each side
//! reads the messages of the other.

mod meter;

use meter::{Host, standard};
use proptest::{collection::vec, prelude::*, sample::Index};
use rig_scpi::{
    Datum, Dialect, Ending, FrameError, Framing, Program, RealFormat, Response, ResponseDecoder,
    Terminators, Value,
};

/// Bytes that a parser finds hard: mostly the characters of the grammar, now and then any byte.
fn hostile(max: usize) -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![
        8 => proptest::sample::select(b";:,*?#\"'()@!\n\r \t+-.eE0123456789ABHQ".to_vec()),
        1 => any::<u8>(),
    ];
    let word = proptest::sample::select(vec![
        "*IDN?",
        "*ESE",
        "FREQ",
        "FREQ?",
        "OUTP2",
        "DISP:LAB",
        "ECHO?",
        "SYST:ERR?",
        "STAT:OPER",
        "#15",
        "#0",
        "#206",
        "1E3",
        "KHZ",
        "MAX",
        "*WAI",
        "*OPC?",
        "FETC?",
    ]);
    let piece = prop_oneof![
        byte.prop_map(|byte| vec![byte]),
        word.prop_map(|word| word.as_bytes().to_vec()),
    ];
    vec(piece, 0..max).prop_map(|pieces| pieces.concat())
}

/// Cuts `bytes` at the places chosen.
fn cut<'a>(bytes: &'a [u8], cuts: &[Index]) -> Vec<&'a [u8]> {
    let mut places: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
    places.extend([0, bytes.len()]);
    places.sort_unstable();
    places.windows(2).map(|pair| &bytes[pair[0]..pair[1]]).collect()
}

fn decode(framing: Framing, pieces: &[&[u8]]) -> (Vec<Response>, Option<FrameError>) {
    let mut decoder = ResponseDecoder::new(framing);
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

/// Text that fits a string on the wire: ASCII, line feeds and quotes included.
fn ascii_text() -> impl Strategy<Value = String> {
    vec(0_u8..0x80, 0..24).prop_map(|bytes| bytes.into_iter().map(char::from).collect())
}

fn finite() -> impl Strategy<Value = f64> {
    any::<f64>().prop_filter("finite", |value| value.is_finite())
}

proptest! {
    #[test]
    fn an_instrument_survives_everything_and_does_not_mind_how_it_is_cut(
        bytes in hostile(60),
        cuts in vec(any::<Index>(), 0..6),
        spans in any::<bool>(),
        is_cr in any::<bool>(),
    ) {
        let terminators =
            [Terminators::LineFeed, Terminators::LineFeedOrCarriageReturn][usize::from(is_cr)];
        let dialect = Dialect { strings_span_lines: spans, terminators, ..standard() };
        let mut whole = Host::new(dialect.clone());
        let mut expected = whole.say(&bytes);
        whole.instrument.end_of_message();
        expected.extend(whole.say(b""));

        let mut pieces = Host::new(dialect);
        let mut found = Vec::new();
        for piece in cut(&bytes, &cuts) {
            found.extend(pieces.say(piece));
        }
        pieces.instrument.end_of_message();
        found.extend(pieces.say(b""));
        prop_assert_eq!(found.escape_ascii().to_string(), expected.escape_ascii().to_string());

        // In every case, the next message is answered.
        let answer = pieces.say(b"*OPC?\n");
        prop_assert_eq!(answer, b"1\n");
    }

    #[test]
    fn the_input_of_an_instrument_is_bounded(
        pieces in vec(hostile(20), 0..12),
        limit_bytes in 8_usize..64,
    ) {
        let mut host = Host::new(Dialect { input_limit_bytes: limit_bytes, ..standard() });
        for piece in &pieces {
            host.instrument.push(piece);
            prop_assert!(host.instrument.room() <= limit_bytes);
        }
        host.run();
        host.instrument.device_clear();
        prop_assert_eq!(host.instrument.room(), limit_bytes);
        host.instrument.take_output();
        prop_assert_eq!(host.say(b"*OPC?\n"), b"1\n");
    }

    #[test]
    fn a_decoder_survives_everything_and_does_not_mind_how_it_is_cut(
        bytes in hostile(60),
        cuts in vec(any::<Index>(), 0..6),
        limit_bytes in 1_usize..100,
        allows_indefinite_blocks in any::<bool>(),
        is_cr in any::<bool>(),
    ) {
        let ending = [Ending::Lf, Ending::Cr][usize::from(is_cr)];
        let framing = Framing { ending, limit_bytes, allows_indefinite_blocks };
        let whole = decode(framing, &[&bytes]);
        for response in &whole.0 {
            prop_assert!(response.bytes().len() < limit_bytes);
            // Data that cannot be read are an error, never a panic.
            _ = response.units();
            _ = rig_scpi::Identity::parse(response);
            _ = rig_scpi::ErrorReport::parse(response);
        }
        prop_assert_eq!(decode(framing, &cut(&bytes, &cuts)), whole);
    }

    #[test]
    fn an_instrument_reads_what_a_controller_writes(
        number in finite(),
        integer in -9_007_199_254_740_992_i64..=9_007_199_254_740_992,
        text in ascii_text(),
        block in vec(any::<u8>(), 0..300),
        is_on in any::<bool>(),
    ) {
        let program = Program::query("ECHO")
            .number(number)
            .unit("V")
            .integer(integer)
            .text(&text)
            .block(&block)
            .boolean(is_on)
            .expression("@1,2!5:3!6")
            .then_query("*OPC")
            .finish(Ending::CrLf)
            .expect("all of it can be written");
        let expected = format!(
            "N{number}|V,N{},T{},B{},C{},E@1,2!5:3!6;1\n",
            integer as f64,
            text.escape_default(),
            block.escape_ascii(),
            if is_on { "ON" } else { "OFF" },
        );
        let answer = Host::new(standard()).say(&program);
        prop_assert_eq!(answer.escape_ascii().to_string(), expected.as_bytes().escape_ascii().to_string());
    }

    #[test]
    fn a_controller_reads_what_an_instrument_writes(
        real in finite().prop_filter("no sentinel", |value| value.abs() < 9e37),
        integer in any::<i64>(),
        bits in any::<u64>(),
        text in ascii_text(),
        block in vec(any::<u8>(), 0..300),
        cuts in vec(any::<Index>(), 0..4),
    ) {
        let values = [
            (Value::Integer(integer), Datum::Integer(integer)),
            (Value::Hex(bits), Datum::NonDecimal(bits)),
            (Value::Octal(bits), Datum::NonDecimal(bits)),
            (Value::Binary(bits), Datum::NonDecimal(bits)),
            (Value::Boolean(true), Datum::Integer(1)),
            (Value::Characters("IMMediate"), Datum::Characters("IMM".to_owned())),
            (Value::Text(text.clone().into()), Datum::Text(text)),
            (Value::Block(block.clone()), Datum::Block(block)),
            (Value::Real(f64::NAN), Datum::Missing),
            (Value::Real(f64::NEG_INFINITY), Datum::Overload { is_negative: true }),
        ];
        let mut bytes = Vec::new();
        for (value, _) in &values {
            value.write(RealFormat::Shortest, &mut bytes);
            bytes.push(b',');
        }
        Value::Real(real).write(RealFormat::Shortest, &mut bytes);
        bytes.push(b'\n');
        let (responses, fault) = decode(Framing::default(), &cut(&bytes, &cuts));
        prop_assert_eq!(fault, None);
        prop_assert_eq!(responses.len(), 1);
        let mut data = responses[0].data().expect("what was written can be read");
        let last = data.pop().map(|datum| datum.number());
        prop_assert_eq!(last, Some(Ok(real)));
        let expected: Vec<Datum> = values.into_iter().map(|(_, datum)| datum).collect();
        prop_assert_eq!(data, expected);
    }

    #[test]
    fn a_number_in_exponent_form_keeps_its_digits(
        mantissa in -9.999_999..9.999_999_f64,
        exponent in -30_i32..30,
    ) {
        let value = mantissa * 10_f64.powi(exponent);
        let format = RealFormat::Scientific { n_decimals: 5, n_exponent: 2, has_plus: true };
        let mut bytes = Vec::new();
        Value::Real(value).write(format, &mut bytes);
        prop_assert_eq!(bytes.len(), "+1.23456E+12".len());
        bytes.push(b'\n');
        let (responses, _) = decode(Framing::default(), &[&bytes]);
        let read = responses[0].datum().and_then(|datum| datum.number()).expect("a number");
        prop_assert!((read - value).abs() <= value.abs() * 5.1e-6);
    }
}
