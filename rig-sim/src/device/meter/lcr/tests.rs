mod drivers;

use std::time::Duration;

use rig_model::RigTime;

use super::*;
use crate::device::meter::test_meter;

type TestMeter = test_meter::TestMeter<Lcr<E4980a>>;

#[test]
fn every_command_has_its_place_in_the_tree() {
    _ = (Lcr::<E4980a>::commands(), Lcr::<Hp4284a>::commands(), Lcr::<Th2832>::commands());
}

#[test]
fn a_bus_trigger_measures_and_the_answer_has_fixed_widths() {
    let mut meter = TestMeter::new();
    meter.say("*RST;:FUNC:IMP RX;:TRIG:SOUR BUS;:INIT:CONT ON;:FREQ 140.04;:VOLT 5;:TRIG:TDEL 3");
    assert_eq!(meter.say("FREQ?;VOLT?"), "+1.400000000E+02;+5.000000000E+00\n");
    let line = meter.say("*TRG");
    let fields: Vec<&str> = line.trim_end().split(',').collect();
    assert_eq!(fields.iter().map(|field| field.len()).collect::<Vec<_>>(), [12, 12, 2]);
    let expected = meter.settled_ohm(140.0);
    let found: Vec<f64> = fields.iter().map(|field| field.parse().unwrap()).collect();
    assert!((found[0] / expected.re - 1.0).abs() < 1e-5, "{line} {expected}");
    assert!((found[1] / expected.im - 1.0).abs() < 1e-5, "{line} {expected}");
    meter.say(":FORM:ASC:LONG ON;:TRIG");
    assert_eq!(meter.say("FETC?").find(','), Some(16));
    assert_eq!(meter.say("SYST:ERR?"), "+0,\"No error\"\n");
}

#[test]
fn a_measurement_takes_the_time_of_its_aperture() {
    let mut meter = TestMeter::new();
    for (aperture, cycles) in [("SHOR", 10_u128), ("SHOR,4", 40), ("MED", 18), ("LONG", 30)] {
        meter.say(&format!("APER {aperture};FREQ 100;:TRIG:SOUR BUS"));
        let before = meter.now;
        meter.say("*TRG");
        assert_eq!(meter.now.since(before).as_micros(), 10_000 * cycles);
        meter.say("APER SHOR,1");
    }
}

#[test]
fn a_list_runs_while_the_status_is_asked_for_and_has_four_fields_a_point() {
    let mut meter = TestMeter::new();
    meter.say("DISP:PAGE LIST;:LIST:MODE SEQ;:LIST:FREQ 130,140,150;:TRIG:SOUR BUS");
    meter.say("STAT:OPER?");
    meter.send("TRIG");
    meter.send("STAT:OPER?");
    assert_eq!(meter.heard(), "0\n");
    assert_eq!(meter.say("FETC?").split(',').count(), 12);
    let first = meter.say("FETC?");
    meter.send("TRIG");
    meter.send("FETC?");
    assert_eq!(meter.heard(), "", "a new measurement is waited for");
    assert_ne!(meter.say(""), first);
    assert_eq!(meter.say("STAT:OPER?"), "24\n");
}

#[test]
fn what_is_not_there_yet_and_what_cannot_be_is_told() {
    let mut meter = TestMeter::new();
    let rows = [
        ("VOLT 21", "-222"),
        ("FREQ 10", "-222"),
        ("TRIG:SOUR INT;:TRIG", "-211"),
        ("BIAS:VOLT 41", "-222"),
        ("CURR?", "-221"),
        ("CORR:LENG 3", "-222"),
        ("FUNC:DEV1:MODE ABS", "-224"),
        ("FUNC:IMP XX", "-224"),
        ("MEAS?", "-113"),
    ];
    for (line, number) in rows {
        assert_eq!(meter.say(line), "", "{line}");
        let told = meter.say("SYST:ERR?");
        assert!(told.starts_with(number), "{line}: {told}");
    }
    assert_eq!(meter.say("*OPT?;FREQ? MAX;:APER?"), "001;+2.000000000E+06;MED,1\n");
}

