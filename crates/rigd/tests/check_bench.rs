//! `rigd check-bench` on a simulated bench, day after day.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

fn config(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A change of a bench: a text of its scene, and what stands there then.
type Change = (&'static str, &'static str);

/// The bench of one data directory.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    /// The same bench on another day, after these changes.
    fn put_together(&self, day: u64, changes: &[Change]) {
        let mut scene = fs::read_to_string(config("scenes/daily.toml")).unwrap();
        let seed = format!("seed = {day}");
        for (old, new) in [("seed = 2020", seed.as_str())].iter().chain(changes) {
            assert!(scene.contains(old), "{old}");
            scene = scene.replacen(old, new, 1);
        }
        fs::write(self.path("scene.toml"), scene).unwrap();
        let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
        fs::write(self.path("rig.toml"), rig.replacen("../scenes/paper.toml", "scene.toml", 1))
            .unwrap();
    }

    fn rigd(&self, args: &[&str]) -> Output {
        self.read(&[args, &["--rig", &self.path("rig.toml")]].concat())
    }

    /// A command that needs no rig.
    fn read(&self, args: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(args).args(["--data", &self.path("data")]).output().unwrap()
    }

    /// Copies the records of checks, each as that of a day before, of other runs.
    fn copy_checks(&self, days: i64) {
        let folder = self.path("data/calibrations");
        let files: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap()).collect();
        for (file, day) in files.iter().flat_map(|file| (1..=days).map(move |day| (file, day))) {
            let text = fs::read_to_string(file.path()).unwrap();
            let earlier = |line: &str| match line.split_once(" = ") {
                Some(("made_unix_s", s)) => {
                    format!("made_unix_s = {}", s.parse::<i64>().unwrap() - 86_400 * day)
                }
                Some(("journal", _)) => "journal = []".to_owned(),
                _ => line.to_owned(),
            };
            let text: Vec<_> = text.lines().map(earlier).collect();
            let name = file.file_name().into_string().unwrap();
            let name = name.replacen("check-", &format!("check-0{day}"), 1);
            fs::write(PathBuf::from(&folder).join(name), text.join("\n")).unwrap();
        }
    }

    /// Makes both runs of a check, and does not judge them.
    #[track_caller]
    fn run_both(&self) {
        for protocol in ["check-block", "check-references"] {
            let path = config(&format!("protocols/{protocol}.toml"));
            let run = self.rigd(&["run", path.to_str().unwrap()]);
            assert!(matches!(run.status.code(), Some(0 | 6)), "{}", stderr(&run));
        }
    }

    /// A check by two runs that is refused, and why.
    #[track_caller]
    fn refused(&self, runs: [&str; 2], why: &str) {
        let output = self.rigd(&["check-bench", "--runs", runs[0], runs[1]]);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        let said = stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains(why), "{said}");
    }

    /// The same runs are none of a real bench of the same name.
    #[track_caller]
    fn refused_by_a_real_rig(&self, runs: [&str; 2]) {
        let rig = fs::read_to_string(self.path("rig.toml")).unwrap();
        let real = rig.replacen("connection = \"simulated\"", "connection = \"ports\"", 1);
        assert_ne!(real, rig);
        fs::write(self.path("rig.toml"), real).unwrap();
        let bench = "the rig \"simulated bench\"";
        let why = format!("{} was made on {bench} (simulated), and not on {bench} (real)", runs[0]);
        self.refused(runs, &why);
        fs::write(self.path("rig.toml"), rig).unwrap();
    }

    /// A check on a day, with its exit code.
    fn check(&self, day: u64, changes: &[Change]) -> (Value, Option<i32>) {
        self.put_together(day, changes);
        let output = self.rigd(&["check-bench", "--json", "--operator", "Ada"]);
        let view = serde_json::from_slice(&output.stdout);
        (view.unwrap_or_else(|_| panic!("{}", stderr(&output))), output.status.code())
    }
}

fn alarms(check: &Value) -> Vec<&str> {
    let quantities = check["quantities"].as_array().unwrap();
    let is_alarm = |quantity: &&Value| quantity["is_alarm"] == true;
    quantities.iter().filter(is_alarm).map(|quantity| quantity["name"].as_str().unwrap()).collect()
}

