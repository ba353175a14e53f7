//! Files of many makers, and the faults of changed ones.

mod instruments;

use proptest::prelude::*;
use rig_model::{Impedance, Reading, ReadingFlag, Window};
use rig_resonance::{NoisePrior, Past, Timing};

mod joined;

use super::{FileSweep, FitSettings, SweepFile};

fn read_all(name: &str, text: &str) -> Vec<FileSweep> {
    let file = SweepFile::read(name, text, None);
    file.unwrap_or_else(|faults| panic!("{faults}\n{text}")).sweeps
}

/// The one sweep of a file.
fn read(name: &str, text: &str) -> FileSweep {
    let mut sweeps = read_all(name, text);
    assert_eq!(sweeps.len(), 1, "{text}");
    sweeps.remove(0)
}

/// The file must hold the readings 120 Hz, 900 − 47000j Ω and 140 Hz, 2000 − 39000j Ω.
#[track_caller]
fn check(name: &str, text: &str) {
    let found = read(name, text);
    let expected = [(120.0, 900.0, -47_000.0), (140.0, 2000.0, -39_000.0)];
    assert_eq!(found.readings.len(), expected.len(), "{text}");
    for (reading, (hz, re, im)) in found.readings.iter().zip(expected) {
        let near = |found: f64, expected: f64| (found - expected).abs() < 1e-6 * f64::hypot(re, im);
        assert!((reading.frequency_hz / hz - 1.0).abs() < 1e-12, "{reading:?}\n{text}");
        let found = reading.impedance().unwrap();
        assert!(near(found.resistance_ohm, re), "{reading:?}\n{text}");
        assert!(near(found.reactance_ohm, im), "{reading:?}\n{text}");
    }
}

/// The faults of a text.
#[track_caller]
fn check_faults(name: &str, text: &str, expected: &[&str]) {
    match SweepFile::read(name, text, None) {
        Ok(file) => panic!("no fault in {text:?}: {file:?}"),
        Err(faults) => {
            let found = faults.to_string();
            let found: Vec<_> = found.lines().collect();
            assert_eq!(found, expected, "{text:?}");
        }
    }
}