#[test]
fn a_trigger_is_taken_while_the_trigger_system_waits_for_it() {
    let mut meter = TestMeter::new();
    meter.say("*RST;:TRIG:SOUR BUS");
    for trigger in ["TRIG", "*TRG"] {
        assert_eq!(meter.say(trigger), "");
        assert!(meter.say("SYST:ERR?").starts_with("-211"), "{trigger} after *RST");
    }
    assert_eq!(meter.say("INIT:CONT?"), "0\n");
    // INITiate takes one.
    assert!(meter.say("INIT;*TRG").ends_with(",+0\n"));
    assert_eq!(meter.say("*TRG"), "");
    assert!(meter.say("SYST:ERR?").starts_with("-211"));
    for line in ["INIT:CONT ON", "SYST:PRES;:TRIG:SOUR BUS"] {
        meter.say(line);
        assert!(meter.say("*TRG").ends_with(",+0\n"), "{line}");
        assert!(meter.say("*TRG").ends_with(",+0\n"), "{line}");
    }
    assert_eq!(meter.say("SYST:ERR?"), "+0,\"No error\"\n");
}

#[test]
fn without_data_the_status_says_so_and_a_reset_clears_them() {
    const NONE: &str = "+9.90000E+37,+9.90000E+37,-1\n";
    let mut meter = TestMeter::new();
    assert_eq!(meter.say("TRIG:SOUR BUS;:FETC?"), NONE);
    assert_eq!(meter.say("FETC:IMP:CORR?"), "+9.90000E+37,+9.90000E+37\n");
    assert_eq!(meter.say("FETC:SMON:VAC?"), "+9.90000E+37\n");
    for reset in ["*RST", "SYST:PRES"] {
        meter.say("TRIG:SOUR BUS;:INIT:CONT ON;:TRIG");
        assert!(meter.say("FETC?").ends_with(",+0\n"));
        assert_eq!(meter.say(&format!("{reset};:TRIG:SOUR BUS;:FETC?")), NONE, "{reset}");
    }
    // After *RST the instrument does not trigger itself either.
    assert_eq!(meter.say("*RST;:FETC?"), NONE);
    assert_eq!(meter.say("SYST:ERR?"), "+0,\"No error\"\n");
}

#[test]
fn a_client_may_end_what_it_has_triggered_itself() {
    let mut meter = TestMeter::new();
    meter.say("FUNC:IMP RX;:TRIG:SOUR BUS;:TRIG:TDEL 999");
    meter.send("TRIG");
    meter.now = RigTime::from_micros(1_000_000);
    // What is no end waits for the measurement.
    meter.send("*IDN?");
    assert_eq!(meter.heard(), "");
    assert!(meter.say("").starts_with("Keysight"));
    assert!(999.0 < meter.now.as_seconds());
    meter.send("TRIG");
    meter.now = meter.now + Duration::from_secs(1);
    meter.send("ABOR");
    assert_eq!(meter.meter.deadline(), None);
    assert_eq!(meter.say("TRIG:TDEL 0;:TRIG;:SYST:ERR?"), "+0,\"No error\"\n");
    assert!(meter.say("FETC?").ends_with(",+0\n"));
}

#[test]
fn a_level_of_zero_is_survived() {
    let mut meter = TestMeter::new();
    meter.say("FUNC:IMP ZTD;:TRIG:SOUR BUS;:FREQ 140;:TRIG:TDEL 5");
    let before = meter.say("*TRG");
    meter.say("VOLT 0");
    meter.say("*TRG");
    assert_eq!(meter.say("VOLT 5;*TRG"), before);
}

#[test]
fn overload_is_a_status_and_no_value() {
    let mut meter = TestMeter::new();
    meter.say("FUNC:IMP ZTD;:TRIG:SOUR BUS");
    meter.meter.overload();
    assert_eq!(meter.say("*TRG"), "+9.90000E+37,+9.90000E+37,+1\n");
}