#[test]
fn a_bench_that_has_changed_is_told_by_the_quantity_that_shows_it() {
    let bench = Bench::new();
    for day in 1..=4 {
        let (check, code) = bench.check(day, &[]);
        assert_eq!((&check["verdict"], code), (&Value::from("look"), Some(8)), "{day}: {check}");
        assert_eq!(check["checks"], day);
    }
    bench.copy_checks(3);
    let (check, code) = bench.check(5, &[]);
    assert_eq!((&check["verdict"], code), (&Value::from("accepted"), Some(0)), "{check}");
    assert_eq!(check["checks"], 17);
    // A run cites the last check, and its report shows it.
    let run = bench.rigd(&["run", config("protocols/check-references.toml").to_str().unwrap()]);
    assert!(run.status.success(), "{}", stderr(&run));
    let shown = bench.read(&["show", "latest", "--json"]);
    let shown: Value = serde_json::from_slice(&shown.stdout).unwrap();
    let trend = fs::read_to_string(bench.path("data/checks.html")).unwrap();
    assert!(trend.contains("accepted") && trend.matches("<svg").count() == 7);
    assert_eq!(shown["daily_check"]["verdict"], "accepted", "{shown}");
    let report = fs::read_to_string(shown["report"].as_str().unwrap()).unwrap();
    assert!(report.contains("daily check") && !report.contains("says: "), "daily check");
    // A zero that was lost and a bent probe, a worn ball, a sensor that aged: each is found by what shows it.
    for (day, changes, shows) in [
        (
            12,
            &[
                ("surface_mm = 10.03", "surface_mm = 10.06"),
                ("probe_beside_pivot_mm = 0.32", "probe_beside_pivot_mm = 0.36"),
            ][..],
            &["check.surface", "check.tilt_difference"][..],
        ),
        (
            13,
            &[("probe_radius_mm = 0.51", "probe_radius_mm = 0.40")],
            &["check.first_reference", "check.second_reference"],
        ),
        (14, &[("length_mm = 35", "length_mm = 34.6")], &["check.free_resonance"]),
    ] {
        let (check, code) = bench.check(day, changes);
        let told = alarms(&check);
        assert!(shows.iter().all(|shows| told.contains(shows)), "{changes:?}: {check}");
        assert_eq!(code, Some(8));
    }
    bench.refused(["check-block-5", "check-references-6"], "check-block-5 belongs to the check of");
    bench.refused(["check-block-1", "check-references-1"], "and a run counts once");
    // After a change of the bench that is meant, the charts begin again.
    bench.run_both();
    bench.refused(["check-block-9", "check-references-6"], "are touched after the block");
    let changed = bench.rigd(&["commission", "changed", "references"]);
    assert!(changed.status.success(), "{}", stderr(&changed));
    bench.refused(["check-block-9", "check-references-10"], "before the bench was changed");
    bench.run_both();
    let judged =
        bench.rigd(&["check-bench", "--json", "--runs", "check-block-10", "check-references-11"]);
    let check: Value = serde_json::from_slice(&judged.stdout).unwrap();
    assert_eq!(check["checks"], 1, "{check}");
    let record = fs::read_to_string(check["record"].as_str().unwrap()).unwrap();
    let shown = bench.read(&["runs", "--json"]);
    let shown: Value = serde_json::from_slice(&shown.stdout).unwrap();
    let ended = shown[0]["finished_at"].as_str().unwrap();
    assert!(record.contains(&format!("made = \"{}Z\"", &ended[..19])), "{ended}: {record}");
    let why = "check-references-5 has 2 samples, and the check on the block has 1";
    bench.refused(["check-references-5", "check-block-5"], why);
    bench.refused_by_a_real_rig(["check-block-9", "check-references-10"]);
    // A run of which a touch does not count shows no bench.
    let skip = ["skip", "check-block-9", "main/block/front/0/1", "--why", "a hair"];
    let skipped = bench.read(&skip);
    assert!(skipped.status.success(), "{}", stderr(&skipped));
    bench
        .refused(["check-block-9", "check-references-10"], "a touch of check-block-9 was left out");
}
