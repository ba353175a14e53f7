//! `rigd fit` as a person or a script starts it, on files as others write them.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    io::Write,
    path::Path,
    process::{Command, Output, Stdio},
};

use serde_json::Value;
use tempfile::TempDir;

fn data(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(file);
    path.to_str().unwrap().to_owned()
}

fn rigd(args: &[&str]) -> Output {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).current_dir(repository).output().unwrap()
}

/// Starts `rigd fit -` with this on its stdin.
fn rigd_fit_stdin(input: &[u8], args: &[&str]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["fit", "-"])
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    child.wait_with_output().unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[track_caller]
fn check_accepted(output: &Output, resonance_hz: f64, q: f64, figure_of_merit: f64) -> Value {
    let view = json(output);
    assert_eq!(output.status.code(), Some(0), "{view}");
    assert_eq!(view["status"], "accepted");
    let of = |key: &str| view[key].as_f64().unwrap();
    let sigmas = (of("resonance_hz") - resonance_hz) / of("sigma_hz");
    assert!(sigmas.abs() < 4.0, "{view}");
    assert!((of("q") / q - 1.0).abs() < 0.02, "{view}");
    assert!((of("figure_of_merit") / figure_of_merit - 1.0).abs() < 0.02, "{view}");
    assert!((0.5..2.0).contains(&of("chi_squared_per_dof")), "{view}");
    assert!(view.get("reason").is_none() && view.get("estimate").is_none(), "{view}");
    view
}

#[test]
fn what_meters_and_network_analyzers_export_is_fitted() {
    let lcr = rigd(&["fit", &data("lcr-meter.csv"), "--json"]);
    let view = check_accepted(&lcr, 140.25, 30.0, 30.0 * 0.05 / 0.95);
    assert_eq!(
        (&view["model_order"], view["readings"].as_u64()),
        (&"dielectric loss".into(), Some(61))
    );
    let crystal = rigd(&["fit", &data("network-analyzer.s1p"), "--json"]);
    let view = check_accepted(&crystal, 9.998e6, 60_000.0, 270.0);
    assert!(view["sigma_hz"].as_f64().unwrap() < 1.0, "{view}");
    let person = rigd(&["fit", &data("lcr-meter.csv")]);
    assert!(text(&person.stdout).starts_with("resonance           140.2"), "{person:?}");
    let piped = rigd_fit_stdin(&fs::read(data("lcr-meter.csv")).unwrap(), &["--json"]);
    assert_eq!(piped.stdout, lcr.stdout);
}

#[test]
fn a_refusal_has_its_reason_its_exit_code_and_its_estimate_apart() {
    let outside = rigd(&["fit", &data("outside-window.csv"), "--json"]);
    let view = json(&outside);
    assert_eq!(outside.status.code(), Some(3));
    assert_eq!(view["status"], "refused");
    assert_eq!((&view["reason"], &view["side"]), (&"outside_window".into(), &"below".into()));
    assert!(view["message"].as_str().unwrap().starts_with("resonance near 140.2"), "{view}");
    assert!(view.get("resonance_hz").is_none(), "{view}");
    let estimate_hz = view["estimate"]["resonance_hz"].as_f64().unwrap();
    assert!((estimate_hz - 140.25).abs() < 0.2, "{view}");
    let person = rigd(&["fit", &data("outside-window.csv")]);
    assert_eq!(person.status.code(), Some(3));
    assert!(text(&person.stdout).starts_with("resonance           refused\n"), "{person:?}");
    assert!(text(&person.stderr).contains("lies below the window"), "{person:?}");

    let lcr = data("lcr-meter.csv");
    let window = |window: &str| json(&rigd(&["fit", &lcr, "--json", "--window", window]));
    assert_eq!(window("120..160")["status"], "accepted");
    assert_eq!(window("150..160")["side"], "below");
    assert_eq!(window("120..130")["side"], "above");
    let few = "f,R,X\n120,900,-47000\n140,2000,-39000\n";
    let few = rigd_fit_stdin(few.as_bytes(), &["--json"]);
    assert_eq!((few.status.code(), &json(&few)["reason"]), (Some(3), &"too_few_points".into()));
}

