//! The radius of the ball by touches on a pin, on a simulated bench whose rig file has another one.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

use tempfile::TempDir;

/// The radius of the ball, where the rig file says 0.5 mm.
const RADIUS_MM: f64 = 0.53;

/// The second block is lower, as for the map of the screw.
const LOWER_MM: f64 = 0.7;

fn config(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn replaced(text: &str, changes: &[(&str, String)]) -> String {
    changes.iter().fold(text.to_owned(), |text, (old, new)| {
        assert!(text.contains(old), "{old}");
        text.replacen(old, new, 1)
    })
}

/// What lies below the probe.
#[derive(Debug, Clone, Copy)]
enum Below {
    Block,
    LowerBlock,
    Pin,
    /// A block of the name of the pin.
    BlockForPin,
}

struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self { folder: TempDir::new().unwrap() };
        let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
        let rig = replaced(&rig, &[("../scenes/paper.toml", "scene.toml".to_owned())]);
        let lower = |mm: f64| format!("{:.2}", mm - LOWER_MM);
        let on_lower = [
            ("surface_mm = 10", format!("surface_mm = {} #", lower(10.0))),
            ("surface_above_pivot_mm = 4", format!("surface_above_pivot_mm = {} #", lower(4.0))),
        ];
        let on_pin = [("# pin_radius_mm = 2", "pin_radius_mm = 2".to_owned())];
        fs::write(bench.path("lower.toml"), replaced(&rig, &on_lower)).unwrap();
        fs::write(bench.path("pin-rig.toml"), replaced(&rig, &on_pin)).unwrap();
        fs::write(bench.path("rig.toml"), rig).unwrap();
        bench
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn put(&self, below: Below) {
        let scene = fs::read_to_string(config("scenes/daily.toml")).unwrap();
        let lower_mm = if matches!(below, Below::LowerBlock) { LOWER_MM } else { 0.0 };
        let mut changes = vec![
            ("probe_radius_mm = 0.51", format!("probe_radius_mm = {RADIUS_MM}")),
            ("screw_mm = 0.002", "screw_mm = 0.004".to_owned()),
            ("mounting_mm = 0.003", "mounting_mm = 0".to_owned()),
            ("slope_deg = 0.05", "slope_deg = 0".to_owned()),
            ("surface_mm = 10.03", format!("surface_mm = {:.2}", 10.03 - lower_mm)),
            (
                "surface_above_pivot_mm = 4.02",
                format!("surface_above_pivot_mm = {:.2}", 4.02 - lower_mm),
            ),
        ];
        if matches!(below, Below::Pin | Below::BlockForPin) {
            changes.push(("name = \"block\"", "name = \"pin\"".to_owned()));
        }
        if matches!(below, Below::Pin) {
            changes.push(("[place]", "[place]\npin_mm = 2".to_owned()));
        }
        fs::write(self.path("scene.toml"), replaced(&scene, &changes)).unwrap();
    }

    fn rigd(&self, args: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(args).args(["--data", &self.path("data")]);
        command.output().unwrap()
    }

    fn run(&self, below: Below, protocol: &str, rig: &str) -> Output {
        self.put(below);
        let protocol = config(protocol);
        self.rigd(&["run", protocol.to_str().unwrap(), "--rig", &self.path(rig)])
    }

    fn touched(&self, below: Below, protocol: &str, rig: &str) {
        let output = self.run(below, protocol, rig);
        assert!(matches!(output.status.code(), Some(0 | 6)), "{}", stderr(&output));
    }

    fn commission(&self, args: &[&str]) -> Output {
        let rig = self.path("rig.toml");
        self.rigd(&[&["commission"], args, &["--rig", &rig]].concat())
    }
}

#[test]
fn a_pin_shows_the_radius_of_the_ball_and_what_to_change_in_the_rig_file() {
    let bench = Bench::new();
    bench.touched(Below::Pin, "protocols/pin.toml", "pin-rig.toml");
    let of_pin = ["pin", "pin-1", "--pin-radius-mm", "2"];
    // Without blocks the rotary axis is known to half a millimetre.
    let alone = bench.commission(&of_pin);
    assert_eq!(alone.status.code(), Some(1), "{}", stderr(&alone));
    assert!(stderr(&alone).contains("the standard uncertainty of geometry.probe_radius_mm is"));

    bench.touched(Below::Block, "protocols/screw.toml", "rig.toml");
    bench.touched(Below::LowerBlock, "protocols/screw.toml", "lower.toml");
    let raised = format!("screw-2=-{LOWER_MM}");
    let of_blocks = ["blocks", "screw-1", "--raised", &raised];
    let found = bench.commission(&of_blocks);
    assert!(found.status.success(), "{}", stderr(&found));

    let refused = bench.commission(&["pin", "screw-1", "--pin-radius-mm", "2"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("screw-1 was made without geometry.pin_radius_mm"));
    let refused = bench.commission(&["pin", "pin-1", "--pin-radius-mm", "2.2"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("pin_radius_mm = 2 in its rig file, but 2.2 mm was given"));

    let found = bench.commission(&of_pin);
    let (shown, said) = (stdout(&found), stderr(&found));
    println!("{shown}{said}");
    assert_eq!(found.status.code(), Some(2), "{said}");
    let changed = said.split("geometry.probe_radius_mm = 0.5 must be changed to ").nth(1).unwrap();
    let to: f64 = changed.split_whitespace().next().unwrap().parse().unwrap();
    let row = shown.lines().find(|line| line.contains("geometry.probe_radius_mm")).unwrap();
    let sigma = row.split("± ").nth(1).and_then(|text| text.split_whitespace().next());
    let sigma: f64 = sigma.unwrap().parse().unwrap();
    assert!((to - RADIUS_MM).abs() < 2.5 * sigma && sigma < 0.015, "{to} ± {sigma}");

    // With the value in the rig file, what rests on it is evaluated again.
    let rig = fs::read_to_string(bench.path("rig.toml")).unwrap();
    let change = [("probe_radius_mm = 0.5", format!("probe_radius_mm = {to}"))];
    fs::write(bench.path("rig.toml"), replaced(&rig, &change)).unwrap();
    assert!(bench.commission(&of_blocks).status.success());
    let accepted = bench.commission(&of_pin);
    assert!(accepted.status.success(), "{}", stderr(&accepted));
    let verified = bench.rigd(&["verify", "pin-1"]);
    assert!(verified.status.success(), "{}{}", stdout(&verified), stderr(&verified));
}

#[test]
fn a_flat_block_where_the_rig_file_has_a_pin_ends_the_run_at_the_first_tilt() {
    let bench = Bench::new();
    let output = bench.run(Below::BlockForPin, "protocols/pin.toml", "pin-rig.toml");
    let said = stderr(&output);
    assert!(!matches!(output.status.code(), Some(0 | 6)), "{said}");
    let shown = stdout(&bench.rigd(&["show", "latest"]));
    assert!(shown.contains("0 of 30 touches measured"), "{shown}");
    assert!(said.contains("above where a surface may lie"), "{said}");

    // How a run ended is said last, and is the exit code, also if nobody reads what it has found.
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let protocol = config("protocols/pin.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.args(["run", protocol.to_str().unwrap(), "--rig", &bench.path("pin-rig.toml")]);
    let unread = command.args(["--data", &bench.path("data")]).stdout(writer).output().unwrap();
    assert_eq!(unread.status.code(), output.status.code(), "{}", stderr(&unread));
    let last =
        |said: &str| said.lines().rfind(|line| line.starts_with("rigd: ")).unwrap().to_owned();
    assert_eq!(last(&stderr(&unread)), last(&said));
}
