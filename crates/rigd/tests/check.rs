//! `rigd check` says where the resonances of a protocol will be, and whether its sweeps look there.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use rig_store::{Reader, Record, RunKind};
use serde_json::Value;
use tempfile::TempDir;

const SMOKE: &str = "config/protocols/smoke.toml";

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn rigd(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).current_dir(repository()).output().unwrap()
}

fn text(output: &Output) -> &str {
    assert!(output.status.success(), "{output:?}");
    std::str::from_utf8(&output.stdout).unwrap()
}

/// A file of the repository with some of its text replaced, which must be there.
fn changed(dir: &Path, file: &str, changes: &[(&str, &str)]) -> String {
    let mut text = fs::read_to_string(repository().join(file)).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{from:?} is not in {file}");
        text = text.replace(from, to);
    }
    let path = dir.join(Path::new(file).file_name().unwrap());
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// What `check` tells a program of smoke with these changes.
fn check(changes: &[(&str, &str)]) -> Value {
    let dir = TempDir::new().unwrap();
    let path = changed(dir.path(), SMOKE, changes);
    let output = rigd(&["check", &path, "--json"]);
    serde_json::from_str(text(&output)).unwrap()
}

fn predictions(checked: &Value) -> BTreeMap<&str, &Value> {
    let steps = checked["steps"].as_array().unwrap().iter();
    let predicted = steps.filter(|step| !step["prediction"].is_null());
    predicted.map(|step| (step["id"].as_str().unwrap(), &step["prediction"])).collect()
}

#[test]
fn the_shipped_protocols_look_where_their_resonances_are() {
    for rig in ["config/rigs/simulated.toml", "config/rigs/bench.toml"] {
        for protocol in [SMOKE, "config/protocols/three-direction.toml"] {
            let output = rigd(&["check", protocol, "--rig", rig]);
            assert!(!text(&output).contains("warning"), "{}", text(&output));
            let output = rigd(&["check", protocol, "--rig", rig, "--json"]);
            let checked: Value = serde_json::from_str(text(&output)).unwrap();
            assert_eq!(checked["warnings"], Value::Array(Vec::new()), "{protocol} on {rig}");
            let count = |name: &str| checked[name].as_u64().unwrap();
            let predicted = predictions(&checked);
            // By drift, some of the references that are planned are expected to be left out.
            let steps = checked["steps"].as_array().unwrap().len() as u64;
            assert_eq!(predicted.len() as u64, steps - count("prompts"));
            assert!(count("touches") + count("no_loads") <= steps - count("prompts"));
            assert!(
                predicted.values().all(|one| one["placing"] == "inside"),
                "{protocol} on {rig}"
            );
        }
    }
}

#[test]
fn a_window_that_is_cut_short_is_warned_of_with_its_steps_and_what_to_write() {
    // The sample, an edge of a window and its new value; the edge to be warned of, and how.
    let rows = [
        ("2", "max_hz = 260", "max_hz = 155", Some(("contact_sweep", "max_hz", 164.0, "outside"))),
        (
            "2",
            "max_hz = 260",
            "max_hz = 160",
            Some(("contact_sweep", "max_hz", 164.0, "near_edge")),
        ),
        ("2", "max_hz = 260", "max_hz = 165", None),
        ("5", "max_hz = 260", "max_hz = 200", Some(("contact_sweep", "max_hz", 247.0, "outside"))),
        ("2", "min_hz = 130", "min_hz = 147", Some(("contact_sweep", "min_hz", 142.0, "outside"))),
        ("2", "min_hz = 125", "min_hz = 141", Some(("no_load_sweep", "min_hz", 138.0, "outside"))),
        (
            "2",
            "min_hz = 125",
            "min_hz = 139",
            Some(("no_load_sweep", "min_hz", 138.0, "near_edge")),
        ),
        (
            "2",
            "max_hz = 160",
            "max_hz = 141",
            Some(("no_load_sweep", "max_hz", 143.0, "near_edge")),
        ),
    ];
    for (sample, from, to, expected) in rows {
        let checked = check(&[(from, to), ("\"5\"]", &format!("\"{sample}\"]"))]);
        assert_eq!(checked["is_runnable"], true, "a warning is no fault");
        let warnings = checked["warnings"].as_array().unwrap();
        let Some((sweep, key, wanted_hz, placing)) = expected else {
            assert!(warnings.is_empty(), "{to}: {warnings:?}");
            continue;
        };
        assert_eq!(warnings.len(), 1, "{to}: {warnings:?}");
        let warning = &warnings[0];
        assert_eq!((&warning["sweep"], &warning["key"]), (&sweep.into(), &key.into()), "{to}");
        assert_eq!(warning["wanted_hz"], wanted_hz, "{to}");
        let worst = warning["steps"][0].as_str().unwrap();
        assert_eq!(predictions(&checked)[worst]["placing"], placing, "{to}: {worst}");
        // The advice is sufficient.
        let advised = to.replace(to.rsplit(' ').next().unwrap(), &wanted_hz.to_string());
        let again = check(&[(from, &advised), ("\"5\"]", &format!("\"{sample}\"]"))]);
        assert_eq!(again["warnings"], Value::Array(Vec::new()), "{advised}");
    }
}