#[test]
fn rows_of_every_origin_are_read() {
    let polar = "47008.61623149527\t-88.90298084780932";
    let second = "39051.248379533274\t-87.06432655357884";
    let admittance = "4.072748335829777e-07\t2.1268796864888837e-05";
    for text in [
        "frequency_hz,resistance_ohm,reactance_ohm\n120,900,-47000\n140,2000,-39000\n".to_owned(),
        // Any order of columns, more of them, no line end at the end.
        "X,note,R,f\n-47000,a,900,120\n-39000,,2000,140".into(),
        // A mark, carriage returns, quotation marks, blanks, an empty line, a trailing separator.
        "\u{feff}\"Freq(Hz)\", \"Rs(ohm)\", \"X(ohm)\",\r\n\"120\",900 , \
         -47000,\r\n\r\n140,2000,-39000,\r\n".into(),
        "Freq.[kHz];Z' / Ω;-Z'' / Ω\n0,12;900,0;47000\n0,14;2000,0;39000\n".into(),
        "frequency / MHz\tRe(Z) (kOhm)\tIm(Z) (kOhm)\r0.00012\t0.9\t-47\r0.00014\t2\t-39\r".into(),
        "Hz R X\n120 900 -47000\n 140   2.0E+3 -3.9e4\n".into(),
        // Comments, and the header lines of an analyzer.
        "!CSV A.01.01\n!maker, model; date\nBEGIN \
         CH1_DATA\nFreq(Hz),R(Ohm),X(Ohm)\n120,900,-47000\n\
         140,2000,-39000\nEND\n120,0,0\n".into(),
        "# a sweep\n# frequency_hz resistance_ohm reactance_ohm\n120 900 -47000\n# more\n140 2000 \
         -39000\n"
            .into(),
        // Two pairs: the rectangular one is read.
        "f,|Z|,deg,Rs,Xs\n120,1,1,900,-47000\n140,1,1,2000,-39000\n".into(),
        format!("Frequency\t|Z|\tphase_deg\n120\t{polar}\n140\t{second}\n"),
        format!("Frequency\tZ[Ω]\ttheta (°)\n120\t{polar}\n140\t{second}\n"),
        format!("FREQ\tZ\tdeg\n120\t{polar}\n140\t{second}\n"),
        "f;impedance_magnitude_ohm;θ (rad)\n120;47008,61623149527;-1,5516497306317323\n\
         140;39051,248379533274;-1,519559159391478\n".into(),
        // As Digilent, Keysight E4990A, PNA and ENA, and LabVIEW programs head their columns.
        "Frequency (Hz),Trace θ (deg),Trace |Z| (Ohm),Trace Rs (Ohm),Trace Xs (Ohm)\n\
         120,1,1,900,-47000\n140,1,1,2000,-39000\n"
            .into(),
        "!Agilent Technologies,E4990A\n!\n\n\nFrequency(Hz), |Z|(Ohm)-data, theta-z(deg)-data\n\
         120, 47008.61623149527, -88.90298084780932\n140, 39051.248379533274, \
         -87.06432655357884\nEND\n"
            .into(),
        "Data Index,Frequency(Hz),Z(Ω),Phase,Z_Real,Z_Img\n0,120,1,1,900,-47000\n\
         1,140,1,1,2000,-39000\n"
            .into(),
        "Freq(Hz),S11(REAL),S11(IMAG)\n120,0.999957011678117,-0.0021267906615789634\n140,0.9998655916181621,-0.0025570375081341657\nEND\n"
            .into(),
        "freq,S11(DB),S11(DEG)\n120,-0.0003537540256733508,-0.1218611836806894\n140,-0.001139131206390128,-0.14652683231245076\n".into(),
        "freq,s11_mag,s11_phase_deg\n120,0.9999592733920457,-0.1218611836806894\n140,0.9998688612726948,-0.14652683231245076\n".into(),
        format!("f\tG(S)\tB(S)\n120\t{admittance}\n140\t1.3114754098360655e-06\t2.557377049180328e-05\n"),
    ] {
        check("sweep.csv", &text);
    }
}

#[test]
fn touchstone_is_read_in_every_format_it_has() {
    // z = Z/50, its reciprocal, and (z − 1)/(z + 1).
    for text in [
        "# HZ Z RI R 50\n120 18 -940\n140 40 -780\n",
        "! made by hand\n#hz z ri r 1 ! these\n120 900 -47000 ! first\n\n140 2e3 -3.9e4\n# GHZ S \
         MA R 50\n",
        "# KHZ Z MA R 1000\n0.12 47.00861623149527 -88.90298084780932\n0.14 39.051248379533274 \
         -87.06432655357884\n",
        "# R 1 Hz Y DB\n120 -93.44354934545368 88.90298084780932\n140 -91.83269843682805 \
         87.06432655357884\n",
        "# MHZ Y RI R 50\n.00012 2.0363741679148884e-05 0.0010634398432444417\n.00014 \
         6.557377049180327e-05 0.001278688524590164\n",
    ] {
        for name in ["sweep.s1p", "-"] {
            check(name, text);
        }
    }
    // The reflection of 100 Ω and of 25 Ω; the second with the defaults of a file without options.
    let found = read("-", "# Hz S RI R 50\n100 0.333333333333 0\n").readings;
    let impedance = found[0].impedance().unwrap();
    assert!((impedance.resistance_ohm - 100.0).abs() < 1e-6 && impedance.reactance_ohm == 0.0);
    let found = read("a.S1P", "! defaults\n1e-7 0.333333333333 180\n").readings;
    let impedance = found[0].impedance().unwrap();
    assert!((impedance.resistance_ohm - 25.0).abs() < 1e-6, "{found:?}");
    assert!((found[0].frequency_hz - 100.0).abs() < 1e-9, "{found:?}");
}

