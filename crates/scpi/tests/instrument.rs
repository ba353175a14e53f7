//! The messages of a small meter on the wire. `check` runs each row once per way of cutting its
//! bytes in two, because a stream delivers them in arbitrary pieces.

mod meter;

use meter::{Host, standard};
use rig_scpi::{
    AfterErrorPolicy, AfterQueryPolicy, Dialect, Ending, QUERY_ERRORS, Session, Terminators,
    UnreadPolicy, Value,
};

#[track_caller]
fn check_with(dialect: &Dialect, sent: &[u8], expected: &[u8]) {
    for cut in 0..=sent.len() {
        let mut host = Host::new(dialect.clone());
        let (head, tail) = sent.split_at(cut);
        let mut found = host.say(head);
        found.extend(host.say(tail));
        assert_eq!(
            found.escape_ascii().to_string(),
            expected.escape_ascii().to_string(),
            "cut at byte {cut} of b\"{}\"",
            sent.escape_ascii()
        );
    }
}

#[track_caller]
fn check(sent: &[u8], expected: &[u8]) {
    check_with(&standard(), sent, expected);
}

/// Sends the unit alone and checks the error it leaves behind.
#[track_caller]
fn check_error(unit: &[u8], number: i16) {
    let mut host = Host::new(standard());
    let answer = host.say(&[unit, b"\nSYST:ERR?\n"].concat());
    let answer = String::from_utf8(answer).expect("error reports are ASCII");
    let found = answer.split(',').next().expect("split gives at least one part");
    assert_eq!(found, number.to_string(), "b\"{}\" gave {answer}", unit.escape_ascii());
}

#[test]
fn units_of_one_message_are_answered_together() {
    check(b"*IDN?\r\n", b"MA,IN,0,VER\n");
    check(b"*IDN?\n*IDN?\n", b"MA,IN,0,VER\nMA,IN,0,VER\n");
    check(b"*IDN?;*IDN?\n", b"MA,IN,0,VER;MA,IN,0,VER\n");
    check(b"*IDN?;*TRG;*IDN?\n", b"MA,IN,0,VER;MA,IN,0,VER\n");
    // Blank units are legal, and a message without a query says nothing.
    check(b";*IDN?\n", b"MA,IN,0,VER\n");
    check(b"*IDN?;\n", b"MA,IN,0,VER\n");
    check(b"*OPC?; ;*OPC?\n", b"1;1\n");
    check(b"\n;\n \r\n*TRG\n", b"");
    check(b"*IDN?", b"");
}

#[test]
fn a_path_lasts_until_the_message_ends() {
    check(b"SYST:VERS?;ERR?;VERS?\n", b"1999.0;0,\"No error\";1999.0\n");
    check(b"SYST:ERR:NEXT?;COUN?\n", b"0,\"No error\";0\n");
    check(b"SYST:VERS?;:SYST:ERR:NEXT?;COUN?\n", b"1999.0;0,\"No error\";0\n");
    // A common command belongs to no subsystem and leaves the path alone.
    check(b"SYST:VERS?;*OPC?;ERR:NEXT?\n", b"1999.0;1;0,\"No error\"\n");
    // A new message begins at the root.
    check(b"SYST:VERS?\nERR?\nSYST:ERR?\n", b"1999.0\n-113,\"Undefined header;ERR?\"\n");
    // An optional node that was left out is not part of the path.
    check(b"FREQ 200;VOLT?;FREQ?\n", b"#131\n2;200\n");
    check(b"SOUR:FREQ 200;VOLT?;FREQ?\n", b"#131\n2;200\n");
    check(b"SOUR:FREQ:CW 200;:FREQ?\n", b"200\n");
    // A unit that fails after a valid header still sets the path; one with an unknown header does
    // not.
    check(b"SYST:VERS? 1;ERR:COUN?\n", b"1\n");
    check(b"SYST:VERS?;FOO:BAR;ERR:COUN?\n", b"1999.0;1\n");
}

