use super::*;
use crate::{
    device::meter::test_meter,
    world::{Drift, Nuisances},
};
use rig_model::RigTime;

type TestMeter = test_meter::TestMeter<E4990a>;

const SET_UP: &str = ":SYST:PRES;:SENS1:FREQ:STAR 120;STOP 160;:SENS1:SWE:POIN 5;DEL 3;\
    :SOUR1:MODE VOLT;VOLT 1;:CALC1:PAR:COUN 2;:CALC1:PAR1:DEF R;:CALC1:PAR2:DEF X;\
    :TRIG:SOUR BUS;:INIT1:CONT ON";

#[test]
fn every_command_has_its_place_in_the_tree() {
    _ = E4990a::commands();
}

#[test]
fn a_sweep_is_waited_for_and_read_trace_by_trace() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.send(":TRIG:SING");
    meter.send("*OPC?");
    assert_eq!(meter.heard(), "", "the sweep is under way");
    assert_eq!(meter.say(""), "1\n");
    // Five delays, and two cycles at each of five frequencies.
    let cycles_s: f64 = [120.0, 130.0, 140.0, 150.0, 160.0].iter().map(|hz| 2.0 / hz).sum();
    assert!((meter.now.as_seconds() - 15.0 - cycles_s).abs() < 1e-5, "{}", meter.now);
    let numbers = |line: String| -> Vec<f64> {
        line.trim_end().split(',').map(|field| field.parse().unwrap()).collect()
    };
    assert_eq!(numbers(meter.say(":SENS1:FREQ:DATA?")), [120.0, 130.0, 140.0, 150.0, 160.0]);
    let r = numbers(meter.say(":CALC1:PAR1:SEL;:CALC1:DATA:FDAT?"));
    let x = numbers(meter.say(":CALC1:PAR2:SEL;:CALC1:DATA:FDAT?"));
    let expected = meter.settled_ohm(140.0);
    assert_eq!((r.len(), r[5], x[5]), (10, 0.0, 0.0));
    assert!((r[4] / expected.re - 1.0).abs() < 1e-6 && (x[4] / expected.im - 1.0).abs() < 1e-6);
    assert_eq!(meter.say("SYST:ERR?"), "+0,\"No error\"\n");
}

/// The resonance moves with the square of the level itself, not of the level over that at power-on.
#[test]
fn the_level_moves_the_resonance_by_its_square() {
    const HZ_PER_V2: f64 = 4.0;
    let swept = |nuisances, level: &str| -> Vec<f64> {
        let mut meter = TestMeter::on(nuisances);
        meter.now = RigTime::from_micros(100_000_000);
        meter.say(&SET_UP.replace("VOLT;VOLT 1;", &format!("VOLT;{level}")));
        meter.say(":TRIG:SING");
        let line = meter.say(":CALC1:PAR1:SEL;:CALC1:DATA:FDAT?");
        line.trim_end().split(',').map(|field| field.parse().unwrap()).collect()
    };
    // 0.5 V is that at power-on.
    for (level, level_v) in [("", 0.5), ("VOLT 0.25;", 0.25), ("VOLT 1;", 1.0)] {
        let found = swept(Nuisances { level_hz_per_v2: HZ_PER_V2, ..Nuisances::NONE }, level);
        // Warmth and level scale the resonance alike.
        let drift = Drift { warm_up_hz: HZ_PER_V2 * level_v * level_v, ..Nuisances::NONE.drift };
        let expected = swept(Nuisances { drift, ..Nuisances::NONE }, level);
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() <= 1e-4 * expected.abs(), "{level_v} V: {found}");
        }
    }
}

#[test]
fn a_second_trigger_does_not_disturb_the_sweep() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.send(":TRIG:SING");
    let until = meter.meter.deadline();
    meter.send(":TRIG:SING;:SYST:ERR?");
    assert!(meter.heard().starts_with("-211"));
    assert_eq!(meter.meter.deadline(), until);
    assert_eq!(meter.say(":CALC1:DATA:FDAT?;*OPC?"), "1\n");
    assert_eq!(meter.say(":CALC1:DATA:FDAT?").split(',').count(), 10);
}