#[test]
fn a_sweep_that_never_settled_is_fitted_where_its_times_are_exact() {
    let path = data("ring-up.csv");
    let fit = |timing: &str| rigd(&["fit", &path, "--json", "--timing", timing]);
    for timing in ["unknown", "waited"] {
        let refused = fit(timing);
        let reason = &json(&refused)["reason"];
        assert_eq!((refused.status.code(), reason), (Some(3), &"not_settled".into()), "{timing}");
    }
    for timing in ["exact", "exact-from-rest"] {
        check_accepted(&fit(timing), 140.0, 30.0, 30.0 * 0.05 / 0.95);
    }
    let args = ["fit", &path, "--json", "--timing", "exact", "--estimator", "maximum-likelihood"];
    let beside = json(&rigd(&args));
    assert_eq!(beside["estimators"][0]["frequency_hz"], beside["resonance_hz"], "{beside}");
    let guessed = rigd(&["fit", &path, "--json"]);
    assert_eq!(guessed.stdout, fit("waited").stdout);
    for (timing, missing) in [("waited", "settle_s and integration_s"), ("exact", "settle_s and")] {
        let without = rigd(&["fit", &data("lcr-meter.csv"), "--timing", timing]);
        assert_eq!(without.status.code(), Some(2));
        assert!(text(&without.stderr).contains(missing), "{without:?}");
    }
    let timeless = "f,R,X,settle_s,integration_s\n120,900,-47000,0,0.1\n140,2000,-39000,0,0.1\n";
    let timeless = rigd_fit_stdin(timeless.as_bytes(), &["--timing", "exact"]);
    assert_eq!(timeless.status.code(), Some(2));
    assert!(text(&timeless.stderr).contains("the columns time_s in the file"), "{timeless:?}");
}

#[test]
fn other_estimators_stand_beside_with_their_bias() {
    let path = data("lcr-meter.csv");
    let view = json(&rigd(&["fit", &path, "--json", "--estimator", "all"]));
    let estimators = view["estimators"].as_array().unwrap();
    assert_eq!(estimators.len(), 12);
    let of = |name: &str| estimators.iter().find(|view| view["name"] == name).unwrap();
    let minimum = of("magnitude-parabola");
    assert_eq!(minimum["definition"], "impedance minimum");
    let bias_hz = minimum["bias_hz"].as_f64().unwrap();
    assert!((-1.2..-1.0).contains(&bias_hz), "{minimum}");
    let error_hz = minimum["frequency_hz"].as_f64().unwrap() - 140.25 - bias_hz;
    assert!(error_hz.abs() < 0.3, "{minimum}");
    // The figure of merit is below 2.
    let zero = of("phase-zero");
    assert!(zero.get("frequency_hz").is_none() && zero.get("bias_hz").is_none(), "{zero}");
    assert_eq!(zero["message"], "the phase does not rise through zero");
    assert_eq!(of("maximum-likelihood")["bias_hz"], 0.0);

    let two = ["fit", &path, "--estimator", "rational", "--estimator", "phase-zero"];
    let two = rigd(&two);
    let lines: Vec<_> = text(&two.stdout).lines().rev().take(2).collect();
    assert!(lines[1].starts_with("phase-zero") && lines[1].ends_with("none"), "{lines:?}");
    assert!(lines[0].starts_with("rational") && lines[0].ends_with("+0.0000"), "{lines:?}");
    assert_eq!(rigd(&["fit", &path, "--estimator", "guess"]).status.code(), Some(2));
}

#[test]
fn a_bad_file_is_refused_with_every_fault_and_its_place() {
    let path = data("faults.csv");
    let output = rigd(&["fit", &path]);
    assert_eq!(output.status.code(), Some(2));
    assert!(output.stdout.is_empty());
    let faults: Vec<_> = text(&output.stderr).lines().collect();
    let expected = [
        ":4:1: 2 cells where the header has 3; complete the line or remove it",
        ":5:8: `9oo` is not a number; write it like 140.25, 1.4025e2 or, between semicolons, \
         140,25",
        ":6:1: frequency_hz = -125 is outside [1e-6, 1e12]; check the unit in the header",
    ];
    assert_eq!(faults, expected.map(|fault| format!("{path}{fault}")));
    let view = rigd(&["fit", &path, "--json"]);
    assert_eq!((view.status.code(), &json(&view)["status"]), (Some(2), &"bad_file".into()));
    let places = json(&view)["faults"].as_array().unwrap().clone();
    let places = places.iter().map(|fault| (fault["line"].as_u64(), fault["column"].as_u64()));
    assert!(places.eq([(Some(4), Some(1)), (Some(5), Some(8)), (Some(6), Some(1))]), "{view:?}");
    let code = |args: &[&str]| rigd(args).status.code();
    assert_eq!(code(&["fit", "no-such-file.csv"]), Some(2));
    for window in ["120", "120..x", "160..120"] {
        assert_eq!(code(&["fit", &data("lcr-meter.csv"), "--window", window]), Some(2));
    }
}

