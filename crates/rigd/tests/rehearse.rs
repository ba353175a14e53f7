//! `rigd rehearse` on the rig file of a real bench: nothing of the bench is touched.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    io::ErrorKind,
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

fn shipped(path: &str) -> String {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    fs::read_to_string(config.join(path)).unwrap()
}

/// A bench whose ports would be noticed if they were opened, and four touches.
fn bench(folder: &Path, ports: &[TcpListener; 2]) -> [PathBuf; 2] {
    let mut rig = shipped("rigs/bench.toml");
    for (name, listener) in ["usb-HIOKI", "usb-FTDI"].iter().zip(ports) {
        let is_port = |line: &&str| line.starts_with("port =") && line.contains(name);
        let line = rig.lines().find(is_port).unwrap().to_owned();
        let address = listener.local_addr().unwrap();
        rig = rig.replace(&line, &format!("port = {{ tcp = \"{address}\" }}"));
    }
    let protocol = shipped("protocols/smoke.toml")
        .replace("directions = [\"front\", \"back\", \"left\"]", "directions = [\"left\"]")
        .replace("angles_deg = [0, 45]", "angles_deg = [30]")
        .replace("trials = 6", "trials = 2");
    let paths = [folder.join("rig.toml"), folder.join("short.toml")];
    for (path, text) in paths.iter().zip([rig, protocol]) {
        fs::write(path, text).unwrap();
    }
    paths
}

#[test]
fn a_rehearsal_says_what_each_fault_does_and_touches_nothing_of_the_bench() {
    let folder = TempDir::new().unwrap();
    let ports = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    let [rig, protocol] = bench(folder.path(), &ports);
    let rehearse = |args: &[&str]| -> Output {
        Command::new(env!("CARGO_BIN_EXE_rigd"))
            .args(["rehearse", protocol.to_str().unwrap(), "--rig", rig.to_str().unwrap()])
            .args(args)
            .current_dir(folder.path())
            .output()
            .unwrap()
    };
    let said = rehearse(&["--json"]);
    let stderr = String::from_utf8_lossy(&said.stderr);
    assert!(said.status.success(), "{stderr}");
    let rehearsal: Value = serde_json::from_slice(&said.stdout).unwrap();
    assert_eq!(rehearsal["touches"], 4);
    let rows = rehearsal["faults"].as_array().unwrap();
    assert_eq!(rows.len(), 29);
    let count = |key: &str| rows.iter().filter(|row| row[key] == true).count();
    assert_eq!((count("is_complete"), count("is_clear")), (29, 29), "{rows:#?}");
    // The unplugged bus latches the rig, and the person has to resume the run.
    let unplugged = rows.iter().find(|row| row["number"] == 13).unwrap();
    assert!(unplugged["resumed"].as_u64() > Some(0), "{unplugged}");
    let message = unplugged["seen"][0].as_str().unwrap();
    assert!(message.contains("simulated bus: ") && message.contains(" → "), "{message}");
    assert!(unplugged["additional_s"].as_f64() > Some(10.0), "{unplugged}");
    // A surface where no touch can reach is told as it was found, and not as a mistake of the program.
    let slipped = rows.iter().find(|row| row["number"] == 23).unwrap();
    assert!(!slipped["seen"].to_string().contains("maintainer"), "{slipped}");
    // A killed program, and one without a disk, is started again, and its run resumed: unless the disk
    // failed before the run was written.
    for number in [31, 34, 35] {
        let rows: Vec<_> = rows.iter().filter(|row| row["number"] == number).collect();
        assert!(rows.iter().all(|row| row["restarted"] == 1), "{rows:?}");
        // The person is told of the run that was written.
        let is_written = |row: &&&Value| {
            row["seen"].to_string().contains("was interrupted at")
                && !row["seen"].to_string().contains("the last session")
        };
        assert!(rows.iter().filter(is_written).all(|row| row["resumed"] == 1), "{rows:?}");
    }
    let full = rows.iter().find(|row| row["number"] == 34).unwrap();
    assert!(full["seen"][0].as_str().unwrap().contains("the disk is full"), "{full}");
    // Waiting costs nothing but time, less the decays that are over in the meantime.
    let of_person: Vec<_> = rows.iter().filter(|row| row["number"] == 39).collect();
    let [late, absent, wrong] = of_person[..] else { panic!("{of_person:?}") };
    assert!((3590.0..3700.0).contains(&late["additional_s"].as_f64().unwrap()), "{late}");
    assert_eq!((&late["resumed"], &absent["restarted"]), (&0.into(), &1.into()));
    // Of an act that was not done nobody hears either, and it costs the touches of that prompt.
    let lost = ["touches_different", "touches_refused"].map(|key| wrong[key].as_u64().unwrap());
    assert!(lost.iter().sum::<u64>() > 0, "{wrong}");
    // Of the analyzer's delay nobody hears.
    let late = rows.iter().find(|row| row["number"] == 16).unwrap();
    assert_eq!((&late["resumed"], late["seen"].as_array().unwrap().len()), (&0.into(), 0));

    for port in &ports {
        port.set_nonblocking(true).unwrap();
        assert_eq!(port.accept().unwrap_err().kind(), ErrorKind::WouldBlock, "a port was opened");
    }
    let mut left: Vec<_> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["rig.toml", "short.toml"], "something was written");

    let table = rehearse(&["--seed", "2"]);
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
    assert!(table.contains("phase") && table.contains("alarm of the linear drive"), "{table}");
}