#[test]
fn a_person_reads_the_worst_steps_and_what_to_change() {
    let dir = TempDir::new().unwrap();
    let path =
        changed(dir.path(), SMOKE, &[("max_hz = 260", "max_hz = 155"), ("\"5\"]", "\"2\"]")]);
    let output = rigd(&["check", &path, "--steps"]);
    let (_, warning) = text(&output).split_once("\nwarning: ").unwrap();
    let expected = "\
[contact_sweep] max_hz = 155 Hz: predicted resonances lie above it, or
less than 1 linewidth below it; set it to at least 164 Hz
  blind/3: 158.4 Hz, 5.3 Hz wide, outside
  main/2/left/0/1: 158.2 Hz, 5.2 Hz wide, outside
  main/2/front/0/1: 158.2 Hz, 5.2 Hz wide, outside
  main/2/back/0/1: 158.2 Hz, 5.2 Hz wide, outside
  blind/1: 157.6 Hz, 5.1 Hz wide, outside
  and 3 more; --json lists them
";
    assert_eq!(warning, expected);
    assert!(
        in_a_line(text(&output)).contains("sample 2 of 2, left, 0° 158.2 Hz "),
        "{}",
        text(&output)
    );
    assert!(text(&output).lines().all(|line| line.chars().count() <= 80), "{}", text(&output));
    // Without its steps: how it goes, and what is wrong.
    let short = rigd(&["check", &path]);
    let lines: Vec<_> = text(&short).lines().collect();
    assert!(
        text(&output).ends_with(text(&short)) && lines[4].starts_with("warning: "),
        "{lines:?}"
    );
}

/// A text without its line ends.
fn in_a_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn of_samples_that_nobody_knows_nothing_is_predicted_and_that_is_said() {
    let dir = TempDir::new().unwrap();
    let known = "name = \"5\"\nstiffness_mpa = 0.649";
    let other = "name = \"steel\"\nstiffness_mpa = 0.649";
    let rig = changed(dir.path(), "config/rigs/bench.toml", &[(known, other)]);
    let output = rigd(&["check", SMOKE, "--rig", &rig]);
    let said = "There is no prediction for touches of 5: their stiffness is not in [[samples]] of \
                bench.";
    assert!(in_a_line(text(&output)).contains(said), "{}", text(&output));
    assert!(!text(&output).contains("warning"), "{}", text(&output));
    let output = rigd(&["check", SMOKE, "--rig", &rig, "--json"]);
    let checked: Value = serde_json::from_str(text(&output)).unwrap();
    let predicted = predictions(&checked);
    assert_eq!(
        predicted["main/5/left/0/1"]["unknown"],
        "the stiffness of sample \"5\" is not known"
    );
    assert_eq!(predicted["main/5/left/0/1/no-load"]["placing"], "inside");
    assert_eq!(predicted["main/1/left/0/1"]["placing"], "inside");
}

#[test]
fn a_resonance_beyond_the_analyzer_is_not_answered_with_a_window_it_cannot_have() {
    let dir = TempDir::new().unwrap();
    let rig = changed(
        dir.path(),
        "config/rigs/bench.toml",
        &[("frequency_hz = [20, 2000]", "frequency_hz = [20, 200]")],
    );
    let path = changed(dir.path(), SMOKE, &[("max_hz = 260", "max_hz = 200")]);
    let output = rigd(&["check", &path, "--rig", &rig]);
    let said = "and this rig's analyzer ends at 200 Hz: touch softer samples, or less deep";
    assert!(in_a_line(text(&output)).contains(said), "{}", text(&output));

    // A length in another unit: nothing is touched in a no-load sweep.
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenes/paper.toml");
    let changes = [("length_mm = 35", "length_mm = 350"), ("../scenes/paper.toml", scene)];
    let rig = changed(dir.path(), "config/rigs/simulated.toml", &changes);
    let output = rigd(&["check", SMOKE, "--rig", &rig]);
    let text = in_a_line(text(&output));
    assert!(text.starts_with("smoke keeps the limits of simulated bench, but no predicted resonance lies in its window"), "{text}");
    assert!(text.contains("[no_load_sweep] min_hz = 125 Hz"), "{text}");
    assert!(text.contains("look whether [sensor] of the rig file describes this sensor"), "{text}");
}

