//! Streams of instruments, as a controller decodes them. `check` runs each row once per way of
//! cutting its bytes in two.

use rig_scpi::{
    DataError, Datum, Ending, ErrorReport, ExpectedResponse, FrameError, Framing, Identity,
    Program, ProgramError, Response, ResponseDecoder,
};

/// What came out: the bytes of an answer, or the fault.
type Row<'a> = Result<&'a [u8], FrameError>;

fn decode(mut decoder: ResponseDecoder, pieces: &[&[u8]]) -> Vec<Result<Response, FrameError>> {
    let mut found = Vec::new();
    for piece in pieces {
        decoder.push(piece);
        loop {
            match decoder.poll() {
                Ok(Some(response)) => found.push(Ok(response)),
                Ok(None) => break,
                Err(fault) => {
                    assert_eq!(decoder.poll(), Err(fault), "a fault is sticky");
                    if found.last() != Some(&Err(fault)) {
                        found.push(Err(fault));
                    }
                    break;
                }
            }
        }
    }
    found
}

#[track_caller]
fn check_with(framing: Framing, stream: &[u8], expected: &[Row<'_>]) {
    for cut in 0..=stream.len() {
        let (head, tail) = stream.split_at(cut);
        let found = decode(ResponseDecoder::new(framing), &[head, tail]);
        let found: Vec<Row<'_>> =
            found.iter().map(|row| row.as_ref().map(Response::bytes).map_err(|e| *e)).collect();
        assert_eq!(found, expected, "cut at byte {cut} of b\"{}\"", stream.escape_ascii());
    }
}

#[track_caller]
fn check(stream: &[u8], expected: &[Row<'_>]) {
    check_with(Framing::default(), stream, expected);
}

fn whole(bytes: &[u8]) -> Response {
    let mut found = decode(ResponseDecoder::new(Framing::default()), &[bytes, b"\n"]);
    assert_eq!(found.len(), 1, "b\"{}\" is one answer", bytes.escape_ascii());
    found.remove(0).expect("the answer is well framed")
}

#[test]
fn answers_end_where_their_data_do() {
    check(b"+1.0E+02", &[]);
    check(b"+1.0E+02\r\n", &[Ok(b"+1.0E+02")]);
    check(b"1\n\n2\n", &[Ok(b"1"), Ok(b""), Ok(b"2")]);
    check(b"#203abc\n1\n", &[Ok(b"#203abc"), Ok(b"1")]);
    // The payload holds endings and a `#`; only the declared length may end the block.
    check(b"#15\n#1\n\n\n7\n", &[Ok(b"#15\n#1\n\n"), Ok(b"7")]);
    check(b"1,#12\r\n;#10\r\n", &[Ok(b"1,#12\r\n;#10")]);
    check(b":DATA #12;\n\n", &[Ok(b":DATA #12;\n")]);
    check(b"\"a\nb;\"\"\n\",#HFF\n", &[Ok(b"\"a\nb;\"\"\n\",#HFF")]);
    // A byte beyond ASCII is data in a block.
    check(b"#12\xFF\n\n", &[Ok(b"#12\xFF\n")]);
}

#[test]
fn a_damaged_stream_is_a_fault_that_stays() {
    check(b"1\xB2\n2\n", &[Err(FrameError::NotAscii { byte: 0xB2, offset: 1 })]);
    check(b"#2+3abc\n", &[Err(FrameError::BlockLength { offset: 2 })]);
    check(b"#3\n12\n", &[Err(FrameError::BlockLength { offset: 2 })]);
    check(b"#12abc\n", &[Err(FrameError::BlockEnd { byte: b'c', offset: 5 })]);
    // Messages before the damage are still returned; those after it are not.
    check(b"1\n#0abc\n2\n", &[Ok(b"1"), Err(FrameError::IndefiniteBlock { offset: 1 })]);

    let framing = Framing { limit_bytes: 8, ..Framing::default() };
    let too_long = FrameError::TooLong { limit_bytes: 8 };
    check_with(framing, b"1234567\n", &[Ok(b"1234567")]);
    check_with(framing, b"12345678\n", &[Err(too_long)]);
    check_with(framing, b"12345678", &[Err(too_long)]);
    check_with(framing, b"#14abcd\n", &[Ok(b"#14abcd")]);
    check_with(framing, b"#15abcde\n", &[Err(too_long)]);
    // A length beyond the limit is refused before its bytes are awaited.
    check_with(framing, b"#3999", &[Err(too_long)]);
}

#[test]
fn framing_follows_the_instrument() {
    let cr = Framing { ending: Ending::Cr, ..Framing::default() };
    check_with(cr, b"1\r2\r\n3\r", &[Ok(b"1"), Ok(b"2"), Ok(b"3")]);
    let indefinite = Framing { allows_indefinite_blocks: true, ..Framing::default() };
    check_with(indefinite, b"#0a,b\xFF\n1\n", &[Ok(b"#0a,b\xFF"), Ok(b"1")]);
    assert_eq!(
        decode(ResponseDecoder::new(indefinite), &[b"7,#0a,b\n"])[0].as_ref().map(Response::data),
        Ok(Ok(vec![Datum::Integer(7), Datum::Block(b"a,b".to_vec())]))
    );
}

#[test]
fn a_line_is_taken_as_it_stands() {
    // As data, the serial number would begin a block that never ends, and the quote a string.
    let identity = b"ACME,5\" PROBE,#12345,V1\n";
    for cut in 0..identity.len() {
        let mut decoder = ResponseDecoder::new(Framing::default());
        decoder.expect(ExpectedResponse::Line);
        let (head, tail) = identity.split_at(cut);
        decoder.push(head);
        assert_eq!(decoder.poll(), Ok(None));
        decoder.push(tail);
        decoder.push(b"\"a\n\"\n");
        let response = decoder.poll().expect("no fault").expect("a whole line");
        assert_eq!(response.text(), Ok("ACME,5\" PROBE,#12345,V1"));
        // Only one answer was expected to be a line.
        let response = decoder.poll().expect("no fault").expect("a whole answer");
        assert_eq!(response.datum(), Ok(Datum::Text("a\n".to_owned())));
        assert_eq!(decoder.n_buffered(), 0);
    }
}

#[test]
fn a_reset_begins_anew_and_the_end_of_a_packet_ends_an_answer() {
    let mut decoder = ResponseDecoder::new(Framing::default());
    decoder.push(b"#1x");
    assert!(decoder.poll().is_err());
    decoder.push(b"1\n");
    decoder.reset();
    decoder.push(b"2");
    assert_eq!(decoder.poll(), Ok(None));
    let response = decoder.end_of_message().expect("no fault").expect("an answer");
    assert_eq!(response.datum(), Ok(Datum::Integer(2)));
    assert_eq!(decoder.end_of_message(), Ok(None));
    decoder.push(b"#15ab");
    assert!(decoder.end_of_message().is_err());
}

#[test]
fn data_have_types_and_sentinels_end_here() {
    let overload = |is_negative| Datum::Overload { is_negative };
    let word = |text: &str| Datum::Characters(text.to_owned());
    let rows: &[(&[u8], Datum)] = &[
        (b"1", Datum::Integer(1)),
        (b"+200", Datum::Integer(200)),
        (b" -7 ", Datum::Integer(-7)),
        (b"99999999999999999999", Datum::Real(1e20)),
        (b"+1.00000E+02", Datum::Real(100.0)),
        (b".5", Datum::Real(0.5)),
        (b"1.", Datum::Real(1.0)),
        (b"1e3", Datum::Real(1000.0)),
        (b"#HfF", Datum::NonDecimal(255)),
        (b"#Q17", Datum::NonDecimal(15)),
        (b"#B101", Datum::NonDecimal(5)),
        (b"\"a\"\"b\"", Datum::Text("a\"b".to_owned())),
        (b"\"\"", Datum::Text(String::new())),
        (b"MEAS", word("MEAS")),
        (b"No error", word("No error")),
        (b"1999.0a", word("1999.0a")),
        (b"#13;,\n", Datum::Block(b";,\n".to_vec())),
        (b"9.9E37", overload(false)),
        (b"+9.90000E+37", overload(false)),
        (b"-9.90000E+37", overload(true)),
        (b"9.9000004E+37", overload(false)),
        (b"1E400", overload(false)),
        (b"9.91E37", Datum::Missing),
        (b"+9.91000E+37", Datum::Missing),
        (b"9.8E37", Datum::Real(9.8e37)),
        (b"********", Datum::Missing),
        (b" *****E+03", Datum::Missing),
        (b"1.#QNB", Datum::Missing),
        (b"1.#QNAN", Datum::Missing),
        (b"-1.#IND", Datum::Missing),
        (b"1.#QNB00E+000", Datum::Missing),
        (b"1.#INF", overload(false)),
        (b"-1.#INF00E+000", overload(true)),
        (b"NAN", Datum::Missing),
        (b"INF", overload(false)),
        (b"NINF", overload(true)),
        (b"-INF", overload(true)),
        (b"INFO", word("INFO")),
    ];
    for (bytes, expected) in rows {
        assert_eq!(whole(bytes).datum().as_ref(), Ok(expected), "{}", bytes.escape_ascii());
    }
    assert_eq!(overload(false).number(), Err(DataError::Overload));
    assert_eq!(Datum::Missing.number(), Err(DataError::Missing));
    assert_eq!(Datum::Real(3.0).integer(), Ok(3));
    assert_eq!(Datum::NonDecimal(1 << 62).integer(), Ok(1 << 62));
    for (datum, kind) in [
        (Datum::Real(3.5), "a fraction"),
        (Datum::Real(2_f64.powi(53)), "too large for one"),
        (Datum::NonDecimal(1 << 63), "too large for one"),
        (Datum::NonDecimal(u64::MAX), "too large for one"),
    ] {
        let error = DataError::Type { expected: "a whole number", found: kind };
        assert_eq!(datum.integer(), Err(error), "{datum:?}");
    }
}

#[test]
fn units_fields_and_headers_are_told_apart() {
    let reading = whole(b"+1.00000E+02,-9.00000E-01,+0").data();
    let expected = vec![Datum::Real(100.0), Datum::Real(-0.9), Datum::Integer(0)];
    assert_eq!(reading, Ok(expected));

    let units = whole(b":FREQUENCY 200;*ESR 0;\"a;b\"").units().expect("three units");
    let headers: Vec<_> = units.iter().map(|unit| unit.header.as_deref()).collect();
    assert_eq!(headers, [Some(":FREQUENCY"), Some("*ESR"), None]);
    assert_eq!(units[0].data, [Datum::Integer(200)]);

    assert_eq!(whole(b"1;2").data(), Err(DataError::UnitCount { expected: 1, found: 2 }));
    assert_eq!(whole(b"1,2").datum(), Err(DataError::FieldCount { expected: 1, found: 2 }));
    for (bytes, offset) in [(b"1,,2".as_slice(), 1), (b"", 0), (b"1,", 1), (b"\"a\"b", 3)] {
        let found = whole(bytes).data();
        assert_eq!(found, Err(DataError::Malformed { offset }), "{}", bytes.escape_ascii());
    }
}

#[test]
fn identities_and_errors_are_read_as_instruments_write_them() {
    let identity = Identity::parse(&whole(b"Keysight Technologies,E4980A,MY46000000,A.06.15"));
    let identity = identity.expect("four fields");
    assert_eq!((&*identity.manufacturer, &*identity.model), ("Keysight Technologies", "E4980A"));
    assert_eq!(identity.serial.as_deref(), Some("MY46000000"));
    assert_eq!(identity.firmware.as_deref(), Some("A.06.15"));
    let identity = Identity::parse(&whole(b"HIOKI, IM3536, 0, V1.20, opt")).expect("four fields");
    assert_eq!((&*identity.model, identity.serial), ("IM3536", None));
    assert_eq!(identity.firmware.as_deref(), Some("V1.20, opt"));
    assert!(Identity::parse(&whole(b"nobody")).is_err());

    let report = |bytes: &[u8]| ErrorReport::parse(&whole(bytes)).expect("an error report");
    assert_eq!(report(b"0,\"No error\""), None);
    assert_eq!(report(b"+0,\"No error\""), None);
    let rows: [(&[u8], i64, &str, Option<&str>); 3] = [
        (b"-113,\"Undefined header\"", -113, "Undefined header", None),
        (b"-113,\"Undefined header;FOO:BAR?\"", -113, "Undefined header", Some("FOO:BAR?")),
        (b"+301,\"Probe hot;ch 2;now\"", 301, "Probe hot", Some("ch 2;now")),
    ];
    for (bytes, number, text, info) in rows {
        let (text, info) = (text.to_owned(), info.map(str::to_owned));
        assert_eq!(report(bytes), Some(ErrorReport { number, text, info }));
    }
    assert!(ErrorReport::parse(&whole(b"1")).is_err());
}

#[test]
fn programs_are_written_as_manuals_print_them() {
    let rows = [
        (Program::query("*IDN"), "*IDN?"),
        (Program::command(":FREQ").number(200.0), ":FREQ 200"),
        (Program::command(":FREQ").number(0.2).unit("KHZ"), ":FREQ 0.2KHZ"),
        (Program::command("APER").characters("LONG").integer(4), "APER LONG,4"),
        (
            Program::command(":LEVel").characters("V").then(":LEVel:VOLTage").number(5.0),
            ":LEVel V;:LEVel:VOLTage 5",
        ),
        (Program::command("A:B").then_query("C").then_query("*OPC"), "A:B;:C?;*OPC?"),
        (Program::command("X").number(1e-7).number(-1.5e20).number(0.0), "X 1E-7,-1.5E20,0"),
        (Program::command("X").boolean(true).text("a\"b").block(b"hi"), "X ON,\"a\"\"b\",#12hi"),
        (Program::query("ROUT").expression("@1,3:5"), "ROUT? (@1,3:5)"),
        (Program::command("MEAS:EQU-CCT").characters("PAR"), "MEAS:EQU-CCT PAR"),
        (Program::command("X").integer(5).unit("EV"), "X 5 EV"),
    ];
    for (program, expected) in rows {
        assert_eq!(program.finish(Ending::CrLf), Ok(format!("{expected}\r\n").into_bytes()));
    }
    let refused = [
        Program::command("FREQ 1"),
        Program::command(""),
        Program::query("A::B"),
        Program::command("X").number(f64::NAN),
        Program::command("X").text("µ"),
        Program::command("X").characters("1A"),
        Program::command("X").unit("V"),
        Program::command("X").integer(1).unit(""),
        Program::command("X").expression("1;*RST"),
    ];
    for program in refused {
        assert!(program.clone().finish(Ending::Lf).is_err(), "{program:?}");
    }
    let header = Program::command("X Y").number(f64::NAN).finish(Ending::Lf);
    assert_eq!(header, Err(ProgramError::Header { header: "X Y".to_owned() }));
}
