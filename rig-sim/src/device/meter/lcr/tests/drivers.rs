//! What public drivers say when they connect and what their getters ask, in their own words.

use super::*;

type Lines = &'static [(&'static str, &'static str)];

#[track_caller]
fn check<M: Make>(name: &str, lines: Lines) {
    let mut meter = test_meter::TestMeter::<Lcr<M>>::new();
    for (line, answer) in lines {
        assert_eq!(meter.say(line).trim_end(), *answer, "{name}: {line}");
    }
    assert_eq!(meter.say("SYST:ERR?"), "+0,\"No error\"\n", "{name}");
}

#[test]
fn public_drivers_are_answered() {
    check::<E4980a>("QCoDeS", QCODES);
    check::<E4980a>("SweepMe!", SWEEP_ME);
    check::<E4980a>("scripts of laboratories", SCRIPTS);
    check::<Hp4284a>("PyMeasure", PYMEASURE);
    check::<Th2832>("a script for the TH2832", TONGHUI_SCRIPT);
}

const QCODES: Lines = &[
    ("*IDN?", E4980a::IDENTITY),
    ("*OPT?", "001"),
    (":VOLTage:LEVel?", "+1.000000000E+00"),
    (":FREQuency?", "+1.000000000E+03"),
    (":FUNCtion:IMPedance?", "CPD"),
    (":FUNCtion:IMPedance:RANGe?", "+1.000000000E+05"),
    (":FUNCtion:IMPedance:RANGe:AUTO?", "1"),
    (":BIAS:STATe?", "0"),
    (":BIAS:VOLTage:LEVel?", "+0.000000000E+00"),
    (":BIAS:RANGe:AUTO?", "1"),
    (":APERture?", "MED,1"),
    (":CORRection:OPEN:STATe?;:CORRection:SHORt:STATe?", "0;0"),
    (":CURRent:LEVel 0.001", ""),
    (":CURRent:LEVel?", "+1.000000000E-03"),
    (":FUNCtion:IMPedance:RANGe 300", ""),
    (":FUNCtion:IMPedance:RANGe?;:FUNCtion:IMPedance:RANGe:AUTO?", "+3.000000000E+02;0"),
    (":CORRection:OPEN;:CORRection:OPEN:STATe 1;:CORRection:OPEN:STATe?", "1"),
    (":BIAS:VOLTage:LEVel -2.5;:BIAS:STATe 1;:BIAS:STATe?", "1"),
];

const SWEEP_ME: Lines = &[
    ("FUNC:IMP?", "CPD"),
    ("FUNC:IMP:RANG:AUTO?", "1"),
    ("DISP:LINE?", "\"\""),
    ("APER?", "MED,1"),
    ("AMPL:ALC?", "0"),
    ("CORR:LENG?", "0"),
    ("CORR:LENG 0M;:CORR:LENG 2;:CORR:LENG?", "2"),
    ("DISP:LINE \"a line\";:DISP:LINE?", "\"a line\""),
    ("BIAS:VOLT 0.000e+00;:VOLT 20.0 MV", ""),
    ("FREQ?;BIAS:VOLT?", "+1.000000000E+03;+0.000000000E+00"),
    ("CURR 1.0 MA", ""),
    ("CURR?", "+1.000000000E-03"),
    ("BIAS:CURR 1.00000e-02A;:BIAS:CURR?", "+1.000000000E-02"),
];

const SCRIPTS: Lines = &[
    ("*RST; *CLS", ""),
    (":DISP:CCL;:DISP:ENAB ON;:FORM ASC;:FORM:DATA ASC,64", ""),
    (":FUNC:SMON:VAC ON;:FUNC:SMON:IAC ON;:FUNC:SMON:VDC OFF;:FUNC:SMON:IDC OFF", ""),
    (":FUNC:SMON:VDC:STAT?", "0"),
    (":SYST:BEEP:STAT OFF;:SYST:BEEP:TONE 2;:SYST:BEEP:TONE?", "2"),
    (":CORR:METH SING;:CORR:METH?", "SING"),
    (":CORR:LOAD:STAT?;:CORR:LOAD:TYPE?", "0;CPD"),
    (":FUNC:IMP:RANG:VAL 100000;:FUNC:DEV1:MODE OFF;:FUNC:DEV2:REF:VAL 0", ""),
    (":BIAS:POL:AUTO OFF;:COMP:MODE PTOL;:COMP:TOL:NOM 0;:COMP:SWAP OFF", ""),
    (":LIST:FREQ 20,100;:LIST:FREQ?", "+2.000000000E+01,+1.000000000E+02"),
    (":LIST:CLE:ALL;:DISP:PAGE LSETup;:DISP:PAGE?", "LSET"),
];

const PYMEASURE: Lines = &[
    ("CURR:LEV 0.02;:CURR:LEV?", "+2.000000000E-02"),
    ("VOLT:LEV 2;:VOLT:LEV?", "+2.000000000E+00"),
    ("OUTP:HPOW 1;:OUTP:HPOW?", "1"),
    ("BIAS:STAT 0;:BIAS:STAT?", "0"),
    ("BIAS:VOLT 40;:BIAS:VOLT?", "+4.000000000E+01"),
    ("FUNC:IMP:RANG 1000;:FUNC:IMP:RANG?", "+1.000000000E+03"),
    ("FUNC:IMP:RANG:AUTO 1;:FUNC:IMP:RANG:AUTO?", "1"),
    ("TRIG:SOUR BUS;:DISP:PAGE LIST;:FORM ASC;:LIST:MODE SEQ;:INIT:CONT ON", ""),
    ("TRIG:SOUR HOLD;:TRIG:SOUR?", "HOLD"),
    (":CORR:SPOT2:STAT 1;:CORR:SPOT2:STAT?;:CORR:SPOT1:STAT?", "1;0"),
    (":CORR:SPOT1:FREQ 10000;:CORR:SPOT1:OPEN;:CORR:SPOT1:FREQ?", "+1.00000E+04"),
];

const TONGHUI_SCRIPT: Lines = &[
    ("*CLS;:TRIG:SOUR BUS;:FUNC:IMP RX", ""),
    ("AMPL:ALC 0;:BIAS:STAT 0;:APER MED, 1", ""),
    ("ORES 100;:FUNC:IMP:RANG:AUTO ON;:TRIG:DEL 0.1S", ""),
];
