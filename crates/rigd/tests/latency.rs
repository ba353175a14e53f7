//! The latency between stage and analyzer of simulated benches, by touches at two speeds.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

/// Where the tip touches a level sample of the scene, mm.
const SURFACE_MM: f64 = 10.03;

fn config(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn replaced(text: &str, changes: &[(&str, &str)]) -> String {
    changes.iter().fold(text.to_owned(), |text, (old, new)| {
        assert!(text.contains(old), "{old}");
        text.replacen(old, new, 1)
    })
}

/// A bench whose drives report positions of some time ago, s, with a sample that lies the same each time.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new(seed: u64, position_age_s: f64) -> Self {
        let bench = Self { folder: TempDir::new().unwrap() };
        let scene = fs::read_to_string(config("scenes/matched.toml")).unwrap();
        let (seed, age) = (format!("seed = {seed}"), format!("position_age_s = {position_age_s}"));
        let changes = [
            ("seed = 2020", seed.as_str()),
            ("# position_age_s = 0.005", &age),
            ("mounting_mm = 0.06", "mounting_mm = 0"),
            ("slope_deg = 1", "slope_deg = 0"),
            ("screw_mm = 0.014", "screw_mm = 0"),
        ];
        fs::write(bench.path("scene.toml"), replaced(&scene, &changes)).unwrap();
        bench.states("0", "0.003");
        bench
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// Writes the rig file with a latency and its standard deviation, s.
    fn states(&self, latency_s: &str, sigma_s: &str) {
        let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
        let stated =
            format!("max_level_v = 5\nlatency_s = {latency_s}\nlatency_sigma_s = {sigma_s}\n");
        let changes = [("../scenes/paper.toml", "scene.toml"), ("max_level_v = 5\n", &stated)];
        fs::write(self.path("rig.toml"), replaced(&rig, &changes)).unwrap();
    }

    fn rigd(&self, args: &[&str]) -> Output {
        let rig = self.path("rig.toml");
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(args).args(["--data", &self.path("data"), "--rig", &rig]);
        command.output().unwrap()
    }

    /// Runs the protocol; the surfaces of the fast touches, mm.
    fn run(&self) -> Vec<f64> {
        let protocol = config("protocols/latency.toml");
        let output = self.rigd(&["run", protocol.to_str().unwrap()]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 6)), "{said}");
        let folders = fs::read_dir(self.path("data/runs")).unwrap();
        let newest = folders.map(|folder| folder.unwrap().path()).max().unwrap();
        let records = fs::read_to_string(newest.join("records.jsonl")).unwrap();
        let records = records.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let records = records.map(|record| record.get("record").cloned().unwrap_or(record));
        let mut is_fast = false;
        let mut surfaces = Vec::new();
        for record in records {
            match record["kind"].as_str() {
                Some("descended") => is_fast = record["speed_mm_per_s"].as_f64().unwrap() > 0.5,
                Some("surface_found") if is_fast => {
                    surfaces.push(record["position_mm"].as_f64().unwrap());
                }
                _ => {}
            }
        }
        surfaces
    }

    /// Judges the last run: exit code, latency and its standard uncertainty, s, and what stderr says.
    fn latency(&self) -> (Option<i32>, f64, f64, String) {
        let output = self.rigd(&["commission", "latency", "latest"]);
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let numbers: Vec<f64> =
            said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(numbers.len() >= 2, "{said}{errors}");
        (output.status.code(), numbers[0], numbers[1], errors)
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// `RIGD_LATENCY_BENCHES=6 cargo test -p rigd --test latency -- --nocapture` prints the figures of six benches.
#[test]
fn the_latency_of_a_bench_is_found_and_its_surfaces_are_true_with_it() {
    let benches = std::env::var("RIGD_LATENCY_BENCHES").ok().and_then(|text| text.parse().ok());
    for seed in 1..=benches.unwrap_or(1) {
        let bench = Bench::new(seed, 0.0);
        bench.run();
        let (code, prompt_s, prompt_sigma_s, said) = bench.latency();
        println!(
            "bench {seed}, positions of now: {:.1} ± {:.1} ms",
            1e3 * prompt_s,
            1e3 * prompt_sigma_s
        );
        assert_eq!(code, Some(0), "{said}");
        let bench = Bench::new(seed, 0.02);
        let before_mm = mean(&bench.run()) - SURFACE_MM;
        let (code, late_s, late_sigma_s, said) = bench.latency();
        println!(
            "bench {seed}, positions 20 ms old: {:.1} ± {:.1} ms",
            1e3 * late_s,
            1e3 * late_sigma_s
        );
        let off_s = late_s - prompt_s - 0.02;
        assert!(off_s.abs() < 2.58 * late_sigma_s.hypot(prompt_sigma_s), "{off_s}");
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("analyzer.latency_s = 0 must be changed to 0.01"), "{said}");
        bench.states(&format!("{late_s:?}"), "0.0012");
        assert_eq!(bench.latency().0, Some(0), "the same run with the new rig file");
        let after_mm = mean(&bench.run()) - SURFACE_MM;
        println!(
            "bench {seed}, surfaces at 1 mm/s: {:+.1} µm off, then {:+.1} µm",
            1e3 * before_mm,
            1e3 * after_mm
        );
        assert!(before_mm > 0.01 && after_mm.abs() < 0.003, "{before_mm} {after_mm}");
    }
}

#[test]
fn a_run_without_descents_shows_no_latency() {
    let bench = Bench::new(1, 0.0);
    let smoke = config("protocols/smoke.toml");
    bench.rigd(&["run", smoke.to_str().unwrap()]);
    let output = bench.rigd(&["commission", "latency", "latest"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("has 0 touches found by a descent") && said.contains("latency.toml"),
        "{said}"
    );
}