#[test]
fn what_is_predicted_is_measured_on_a_bench_as_described() {
    let dir = TempDir::new().unwrap();
    let checked = check(&[]);
    let predicted = predictions(&checked);
    let data = dir.path().to_str().unwrap();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenes/matched.toml");
    let simulated = "config/rigs/simulated.toml";
    let rig = changed(dir.path(), simulated, &[("../scenes/paper.toml", scene)]);
    assert!(rigd(&["run", SMOKE, "--rig", &rig, "--data", data]).status.success());
    let output = rigd(&["export", "latest", "--data", data, "--format", "csv"]);
    let mut lines = text(&output).lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let column = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let (step, resonance) = (column("step"), column("resonance_hz"));
    let mut touches = 0;
    for row in lines {
        touches += 1;
        let of_step = predicted[row[step].trim_matches('"')];
        let [at_hz, width_hz] =
            ["resonance_hz", "linewidth_hz"].map(|name| of_step[name].as_f64().unwrap());
        let off = (row[resonance].parse::<f64>().unwrap() - at_hz) / width_hz;
        assert!(off.abs() < 0.5, "{}: {off} linewidths from {of_step}", row[step]);
    }
    assert_eq!(touches, 18);
}

/// Speeds of the descents that a run has recorded, mm/s.
fn descents(data: &Path) -> Vec<f64> {
    let reader = Reader::open(data).unwrap();
    let run = reader.runs().unwrap().into_iter().find(|run| run.kind == RunKind::Run).unwrap();
    let records = reader.records(run.id).unwrap().into_iter();
    let speed = |record| match record {
        Record::Descended(descended) => Some(descended.speed_mm_per_s),
        _ => None,
    };
    records.filter_map(|stored| speed(stored.record().unwrap())).collect()
}

/// An analyzer that integrates a tenth of a second at least goes down more slowly than two cycles would allow.
#[test]
fn check_says_how_fast_the_descents_of_a_run_go_with_its_analyzer() {
    let protocol_changes = [
        ("cycles = 10\n\n[no_load", "cycles = 2\nmethod = \"descent\"\n\n[no_load"),
        ("[\"front\", \"back\", \"left\"]", "[\"front\"]"),
        ("level_v = 5", "level_v = 2"),
    ];
    for (dialect, said, speeds) in [
        ("hioki-im3536", None, Some(0.9..=3.0)),
        ("keysight-e4980a", Some("the descents go down at 0.4"), Some(0.4..=0.5)),
        ("hp-4284a", Some("no descent is faster than the search in steps"), None),
    ] {
        let dir = TempDir::new().unwrap();
        let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenes/paper.toml");
        let named = format!("dialect = \"{dialect}\"");
        let rig_changes = [
            ("../scenes/paper.toml", scene),
            ("dialect = \"hioki-im3536\"", &named),
            ("max_level_v = 5", "max_level_v = 2"),
        ];
        let rig = changed(dir.path(), "config/rigs/simulated.toml", &rig_changes);
        let protocol = changed(dir.path(), SMOKE, &protocol_changes);
        let lines = in_a_line(text(&rigd(&["check", &protocol, "--rig", &rig])));
        assert_eq!(lines.contains("method = \"descent\""), said.is_some(), "{dialect}: {lines}");
        assert!(said.is_none_or(|said| lines.contains(said)), "{dialect}: {lines}");
        let json = rigd(&["check", &protocol, "--rig", &rig, "--json"]);
        let checked: Value = serde_json::from_str(text(&json)).unwrap();
        let expected = checked["descents"]["mm_per_s"].as_f64();
        assert_eq!(expected.is_none(), speeds.is_none(), "{dialect}: {}", checked["descents"]);

        let data = dir.path().join("data");
        let run = ["run", &protocol, "--rig", &rig, "--data", data.to_str().unwrap()];
        assert!(rigd(&run).status.success(), "{dialect}");
        let found = descents(&data);
        assert_eq!(found.is_empty(), speeds.is_none(), "{dialect}: {found:?}");
        for speed in found {
            assert!(
                speeds.as_ref().is_some_and(|speeds| speeds.contains(&speed)),
                "{dialect}: {speed}"
            );
            // Check takes the slowest frequency of the window.
            let ratio = expected.map(|expected| speed / expected);
            assert!(
                ratio.is_some_and(|ratio| (0.99..1.1).contains(&ratio)),
                "{dialect}: {ratio:?}"
            );
        }
    }
}
