//! Runs whose depths are corrected by the error of the linear screw, as touches on two hard blocks have measured it.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

/// The second block is lower than the samples: the probe is below their surface when it is in them.
const LOWER_MM: f64 = 0.7;

/// Standard deviation of the error of the screw, mm.
const SCREW_MM: f64 = 0.014;

fn config(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A bench with a screw of its own.
struct Bench(TempDir);

impl Bench {
    fn new(seed: u64) -> Self {
        let bench = Self(TempDir::new().unwrap());
        bench.put(seed, 0.0, 0.0);
        let protocol = fs::read_to_string(config("protocols/check-references.toml")).unwrap();
        let protocol = replaced(
            &protocol,
            &[
                ("name = \"check-references\"", "name = \"samples\"".to_owned()),
                ("directions = [\"front\"]", "directions = [\"front\", \"back\"]".to_owned()),
                ("angles_deg = [0]", "angles_deg = [0, 15, 30, 45]".to_owned()),
                ("repeats = 3", "repeats = 1".to_owned()),
                // The reference of the soft one scatters more than the screw does.
                ("samples = [\"soft\", \"hard\"]", "samples = [\"hard\"]".to_owned()),
            ],
        );
        fs::write(bench.path("samples.toml"), protocol).unwrap();
        bench
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    /// Puts a sample or a block on the bench, whose surface is by so much lower, mm, with an error of the screw, mm.
    fn put(&self, seed: u64, screw_mm: f64, lower_mm: f64) {
        let scene = fs::read_to_string(config("scenes/daily.toml")).unwrap();
        let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
        let mut scene = replaced(
            &scene,
            &[
                ("seed = 2020", format!("seed = {seed}")),
                ("screw_mm = 0.002", format!("screw_mm = {screw_mm:?}")),
                ("mounting_mm = 0.003", "mounting_mm = 0".to_owned()),
                ("slope_deg = 0.05", "slope_deg = 0".to_owned()),
                ("stiffness_rel = 0.01", "stiffness_rel = 0".to_owned()),
            ],
        );
        let mut rig = replaced(&rig, &[("../scenes/paper.toml", "scene.toml".to_owned())]);
        if lower_mm > 0.0 {
            let lower = |mm: f64| format!("{:.2}", mm - lower_mm);
            scene = replaced(
                &scene,
                &[
                    ("surface_mm = 10.03", format!("surface_mm = {}", lower(10.03))),
                    (
                        "surface_above_pivot_mm = 4.02",
                        format!("surface_above_pivot_mm = {}", lower(4.02)),
                    ),
                ],
            );
            rig = replaced(
                &rig,
                &[
                    ("surface_mm = 10", format!("surface_mm = {} #", lower(10.0))),
                    (
                        "surface_above_pivot_mm = 4",
                        format!("surface_above_pivot_mm = {} #", lower(4.0)),
                    ),
                ],
            );
        }
        fs::write(self.path("scene.toml"), scene).unwrap();
        fs::write(self.path("rig.toml"), rig).unwrap();
    }

    fn rigd(&self, args: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(args).args(["--data", &self.path("data")]);
        command.output().unwrap()
    }

    fn run(&self, protocol: &str) {
        let output = self.rigd(&["run", protocol, "--rig", &self.path("rig.toml")]);
        assert!(matches!(output.status.code(), Some(0 | 6)), "{}", stderr(&output));
    }

    /// Touches the sample; gives the stiffness of each touch, MPa, and the part of its uncertainty from the depth, relative.
    fn touch(&self) -> Vec<(f64, f64)> {
        self.run(&self.path("samples.toml"));
        let output = self.rigd(&["show", "latest", "--json"]);
        let run: Value = serde_json::from_slice(&output.stdout).unwrap();
        let touch = |touch: &Value| {
            let mpa = touch["stiffness_mpa"].as_f64().unwrap();
            (mpa, touch["budget"]["depth_mpa"].as_f64().unwrap() / mpa)
        };
        run["touch_results"].as_array().unwrap().iter().map(touch).collect()
    }

    /// Measures the screw on two blocks.
    fn map_screw(&self, seed: u64) {
        let screw = config("protocols/screw.toml");
        self.run(screw.to_str().unwrap());
        self.put(seed, SCREW_MM, LOWER_MM);
        self.run(screw.to_str().unwrap());
        self.put(seed, SCREW_MM, 0.0);
        let raised = format!("screw-2=-{LOWER_MM}");
        let rig = self.path("rig.toml");
        let found =
            self.rigd(&["commission", "blocks", "screw-1", "--raised", &raised, "--rig", &rig]);
        assert!(found.status.success(), "{}", stderr(&found));
    }
}

fn replaced(text: &str, changes: &[(&str, String)]) -> String {
    changes.iter().fold(text.to_owned(), |text, (old, new)| {
        assert!(text.contains(old), "{old}");
        text.replacen(old, new, 1)
    })
}

/// Root mean square of the errors of the stiffness, relative to the same bench with a perfect screw, and of what is stated of
/// the depth.
fn errors(found: &[(f64, f64)], perfect: &[(f64, f64)]) -> [f64; 2] {
    let rms = |values: Vec<f64>| {
        let squares: f64 = values.iter().map(|value| value * value).sum();
        (squares / values.len() as f64).sqrt()
    };
    let error = |(found, perfect): (&(f64, f64), &(f64, f64))| (found.0 / perfect.0).ln();
    [
        rms(found.iter().zip(perfect).map(error).collect()),
        rms(found.iter().map(|touch| touch.1).collect()),
    ]
}

/// `RIGD_SCREW_BENCHES=6 cargo test -p rigd --test screw_map -- --nocapture` prints more benches.
#[test]
fn the_map_of_the_screw_makes_stiffness_less_wrong_and_says_by_how_much() {
    let benches = std::env::var("RIGD_SCREW_BENCHES").map_or(1, |count| count.parse().unwrap());
    let (mut perfect, mut raw, mut mapped) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 1..=benches {
        let bench = Bench::new(seed);
        let without = bench.touch();
        bench.put(seed, SCREW_MM, 0.0);
        let wrong = bench.touch();
        bench.map_screw(seed);
        let right = bench.touch();
        let shown = bench.rigd(&["show", "latest"]);
        let said = String::from_utf8(shown.stdout).unwrap();
        assert!(said.contains("is taken out of 8 of 8"), "{said}");
        let verified = bench.rigd(&["verify", "latest"]);
        assert!(verified.status.success(), "{}", stderr(&verified));
        let [by_drive, by_map] = [&wrong, &right].map(|found| errors(found, &without));
        println!(
            "bench {seed}: error and stated part of the depth {by_drive:?}, by the map {by_map:?}"
        );
        perfect.extend(without);
        raw.extend(wrong);
        mapped.extend(right);
    }
    let [by_drive, by_map] = [&raw, &mapped].map(|found| errors(found, &perfect));
    println!("{} touches: {by_drive:?}, by the map {by_map:?}", mapped.len());
    assert!(by_map[0] < 0.6 * by_drive[0], "{by_map:?} of {by_drive:?}");
    assert!(by_map[1] < 0.2 * by_drive[1], "{by_map:?} of {by_drive:?}");
    // Sweep, reference and search scatter by 0.3 % beside the depth, and by as much on the bench with a perfect screw.
    assert!(by_map[0] < 0.005, "{by_map:?}");
}
