//! `rigd instrument`: files to start from, transcripts of the simulated rig, and their replay.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use rigd::{
    loaded_rig::LoadedRig,
    transcripts::{Role, Unproven},
};
use tempfile::TempDir;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn rigd(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).current_dir(repository()).output().unwrap()
}

#[track_caller]
fn done(args: &[&str]) -> String {
    let output = rigd(args);
    let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    assert!(output.status.success(), "{args:?}: {text}");
    text
}

/// The simulated rig with a meter and drives that have files of their own, in a directory.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let text = |path: &str| fs::read_to_string(repository().join(path)).unwrap();
        let changed = |text: String, changes: &[(&str, &str)]| {
            changes.iter().fold(text, |text, (old, new)| {
                assert!(text.contains(old), "{old}");
                text.replacen(old, new, 1)
            })
        };
        let own = |name: &str| text(&format!("config/instruments/{name}.toml"));
        let meter =
            changed(own("keysight-e4980a"), &[("name = \"keysight-e4980a\"", "name = \"meter\"")]);
        let drive = changed(own("oriental-az"), &[("name = \"oriental-az\"", "name = \"drive\"")]);
        let rig = changed(
            text("config/rigs/simulated.toml"),
            &[
                ("../scenes/paper.toml", "scene.toml"),
                ("dialect = \"hioki-im3536\"", "dialect = \"meter.toml\""),
                ("max_level_v = 5", "max_level_v = 2"),
                ("register_map = \"oriental-az\"", "register_map = \"drive.toml\""),
                ("baud = 115200 }", "baud = 115200, parity = \"even\" }"),
            ],
        );
        let files = [
            ("scene.toml", text("config/scenes/paper.toml")),
            ("meter.toml", meter),
            ("drive.toml", drive),
            ("rig.toml", rig),
        ];
        for (name, text) in files {
            fs::write(folder.path().join(name), text).unwrap();
        }
        Self { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn unproven(&self) -> Vec<Unproven> {
        LoadedRig::load(Path::new(&self.path("rig.toml"))).unwrap().unproven()
    }

    fn change(&self, name: &str, old: &str, new: &str) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        assert!(text.contains(old), "{old}");
        fs::write(self.path(name), text.replacen(old, new, 1)).unwrap();
    }
}

#[test]
fn a_new_file_has_only_the_name_to_change_and_passes_its_check() {
    let folder = TempDir::new().unwrap();
    for kind in ["analyzer", "drive"] {
        let path = folder.path().join(format!("lab-{kind}.toml"));
        let path = path.to_str().unwrap();
        done(&["instrument", "new", kind, path]);
        assert!(fs::read_to_string(path).unwrap().contains(&format!("\nname = \"lab-{kind}\"\n")));
        let text = done(&["instrument", "check", path]);
        assert!(text.contains("unproven") && text.contains("no transcript"), "{text}");
        assert!(!rigd(&["instrument", "new", kind, path]).status.success(), "it was replaced");
    }
}