#[test]
fn times_and_flags_are_kept_and_the_order_is_that_of_the_times() {
    let text = "frequency_hz,resistance_ohm,reactance_ohm,time_s,settle_s,integration_s,flag\n\
                140,2000,-39000,17.5,0.5,0.07,normal\n\
                120,900,-47000,15,0.5,0.08,low_signal\n\
                130,9.91E+37,9.91E+37,20,0.5,0.08,normal\n\
                135,OL,1,21,0.5,0.08,normal\n\
                136,1,1,22,0.5,0.08,overload\n\
                137,,,23,0.5,0.08,overload\n";
    let file = read("sweep.csv", text);
    assert!(file.has_dwell && file.has_time && file.begins_s == 15.0);
    let hz: Vec<_> = file.readings.iter().map(|reading| reading.frequency_hz).collect();
    assert_eq!(hz, [120.0, 140.0, 130.0, 135.0, 136.0, 137.0]);
    let started: Vec<_> =
        file.readings.iter().map(|reading| reading.started.as_seconds()).collect();
    assert_eq!(started, [0.0, 2.5, 5.0, 6.0, 7.0, 8.0]);
    let flags: Vec<_> = file.readings.iter().map(Reading::flag).collect();
    assert_eq!(flags[..2], [Some(ReadingFlag::LowSignal), None]);
    let is_overload = |flag: &Option<ReadingFlag>| *flag == Some(ReadingFlag::Overload);
    assert!(flags[2..].iter().all(is_overload), "{flags:?}");
    assert_eq!((file.readings[0].settle_s, file.readings[0].integration_s), (0.5, 0.08));
    // The clock of a logger is no time of a reading.
    let clock = "Time,f,R,X\n2020-11-02 12:03:55,120,900,-47000\n,140,2000,-39000\n";
    check("sweep.csv", clock);
    let clock = read("sweep.csv", clock);
    assert!(!clock.has_dwell && !clock.has_time);
}

#[test]
fn all_sweeps_of_a_file_are_read_or_the_one_that_is_asked_for() {
    let text = "sweep,reading,frequency_hz,resistance_ohm,reactance_ohm,is_used\n\
                7,1,120,900,-47000,true\n3,1,100,1,1,false\n3,2,110,2,2,true\n7,2,140,2000,-39000,true\n";
    let counts = |sweep| {
        let file = SweepFile::read("r.csv", text, sweep);
        let count = |sweep: &FileSweep| (sweep.number, sweep.readings.len());
        file.map(|file| file.sweeps.iter().map(count).collect::<Vec<_>>())
    };
    assert_eq!(counts(None), Ok(vec![(Some(3), 1), (Some(7), 2)]));
    assert_eq!(counts(Some(3)), Ok(vec![(Some(3), 1)]));
    assert_eq!(counts(Some(7)), Ok(vec![(Some(7), 2)]));
    assert_eq!(
        counts(Some(4)).unwrap_err().to_string(),
        "r.csv:1:1: the file has 2 sweeps, from 3 to 7, but no sweep 4; choose one of them, or \
         leave out `--sweep` to fit them all"
    );
    let single = "f,R,X\n120,900,-47000\n";
    assert_eq!(
        SweepFile::read("r.csv", single, Some(1)).unwrap_err().to_string(),
        "r.csv:1:1: the file does not number its sweeps; leave out `--sweep`"
    );
}