#[test]
fn optional_nodes_and_both_forms_are_understood() {
    for header in ["conf?", "CONFIGURE?", "conf:scal?", ":CONF:SCALar?"] {
        check(format!("{header}\n").as_bytes(), b"1\n");
    }
    for header in ["conf:scal:volt:dc?", "conf:volt:dc?", "conf:volt?", "conf:scal:volt?"] {
        check(format!("{header}\n").as_bytes(), b"3\n");
    }
    check(b"conf:volt:ac?\n", b"2\n");
    for header in ["init?", "init:imm?", "init:all?", "INITiate:IMMediate:ALL?"] {
        check(format!("{header}\n").as_bytes(), b"0\n");
    }
    for header in ["INITIA?", "INI?", "CONF:DC?", "CONF:SCALA?", "FREQ:CW:CW?", "OPC?", "*FREQ?"] {
        check_error(header.as_bytes(), -113);
    }
    check(b"OUTP2 ON;OUTP?;OUTP1?;OUTP2?;:OUTPUT2:STATE?\n", b"0;0;1;1\n");
    check_error(b"OUTP5 ON", -114);
    check_error(b"OUTP0 ON", -114);
    check_error(b"OUTP99999999 ON", -114);
}

#[test]
fn data_are_read_as_their_types() {
    let rows: &[(&[u8], &[u8])] = &[
        (b"10", b"N10"),
        (b"+.5, -10.5 , 1.5E12", b"N0.5,N-10.5,N1500000000000"),
        (b"-1 e 3,1E+2,5.", b"N-1000,N100,N5"),
        (b"-1 e ", b"N-1|e"),
        (b"1.5E12 V,100mv, 3 KOHM.M/S-2", b"N1500000000000|V,N100|mv,N3|KOHM.M/S-2"),
        (b"#H1F,#q17,#B101", b"D31,D15,D5"),
        (b"abc_213as564 , MAX", b"Cabc_213as564,CMAX"),
        (b"'ah''oj',\"ah\"\"oj\",\"\"", b"Tah\\'oj,Tah\\\"oj,T"),
        (b"'a;b\n',\"test\r\n\"", b"Ta;b\\n,Ttest\\r\\n"),
        (b"#204A\n;D,#12\r\n, #10", b"BA\\n;D,B\\r\\n,B"),
        (b"1,#0AB;,", b"N1,BAB;,"),
        (b"(1,3:9), (@1,2!5:3!6)", b"E1,3:9,E@1,2!5:3!6"),
        (b"( 1 + (2) ),(@'a);b')", b"E 1 + (2) ,E@'a);b'"),
    ];
    for (data, expected) in rows {
        check(&[b"ECHO? ", *data, b"\n"].concat(), &[*expected, b"\n"].concat());
    }
}

#[test]
fn every_fault_has_its_number() {
    let rows: &[(&[u8], i16)] = &[
        (b"[", -101),
        (b"SETUP&", -101),
        (b":*IDN?", -101),
        (b"*?", -101),
        (b"A::B", -101),
        (b"\xFAFREQ 1", -101),
        (b"ECHO? @1", -101),
        (b"ECHO? 1 & 2", -101),
        (b"SYST: ERR?", -102),
        (b"SYST :ERR?", -113),
        (b"ECHO? 1,,2", -102),
        (b"ECHO? 1,", -102),
        (b"ECHO? ,1", -102),
        (b"FREQ,1", -103),
        (b"FREQ 1 1000", -103),
        (b"FREQ 1:CH1:VOLTS 5", -103),
        (b"ECHO? (1) 2", -103),
        (b"*TRG 1", -108),
        (b"FREQ 1,2", -108),
        (b"FREQ", -109),
        (b"FREQ ", -109),
        (b"LABEL\"x\"", -111),
        (b"FREQ#H1", -111),
        (b"FREQ?MAX", -111),
        (b"ABCDEFGHIJKLM", -112),
        (b"FOO", -113),
        (b"*FOO?", -113),
        (b"FETC", -113),
        (b"*TRG?", -113),
        (b"ECHO? -.", -121),
        (b"ECHO? 1.5.2", -121),
        (b"ECHO? #B0102", -121),
        (b"ECHO? #H", -121),
        (b"ECHO? 1E99999999999999999999", -123),
        (b"ECHO? 1E32000", -222),
        (b"ECHO? 1E32001", -123),
        (b"LIST 0E32000,1E-32000", 0),
        (b"FREQ 'x'", -158),
        (b"FREQ #13abc", -168),
        (b"FREQ (1)", -178),
        (b"DISP:LAB 1", -128),
        (b"DISP:LAB ON", -148),
        (b"TRIG:SOUR NEVER", -224),
        (b"FREQ NEVER", -224),
        (b"FREQ 200 V", -131),
        (b"OUTP 1 V", -138),
        (b"ECHO? 1 ABCDEFGHIJKLM", -134),
        (b"ECHO? ABCDEFGHIJKLM", -144),
        (b"ECHO? \"\xFA\"", -151),
        (b"ECHO? #1", -161),
        (b"ECHO? (1", -171),
        (b"FREQ 1", -222),
        (b"FREQ 2.1MHZ", -222),
        (b"*ESE 256", -222),
        (b"*ESE -1", -222),
        (b"VOLT 1", -221),
    ];
    for (unit, number) in rows {
        check_error(unit, *number);
    }
    check_error(&[b"ECHO? ", &[b'1'; 256][..]].concat(), -124);
    check_error(&[b"LIST 000", &[b'1'; 255][..]].concat(), 0);
}