#[test]
fn what_was_recorded_proves_the_files_until_they_change() {
    let bench = Bench::new();
    let roles = |device, instrument: &str, roles: &[Role]| Unproven {
        device,
        instrument: instrument.to_owned(),
        roles: roles.to_vec(),
        trouble: None,
    };
    let analyzer = [Role::Identity, Role::Setup, Role::Reading];
    let all =
        [roles("analyzer", "meter", &analyzer), roles("linear stage", "drive", &[Role::Look])];
    assert_eq!(bench.unproven(), all);
    let text =
        done(&["instrument", "record", "--rig", &bench.path("rig.toml"), "--out", &bench.path("")]);
    assert!(text.contains("analyzer: meter, identity, setup, reading recorded in"), "{text}");
    assert_eq!(bench.unproven(), []);
    for (name, roles) in [("meter.toml", 3), ("drive.toml", 1)] {
        let text = done(&["instrument", "check", &bench.path(name)]);
        assert_eq!(text.matches("proven").count(), roles, "{text}");
    }
    // One that exists is kept, and the others are recorded.
    fs::remove_file(bench.path("oriental-az.transcript")).unwrap();
    let rig = bench.path("rig.toml");
    let again = rigd(&["instrument", "record", "--rig", &rig, "--out", &bench.path("")]);
    assert_eq!(again.status.code(), Some(1));
    let told = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(told.contains("analyzer: not recorded in"), "{told}");
    // The other axis has a shipped drive.
    let transcript = bench.path("oriental-az.transcript");
    let text = done(&["instrument", "check", "oriental-az", "--transcript", &transcript]);
    assert!(text.contains("look      proven"), "{text}");

    // Another message, and the same message read otherwise.
    bench.change("meter.toml", ":TRIGger:TDELay {delay_s}", ":TRIGger:TDELay {delay_s:.2}");
    let output = rigd(&["instrument", "check", &bench.path("meter.toml")]);
    let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("setup     proven\nreading   differs: at "), "{text}");
    assert!(text.contains("the file sends `:FREQuency 20;:APERture SHORt,"), "{text}");
    assert_eq!(bench.unproven(), [roles("analyzer", "meter", &[Role::Reading])]);
    bench.change("meter.toml", ":TRIGger:TDELay {delay_s:.2}", ":TRIGger:TDELay {delay_s}");
    bench.change(
        "meter.toml",
        "[\"resistance_ohm\", \"reactance_ohm\"",
        "[\"reactance_ohm\", \"resistance_ohm\"",
    );
    let output = rigd(&["instrument", "check", &bench.path("meter.toml")]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("reading   differs: the result is 20 Hz: "), "{text}");
    bench.change(
        "drive.toml",
        "{ address = 0x0120, count = 4 }",
        "{ address = 0x0120, count = 5 }",
    );
    let text = String::from_utf8(rigd(&["instrument", "check", &bench.path("drive.toml")]).stdout);
    assert!(text.as_ref().unwrap().contains("look      differs: at "), "{text:?}");
}