#[test]
fn what_a_file_tells_the_fit_is_read_with_the_readings() {
    let header = "frequency_hz,resistance_ohm,reactance_ohm,is_used,fit_min_hz,fit_max_hz,\
                  fit_noise_at_ten_cycles,fit_noise_degrees_of_freedom,fit_timing,fit_always_loss,\
                  fit_target_sigma_hz";
    let settings = |cells: &str| {
        let text = format!("{header}\n120,900,-47000,false{cells}\n140,2000,-39000,true{cells}\n");
        let sweep = read("a.csv", &text);
        (sweep.readings.len(), sweep.fit)
    };
    let window = Some(Window { min_hz: 125.0, max_hz: 160.0 });
    let noise = |degrees_of_freedom| NoisePrior { at_ten_cycles: 0.005, degrees_of_freedom };
    let all = FitSettings {
        window,
        noise: Some(noise(4.0)),
        timing: Some(Timing::Exact(Past::Rest)),
        always_loss: true,
        target_hz: Some(0.05),
        near: None,
        bench: None,
    };
    // With a known noise, no reading is left out: the fit weighs them by their settling.
    assert_eq!(settings(",125,160,0.005,4,exact-from-rest,true,0.05"), (2, all));
    let stated = FitSettings {
        window,
        noise: Some(noise(NoisePrior::STATED_DEGREES)),
        timing: Some(Timing::Waited),
        ..FitSettings::default()
    };
    assert_eq!(settings(",125,160,0.005,,\"Waited\",FALSE,"), (2, stated));
    assert_eq!(settings(",,,,,,,"), (1, FitSettings::default()));
    for (word, timing) in [("unknown", Timing::Unknown), ("exact", Timing::Exact(Past::Unknown))] {
        assert_eq!(settings(&format!(",,,,,{word},,")).1.timing, Some(timing));
    }

    let near = "f,R,X,fit_near_resonance_hz,fit_near_quality_factor,fit_near_static_capacitance_f,\
                fit_near_capacitance_ratio,fit_near_loss_tangent\n\
                120,900,-47000,140,60,2e-8,0.05,-0.0\n140,2000,-39000,140,60,2e-8,0.05,-0.0\n";
    let circuit = read("a.csv", near).fit.near.unwrap();
    assert_eq!((circuit.resonance_hz, circuit.q), (140.0, 60.0));
    assert_eq!((circuit.c0_farad, circuit.c1_farad, circuit.loss_tangent), (2e-8, 1e-9, 0.0));
    let bench = near.replace("loss_tangent\n", "loss_tangent,fit_bench_phase_rad,fit_bench_phase_sigma_rad,fit_bench_first_gap_s,fit_bench_dispersion_f,fit_bench_dispersion_sigma_f,fit_bench_mode_sigma,fit_bench_min_hz,fit_bench_max_hz\n");
    let bench = bench.replace("-0.0\n", "-0.0,0.01,2e-4,-0.001,-3e-10,2e-11,0.003,126,159\n");
    let found = read("a.csv", &bench).fit.bench.unwrap();
    assert_eq!((found.phase_rad, found.phase_sigma_rad, found.mode_sigma), (0.01, 2e-4, 0.003));
    assert_eq!(found.surveyed, Window { min_hz: 126.0, max_hz: 159.0 });
    assert_eq!(found.first_gap_s, -1e-3);
    assert_eq!((found.dispersion_farad, found.dispersion_sigma_farad), (-3e-10, 2e-11));
    let older = bench.replace(",-0.001,-3e-10,2e-11,", ",,,,");
    let found = read("a.csv", &older).fit.bench.unwrap();
    assert_eq!((found.first_gap_s, found.dispersion_farad), (0.0, 0.0));
    assert_eq!(found.dispersion_sigma_farad, 0.0);
    // All other parts are needed, and a dispersion with its standard deviation.
    assert_eq!(read("a.csv", &bench.replace(",2e-11,", ",,")).fit.bench, None);
    assert_eq!(read("a.csv", &bench.replace(",0.003,", ",,")).fit.bench, None);
    assert_eq!(read("a.csv", &near.replace(",60,", ",,")).fit.near, None);
}