#[test]
fn numbers_take_units_words_and_limits() {
    check(b"FREQ 2KHZ;FREQ?\n", b"2000\n");
    check(b"FREQ 1.1 MHZ;FREQ?\n", b"1100000\n");
    check(b"FREQ 2 MAHZ;FREQ?\n", b"2000000\n");
    check(b"FREQ #H64;FREQ?\n", b"100\n");
    check(b"FREQ MAX;FREQ?;FREQ? MIN;FREQ? DEF\n", b"2000000;20;1000\n");
    check(b"OUTP 0.4;OUTP?;OUTP 2;OUTP?;OUTP OFF;OUTP?\n", b"0;1;0\n");
    check(b"FETC?;TRIG:SOUR?\n", b"9.91E37,9.9E37,-1;IMM\n");
    check(b"DISP:LAB 'say \"hi\"';:DISP:LAB?\n", b"\"say \"\"hi\"\"\"\n");
}

#[test]
fn the_status_model_answers_as_printed_in_manuals() {
    check(b"*ESE #H20;*SRE #HFF;*ESE?;*SRE?\n", b"32;191\n");
    // An undefined header, the request for service it causes, and how reading takes it back.
    check(
        b"*ESE #H20\n*SRE #HFF\nABCD\n*STB?\n*ESR?\n*STB?\nSYST:ERR:COUN?\nSYST:ERR?\nSYST:ERR?\n*STB?\n",
        b"100\n32\n68\n1\n-113,\"Undefined header;ABCD\"\n0,\"No error\"\n0\n",
    );
    check(b"*OPC;*ESR?;*ESR?;*OPC?\n", b"1;0;1\n");
    check(b"FOO;BAR?;*CLS;*ESR?;:SYST:ERR:COUN?\n", b"0;0\n");
    check(b"*TST?;*RST;*WAI\n", b"0\n");
    check(b"*IDN?;*STB?\n", b"MA,IN,0,VER;16\n");
    check(b"STAT:OPER:ENAB 65535;ENAB?;PTR?;NTR?;COND?;EVEN?\n", b"32767;32767;0;0;0\n");
    check(b"STAT:QUES:ENAB 9;:STAT:PRES;QUES:ENAB?;:STAT:QUES?\n", b"0;0\n");
    check(
        b"FOO;BAR;*OPC?;:SYST:ERR:ALL?\n",
        b"1;-113,\"Undefined header;FOO\",-113,\"Undefined header;BAR\"\n",
    );
}

#[test]
fn errors_fill_the_queue_and_the_last_becomes_an_overflow() {
    let dialect = Dialect { error_queue: Some(2), ..standard() };
    check_with(
        &dialect,
        b"A;B;C;*ESR?\nSYST:ERR?;ERR?;ERR?\n",
        b"40\n-113,\"Undefined header;A\";-350,\"Queue overflow\";0,\"No error\"\n",
    );
}

