//! The modes of LCR meters, and the habits of instruments and spreadsheets.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::{check, check_faults, read};

/// The two readings that [`check`] expects.
const SWEEP: [(f64, Complex64); 2] =
    [(120.0, Complex64::new(900.0, -47_000.0)), (140.0, Complex64::new(2000.0, -39_000.0))];

/// A file with a header and a row for each reading.
fn file(header: &str, row: impl Fn(f64, Complex64) -> [f64; 3]) -> String {
    let row = |(hz, z)| row(hz, z).map(|value| format!("{value:e}")).join(",") + "\n";
    format!("{header}\n{}", SWEEP.map(row).concat())
}

#[test]
fn every_mode_of_an_lcr_meter_is_read() {
    let series = |hz: f64, z: Complex64| -1.0 / (TAU * hz * z.im);
    let parallel = |hz: f64, z: Complex64| (1.0 / z).im / (TAU * hz);
    let dissipation = |z: Complex64| z.re / z.im.abs();
    for text in [
        file("Freq[Hz],Cs[F],Rs[ohm]", |hz, z| [hz, series(hz, z), z.re]),
        file("FREQUENCY(kHz),Cs(nF),D", |hz, z| [hz * 1e-3, series(hz, z) * 1e9, dissipation(z)]),
        file("Freq.(Hz),Cs(F),Q", |hz, z| [hz, series(hz, z), 1.0 / dissipation(z)]),
        file("Freq(Hz),CP(F),D[ ]", |hz, z| [hz, parallel(hz, z), dissipation(z)]),
        file("frequency_hz,cp_f,d", |hz, z| [hz, parallel(hz, z), dissipation(z)]),
        file("f,Cp (pF),tan δ", |hz, z| [hz, parallel(hz, z) * 1e12, dissipation(z)]),
        file("Freq,Cp,Q (-)", |hz, z| [hz, parallel(hz, z), 1.0 / dissipation(z)]),
        file("Hz,Cp [µF],G [S]", |hz, z| [hz, parallel(hz, z) * 1e6, (1.0 / z).re]),
        file("Hz,Cp(F),Rp(MOhm)", |hz, z| [hz, parallel(hz, z), 1e-6 / (1.0 / z).re]),
        file("Hz,Ls(H),Rs(Ohm)", |hz, z| [hz, z.im / (TAU * hz), z.re]),
        file("Hz,Ls(mH),D", |hz, z| [hz, 1e3 * z.im / (TAU * hz), dissipation(z)]),
        file("Hz,Ls(H),Q", |hz, z| [hz, z.im / (TAU * hz), 1.0 / dissipation(z)]),
        file("Hz,Lp(H),G(S)", |hz, z| [hz, -1.0 / (TAU * hz * (1.0 / z).im), (1.0 / z).re]),
        file("Hz,Lp(H),Rp(Ohm)", |hz, z| {
            [hz, -1.0 / (TAU * hz * (1.0 / z).im), 1.0 / (1.0 / z).re]
        }),
        file("Hz,Lp(H),D", |hz, z| [hz, -1.0 / (TAU * hz * (1.0 / z).im), dissipation(z)]),
        file("Hz,Lp(H),Q", |hz, z| [hz, -1.0 / (TAU * hz * (1.0 / z).im), 1.0 / dissipation(z)]),
        file("Hz,|Y|(uS),θy(deg)", |hz, z| [hz, 1e6 / z.norm(), -z.arg().to_degrees()]),
        file("Hz,Y,admittance_phase_deg", |hz, z| [hz, 1.0 / z.norm(), -z.arg().to_degrees()]),
        // Some meters give an inductive sample a negative capacitance and a negative dissipation.
        file("Hz,Ls(H),D", |hz, z| [hz, z.im / (TAU * hz), -dissipation(z)]),
    ] {
        check("lcr.csv", &text);
    }
    // The rectangular parts count if the file has them too.
    check("lcr.csv", "Freq(Hz),Cp(F),D,Rs(Ohm),X(Ohm)\n120,1,1,900,-47000\n140,1,1,2000,-39000\n");
}

#[test]
fn the_tables_of_digilent_and_gamry_are_read() {
    let polar =
        ["120,47008.61623149527,-88.90298084780932", "140,39051.248379533274,-87.06432655357884"];
    let waveforms = "#Digilent WaveForms Impedance Analyzer\n\
                     Frequency (Hz),Trace 1 |Z| (Ohm),Trace 1 theta (deg)\n";
    check("trace.csv", &(waveforms.to_owned() + &polar.join("\n")));
    let gamry = "EXPLAIN\nTAG\tEISPOT\nFREQINIT\tQUANTITY\t1.00000E+003\tInitial frequency (Hz)\n\
                 ZCURVE\tTABLE\n\
                 \tPt\tTime\tFreq\tZreal\tZimag\tZsig\tZmod\tZphz\n\
                 \t#\ts\tHz\tohm\tohm\tV\tohm\t°\n\
                 \t0\t3\t120\t900\t-47000\t1\t47008.6\t-88.9\n\
                 \t1\t7\t140\t2000\t-39000\t1\t39051.2\t-87.1\n";
    check("spectrum.DTA", gamry);
}