#[test]
fn a_flagged_reading_of_rigd_was_repeated_or_ended_the_sweep() {
    let rows = "120,900,-47000,true,normal,TIMING\n130,1,-1,false,low_signal,TIMING\n\
                130,900,-47000,false,normal,TIMING\n140,,,false,overload,TIMING\n\
                140,,,false,overload,TIMING\n";
    let sweep = |timing: &str| {
        let header = "f,R,X,is_used,flag,fit_timing,fit_noise_at_ten_cycles\n";
        let noise = if timing.is_empty() { "\n" } else { ",0.005\n" };
        let rows = rows.replace("TIMING\n", &format!("{timing}{noise}"));
        let header = if timing.is_empty() { "f,R,X,is_used,flag,note\n" } else { header };
        read("a.csv", &(header.to_owned() + &rows))
    };
    let hz = |sweep: &FileSweep| -> Vec<f64> {
        sweep.readings.iter().map(|reading| reading.frequency_hz).collect()
    };
    let rigs = sweep("waited");
    assert_eq!(hz(&rigs), [120.0, 130.0]);
    assert_eq!(
        rigs.given_up.as_ref().unwrap().to_string(),
        "the analyzer flagged overload at 140 Hz in 2 of 2 tries"
    );
    let other = sweep("");
    assert_eq!((hz(&other), other.given_up.clone()), (vec![120.0], None));
}

#[test]
fn an_impossible_setting_of_the_fit_is_a_fault() {
    check_faults(
        "a.csv",
        "f,R,X,fit_min_hz,fit_max_hz\n120,900,-47000,160,125\n140,2000,-39000,160,125\n",
        &["a.csv:2:1: fit_max_hz = 125 is not above fit_min_hz = 160; correct one of them, or \
             remove \
           both columns"],
    );
    check_faults(
        "a.csv",
        "f,R,X,fit_timing,fit_always_loss,fit_noise_at_ten_cycles\n120,900,-47000,soon,maybe,0\n",
        &[
            "a.csv:2:16: `soon` is not one of unknown, waited, exact, exact-from-rest, any-phase; \
             correct it \
             or remove the column",
            "a.csv:2:21: `maybe` is neither true nor false; correct it or remove the column",
            "a.csv:2:27: fit_noise_at_ten_cycles = 0 is outside [1e-12, 1e0]; check the unit in \
             the header",
        ],
    );
    check_faults(
        "a.csv",
        "sweep,f,R,X,fit_max_hz\n1,120,900,-47000,160\n2,120,900,-47000,170\n1,140,2000,-39000,165\n",
        &["a.csv:4:1: the upper end of the window of the fit differs from that of the first row \
             of \
           the sweep; write one value in all rows of a sweep, or number the sweeps"],
    );
}

/// A frequency of 40,000 Hz is not one of 40 Hz.
#[test]
fn a_comma_for_thousands_is_no_decimal_mark() {
    check_faults(
        "a.csv",
        "Frequency (Hz),R (Ohm),X (Ohm)\n\"40,000\",350,-870\n",
        &["a.csv:2:1: `40,000` is not a number; write it like 140.25, 1.4025e2 or, between \
           semicolons, 140,25"],
    );
    let thousands = "a.csv:2:1: the comma of `40,000` may be a decimal mark or one for thousands; \
         write all numbers with a point, without marks for thousands";
    for (rows, is_refused) in [
        ("40,000;350;-870\n40,010;362;-861\n", true),
        ("40,000;350;-1,870\n", true),
        ("40,000;350,120;-870,334\n", true),
        ("140,125;350;-870,3\n", false),
        ("1400,125;350;-870\n", false),
        ("0,125;350;-870\n", false),
        ("140;350;-870\n", false),
    ] {
        for separator in [";", "\t"] {
            let text = format!("f (Hz);R (Ohm);X (Ohm)\n{rows}").replace(';', separator);
            let read = SweepFile::read("a.csv", &text, None);
            let faults = read.err().map(|faults| faults.to_string()).unwrap_or_default();
            assert_eq!(faults.contains(thousands), is_refused, "{rows}: {faults}");
        }
    }
}

#[test]
fn units_that_stand_apart_belong_to_the_names_before_them() {
    for unit in ["(kHz)", "[kHz]"] {
        let text = format!("Freq {unit}   R (Ohm)  X [Ohm]\n0.12  900  -47000\n0.14 2000 -39000\n");
        let sweep = SweepFile::read("a.txt", &text, None).unwrap();
        let hz: Vec<f64> = sweep.sweeps[0].readings.iter().map(|one| one.frequency_hz).collect();
        assert_eq!(hz, [120.0, 140.0], "{text}");
    }
}