#[test]
fn an_instrument_without_error_queue_reports_in_the_event_register_only() {
    let dialect = Dialect {
        after_error: AfterErrorPolicy::SkipMessage,
        ending: Ending::CrLf,
        headers: Some(false),
        ..Dialect::common_only("HIOKI,IM3536,123456789,V1.00")
    };
    check_with(&dialect, b"SYST:ERR?\r\n*ESR?\r\n", b"32\r\n");
    check_with(&dialect, b":FREQ 200;FOO;*IDN?\r\n:FREQ?\r\n", b"200\r\n");
    check_with(
        &dialect,
        b":HEADER ON;:HEAD?;:FREQ?;*OPC?;:OUTP2?;:HEAD OFF;:FREQ?\r\n",
        b":HEADER ON;:FREQUENCY 1000;1;:OUTPUT2 0;1000\r\n",
    );
}

#[test]
fn terminators_follow_the_dialect() {
    let dialect = Dialect {
        terminators: Terminators::LineFeedOrCarriageReturn,
        ending: Ending::Cr,
        ..standard()
    };
    check_with(&dialect, b"*OPC?\r*OPC?\r\n*OPC?\n", b"1\r1\r1\r");
}

#[test]
fn an_answer_that_was_not_read_follows_the_dialect() {
    let answers = |unread, query_errors| {
        let mut host = Host::new(Dialect { unread, query_errors, ..standard() });
        host.instrument.push(b"*IDN?\n*OPC?\n");
        host.run();
        let answers = host.instrument.take_output();
        (answers, host.say(b"SYST:ERR?\n"), host)
    };
    let none = b"0,\"No error\"\n".to_vec();
    assert_eq!(answers(UnreadPolicy::Keep, QUERY_ERRORS).0, b"MA,IN,0,VER\n1\n");
    let (found, error, _) = answers(UnreadPolicy::Drop, &[]);
    assert_eq!((found, error), (b"1\n".to_vec(), none.clone()));
    let (found, error, mut host) = answers(UnreadPolicy::Drop, QUERY_ERRORS);
    assert_eq!((found, error), (b"1\n".to_vec(), b"-410,\"Query INTERRUPTED\"\n".to_vec()));

    assert_eq!(host.instrument.fetch_output(), None);
    assert_eq!(host.say(b"SYST:ERR?\n"), b"-420,\"Query UNTERMINATED\"\n");
    let answer = host.say(b"*IDN?;*OPC?\n");
    assert_eq!(answer, b"MA,IN,0,VER\n");
    let answer = host.say(b"SYST:ERR?\n");
    assert_eq!(answer, b"-440,\"Query UNTERMINATED after indefinite response\"\n");
    assert_eq!(host.say(b"SYST:ERR?\n"), none);
    assert_eq!(host.say(b"SYST:VERS?;*OPC?\n"), b"1999.0;1\n");
}

#[test]
fn a_unit_after_a_query_is_refused_where_the_dialect_says_so() {
    let dialect = Dialect { after_query: AfterQueryPolicy::Refuse, ..standard() };
    check_with(&dialect, b"FREQ 200;FREQ?;\n", b"200\n");
    check_with(
        &dialect,
        b"FREQ?;FREQ 200;FREQ 300\nFREQ?\nSYST:ERR?\nSYST:ERR?\n",
        b"1000\n1000\n-400,\"Query error\"\n0,\"No error\"\n",
    );
}

#[test]
fn a_forgotten_quote_costs_one_message_where_strings_stay_in_a_line() {
    let dialect = Dialect { strings_span_lines: false, ..standard() };
    check_with(
        &dialect,
        b"DISP:LAB 'x\nDISP:LAB?;:SYST:ERR?\n",
        b"\"\";-151,\"Invalid string data\"\n",
    );
    check(b"DISP:LAB 'x\n*OPC?';LAB?\n", b"\"x\n*OPC?\"\n");
    // A quote begins a string only where a parameter begins.
    check(b"LIST 1'\nLIST #10'\nLIST A'\n*OPC?\n", b"1\n");
}

#[test]
fn an_answer_beyond_the_limit_is_a_deadlock() {
    let dialect = Dialect { output_limit_bytes: 40, ..standard() };
    check_with(&dialect, b"*IDN?;*IDN?;*IDN?;*IDN?\nSYST:ERR?\n", b"-430,\"Query DEADLOCKED\"\n");
}

