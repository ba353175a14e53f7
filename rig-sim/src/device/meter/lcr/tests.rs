use super::*;
use crate::device::meter::bench;

type Bench = bench::Bench<Lcr<E4980a>>;

#[test]
fn every_command_has_its_place_in_the_tree() {
    assert!(Tree::new(COMMANDS).is_ok());
}

#[test]
fn a_bus_trigger_measures_and_the_answer_has_fixed_widths() {
    let mut bench = Bench::new();
    bench.say("*RST;:FUNC:IMP RX;:TRIG:SOUR BUS;:FREQ 140.04;:VOLT 5;:TRIG:TDEL 3");
    assert_eq!(bench.say("FREQ?;VOLT?"), "+1.400000000E+02;+5.000000000E+00\n");
    let line = bench.say("*TRG");
    let fields: Vec<&str> = line.trim_end().split(',').collect();
    assert_eq!(fields.iter().map(|field| field.len()).collect::<Vec<_>>(), [12, 12, 2]);
    let expected = bench.settled_ohm(140.0);
    let found: Vec<f64> = fields.iter().map(|field| field.parse().unwrap()).collect();
    assert!((found[0] / expected.re - 1.0).abs() < 1e-5, "{line} {expected}");
    assert!((found[1] / expected.im - 1.0).abs() < 1e-5, "{line} {expected}");
    bench.say(":FORM:ASC:LONG ON;:TRIG");
    assert_eq!(bench.say("FETC?").find(','), Some(16));
    assert_eq!(bench.say("SYST:ERR?"), "+0,\"No error\"\n");
}

#[test]
fn a_measurement_takes_the_time_of_its_aperture() {
    let mut bench = Bench::new();
    for (aperture, cycles) in [("SHOR", 10_u128), ("SHOR,4", 40), ("MED", 18), ("LONG", 30)] {
        bench.say(&format!("APER {aperture};FREQ 100;:TRIG:SOUR BUS"));
        let before = bench.now;
        bench.say("*TRG");
        assert_eq!(bench.now.since(before).as_micros(), 10_000 * cycles);
        bench.say("APER SHOR,1");
    }
}

#[test]
fn a_list_runs_while_the_status_is_asked_for_and_has_four_fields_a_point() {
    let mut bench = Bench::new();
    bench.say("DISP:PAGE LIST;:LIST:MODE SEQ;:LIST:FREQ 130,140,150;:TRIG:SOUR BUS");
    bench.say("STAT:OPER?");
    bench.send("TRIG");
    bench.send("STAT:OPER?");
    assert_eq!(bench.heard(), "0\n");
    assert_eq!(bench.say("FETC?").split(',').count(), 12);
    let first = bench.say("FETC?");
    bench.send("TRIG");
    bench.send("FETC?");
    assert_eq!(bench.heard(), "", "a new measurement is waited for");
    assert_ne!(bench.say(""), first);
    assert_eq!(bench.say("STAT:OPER?"), "24\n");
}

#[test]
fn what_is_not_there_yet_and_what_cannot_be_is_told() {
    let mut bench = Bench::new();
    let rows = [
        (":TRIG:SOUR BUS;:FETC?", "-230"),
        ("VOLT 21", "-222"),
        ("FREQ 10", "-222"),
        ("TRIG:SOUR INT;:TRIG", "-211"),
        ("BIAS:STAT ON", "-221"),
        ("FUNC:IMP XX", "-224"),
        ("MEAS?", "-113"),
    ];
    for (line, number) in rows {
        assert_eq!(bench.say(line), "", "{line}");
        let told = bench.say("SYST:ERR?");
        assert!(told.starts_with(number), "{line}: {told}");
    }
    assert_eq!(bench.say("*OPT?;FREQ? MAX;:APER?"), "001;+2.000000000E+06;MED,1\n");
}

#[test]
fn a_level_of_zero_is_survived() {
    let mut bench = Bench::new();
    bench.say("FUNC:IMP ZTD;:TRIG:SOUR BUS;:FREQ 140;:TRIG:TDEL 5");
    let before = bench.say("*TRG");
    bench.say("VOLT 0");
    bench.say("*TRG");
    assert_eq!(bench.say("VOLT 5;*TRG"), before);
}

#[test]
fn overload_is_a_status_and_no_value() {
    let mut bench = Bench::new();
    bench.say("FUNC:IMP ZTD;:TRIG:SOUR BUS");
    bench.meter.overload();
    assert_eq!(bench.say("*TRG"), "+9.90000E+37,+9.90000E+37,+1\n");
}

#[test]
fn the_forerunner_needs_its_high_power_switched_on_and_divides_a_clock() {
    let mut bench = bench::Bench::<Lcr<Hp4284a>>::new();
    bench.say("VOLT 5");
    assert!(bench.say("SYST:ERR?").starts_with("-222"));
    bench.say(":OUTP:HPOW ON;:VOLT 5;:FREQ 140;:TRIG:DEL 2");
    assert_eq!(bench.say("VOLT?;*OPT?"), "+5.000000000E+00;001,0,0,0,0\n");
    let frequency_hz: f64 = bench.say("FREQ?").trim().parse().unwrap();
    assert!(frequency_hz != 140.0 && (frequency_hz / 140.0 - 1.0).abs() < 0.01);
    assert_eq!(bench.say("SYST:ERR?"), "+0,\"No error\"\n");
    bench.say(":TRIG:TDEL 1");
    assert!(bench.say("SYST:ERR?").starts_with("-113"));
}

#[test]
fn one_make_answers_before_it_has_measured_and_says_so() {
    let mut bench = bench::Bench::<Lcr<Th2832>>::new();
    bench.say("FUNC:IMP RX;:TRIG:SOUR BUS;:FREQ 140HZ");
    bench.send(":TRIG;:FETC?");
    assert_eq!(bench.heard(), "+9.90000E+37,+9.90000E+37,-1\n");
    bench.say("");
    assert!(bench.say("FETC?").ends_with(",+0\n"));
}