#[test]
fn all_faults_are_reported_at_once() {
    check_faults(
        "a.csv",
        "frequency_hz,resistance_ohm,reactance_ohm\n120,900\n-130,900,abc\n140,,-39000\n150,1,2,3\n\
         160,\"1,2\n170,0,0\n180,1.2.3,inf\n",
        &[
            "a.csv:2:1: 2 cells where the header has 3; complete the line or remove it",
            "a.csv:3:1: frequency_hz = -130 is outside [1e-6, 1e12]; check the unit in the header",
            "a.csv:3:10: `abc` is not a number; write it like 140.25, 1.4025e2 or, between \
             semicolons, 140,25",
            "a.csv:4:5: the resistance is missing; complete the line or remove it",
            "a.csv:5:1: 4 cells where the header has 3; where commas are decimal marks, separate \
             the columns by semicolons",
            "a.csv:6:5: the quotation mark is not closed; close it on the same line",
            "a.csv:7:5: an impedance of zero was not measured; remove the line",
            "a.csv:8:5: `1.2.3` is not a number; write it like 140.25, 1.4025e2 or, between \
             semicolons, 140,25",
            "a.csv:8:11: `inf` is not a number; write it like 140.25, 1.4025e2 or, between \
             semicolons, 140,25",
        ],
    );
    check_faults(
        "a.csv",
        "f;R;X;flag;is_used\n120;1.5;-1;odd;yes\n120;1,5;-1;normal;true\n",
        &[
            "a.csv:2:12: `odd` is not one of normal, low_signal, overload; correct it or remove \
             the \
             column",
            "a.csv:2:16: `yes` is neither true nor false; correct it or remove the column",
            "a.csv:3:5: `1,5` has a different decimal mark from the numbers before; write all \
             numbers \
             with a point, without marks for thousands",
        ],
    );
    let rows = (0..50).map(|n| format!("x{n},900,-47000\n")).collect::<Vec<_>>().concat();
    let faults = SweepFile::read("a.csv", &format!("f,R,X\n{rows}"), None).unwrap_err();
    assert_eq!(faults.len(), 21);
    assert!(
        faults
            .to_string()
            .ends_with("the file has more faults than the 20 above; correct these first")
    );
}

/// A cell that is missing between blanks would move those behind it.
#[test]
fn rows_between_blanks_have_as_many_cells_as_the_first() {
    check_faults(
        "a.csv",
        "f R X |Z|\n120 900 -47000 47009\n130     -44000 44010\n140 2000 -39000 39051\n",
        &[
            "a.csv:3:1: 3 cells where line 2 has 4: between blanks, none can be empty; complete the \
           line or remove it",
        ],
    );
}

#[test]
fn a_fault_of_many_rows_is_one_line_with_their_number() {
    check_faults(
        "a.csv",
        &format!("f;R;X\n{}x;1;1\n", "120;1;2;3\n".repeat(400)),
        &[
            "a.csv:2:1: 4 cells where the header has 3 (and 399 times more below); name every \
             column in the header, or remove the further cells",
            "a.csv:402:1: `x` is not a number; write it like 140.25, 1.4025e2 or, between \
             semicolons, 140,25",
        ],
    );
    check_faults(
        "a.s1p",
        "# HZ S RI\n120 1\n130 1\n",
        &["a.s1p:2:1: 2 numbers in a row; one port has 3 (and once more below); export one port: \
           frequency and the two parts of one parameter"],
    );
}

#[test]
fn readings_at_one_frequency_are_no_sweep() {
    let rows = (0..71).map(|n| format!("141,{n},-47000\n")).collect::<Vec<_>>().concat();
    check_faults(
        "a.csv",
        &format!("f,R,X\n{rows}"),
        &["a.csv:1:1: all 71 readings are at 141 Hz; a sweep has readings at several frequencies"],
    );
    assert_eq!(read("a.csv", &format!("f,R,X\n{rows}142,1,-1\n")).readings.len(), 72);
}