#[test]
fn a_transcript_that_is_damaged_or_of_another_instrument_is_refused() {
    let bench = Bench::new();
    let path = bench.path("meter.transcript");
    let check = || {
        let output = rigd(&["instrument", "check", &bench.path("meter.toml")]);
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    let title = "# rigd transcript 1: ms since the port was opened, direction, bytes\n";
    for (text, said) in [
        (String::new(), "meter.transcript:1: not a transcript of rigd"),
        (title.to_owned(), "of the instrument , and this one is meter"),
        (format!("{title}instrument = other\n"), "of the instrument other, and this one is meter"),
        (format!("{title}instrument = meter\nline = tcp\n"), "has no `level_v`"),
        (format!("{title}instrument = meter\n[identity]\n1 -> \\q\n"), "transcript:4: a byte is"),
    ] {
        fs::write(&path, text).unwrap();
        let found = check();
        assert!(found.contains(said), "{found}\ndoes not say: {said}");
    }
    let Unproven { roles, trouble, .. } = &bench.unproven()[0];
    assert_eq!(roles.len(), 3);
    assert!(trouble.as_ref().is_some_and(|why| why.contains("transcript:4")), "{trouble:?}");
}

#[test]
fn a_correction_is_kept_with_its_cable_and_its_date() {
    let bench = Bench::new();
    let (rig, data) = (bench.path("rig.toml"), bench.path("data"));
    let common = ["--rig", &rig, "--data", &data];
    let compensate = |args: &[&str]| {
        let output = rigd(&[&["compensate"], args, &common].concat());
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        (output.status.success(), text)
    };
    let (is_done, text) = compensate(&["open", "--cable", "RG174, blue", "--length-m", "1"]);
    assert!(is_done && text.contains("open: measured, and on, for RG174, blue"), "{text}");
    // A simulated analyzer is switched on again for each command.
    let (is_done, text) = compensate(&[]);
    assert!(
        is_done && text.contains("open   off  made 2") && text.contains("for RG174, blue"),
        "{text}"
    );
    assert!(text.contains("short  off  never made for this analyzer"), "{text}");
    let (is_done, text) = compensate(&["short", "--cable", "x", "--length-m", "3"]);
    assert!(
        !is_done
            && text
                .contains("--length-m 3 is no length that the analyzer corrects for: 0, 1, 2, 4 m"),
        "{text}"
    );
    let (is_done, text) = compensate(&["short", "--cable", "  "]);
    assert!(!is_done && text.contains("the name of the cable is empty"), "{text}");
    let (is_done, text) = compensate(&["short", "--cable", "RG58"]);
    assert!(is_done && text.contains("open was made for RG174, blue"), "{text}");
    let (is_done, text) = compensate(&["load", "--cable", "x"]);
    assert!(
        !is_done && text.contains("the file of meter has no commands for this: load"),
        "{text}"
    );
    bench.change("rig.toml", "dialect = \"meter.toml\"", "dialect = \"hioki-im3536\"");
    let (is_done, text) = compensate(&["open", "--cable", "x"]);
    assert!(!is_done && text.contains("correct it at its panel"), "{text}");
}

/// The noise of the simulated analyzer is 0.5 % at every frequency. A sensor that has not settled adds its decay.
#[test]
fn a_selftest_finds_the_noise_of_the_analyzer_with_a_sensor_that_rings_for_long() {
    for (quality, loss) in [(67, "0.015"), (250, "0.004"), (300, "0.00333")] {
        let bench = Bench::new();
        bench.change("scene.toml", "beam_loss = 0.015", &format!("beam_loss = {loss}"));
        let output = rigd(&["selftest", "--rig", &bench.path("rig.toml"), "--json"]);
        let checks: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let is_noise =
            |check: &&serde_json::Value| check["check"].as_str().unwrap().starts_with("noise at");
        let noise: Vec<f64> = checks
            .as_array()
            .unwrap()
            .iter()
            .filter(is_noise)
            .map(|check| check["value"].as_f64().unwrap())
            .collect();
        assert_eq!(noise.len(), 6, "{checks}");
        let mean = noise.iter().sum::<f64>() / 6.0;
        // Each is known to 16 %, and their mean to 7 %.
        assert!(noise.iter().all(|percent| *percent < 0.78), "Q {quality}: {noise:?}");
        assert!((0.4..0.6).contains(&mean), "Q {quality}: {noise:?}");
    }
}

/// The archive of a bench that nobody here has seen becomes a test: its transcripts replay.
#[test]
fn a_selftest_has_a_line_for_each_check_and_an_archive_whose_transcripts_replay() {
    let bench = Bench::new();
    let (rig, archive) = (bench.path("rig.toml"), bench.path("selftest.json"));
    for (args, why) in [
        (&["--hours", "2"][..], "--hours is for --level soak"),
        (&["--level", "soak", "--hours", "0.01"], "a whole number of hours, from 1 to 24"),
    ] {
        let refused = rigd(&[&["selftest", "--rig", &rig], args].concat());
        assert_eq!(refused.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&refused.stderr).contains(why), "{why}");
    }
    let text = done(&["selftest", "--rig", &rig, "--archive", &archive]);
    for said in [
        "ok       computer, ports: the rig has no serial port of this computer",
        "ok       analyzer, late, corrupt or repeated: 0 answers, limit 0 answers",
        "ok       analyzer, noise at 150 Hz: 0.",
        "ok       analyzer, impedance at 0.5 V against 1 V: ",
        "ok       linear stage, median of a reading: ",
        "ok       rotary stage, longest reading: ",
    ] {
        assert!(text.contains(said), "{text}\ndoes not say: {said}");
    }
    let text = fs::read_to_string(&archive).unwrap();
    assert!(text.len() < 5_000_000);
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let transcripts = value["transcripts"].as_array().unwrap();
    assert_eq!(transcripts.len(), 3);
    for transcript in transcripts {
        let path = bench.path("sent.transcript");
        fs::write(&path, transcript["text"].as_str().unwrap()).unwrap();
        let instrument = match transcript["instrument"].as_str().unwrap() {
            own @ ("meter" | "drive") => bench.path(&format!("{own}.toml")),
            shipped => shipped.to_owned(),
        };
        let text = done(&["instrument", "check", &instrument, "--transcript", &path]);
        assert!(!text.contains("unproven") && text.contains("proven"), "{text}");
        // The serial number of the simulated meter.
        assert!(!transcript["text"].as_str().unwrap().contains("MY46"), "{transcript}");
    }
    assert!(
        !rigd(&["selftest", "--rig", &rig, "--archive", &archive]).status.success(),
        "replaced"
    );
    let text = done(&["selftest", "--rig", &rig, "--level", "host"]);
    assert!(!text.contains("analyzer"), "{text}");
}
