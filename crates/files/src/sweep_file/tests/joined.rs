//! Files with several tables, and heads that mean something else.

use super::*;

const HEAD: &str = "Freq(Hz),R(Ohm),X(Ohm)\n";

/// Rows at these frequencies, Hz.
fn rows(frequencies_hz: &[f64]) -> String {
    let rows: Vec<_> = frequencies_hz.iter().map(|hz| format!("{hz},900,-47000\n")).collect();
    rows.concat()
}

/// The number and the frequencies of each sweep.
fn sweeps(text: &str, sweep: Option<u64>) -> Vec<(Option<u64>, Vec<f64>)> {
    let file = SweepFile::read("a.csv", text, sweep).unwrap();
    let of = |sweep: &FileSweep| {
        (sweep.number, sweep.readings.iter().map(|one| one.frequency_hz).collect())
    };
    file.sweeps.iter().map(of).collect()
}

/// Averaged, two sweeps would give a resonance that neither has.
#[test]
fn tables_below_each_other_are_sweeps_of_their_own() {
    let (up, down) = (rows(&[120.0, 130.0, 140.0]), rows(&[140.0, 130.0, 120.0]));
    let first = (Some(0), vec![120.0, 130.0, 140.0]);
    for (text, second) in [
        (format!("{HEAD}{up}{HEAD}{up}"), vec![120.0, 130.0, 140.0]),
        (format!("{HEAD}{up}\n{HEAD}{down}"), vec![140.0, 130.0, 120.0]),
        // As Keysight and Copper Mountain write channels.
        (
            format!("BEGIN CH1_DATA\n{HEAD}{up}END\nBEGIN CH2_DATA\n{HEAD}{down}END\n"),
            vec![140.0, 130.0, 120.0],
        ),
    ] {
        let second = (Some(1), second);
        assert_eq!(sweeps(&text, None), [first.clone(), second.clone()], "{text}");
        assert_eq!(sweeps(&text, Some(1)), [second], "{text}");
        let other = SweepFile::read("a.csv", &text, Some(2)).unwrap_err().to_string();
        assert!(other.contains("the file has 2 sweeps, from 0 to 1, but no sweep 2"), "{other}");
    }
    let units = "Frequency;Rs;X\nkHz;kOhm;kOhm\n0.12;0.9;-47\n0.14;2;-39\n";
    let both = [(Some(0), vec![120.0, 140.0]), (Some(1), vec![120.0, 140.0])];
    assert_eq!(sweeps(&units.repeat(2), None), both);
    // The next page of one table.
    let pages = format!("{HEAD}{up}{HEAD}{}", rows(&[150.0, 160.0]));
    assert_eq!(sweeps(&pages, None), [(None, vec![120.0, 130.0, 140.0, 150.0, 160.0])]);
    assert_eq!(sweeps(&format!("{HEAD}{HEAD}{up}"), None), [(None, first.1)]);
    // A row without a frequency neither goes on with a table nor ends it.
    let without = format!("{HEAD}{down}{HEAD}NaN,900,-47000\n{}", rows(&[130.0, 120.0]));
    let both = [(Some(0), vec![140.0, 130.0, 120.0]), (Some(1), vec![130.0, 120.0])];
    assert_eq!(sweeps(&without, None), both);
    let ended = format!("{HEAD}{up}NaN,900,-47000\n{HEAD}{}", rows(&[150.0, 160.0]));
    assert_eq!(sweeps(&ended, None), [(None, vec![120.0, 130.0, 140.0, 150.0, 160.0])]);
}

#[test]
fn what_would_be_lost_or_mixed_in_a_joined_file_is_refused() {
    check_faults(
        "a.csv",
        &format!("{HEAD}{}END\nFreq(Hz),Cp(F),D\n120,1e-9,0.1\n", rows(&[120.0, 130.0])),
        &["a.csv:5:1: this line names the columns of another table; split the file"],
    );
    let numbered = "sweep,frequency_hz,R,X\n3,120,900,-47000\n3,140,900,-47000\n";
    check_faults(
        "a.csv",
        &numbered.repeat(2),
        &["a.csv:5:1: sweep 3 is also above the header that is repeated in line 4; split the file"],
    );
    let apart = format!("{numbered}{}", numbered.replace("\n3,", "\n4,"));
    assert_eq!(
        sweeps(&apart, None),
        [(Some(3), vec![120.0, 140.0]), (Some(4), vec![120.0, 140.0])]
    );
}

/// A row of units that is not seen makes the resonance a thousandth of what it is.
#[test]
fn units_are_found_below_comments_of_every_kind() {
    for text in [
        "; Frequency\tRs\tX\n; kHz\tkOhm\tkOhm\n0.12\t0.9\t-47\n0.14\t2\t-39\n",
        "# Frequency\tRs\tX\n# ----------\n# kHz\tkOhm\tkOhm\n0.12\t0.9\t-47\n0.14\t2\t-39\n",
        "Frequency Rs X\n--------- -- -\n\nkHz kOhm kOhm\n0.12 0.9 -47\n0.14 2 -39\n",
        "Frequency;Rs;X\n# measured by hand\nkHz;kOhm;kOhm\n0,12;0,9;-47\n0,14;2;-39\n",
    ] {
        check("a.txt", text);
    }
}

#[test]
fn a_letter_with_the_unit_of_something_else_is_something_else() {
    let cs = |omega: f64| format!("{:e}", 1.0 / omega / 47_000.0);
    let first = cs(std::f64::consts::TAU * 120.0);
    let second = format!("{:e}", 1.0 / (std::f64::consts::TAU * 140.0 * 39_000.0));
    for text in [
        "F (N),X (mm),Freq(Hz),Rs(Ohm),Xs(Ohm)\n0.1,2,120,900,-47000\n0.2,2,140,2000,-39000\n",
        &format!("X,Y,Freq(Hz),Cs(F),Rs(Ohm)\n1,2,120,{first},900\n1,3,140,{second},2000\n"),
        "Freq(Hz)\tAmpl\tZ'(a)\tZ''(b)\nEnd Comments\n120\t1\t900\t-47000\n140\t1\t2000\t-39000\n",
        "freq[Hz];re:Trc1_S11;im:Trc1_S11;\n120;0.999957011678117;-0.0021267906615789634;\n\
         140;0.9998655916181621;-0.0025570375081341657;\n",
        "f,R (GOhm),X (GOhm)\n120,0.0000009,-0.000047\n140,0.000002,-0.000039\n",
        // Ends of lines of an old program below those of an older one.
        "f,R,X\r120,900,-47000\r140,2000,-39000\r\n",
    ] {
        check("a.csv", text);
    }
}

#[test]
fn a_row_of_touchstone_without_a_number_or_written_twice_is_left_out_and_named() {
    let text = "# HZ Z RI R 1\n120 900 -47000\n130 NaN NaN\n140 2000 -39000\n140 2000 -39000\n";
    let sweep = read("a.s1p", text);
    assert_eq!(sweep.readings.len(), 2);
    let told: Vec<String> = sweep.left_out.iter().map(ToString::to_string).collect();
    assert_eq!(
        told,
        [
            "line 3 was left out: it has `NaN` in place of a number",
            "line 5 was left out: it repeats line 4 in every value",
        ]
    );
}