#[test]
fn a_phase_beside_an_admittance_needs_its_name() {
    check_faults(
        "a.csv",
        "Freq(Hz),Y(S),PHASE(deg)\n120,2e-5,88.9\n",
        &["a.csv:1:1: the phase beside |Y| may be that of the impedance or that of the \
           admittance; name it `admittance_phase_deg` if it is that of the admittance; otherwise \
           export |Z| instead of |Y|"],
    );
}

#[test]
fn a_row_below_the_header_may_have_the_units() {
    for text in [
        "Freq,R,X\nHz,Ohm,Ohm\n120,900,-47000\n140,2000,-39000\n",
        "Frequency;Rs;-Z'';note\n[kHz];[kΩ];[kΩ];\n0,12;0,9;47;a\n0,14;2;39;b\n",
        "# Frequency\tRe(Z)\tIm(Z)\n# (MHz)\t(Ohm)\t(Ohm)\n0.00012\t900\t-47000\n\
         0.00014\t2000\t-39000\n",
        "f(Hz),R,X\nHz,kOhm,kOhm\n120,0.9,-47\n140,2,-39\n",
        // A column without a cell in the row keeps the unit of its key.
        "Freq,R,X\nHz,,\n120,900,-47000\n140,2000,-39000\n",
    ] {
        check("a.csv", text);
    }
    let phase = "f,|Z|,theta\nHz,Ohm,deg\n120,47008.61623149527,-88.90298084780932\n\
                 140,39051.248379533274,-87.06432655357884\n";
    check("a.csv", phase);
    check_faults(
        "a.csv",
        "f,R,X(Ohm)\nHz,dB,kOhm\n120,900,-47000\n",
        &[
            "a.csv:1:3: `dB` is not a unit of the resistance; write `resistance_ohm`",
            "a.csv:1:5: `kOhm` is not a unit of the reactance; write `reactance_ohm`",
        ],
    );
}

#[test]
fn a_frequency_that_cannot_be_in_hertz_is_refused() {
    check_faults(
        "a.csv",
        "Freq,R,X\n0.12,900,-47000\n0.14,2000,-39000\n",
        &["a.csv:1:1: the frequency has no unit, and all values are below 4, the lowest of any \
           analyzer in Hz; name the column `Freq(kHz)`, `Freq(MHz)` or `frequency_hz`"],
    );
    // A unit, or a name with one, says it.
    assert_eq!(read("a.csv", "frequency_hz,R,X\n0.12,900,-47000\n").readings[0].frequency_hz, 0.12);
    assert_eq!(read("a.csv", "Freq,R,X\n3.9,1,-1\n4.1,1,-1\n").readings.len(), 2);
}

#[test]
fn rows_without_a_value_and_repeated_rows_are_left_out_and_named() {
    let text = "f,R,X\n120,900,-47000\n125,NaN,-44000\n130,n/a,---\n140,2000,-39000\n\
                140,2000,-39000\n120,900,-47000\n";
    check("a.csv", text);
    let said: Vec<_> = read("a.csv", text).left_out.iter().map(ToString::to_string).collect();
    assert_eq!(
        said,
        [
            "line 3 was left out: it has `NaN` in place of a number",
            "line 4 was left out: it has `N/A` in place of a number",
            "line 6 was left out: it repeats line 5 in every value",
            "line 7 was left out: it repeats line 2 in every value",
        ]
    );
    // Another time or another value is another reading; overloads have nothing to compare.
    for text in [
        "f,R,X,time_s\n120,900,-47000,0\n120,900,-47000,1\n",
        "f,R,X\n120,900,-47000\n120,900,-47001\n",
        "f,R,X\n120,OL,OL\n120,OL,OL\n",
        "f,R,X,flag\n120,NaN,NaN,overload\n120,NaN,NaN,overload\n",
    ] {
        let sweep = read("a.csv", text);
        assert_eq!((sweep.readings.len(), sweep.left_out.len()), (2, 0), "{text}");
    }
    let begin = "begin with the line `frequency_hz,resistance_ohm,reactance_ohm`, then one line \
                 for each reading";
    let fault = format!("a.csv:1:1: the file holds no readings; {begin}");
    check_faults("a.csv", "f,R,X\n120,NaN,1\n", &[&fault]);
}

#[test]
fn touchstone_2_is_read() {
    for text in [
        "! a network analyzer\n[Version] 2.0\n# Hz Z RI R 75\n[Number of Ports] 1\n\
         [Number of Frequencies] 2\n[Reference] 50\n[Network Data]\n120 900 -47000\n\
         140 2000 -39000\n[End]\nrubbish\n",
        "[version] 2.1\n# KHZ Y RI\n[Number of Ports] 1\n[Begin Information]\na b c\n\
         [End Information]\n[Network Data]\n0.12 4.072748335829777e-07 2.1268796864888837e-05\n\
         0.14 1.3114754098360655e-06 2.557377049180328e-05\n[Noise Data]\n0.12 1 2 3 4\n[End]\n",
        "[Version] 2.0\n# HZ S RI R 10\n[Number of Ports] 1\n[Reference] 50\n[Network Data]\n\
         120 0.999957011678117 -0.0021267906615789634\n\
         140 0.9998655916181621 -0.0025570375081341657\n",
    ] {
        for name in ["sweep.s1p", "sweep.ts", "-"] {
            check(name, text);
        }
    }
}