#[test]
fn a_message_beyond_the_limit_is_an_overrun_and_the_next_is_heard() {
    let dialect = Dialect { input_limit_bytes: 32, ..standard() };
    let long = [b"ECHO? '".as_slice(), &[b'x'; 40], b"\n*TRG'\n"].concat();
    let mut host = Host::new(dialect);
    assert_eq!(host.say(&long), b"");
    assert_eq!(host.say(b"SYST:ERR?\n"), b"-363,\"Input buffer overrun\"\n");
    assert_eq!(host.say(b"*OPC?\n"), b"1\n");

    // What just fits is carried out, its terminator not counted.
    let fits = [b"ECHO? '".as_slice(), &[b'x'; 24], b"'\n"].concat();
    assert_eq!(host.say(&fits).len(), "T\n".len() + 24);
    // While no messages are carried out, those that do not fit give one error, and the order is
    // kept.
    host.instrument.push(b"*OPC?;*OPC?;*OPC?;*OPC?;*OPC?\nA;B;C\nD;E;F\n*OPC?\n");
    host.run();
    assert_eq!(host.instrument.take_output(), b"1;1;1;1;1\n");
    assert_eq!(host.say(b"SYST:ERR:ALL?\n"), b"-363,\"Input buffer overrun\"\n");
}

#[test]
fn commands_wait_for_pending_operations_where_they_ask_for_it() {
    let mut host = Host::new(standard());
    host.instrument.set_operation_pending(true);
    assert_eq!(host.say(b"*OPC;*ESR?\n"), b"0\n");
    assert_eq!(host.say(b"*OPC?\n*IDN?\n"), b"");
    host.instrument.set_operation_pending(false);
    assert_eq!(host.say(b"*ESR?\n"), b"1\nMA,IN,0,VER\n1\n");

    // A reset or a clear cancels the pending completion.
    for cancel in [b"*RST\n", b"*CLS\n"] {
        host.instrument.set_operation_pending(true);
        assert_eq!(host.say(b"*OPC\n"), b"");
        assert_eq!(host.say(cancel), b"");
        host.instrument.set_operation_pending(false);
        assert_eq!(host.say(b"*ESR?\n"), b"0\n");
    }

    host.instrument.set_operation_pending(true);
    assert_eq!(host.say(b"*WAI;*IDN?\n"), b"");
    host.instrument.set_operation_pending(false);
    host.run();
    assert_eq!(host.instrument.take_output(), b"MA,IN,0,VER\n");
}

#[test]
fn a_device_clear_forgets_what_was_under_way_but_not_the_status() {
    let mut host = Host::new(standard());
    assert_eq!(host.say(b"FOO\n"), b"");
    host.instrument.push(b"*IDN?;FREQ?;*IDN?\n*IDN?\nECHO? 'unclosed\n");
    assert!(host.instrument.poll().is_some());
    host.instrument.device_clear();
    assert_eq!(host.instrument.poll(), None);
    host.instrument.answer(Ok(vec![Value::Integer(1)]));
    assert_eq!(host.say(b"*OPC?;SYST:ERR?\n"), b"1;-113,\"Undefined header;FOO\"\n");
}

#[test]
fn the_end_of_a_packet_ends_a_message() {
    let mut host = Host::new(standard());
    for (packet, expected) in [
        (b"*IDN?".as_slice(), b"MA,IN,0,VER\n".as_slice()),
        (b"ECHO? #0a", b"Ba\n"),
        (b"ECHO? 'unclosed", b""),
        (b"ECHO? #15abc", b""),
        (b"SYST:ERR:ALL?", b"-151,\"Invalid string data\",-161,\"Invalid block data\"\n"),
    ] {
        host.instrument.push(packet);
        host.instrument.end_of_message();
        host.run();
        assert_eq!(host.instrument.take_output(), expected, "{}", packet.escape_ascii());
    }
}

#[test]
fn each_client_has_its_own_messages_and_answers_and_all_share_the_errors() {
    let mut host = Host::new(standard());
    let mut other = Box::new(Session::new(host.instrument.dialect()));
    assert_eq!(host.say(b"FREQ 4"), b"");
    host.instrument.push(b"00;*IDN?\n");
    host.instrument.turn_to(&mut other);
    assert_eq!(host.say(b"FREQ 300;FREQ?;FOO\n"), b"300\n");
    host.instrument.turn_to(&mut other);
    assert_eq!(host.say(b"FREQ?;SYST:ERR:COUN?\n"), b"MA,IN,0,VER\n400;1\n");
}