#[test]
fn the_forerunner_needs_its_high_power_switched_on_and_divides_a_clock() {
    let mut meter = test_meter::TestMeter::<Lcr<Hp4284a>>::new();
    meter.say("VOLT 5");
    assert!(meter.say("SYST:ERR?").starts_with("-222"));
    meter.say(":OUTP:HPOW ON;:VOLT 5;:FREQ 140;:TRIG:DEL 2");
    assert_eq!(meter.say("VOLT?;*OPT?"), "+5.000000000E+00;001,0,0,0,0\n");
    let frequency_hz: f64 = meter.say("FREQ?").trim().parse().unwrap();
    assert!(frequency_hz != 140.0 && (frequency_hz / 140.0 - 1.0).abs() < 0.01);
    assert_eq!(meter.say("SYST:ERR?"), "+0,\"No error\"\n");
    meter.say(":TRIG:TDEL 1");
    assert!(meter.say("SYST:ERR?").starts_with("-113"));
}

#[test]
fn one_make_answers_before_it_has_measured_and_says_so() {
    let mut meter = test_meter::TestMeter::<Lcr<Th2832>>::new();
    meter.say("FUNC:IMP RX;:TRIG:SOUR BUS;:FREQ 140HZ");
    meter.send(":TRIG;:FETC?");
    assert_eq!(meter.heard(), "+9.90000E+37,+9.90000E+37,-1\n");
    meter.say("");
    assert!(meter.say("FETC?").ends_with(",+0\n"));
}

#[test]
fn whatever_is_fetched_under_internal_trigger_is_measured_after_the_question() {
    let mut meter = TestMeter::new();
    meter.say(":FUNC:IMP RX;:FORM:ASC:LONG ON;:TRIG:TDEL 5;:FREQ 140;:TRIG:SOUR INT");
    let pair = |line: String| line.trim_end().split(',').take(2).map(str::to_owned).collect();
    let fetched: Vec<String> = pair(meter.say("FETC?"));
    assert_eq!(pair(meter.say("FETC:IMP:CORR?")), fetched);
    meter.say(":FREQ 150");
    let corrected: Vec<String> = pair(meter.say("FETC:IMP:CORR?"));
    assert_ne!(corrected, fetched, "the impedance at another frequency");
    assert_eq!(pair(meter.say("FETC?")), corrected);
    assert_eq!(meter.say("FETC:IMP:CORR?").split(',').count(), 2);
}

#[test]
fn a_measurement_shows_in_the_condition_and_its_end_in_the_event() {
    let mut meter = TestMeter::new();
    meter.say("DISP:PAGE LIST;:LIST:FREQ 130,140;:TRIG:SOUR BUS");
    meter.send("TRIG;:STAT:OPER:COND?;:STAT:OPER?");
    assert_eq!(meter.heard(), "24;0\n");
    assert_eq!(meter.say("STAT:OPER:COND?;:ABOR;:STAT:OPER:COND?;:STAT:OPER?"), "24;0;0\n");
    meter.send("TRIG");
    meter.say("");
    assert_eq!(meter.say("STAT:OPER:COND?;:STAT:OPER?"), "0;24\n");
}

#[test]
fn one_client_is_not_disturbed_by_another_and_does_not_keep_it_waiting_for_long() {
    let mut meter = TestMeter::new();
    meter.send_as(1, "FUNC:IMP RX;:FREQ 140;:TRIG:SOUR BUS;:TRIG:TDEL 5;*TRG");
    meter.send_as(2, "FREQ?;*IDN?");
    assert_eq!(
        meter.heard_by(2),
        "+1.400000000E+02;Keysight Technologies,E4980A,MY46516789,A.06.16\n"
    );
    // Its settings and its measurement follow the measurement of the first client.
    meter.send_as(2, "FREQ 150;:FREQ?;*TRG");
    assert_eq!(meter.heard_by(2), "");
    meter.say("");
    let (first, second) = (meter.heard_by(1), meter.heard_by(2));
    let resistance = |line: &str| -> f64 { line.split(',').next().unwrap().parse().unwrap() };
    assert!((resistance(&first) / meter.settled_ohm(140.0).re - 1.0).abs() < 1e-4, "{first}");
    let (frequency, second) = second.split_once(';').unwrap();
    assert_eq!(frequency, "+1.500000000E+02");
    assert!((resistance(second) / meter.settled_ohm(150.0).re - 1.0).abs() < 1e-4, "{second}");
}