#[test]
fn a_sweep_has_a_largest_number_of_readings() {
    let rows = |count: u32| {
        let rows = (0..count).map(|n| format!("{n},1,-1\n")).collect::<Vec<_>>().concat();
        format!("frequency_hz,R,X\n{}", rows.replacen("0,1", "0.5,1", 1))
    };
    assert_eq!(read("a.csv", &rows(101_000)).readings.len(), 101_000);
    check_faults(
        "a.csv",
        &rows(101_001),
        &["a.csv:101002:1: a sweep has more than 101000 readings; keep those around the resonance"],
    );
}

#[test]
fn a_faulty_header_is_refused() {
    let begin = "begin with the line `frequency_hz,resistance_ohm,reactance_ohm`, then one line \
                 for each reading";
    let pairs = "no columns make an impedance; name two `resistance_ohm` and `reactance_ohm`, or \
                 `impedance_magnitude_ohm` and `phase_deg`, or `conductance_s` and \
                 `susceptance_s`, or `s11_real` and `s11_imag`, or those of an LCR meter such as \
                 `cp_f` and `d`, or `cs_f` and `rs_ohm`";
    for (text, fault) in [
        (
            "f,R,X\n120,\0,1\n",
            "2:1: the file is not text: it has a zero byte in this line; export it as text, in UTF-8, or in \
             UTF-16 with a byte order mark"
                .into(),
        ),
        ("", format!("1:1: the file holds no readings; {begin}")),
        ("# nothing\n\n", format!("1:1: the file holds no readings; {begin}")),
        ("f,R,X\n", format!("1:1: the file holds no readings; {begin}")),
        ("\n120,900,-47000\n", format!("2:1: no line names the columns; {begin}")),
        ("junk\nFreq(Hz),C(F),ESR\n120,1,1\n", format!("2:1: {pairs}")),
        // Blanks do not separate the names between commas.
        ("junk\nf,Channel 1 |Z| (Ohm),Channel 1 theta (deg)\n1,1,1\n", format!("2:1: {pairs}")),
        ("a,R,X\n1,1,1\n", "1:1: no column is a frequency; name one `frequency_hz`".into()),
        ("R,X\n1,1\n", "1:1: no column is a frequency; name one `frequency_hz`".into()),
        (
            "f,R,X,Rs\n120,1,1,1\n",
            "1:7: `Rs` is a second column for the resistance; rename or remove one of them".into(),
        ),
        (
            "f,R(dB),X\n120,1,1\n",
            "1:3: `dB` is not a unit of the resistance; write `resistance_ohm`".into(),
        ),
        (
            "f,|Z|,theta\n120,47000,-1.55\n140,39000,-1.52\n",
            "1:7: the phase has no unit, and within ±π it may be in degrees or in radians; name \
             the column `phase_deg` if they are degrees"
                .into(),
        ),
    ] {
        check_faults("a.csv", text, &[&format!("a.csv:{fault}")]);
    }
}