#[test]
fn a_change_of_the_trigger_source_ends_the_sweep() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.send(":TRIG:SING;:TRIG:SOUR BUS;*OPC?");
    assert_eq!(meter.heard(), "1\n");
    assert_eq!(meter.meter.deadline(), None);
}

#[test]
fn what_cannot_be_is_told_and_a_bad_point_is_no_number() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    let rows = [
        (":SOUR1:VOLT 5", "-222"),
        (":SENS1:FREQ:STAR 10", "-222"),
        (":INIT1:CONT OFF;:TRIG:SING", "-211"),
        (":CALC1:PAR9:DEF Z", "-114"),
    ];
    for (line, number) in rows {
        assert_eq!(meter.say(line), "", "{line}");
        let told = meter.say("SYST:ERR?");
        assert!(told.starts_with(number), "{line}: {told}");
    }
    meter.meter.overload();
    meter.say(":INIT1;:TRIG:SING");
    let line = meter.say(":CALC1:DATA:FDAT?");
    assert!(line.starts_with("1.#QNB,+0.00000000000E+000,+"), "{line}");
}

#[test]
fn public_drivers_are_answered() {
    let mut meter = TestMeter::new();
    let rows = [
        ("*CLS;:FORM:DATA REAL;:FORM:BORD NORM;:FORM:DATA?;:FORM:DATA ASC", "REAL\n"),
        ("*OPT?;:SENS:FIXT:SEL?", "0;NONE\n"),
        (":DISP:ENAB OFF;:DISP:WIND1:X:SPAC LIN;:DISP:WIND1:SPL D1_2", ""),
        (":SOUR1:BIAS:MODE VOLT;:SOUR1:BIAS:VOLT 0;:SOUR:BIAS:STAT OFF", ""),
        (":SOUR1:BIAS:STAT?;:SOUR1:ALC OFF;:SOUR1:ALC?", "0;0\n"),
        (":SENS1:FREQ?", "+1.00000000000E+006\n"),
        (":SENS1:DC:MEAS:ENAB ON;:SENS1:DC:MEAS:CLE;:CALC1:MARK1 ON", ""),
        (":CALC1:AVER OFF;:CALC1:AVER:CLE;:CALC1:MARK1:FUNC:TYPE PEAK", ""),
        (":DISP:WIND1:TRAC2:STAT OFF;:DISP:WIND1:TRAC1:STAT?", "1\n"),
        (":DISP:WIND1:TRAC2:STAT?;:DISP:WIND1:TRAC2:Y:AUTO", "0\n"),
        (":CALC1:PAR:COUN 4;:CALC1:PAR:COUN?;:STAT:OPER:COND?", "4;0\n"),
        (":SYST:ERR?", "+0,\"No error\"\n"),
    ];
    for (line, answer) in rows {
        assert_eq!(meter.say(line), answer, "{line}");
    }
}

#[test]
fn raw_data_are_resistance_and_reactance_in_text_and_in_blocks() {
    let mut meter = TestMeter::new();
    meter.say(SET_UP);
    meter.send(":TRIG:SING");
    meter.send(":STAT:OPER:COND?");
    assert_eq!(meter.heard(), "16\n");
    meter.say("");
    let line = meter.say(":CALC1:DATA:RDAT?");
    let numbers: Vec<f64> = line.trim_end().split(',').map(|x| x.parse().unwrap()).collect();
    let z = meter.settled_ohm(140.0);
    assert!((numbers[4] / z.re - 1.0).abs() < 1e-6 && (numbers[5] / z.im - 1.0).abs() < 1e-6);
    meter.send(":FORM:DATA REAL;:CALC1:DATA:RDAT?");
    let (_, said) = meter.meter.take_said(0).remove(0);
    assert!(said.starts_with(b"#280"), "{}", said.escape_ascii());
    for (bytes, expected) in said[4..].chunks_exact(8).zip(numbers) {
        let number = f64::from_be_bytes(bytes.try_into().unwrap());
        assert!((number / expected - 1.0).abs() < 1e-9, "{number} {expected}");
    }
}