/// Whether a fit of a file repeats the result of the rig, to the last digits.
#[track_caller]
fn check_same(fitted: &Value, rig: &Value) {
    assert_eq!(fitted["status"], rig["status"], "{fitted} {rig}");
    // A journal has the sentence of a refusal; a fit also has the word.
    assert_eq!(fitted["message"], rig["reason"], "{fitted} {rig}");
    for key in ["resonance_hz", "sigma_hz", "effective_time_s", "q", "static_capacitance_f"] {
        let [fitted_is, rig_is] = [fitted, rig].map(|view| view[key].as_f64());
        let is_same = match (fitted_is, rig_is) {
            // Times are written to a nanosecond, and their differences count.
            (Some(fitted), Some(rig)) => (fitted / rig - 1.0).abs() < 1e-9,
            (fitted, rig) => fitted == rig,
        };
        assert!(is_same, "{key}: {fitted} {rig}");
    }
}

#[test]
fn what_rigd_measures_it_fits_again_and_finds_the_same() {
    let adaptive = ["--min-hz", "120", "--max-hz", "165"];
    let uniform = ["--min-hz", "120", "--max-hz", "165", "--points", "41"];
    let away = ["--min-hz", "300", "--max-hz", "400"];
    for request in [&adaptive[..], &uniform, &away] {
        // Two data directories: the same seed measures the same again.
        let [csv, rig] = ["--csv", "--json"].map(|form| {
            let data = TempDir::new().unwrap();
            let data = ["--data", data.path().to_str().unwrap()];
            rigd(&[&["measure"], request, &data, &[form]].concat())
        });
        let fitted = rigd_fit_stdin(&csv.stdout, &["--json"]);
        assert_eq!(fitted.status.code(), rig.status.code(), "{fitted:?}");
        check_same(&json(&fitted), &json(&rig));
    }
}

#[test]
fn what_rigd_exports_it_fits_again_and_finds_the_same() {
    let folder = TempDir::new().unwrap();
    let dir = folder.path().to_str().unwrap();
    // Some resonances of the stiffer sample lie above this window.
    let protocol = fs::read_to_string("../../config/protocols/smoke.toml").unwrap();
    let narrow = folder.path().join("narrow.toml");
    fs::write(&narrow, protocol.replace("max_hz = 260", "max_hz = 209")).unwrap();
    let run = rigd(&["run", narrow.to_str().unwrap(), "--data", dir, "--json"]);
    assert_eq!(run.status.code(), Some(6), "{run:?}");
    let export = |format| rigd(&["export", "latest", "--data", dir, "--format", format]).stdout;
    let readings = folder.path().join("readings.csv");
    fs::write(&readings, export("readings")).unwrap();
    let readings = readings.to_str().unwrap();
    let records = String::from_utf8(export("jsonl")).unwrap();
    let records = records.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let rig: Vec<_> = records
        .map(|mut line| line["record"].take())
        .filter(|record| record["kind"] == "sweep")
        .collect();

    let all = rigd(&["fit", readings, "--json"]);
    assert_eq!(all.status.code(), Some(3));
    let fitted = json(&all)["sweeps"].as_array().unwrap().clone();
    assert_eq!(fitted.len(), rig.len());
    for (fitted, rig) in fitted.iter().zip(&rig) {
        let mut outcome = rig["outcome"].clone();
        outcome["q"] = outcome["circuit"]["quality_factor"].clone();
        outcome["static_capacitance_f"] = outcome["circuit"]["static_capacitance_f"].clone();
        check_same(fitted, &outcome);
        assert_eq!(fitted["sweep"], rig["number"]);
    }
    let refused = fitted.iter().filter(|view| view["status"] == "refused").count();
    let sweeps = fitted.len();
    assert!(0 < refused && refused < sweeps);

    let person = rigd(&["fit", readings]);
    assert_eq!(person.status.code(), Some(3));
    let table: Vec<_> = text(&person.stdout).lines().collect();
    assert_eq!(table.len(), 1 + sweeps);
    let header = "sweep resonance, Hz ± Hz Q readings refused for";
    assert_eq!(table[0].split_whitespace().collect::<Vec<_>>().join(" "), header);
    // A resonance far outside leaves nothing that could be told from a capacitor.
    let outside = table.iter().filter(|line| line.ends_with("outside_window")).count();
    assert!(0 < outside && outside <= refused, "{outside} of {refused}");
    let end = format!("rigd: {refused} of {sweeps} sweeps have no resonance\n");
    assert!(text(&person.stderr).starts_with(&end), "{person:?}");

    let one = json(&rigd(&["fit", readings, "--sweep", "3", "--json"]));
    assert_eq!(one, fitted[2]);
    let other = rigd(&["fit", readings, "--sweep", "999"]);
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("leave out `--sweep` to fit them all"), "{other:?}");
}

