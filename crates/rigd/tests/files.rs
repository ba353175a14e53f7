//! Wrong files and names: messages and exit codes.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use rig_files::rig_file::RigFile;
use rigd::{loaded_rig::LoadedRig, protocol_file::LoadedProtocol};
use tempfile::TempDir;

const SIMULATED: &str = include_str!("../../../config/rigs/simulated.toml");
const SCENE: &str = include_str!("../../../config/scenes/paper.toml");

fn config(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn rigd(args: &[&Path]) -> Output {
    // In the directory of the default rig file.
    let repository = config("..");
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).current_dir(repository).output().unwrap()
}

/// The program refuses, says this on stderr, and nothing on stdout.
#[track_caller]
fn check(args: &[&Path], code: i32, expected: &[&str]) {
    let output = rigd(args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
    for expected in expected {
        assert!(said.contains(expected), "{args:?}: {expected:?} is not in {said}");
    }
    assert!(output.stdout.is_empty(), "{args:?}");
}

#[test]
fn a_missing_file_is_told_with_those_that_are_there_and_exits_with_2() {
    let (rig, smoke) = (config("rigs/simulated.toml"), config("protocols/smoke.toml"));
    let none = config("protocols/smok.toml");
    let there = [
        "smok.toml: no such file; ",
        "protocols holds block.toml, check-block.toml, check-references.toml, ",
    ];
    for command in ["run", "check", "serve"] {
        check(&[command.as_ref(), &none, "--rig".as_ref(), &rig], 2, &there);
    }
    let none = config("rigs/none.toml");
    let there = ["none.toml: no such file; ", "rigs holds bench.toml, simulated.toml"];
    for command in ["identify", "doctor", "home"] {
        check(&[command.as_ref(), "--rig".as_ref(), &none], 2, &there);
    }
    check(&["run".as_ref(), &smoke, "--rig".as_ref(), &none], 2, &there);
    check(&["fit".as_ref(), &config("x.csv")], 2, &["x.csv: no such file; "]);
    check(&["check".as_ref(), &config("no/x.toml")], 2, &["there is no directory "]);
    let folder = [": a directory, no file; ", " holds instruments/, protocols/, rigs/, scenes/"];
    check(&["check".as_ref(), &config("")], 2, &folder);
    // Named by the rig file, where its place is.
    let scratch = TempDir::new().unwrap();
    let path = scratch.path().join("rig.toml");
    let text = fs::read_to_string(rig).unwrap();
    fs::write(&path, text.replace("../scenes/paper.toml", "papers.toml")).unwrap();
    let named = ["rig.toml:17:9: scene = \"papers.toml\": no such file; ", " holds rig.toml"];
    check(&["identify".as_ref(), "--rig".as_ref(), &path], 2, &named);
}

#[test]
fn away_from_the_repository_a_rig_file_is_asked_for() {
    let scratch = TempDir::new().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    let output = command.arg("identify").current_dir(scratch.path()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("→ give a rig file with --rig"), "{said}");
}

#[test]
fn files_that_were_mixed_up_are_told_apart() {
    let (rig, smoke) = (config("rigs/simulated.toml"), config("protocols/smoke.toml"));
    let scene = config("scenes/paper.toml");
    for command in ["run", "check"] {
        check(&[command.as_ref(), &rig], 2, &["simulated.toml:1:1: this looks like a rig file"]);
        check(&[command.as_ref(), &scene], 2, &["paper.toml:1:1: this looks like a scene file"]);
        // Both the wrong way round.
        let args = [command.as_ref(), rig.as_path(), "--rig".as_ref(), &smoke];
        check(&args, 2, &["smoke.toml:1:1: this looks like a protocol file, not like a rig file"]);
    }
    check(
        &["fit".as_ref(), &smoke],
        2,
        &["this looks like a protocol file, not like a sweep file"],
    );
    let scratch = TempDir::new().unwrap();
    let sweep = scratch.path().join("sweep.toml");
    fs::write(&sweep, "frequency_hz,resistance_ohm,reactance_ohm\n140,1,2\n").unwrap();
    check(&["run".as_ref(), &sweep], 2, &["sweep file", "`rigd fit` takes sweeps"]);
}

#[test]
fn text_in_another_encoding_is_named_with_its_place() {
    let scratch = TempDir::new().unwrap();
    let smoke = fs::read_to_string(config("protocols/smoke.toml")).unwrap();
    let path = scratch.path().join("smoke.toml");
    let utf16: Vec<u8> = smoke.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let latin1 = [smoke.as_bytes(), b"# 45\xb0\n"].concat();
    let line = smoke.lines().count() + 1;
    for (bytes, expected) in [
        ([&[0xFF, 0xFE], &utf16[..]].concat(), "smoke.toml:1:1: the file is UTF-16".to_owned()),
        (latin1, format!("smoke.toml:{line}:5: the byte 0xB0 is not UTF-8; in Latin-1 it is `°`")),
        (b"PK\x03\x04\0\0".to_vec(), "smoke.toml:1:5: the file is not text".to_owned()),
    ] {
        fs::write(&path, bytes).unwrap();
        check(&["check".as_ref(), &path], 2, &[&expected]);
        check(&["identify".as_ref(), "--rig".as_ref(), &path], 2, &[&expected]);
    }
    // A byte order mark changes nothing.
    fs::write(&path, format!("\u{feff}{smoke}")).unwrap();
    let args = ["check".as_ref(), path.as_path(), "--rig".as_ref(), &config("rigs/simulated.toml")];
    let checked = rigd(&args);
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}

#[test]
fn a_port_that_is_a_file_and_an_address_without_port_are_told_so() {
    let scratch = TempDir::new().unwrap();
    let path = scratch.path().join("rig.toml");
    let device = scratch.path().join("ttyUSB0");
    fs::write(&device, "").unwrap();
    let bench = fs::read_to_string(config("rigs/bench.toml")).unwrap();
    let analyzer = "/dev/serial/by-id/usb-HIOKI_IM3536-if00";
    assert!(bench.contains(analyzer));
    for (name, what) in [(device.as_path(), "a file"), (scratch.path(), "a directory")] {
        fs::write(&path, bench.replace(analyzer, &name.display().to_string())).unwrap();
        let said = [
            &format!("{}: {what}, not a serial port", name.display()),
            "→ name a port in the rig file",
        ];
        let data = scratch.path().join("data");
        check(
            &["home".as_ref(), "--rig".as_ref(), &path, "--data".as_ref(), &data],
            1,
            &said.map(|said| said as &str),
        );
    }
    let form = "expected an address or a name and a port, such as 127.0.0.1:8137 or localhost:8137";
    for listen in ["localhost", "8140", "localhost:http"] {
        check(&["serve".as_ref(), "--listen".as_ref(), listen.as_ref()], 2, &[form]);
    }
}

#[test]
fn a_run_that_is_not_there_or_not_one_is_told_with_those_that_are() {
    let scratch = TempDir::new().unwrap();
    let data = scratch.path().join("data");
    let no_journal = ["data: holds no journal", "→ name the directory of an earlier run"];
    check(&["show".as_ref(), "latest".as_ref(), "--data".as_ref(), &data], 1, &no_journal);
    let store = rig_store::Store::open(&data).unwrap();
    for _ in 0..2 {
        let mut journal = store.begin(rig_store::RunKind::Run, "smoke").unwrap();
        journal.commit().unwrap();
    }
    drop(store);
    let show = |run: &'static str| [Path::new("show"), Path::new(run), Path::new("--data")];
    let with = |run| [&show(run)[..], &[data.as_path()]].concat();
    check(&with("smoke-3"), 3, &["rigd: no run `smoke-3`", "→ `rigd runs --data DIR` lists"]);
    check(&with("smoke"), 3, &["`smoke` fits 2 runs: smoke-2 (", ", smoke-1 ("]);
}

#[test]
fn the_shipped_protocols_run_on_the_shipped_rigs() {
    for rig in ["rigs/simulated.toml", "rigs/bench.toml"] {
        let rig = LoadedRig::load(&config(rig)).unwrap();
        for protocol in ["protocols/three-direction.toml", "protocols/smoke.toml"] {
            let loaded = LoadedProtocol::load(&config(protocol), &rig.facts()).unwrap();
            assert!(loaded.plan.steps.len() > 20);
        }
    }
}

#[test]
fn the_simulated_rig_is_described_as_well_as_a_person_measures() {
    let rig = RigFile::read("rig.toml", SIMULATED).unwrap();
    let place = rig_sim::scene::read("scene.toml", SCENE).unwrap().place;
    let geometry = rig.limits.geometry;
    let pairs = [
        (geometry.surface.value(), place.surface_mm),
        (geometry.surface_above_pivot_mm, place.surface_above_pivot_mm),
        (geometry.probe_beside_pivot_mm, place.probe_beside_pivot_mm),
    ];
    for (described, real) in pairs {
        assert!((described - real).abs() < 0.1, "{described} mm for {real} mm");
    }
}
