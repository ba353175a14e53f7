//! The program as a person or a script starts it.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Starts the program in the repository, as the README does.
fn rigd(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).current_dir(repository()).output().unwrap()
}

fn stdout(output: &Output) -> &str {
    std::str::from_utf8(&output.stdout).unwrap()
}

fn stderr(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_run_ends_with_its_results_its_report_and_its_data() {
    let data = TempDir::new().unwrap();
    let dir = data.path().to_str().unwrap();
    let output = rigd(&["run", "config/protocols/smoke.toml", "--data", dir, "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let result = json(&output);
    let keys: BTreeSet<&str> = result.as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "classification",
        "data",
        "no_load_hz",
        "prompts",
        "report",
        "rig_seconds",
        "run_id",
        "sensitivity_hz_per_mpa",
        "shifts",
        "status",
        "touches",
        "wall_seconds",
    ];
    assert!(expected.iter().all(|key| keys.contains(key)), "{keys:?}");
    assert_eq!(result["status"], "completed");
    assert_eq!(result["touches"], 18);
    assert_eq!(result["shifts"].as_array().unwrap().len(), 2 * 3 * 2);
    let report = fs::read_to_string(result["report"].as_str().unwrap()).unwrap();
    assert!(report.contains("<svg") && !report.contains("src=\"http"));
    let folder = Path::new(result["data"].as_str().unwrap());
    let name = folder.file_name().unwrap().to_str().unwrap();
    let day = json(&rigd(&["runs", "--data", dir, "--json"]))[0]["started_at"].clone();
    assert_eq!(name, format!("{}_smoke-1", &day.as_str().unwrap()[..10]));
    for file in ["touches.csv", "readings.parquet", "records.jsonl", "documents.jsonl", "README.md"]
    {
        assert!(folder.join(file).exists(), "{file}");
    }

    let shown = json(&rigd(&["show", "latest", "--data", dir, "--json"]));
    assert_eq!(shown, result);
    let runs = json(&rigd(&["runs", "--data", dir, "--json"]));
    assert_eq!(runs[0]["run_id"], result["run_id"]);
    assert_eq!(runs[0]["name"], "smoke-1");
    assert_eq!(json(&rigd(&["show", "smoke-1", "--data", dir, "--json"])), result);
    assert_eq!(result["touches_planned"], 18);
    let touches = rigd(&["export", "latest", "--data", dir, "--format", "csv"]);
    assert_eq!(stdout(&touches).lines().count(), 1 + 18);
    let searches = ["export", "latest", "--data", dir, "--format", "csv", "--table", "searches"];
    let searches = rigd(&searches);
    assert!(stdout(&searches).starts_with("step,purpose,direction,angle_deg,surface_mm,"));
    assert!(stdout(&searches).lines().count() > 1 + 18);
    let records = rigd(&["export", "latest", "--data", dir, "--format", "jsonl"]);
    for line in stdout(&records).lines() {
        serde_json::from_str::<Value>(line).unwrap();
    }
    let copy = data.path().join("again.html");
    let again = rigd(&["report", "latest", "--data", dir, "--out", copy.to_str().unwrap()]);
    assert!(again.status.success(), "{}", stderr(&again));
    assert_eq!(fs::read_to_string(copy).unwrap(), report);
}

#[test]
fn a_run_with_refused_touches_says_which_and_why_and_has_an_exit_code_of_its_own() {
    let data = TempDir::new().unwrap();
    let (dir, path) = (data.path().to_str().unwrap(), data.path().join("narrow.toml"));
    let smoke = fs::read_to_string(repository().join("config/protocols/smoke.toml")).unwrap();
    let (head, contact) = smoke.split_once("[contact_sweep]").unwrap();
    // The resonance on sample 5 lies above it.
    let contact = contact
        .replace("max_hz = 260", "max_hz = 160\nmethod = \"uniform\"\nsettle_s = 0.2\npoints = 41");
    fs::write(&path, format!("{head}[contact_sweep]{contact}")).unwrap();
    let run = ["run", path.to_str().unwrap(), "--data", dir];
    let output = rigd(&run);
    assert_eq!(output.status.code(), Some(6), "{}", stderr(&output));
    let text = stdout(&output);
    let last = text.lines().last().unwrap();
    let (measured, rest) = last.split_once(" of 18 touches measured; ").expect(last);
    let (refused, named) = rest.split_once(" refused: ").expect(last);
    let (measured, refused): (usize, usize) = (measured.parse().unwrap(), refused.parse().unwrap());
    assert!(measured > 0 && refused > 5 && measured + refused == 18, "{last}");
    assert!(named.starts_with("main/5/") && named.ends_with("more"), "{last}");
    assert_eq!(text.lines().filter(|line| line.starts_with("main/5/")).count(), 6, "{text}");

    let output = rigd(&[&run[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(6));
    assert_eq!(stderr(&output).trim_end(), last);
    let result = json(&output);
    assert_eq!(result["status"], "completed_with_refusals");
    let counts = ["touches_planned", "touches_measured", "touches_refused", "touches_not_reached"];
    assert_eq!(
        counts.map(|name| result[name].clone()),
        [18, measured, refused, 0].map(Value::from)
    );
    let table = rigd(&["export", "latest", "--data", dir, "--format", "csv"]);
    let mut table = csv::Reader::from_reader(stdout(&table).as_bytes());
    let rows: Vec<BTreeMap<String, String>> = table.deserialize().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 18);
    for row in rows.iter().filter(|row| row["sample"] == "5") {
        assert_eq!(
            (row["status"].as_str(), row["reason"].is_empty()),
            ("refused", false),
            "{row:?}"
        );
    }
}

#[test]
fn check_lists_the_steps_and_moves_nothing() {
    let output = rigd(&["check", "config/protocols/three-direction.toml", "--steps"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let text = stdout(&output);
    assert!(text.contains("main/3/left/30/1"), "{text}");
    assert!(text.contains("can run on simulated bench"), "{text}");
    assert!(text.contains("110 touches, 21 no-load references, 20 prompts"), "{text}");
    let folder = TempDir::new().unwrap();
    let drawn = folder.path().join("drawn.toml");
    let shipped =
        fs::read_to_string(repository().join("config/protocols/three-direction.toml")).unwrap();
    fs::write(&drawn, shipped.replace("order = \"by-mounting\"", "order = \"drawn\"")).unwrap();
    let output = rigd(&["check", drawn.to_str().unwrap()]);
    let text = stdout(&output);
    assert!(text.contains("76 prompts") && text.contains("same touches with 20 prompts"), "{text}");
    let view = json(&rigd(&["check", "config/protocols/three-direction.toml", "--json"]));
    assert_eq!(view["is_runnable"], true);
    assert_eq!(view["touches"], 110);
    let on_bench = rigd(&[
        "check",
        "config/protocols/three-direction.toml",
        "--rig",
        "config/rigs/bench.toml",
    ]);
    assert!(on_bench.status.success(), "{}", stderr(&on_bench));
}

#[test]
fn a_bad_protocol_is_refused_with_every_fault_and_its_place() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("bad.toml");
    let good = fs::read_to_string(repository().join("config/protocols/smoke.toml")).unwrap();
    let bad =
        good.replace("indentation_mm", "indentaton_mm").replace("trials = 6", "trials = \"six\"");
    assert_ne!(good, bad);
    fs::write(&path, bad).unwrap();
    for command in ["check", "run"] {
        let output = rigd(&[command, path.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stdout(&output).is_empty());
        let faults = stderr(&output);
        assert!(faults.contains("did you mean `indentation_mm`?"), "{faults}");
        assert!(faults.lines().count() >= 2, "{faults}");
        assert!(faults.lines().all(|line| line.starts_with(path.to_str().unwrap())), "{faults}");
    }
}

#[test]
fn failures_have_their_exit_codes() {
    let data = TempDir::new().unwrap();
    let dir = data.path().to_str().unwrap();
    let code = |args: &[&str]| rigd(args).status.code();
    assert_eq!(code(&["check", "no-such-file.toml"]), Some(2));
    assert_eq!(code(&["runs", "--data", dir]), Some(1));
    assert_eq!(code(&["fly"]), Some(2));
    let output = rigd(&["run", "config/protocols/smoke.toml", "--data", dir]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(code(&["show", "0000", "--data", dir]), Some(3));
    // Ports that are not there.
    let bench = ["--rig", "config/rigs/bench.toml"];
    let run = ["run", "config/protocols/smoke.toml", "--data", dir, bench[0], bench[1]];
    assert_eq!(code(&run), Some(1));
}

#[test]
fn an_axis_is_moved_by_hand_and_read_back() {
    let data = TempDir::new().unwrap();
    let by_hand = |args: &[&str]| {
        let output = rigd(&[args, &["--data", data.path().to_str().unwrap(), "--json"]].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        let view = json(&output);
        (view["linear_mm"].as_f64(), view["rotary_deg"].as_f64(), view["probe"].clone())
    };
    assert_eq!(by_hand(&["home"]), (Some(24.5), Some(0.0), "clear".into()));
    assert_eq!(by_hand(&["move", "linear", "9.5"]), (Some(9.5), Some(0.0), "in contact".into()));
    assert_eq!(by_hand(&["move", "rotary", "-30"]), (Some(24.5), Some(-30.0), "clear".into()));
    let text = rigd(&["move", "linear", "9.5", "--data", data.path().to_str().unwrap()]);
    assert!(stdout(&text).contains("linear stage  9.500 mm\n"), "{}", stdout(&text));
    assert!(stderr(&text).contains("the probe stays there"), "{}", stderr(&text));
}

#[test]
fn nothing_by_hand_goes_beyond_the_limits() {
    let data = TempDir::new().unwrap();
    let window = ["measure", "--min-hz", "120", "--max-hz", "165"];
    let refused: [(&[&str], &str); 9] = [
        (&["move", "linear", "46"], "outside the soft limits [8.000 mm, 45.000 mm]"),
        (&["move", "linear", "8.5"], "below 8.900 mm, the deepest that a touch may go here"),
        (&["move", "linear", "9.1"], "below 9.200 mm, the lowest target of one move from here"),
        (&["move", "rotary", "51"], "outside the soft limits [-50.000 °, 50.000 °]"),
        (&[window.as_slice(), &["--at-mm", "8.5"]].concat(), "the deepest that a touch may go"),
        (&[window.as_slice(), &["--level-v", "6"]].concat(), "level_v = 6 is outside [0.01, 5]"),
        (&[window.as_slice(), &["--level-v", "0.001"]].concat(), "is outside [0.01, 5]"),
        (&["measure", "--min-hz", "120", "--max-hz", "inf"], "both must be finite"),
        (
            &["measure", "--min-hz", "165", "--max-hz", "120"],
            "min_hz must be positive and below max_hz",
        ),
    ];
    for (args, reason) in refused {
        let output = rigd(&[args, &["--data", data.path().to_str().unwrap()]].concat());
        assert_eq!(output.status.code(), Some(2), "{args:?}: {}", stderr(&output));
        assert!(stdout(&output).is_empty(), "{args:?}");
        assert!(stderr(&output).contains(reason), "{args:?}: {}", stderr(&output));
    }
}

#[test]
fn one_resonance_is_measured_by_hand() {
    let data = TempDir::new().unwrap();
    let measure = |args: &[&str]| {
        let window = ["measure", "--min-hz", "120", "--max-hz", "165"];
        rigd(&[window.as_slice(), args, &["--data", data.path().to_str().unwrap()]].concat())
    };
    let view = json(&measure(&["--json"]));
    assert_eq!(view["status"], "accepted");
    let (found, sigma) =
        (view["resonance_hz"].as_f64().unwrap(), view["sigma_hz"].as_f64().unwrap());
    // The scene says 140 Hz, give or take the temperature of the day.
    assert!((found - 140.0).abs() < 2.0 && sigma < 0.05, "{view}");
    assert_eq!((view["linear_mm"].as_f64(), view["rotary_deg"].as_f64()), (Some(24.5), Some(0.0)));

    let lowered = json(&measure(&["--at-mm", "12", "--angle-deg", "15", "--json"]));
    assert_eq!(lowered["linear_mm"].as_f64(), Some(12.0));
    assert_eq!(lowered["rotary_deg"].as_f64(), Some(15.0));
    let reader = rig_store::Reader::open(data.path()).unwrap();
    let session = reader.runs().unwrap().swap_remove(0);
    let is_lowered = |record: rig_store::Record| {
        use rig_store::{Axis::LinearMm, Record::Moved};
        if let Moved(moved) = record {
            Some((moved.axis == LinearMm, moved.read_back))
        } else {
            None
        }
    };
    let records = reader.records(session.id).unwrap();
    let moves: Vec<_> =
        records.iter().filter_map(|stored| is_lowered(stored.record().unwrap())).collect();
    let expected = [(true, 24.5), (false, 0.0), (false, 15.0), (true, 12.0), (true, 24.5)];
    assert_eq!(moves, expected);

    let csv = measure(&["--points", "21", "--csv"]);
    assert_eq!(stdout(&csv).lines().count(), 1 + 21);
    assert!(stdout(&csv).starts_with("frequency_hz,resistance_ohm,reactance_ohm,started_s,"));

    let away = ["measure", "--min-hz", "300", "--max-hz", "400", "--json"];
    let away = rigd(&[away.as_slice(), &["--data", data.path().to_str().unwrap()]].concat());
    assert_eq!((away.status.code(), &json(&away)["status"]), (Some(3), &Value::from("refused")));
}