#[test]
fn a_client_may_end_what_another_one_measures() {
    let mut meter = TestMeter::new();
    meter.send_as(1, ":TRIG:SOUR BUS;:TRIG:TDEL 999;*TRG");
    meter.send_as(2, "ABOR;*OPC?");
    assert_eq!(meter.heard_by(2), "1\n");
    assert_eq!(meter.meter.deadline(), None);
    meter.send_as(1, "SYST:ERR?");
    assert!(meter.heard_by(1).starts_with("-230"));
    // A closed client gets no answer, and leaves no state.
    meter.send_as(1, "TRIG:TDEL 1;*TRG");
    meter.meter.hang_up(1);
    assert_eq!(meter.say("SYST:ERR?"), "+0,\"No error\"\n");
    assert_eq!(meter.heard_by(1), "");
}

#[test]
fn a_level_of_current_drives_the_source_and_the_monitors_show_what_is_at_the_terminals() {
    let mut meter = TestMeter::new();
    meter.say("FUNC:IMP RX;:FREQ 140;:TRIG:SOUR BUS;:TRIG:TDEL 5;:CURR 0.01;:FORM:ASC:LONG ON");
    let value = |line: String| line.trim_end().parse::<f64>().unwrap();
    meter.say("TRIG");
    let (volt, ampere) = (value(meter.say("FETC:SMON:VAC?")), value(meter.say("FETC:SMON:IAC?")));
    let z = meter.settled_ohm(140.0);
    assert!((volt / ampere / z.norm() - 1.0).abs() < 1e-5, "{volt} {ampere} {z}");
    // 10 mA through the source alone is 1 V across it.
    assert!((ampere * (z + 100.0).norm() - 1.0).abs() < 1e-5, "{ampere} {z}");
    let range_ohm = value(meter.say("FUNC:IMP:RANG?"));
    assert!((range_ohm..=4.0 * range_ohm).contains(&z.norm()), "{range_ohm} {z}");
    assert_eq!(meter.say("VOLT?"), "");
    assert!(meter.say("SYST:ERR?").starts_with("-221"));
    assert_eq!(meter.say("VOLT? MAX;:CURR? MAX"), "+2.000000000E+01;+1.000000000E-01\n");
    assert_eq!(meter.say("FUNC:SMON:VAC OFF;:FETC:SMON:VAC?"), "+9.900000000E+37\n");
}

#[test]
fn binary_readings_are_those_in_text() {
    let mut meter = TestMeter::new();
    meter.say("FUNC:IMP RX;:FREQ 140;:TRIG:SOUR BUS;:FORM:ASC:LONG ON;:TRIG");
    let text = meter.say("FETC?");
    for (order, read) in [
        ("NORM", f64::from_be_bytes as fn([u8; 8]) -> f64),
        ("SWAP", f64::from_le_bytes as fn([u8; 8]) -> f64),
    ] {
        meter.send(&format!("FORM REAL,64;:FORM:BORD {order};:FETC?;:FORM ASC"));
        let (_, said) = meter.meter.take_said(0).remove(0);
        let (head, block) = said.split_at(4);
        assert_eq!(head, b"#224");
        let numbers = block.chunks_exact(8).map(|bytes| read(bytes.try_into().unwrap()));
        for (number, field) in numbers.zip(text.trim_end().split(',')) {
            assert!(
                (number - field.parse::<f64>().unwrap()).abs() <= 1e-8 * number.abs(),
                "{text}"
            );
        }
    }
}
