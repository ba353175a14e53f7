//! Commissioning with a drive that does not know where its axis is, and with one that no transcript proves.

// Signals are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "support/commissioned.rs"]
mod commissioned;
#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use program::{Program, post, request, wait_until};
use rustix::process::Signal;
use tempfile::TempDir;

/// A bench as its rig file says, but for a small zero of its table.
struct Bench(TempDir);

fn changed(path: &str, changes: &[(&str, &str)]) -> String {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let text = fs::read_to_string(config.join(path)).unwrap();
    changes.iter().fold(text, |text, (old, new)| {
        assert!(text.contains(old), "{old}");
        text.replacen(old, new, 1)
    })
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

impl Bench {
    /// With this linear drive; `drive.toml` is an instrument file of its own.
    fn new(drive: &str) -> Self {
        let bench = Self(TempDir::new().unwrap());
        let of_bench = [
            ("mm_per_step = 0.00102", "mm_per_step = 0.001"),
            ("deg_per_step = -0.01", "deg_per_step = 0.01"),
            ("zero_deg = 0.8", "zero_deg = 0.05"),
            ("wrong_answers = 0.1", "wrong_answers = 0"),
        ];
        let drive = format!("register_map = \"{drive}\"");
        let of_rig = [
            ("../scenes/paper.toml", "scene.toml"),
            ("register_map = \"oriental-az\"", &*drive),
            ("baud = 115200 }", "baud = 115200, parity = \"even\" }"),
        ];
        let of_drive = [("name = \"oriental-az\"", "name = \"drive\"")];
        for (name, text) in [
            ("scene.toml", changed("scenes/new-bench.toml", &of_bench)),
            ("rig.toml", changed("rigs/simulated.toml", &of_rig)),
            ("drive.toml", changed("instruments/oriental-az.toml", &of_drive)),
        ] {
            fs::write(bench.path(name), text).unwrap();
        }
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        let (rig, data) = (self.path("rig.toml"), self.path("data"));
        command.args(args).arg("--rig").arg(rig).arg("--data").arg(data);
        command
    }

    fn rigd(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }

    fn commissioned(drive: &str) -> Self {
        let bench = Self::new(drive);
        let rig = fs::read_to_string(bench.path("rig.toml")).unwrap();
        commissioned::commission(&rig, &bench.path("data"));
        bench
    }
}

#[test]
fn a_drive_that_does_not_know_where_its_axis_is_is_not_sent_far_by_hand() {
    for (drive, is_homed) in [("leadshine-pr", false), ("oriental-az", true)] {
        let bench = Bench::commissioned(drive);
        // The power of its drives comes with the program.
        let short = bench.rigd(&["commission", "jog", "linear", "0.2"]);
        assert!(short.status.success(), "{}", stderr(&short));
        let long = bench.rigd(&["commission", "jog", "linear", "-10"]);
        let said = stderr(&long);
        assert_eq!(long.status.code(), Some(if is_homed { 0 } else { 2 }), "{said}");
        let why = "the drive says that it does not know where its axis is";
        assert_eq!(said.contains(why), !is_homed, "{said}");
    }
}

#[test]
fn a_step_by_hand_after_a_homing_that_was_interrupted_voids_what_rests_on_the_zero() {
    let bench = Bench::commissioned("oriental-az");
    let mut paths =
        fs::read_dir(bench.path("data/calibrations")).unwrap().map(|entry| entry.unwrap().path());
    let homing = paths.find(|path| path.to_str().unwrap().contains("/homing-")).unwrap();
    // As a program that was killed during the homing has left it.
    let text = fs::read_to_string(&homing).unwrap();
    fs::write(&homing, text.replacen("\"accepted\"", "\"begun\"", 1)).unwrap();
    let step = bench.rigd(&["commission", "jog", "linear", "10"]);
    let said = stderr(&step);
    assert_eq!(step.status.code(), Some(2), "{said}");
    assert!(said.contains("A homing was interrupted"), "{said}");
    let shown = String::from_utf8(bench.rigd(&["commission", "show"]).stdout).unwrap();
    assert!(shown.contains("the bench was changed since"), "{shown}");
}

/// What the calibrations show is not all that a rig in service needs.
#[test]
fn a_commissioned_rig_with_an_unproven_drive_is_not_said_to_be_in_service() {
    let told = "No step of commissioning is missing. The rig is not in service: the file of drive (linear stage) is \
                unproven: look; `rigd instrument record` proves it.";
    let bench = Bench::new("drive.toml");
    let mut command = bench.command(&["serve", "--listen", "127.0.0.1:0", "--operator", "Ada"]);
    let mut program = Program::spawn(&mut command, bench.path("data"));
    let address = program.wait_for_address();
    let begun = post(&address, "commission", "{}");
    assert!(begun.starts_with("HTTP/1.1 202 "), "{begun}");
    let show = || request(&address, "GET /api/v1/commission", "");
    wait_until("the end of the commissioning", || show().contains("\"under_way\":null"));
    assert!(show().contains(told) && !show().contains("goes into service"), "{}", show());
    let again = post(&address, "commission", "{}");
    assert!(again.starts_with("HTTP/1.1 409 ") && again.contains(told), "{again}");
    program.signal(Signal::TERM);
    program.end();
    let said = stderr(&bench.rigd(&["commission"]));
    assert!(said.contains(told) && !said.contains("rigd home"), "{said}");
}