#[test]
fn faulty_touchstone_is_refused() {
    for (text, fault) in [
        (
            "# HZ S RI R 50 Q\n",
            "1:16: `Q` is not an option of an option line; write it like `# HZ S RI R 50`",
        ),
        (
            "# HZ H RI\n",
            "1:6: H-parameters do not exist for one port; export S-, Z- or Y-parameters",
        ),
        (
            "# HZ S R -5\n",
            "1:8: the reference resistance `-5` is not a positive number; write it like `R 50`",
        ),
        (
            "[Version] 3.0\n",
            "1:1: this is neither version 1 nor version 2 of the format; export version 1 or 2, or \
             CSV",
        ),
        (
            "[Version] 2.0\n# HZ S RI\n[Number of Ports] 2\n",
            "3:1: the file has 2 ports; export one port: frequency and the two parts of one \
             parameter",
        ),
        (
            "[Version] 2.0\n[Mixed-Mode Order] D1,2\n",
            "2:1: `[Mixed-Mode Order] D1,2` is not a keyword for one port; export version 1, or CSV",
        ),
        (
            "! two ports\n# HZ S RI\n1 2 3 4 5 6 7 8 9\n",
            "3:1: 9 numbers in a row; one port has 3; export one port: frequency and the two parts \
             of one parameter",
        ),
        (
            "# HZ S RI\n100 1 0\n",
            "2:5: the reflection of an open circuit: no impedance follows from it; export more \
             digits, or remove the line",
        ),
        (
            "# HZ S RI\n100 0,5 0\n",
            "2:5: `0,5` is not a number; write it like 140.25, 1.4025e2 or, between semicolons, \
             140,25",
        ),
        ("# HZ S RI\n100 -1 0\n", "2:5: an impedance of zero was not measured; remove the line"),
        (
            "# HZ S RI\n0 0.5 0\n",
            "2:1: frequency_hz = 0 is outside [1e-6, 1e12]; check the unit in the header",
        ),
    ] {
        check_faults("a.s1p", text, &[&format!("a.s1p:{fault}")]);
    }
}

#[test]
fn bytes_are_read_in_the_encodings_of_instruments() {
    let text = "f;|Z| [Ω];θ [°]";
    let wide = |mark: u16, bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
        [mark].into_iter().chain(text.encode_utf16()).flat_map(bytes).collect()
    };
    assert_eq!(SweepFile::decode(text.as_bytes()), text);
    assert_eq!(SweepFile::decode(&wide(0xfeff, u16::to_le_bytes)), text);
    assert_eq!(SweepFile::decode(&wide(0xfeff, u16::to_be_bytes)), text);
    assert_eq!(SweepFile::decode(b"Phase(\xb0)"), "Phase(°)");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4_000, ..ProptestConfig::default() })]

    #[test]
    fn no_input_causes_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let text = SweepFile::decode(&bytes);
        for name in ["a.csv", "a.s1p"] {
            let _ = SweepFile::read(name, &text, None);
        }
    }

    /// Random texts of the words of real files test more than random bytes.
    #[test]
    fn accepted_readings_are_positive_and_finite(
        pieces in proptest::collection::vec(
            proptest::sample::select(vec![
                "f", "R", "X", "|Z|", "S11(DB)", "s11_deg", "theta", "deg", "G", "B", "Cp", "Ls(mH)", "D", "Q", "|Y|", "θy", "Hz", "NaN", "[Version] 2.0\n", "time_s", "settle_s", "sweep",
                "flag", "is_used", "fit_min_hz", "fit_timing", "waited", "true", "normal", "frequency_hz", "(kHz)", "120", "1e9", "-3",
                "0", "1,5", "9.9e37", "inf", "OL", "1e-300", "1e-13", "1e30", ",", ",", ",", ";", ";", "\t",
                " ", "\n", "\n", "\r\n", "\"", "\"\"", "#", "!", "# HZ S MA R 50\n", "# HZ Y DB\n",
                "°", "\u{feff}",
            ]),
            0..60,
        ),
        sweep in proptest::option::of(0_u64..3),
    ) {
        let text: String = ["f,R,X\n120,900,-47000\n", ""][pieces.len() % 2].to_owned() + &pieces.concat();
        for name in ["a.csv", "a.s1p"] {
            if let Ok(file) = SweepFile::read(name, &text, sweep) {
                for reading in file.sweeps.iter().flat_map(|sweep| &sweep.readings) {
                    prop_assert!(reading.frequency_hz > 0.0 && reading.frequency_hz.is_finite());
                    let size = reading.impedance().map(Impedance::magnitude_ohm);
                    let is_size = |size: f64| size > 0.0 && size.is_finite();
                    prop_assert!(size.is_none_or(is_size), "{reading:?}");
                }
                prop_assert!(file.sweeps.iter().any(|sweep| !sweep.readings.is_empty()));
            }
        }
    }
}
