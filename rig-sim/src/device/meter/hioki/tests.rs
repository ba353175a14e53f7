use super::*;
use crate::device::meter::test_meter;

type TestMeter = test_meter::TestMeter<Hioki>;

const SET_UP: &str = "*RST;:MODE LCR;:TRIGger EXTernal;:SPEEd FAST;:AVERaging 10;\
    :PARameter1 RS;:PARameter3 X;:MEASure:VALid 0;:LEVel V;:LEVel:VOLTage 5";

#[test]
fn every_command_has_its_place_in_the_tree() {
    _ = Hioki::commands();
}

#[test]
fn a_settled_measurement_is_the_impedance_of_the_circuit_to_six_digits() {
    let mut meter = TestMeter::new();
    assert_eq!(meter.say(SET_UP), "");
    let before = meter.now;
    let line = meter.say(":FREQuency 139.998;:TRIGger:DELay 3;*TRG;:MEASure?");
    // 3 s of delay and ten cycles at the 140.00 Hz that the panel makes of it.
    assert_eq!(meter.now.since(before).as_micros(), 3_071_429);
    let fields: Vec<f64> = line.trim_end().split(',').map(|x| x.parse().unwrap()).collect();
    let expected = meter.settled_ohm(140.0);
    assert!((fields[0] / expected.re - 1.0).abs() < 1e-5, "{line} {expected}");
    assert!((fields[1] / expected.im - 1.0).abs() < 1e-5, "{line} {expected}");
    assert_eq!(meter.say("*ESR?"), "128\r\n", "power on, and no error");
}

#[test]
fn a_reading_taken_too_early_remembers_the_frequency_before() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.say(":AVERaging 1");
    let early = meter.say(":FREQuency 140;*TRG;:MEASure?");
    let late = meter.say(":TRIGger:DELay 2;*TRG;:MEASure?");
    assert_ne!(early, late);
}

#[test]
fn settings_are_answered_in_long_words_and_with_their_headers_when_asked_for() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.say(":FREQuency 140.406;:LEVel:VOLTage 1.00049");
    let rows = [
        (":FREQuency?", "1.4041E+02\r\n"),
        (":LEVel?;:LEVel:VOLTage?", "V;1.000\r\n"),
        (":SPEEd?;:AVERaging?", "FAST;10\r\n"),
        (":TRIGger?;:TRIGger:DELay?", "EXTERNAL;0.0000\r\n"),
        (":PARameter1?;:PARameter2?;:PAR3?", "RS;OFF;X\r\n"),
        (":HEADer ON;:FREQuency?;:HEADer OFF", ":FREQUENCY 1.4041E+02\r\n"),
        ("*IDN?", "HIOKI,IM3536,190512345,V1.21\r\n"),
        (":MEASure:ITEM 31,31,0;:MEASure:ITEM?", "31,31,0\r\n"),
    ];
    for (line, answer) in rows {
        assert_eq!(meter.say(line), answer, "{line}");
    }
}

#[test]
fn errors_are_told_in_the_event_register_only_and_end_the_line() {
    let mut meter = TestMeter::new();
    meter.say("*CLS");
    let rows = [
        (":FREQuency 1;:AVERaging 7", "16\r\n"),
        (":LEVel:VOLTage 5.1", "16\r\n"),
        (":FREQency 200", "32\r\n"),
        (":PARameter5 Z", "32\r\n"),
        (":FREQuency", "32\r\n"),
        (":SYSTem:ERRor?", "32\r\n"),
        ("*TRG", "16\r\n"),
        (":AVERaging 256", "0\r\n"),
    ];
    for (line, event) in rows {
        assert_eq!(meter.say(line), "", "{line}");
        assert_eq!(meter.say("*ESR?"), event, "{line}");
    }
    assert_eq!(meter.say(":FREQuency?;:AVERaging?"), "1.0000E+03;256\r\n");
}

#[test]
fn it_listens_while_it_measures_and_answers_afterwards() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.say(":FREQuency 100");
    let before = meter.now;
    meter.send("*TRG\r\n:FREQuency 200\r\n:FREQuency?");
    assert_eq!(meter.heard(), "");
    assert_eq!(meter.meter.deadline().unwrap().since(before).as_micros(), 100_000);
    assert_eq!(meter.say(""), "2.0000E+02\r\n");
}

#[test]
fn a_trigger_answers_by_itself_when_told_to_and_status_and_overload_show() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.say(":MEASure:OUTPut:AUTO ON;:MEASure:VALid 1;:FREQuency 140;:TRIGger:DELay 5");
    let answer = meter.say("*TRG");
    assert!(answer.starts_with("0,") && answer.matches(',').count() == 2, "{answer}");
    assert_eq!(meter.say(":MEASure?"), answer);
    meter.meter.overload();
    assert_eq!(meter.say("*TRG"), "2,**********,**********\r\n");
    assert_eq!(meter.say("*TRG"), answer);
}

#[test]
fn a_restart_forgets_the_settings_and_says_so() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.say("*CLS");
    meter.meter.restart(meter.now, &mut meter.world);
    assert_eq!(meter.say("*ESR?;:AVERaging?"), "128;1\r\n");
}

#[test]
fn public_drivers_are_answered() {
    let mut meter = TestMeter::new();
    meter.say("*CLS");
    let rows = [
        (":PRESet;*CLS;:TRIGger EXTernal;:FORMat:DATA ASCii;:AVERaging 10", ""),
        (":LEVel V;:LEVel:VOLTage 10e-3;:PARameter3 OFF;:PARameter4 OFF", ""),
        (":DCBias:LEVel 0;:DCBias:LEVel?;:DCBias OFF;:DCBias?", "0.00;OFF\r\n"),
        (":DISP ON;:MEAS:OUTP:AUTO ON;:SPEE SLOW2;:TRIG INT;:TRIG?", "INTERNAL\r\n"),
        (":COMParator OFF;:CORR:OPEN?;:CORR:SHOR?;:KEYL OFF;:BEEP:KEY?", "OFF;OFF;ON\r\n"),
        (":MODE LCR;:MODE?", "LCR\r\n"),
    ];
    for (line, answer) in rows {
        assert_eq!(meter.say(line), answer, "{line}");
        assert_eq!(meter.say("*ESR?"), "0\r\n", "{line}");
    }
}

#[test]
fn the_items_of_a_measurement_are_picked_by_bits() {
    let mut meter = TestMeter::new();
    meter.say(":MEASure:VALid 0;:MEASure:ITEM 31,31,0;:TRIG:DEL 3;:FREQ 140;:LEV:VOLT 1");
    let line = meter.say(":MEASure?");
    let fields: Vec<f64> = line.trim_end().split(',').map(|x| x.parse().unwrap()).collect();
    let z = meter.settled_ohm(140.0);
    assert_eq!(fields.len(), 10, "{line}");
    for (index, expected) in [(0, z.norm()), (1, z.inv().norm()), (6, z.re), (9, z.im)] {
        assert!((fields[index] / expected - 1.0).abs() < 1e-5, "{line} {z}");
    }
    let line = meter.say(":MONitor?");
    let (volt, ampere) = line.trim_end().split_once(',').unwrap();
    let ratio = volt.parse::<f64>().unwrap() / ampere.parse::<f64>().unwrap();
    assert!((ratio / z.norm() - 1.0).abs() < 1e-4, "{line} {z}");
    assert_eq!(meter.say(":MEASure:ITEM 0,0;:MEASure?").split(',').count(), 2);
}