#[test]
fn what_a_person_states_has_precedence_over_the_file() {
    let folder = TempDir::new().unwrap();
    let dir = folder.path().to_str().unwrap();
    let measure = ["measure", "--min-hz", "120", "--max-hz", "165", "--csv", "--data", dir];
    let csv = rigd(&measure).stdout;
    let fit = |flags: &[&str]| rigd_fit_stdin(&csv, &[&["--json"], flags].concat());
    assert_eq!(json(&fit(&["--window", "150..160"]))["side"], "below");
    assert_eq!(json(&fit(&["--timing", "unknown"]))["status"], "refused");
    // Quiet readings among a hundred errors of the noise that was stated.
    let noisy = json(&fit(&["--noise", "0.02"]));
    let found = if noisy["status"] == "accepted" { &noisy } else { &noisy["estimate"] };
    let noise = found["noise_at_ten_cycles"].as_f64().unwrap();
    assert!((0.015..0.02).contains(&noise), "{noisy}");

    // A fit is checked against the same target as its sweep.
    let asked_more = text(&csv).replace(",true,0.05,", ",true,0.001,");
    let refused = json(&rigd_fit_stdin(asked_more.as_bytes(), &["--json"]));
    assert_eq!(refused["reason"], "target_not_reached", "{refused}");
    assert!(refused["estimate"]["sigma_hz"].as_f64() < Some(0.05), "{refused}");
}

/// The same sweep as an LCR meter writes it in its default mode, with two rows that are no readings.
#[test]
fn a_meter_in_its_default_mode_gives_the_same_fit_and_rows_that_are_left_out_are_named() {
    let polar = fs::read_to_string(data("lcr-meter.csv")).unwrap();
    let mut rows = Vec::new();
    for line in polar.lines().skip(2) {
        let cell = |index| line.split(',').nth(index).unwrap().parse::<f64>().unwrap();
        let (hz, ohm, radians) = (cell(1), 1e3 * cell(2), cell(3).to_radians());
        // Y = 1/Z, with G = |Y| cos θ and B = −|Y| sin θ.
        let cp_f = -radians.sin() / ohm / (std::f64::consts::TAU * hz);
        rows.push(format!("{hz},{:e},{:e}\n", 1e9 * cp_f, 1.0 / radians.tan().abs()));
    }
    let table = |rows: &[String]| format!("Freq,Cp,D\nHz,nF,-\n{}", rows.concat());
    let fitted = |text: &str| rigd_fit_stdin(text.as_bytes(), &["--json"]);
    let (whole, expected) =
        (json(&fitted(&table(&rows))), rigd(&["fit", &data("lcr-meter.csv"), "--json"]));
    let hz = |view: &Value| view["resonance_hz"].as_f64().unwrap();
    assert!((hz(&whole) - hz(&json(&expected))).abs() < 1e-6, "{whole}");
    assert!(whole.get("left_out").is_none(), "{whole}");

    rows.push(rows[0].clone());
    rows.push("140,NaN,0.01\n".to_owned());
    let output = fitted(&table(&rows));
    let view = json(&output);
    assert_eq!((hz(&view), &view["readings"]), (hz(&whole), &whole["readings"]), "{view}");
    let said = [
        "line 64 was left out: it repeats line 3 in every value",
        "line 65 was left out: it has `NaN` in place of a number",
    ];
    assert_eq!(view["left_out"], serde_json::json!(said));
    assert!(said.iter().all(|said| text(&output.stderr).contains(said)), "{output:?}");
}
