//! `rigd safe` on simulated devices on ports, with the probe in contact in truth.

// Pseudo-terminals are those of Linux.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests add servers")]
#[path = "support/bench.rs"]
mod bench;

use std::{fs::File, io::pipe, os::fd::OwnedFd};

use rig_model::DriveMake;
use rig_sim::{
    PortId,
    faults::{DeviceFault, Fault, FaultKind, FaultTrigger, RequestFault},
};
use rig_store::{ProbeWord, Reader, Record, Store};
use rigd::loaded_rig::LoadedRig;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use bench::{Bench, json, stderr};

/// Where the linear stage rests clear, mm.
const CLEAR_MM: f64 = 30.0;

const PATIENT: (&str, &str) = ("[geometry]", "[recovery]\npatience_s = 3\n\n[geometry]");

/// A bench on which a program was killed after it had lowered the probe into the sample.
async fn in_contact() -> Bench {
    let bench = Bench::start().await;
    bench.sim.with(|now, rig| rig.world().place_sample(now, "3")).unwrap();
    let fast = ("contact_speed_mm_per_s = 0.5", "contact_speed_mm_per_s = 10");
    let lowered = bench.rigd_with(&bench.analyzer, &bench.bus, &[fast], &["move", "linear", "9.7"]);
    assert!(lowered.status.success(), "{}", stderr(&lowered));
    assert!(bench.is_in_contact(), "the probe does not touch");
    bench
}

impl Bench {
    fn data(&self) -> std::path::PathBuf {
        self.folder.path().join("data")
    }

    fn safe(&self, changes: &[(&str, &str)], args: &[&str]) -> std::process::Output {
        self.rigd_with("127.0.0.1:1", &self.bus, changes, &[&["safe"], args].concat())
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_probe_in_contact_is_retracted_without_the_analyzer() {
    let bench = in_contact().await;
    let before = bench.places();
    let safe = bench.safe(&[], &["--json"]);
    assert!(safe.status.success(), "{}", stderr(&safe));
    let said = json(&safe);
    assert_eq!((&said["probe"], &said["faults"]), (&"clear".into(), &serde_json::json!([])));
    assert!((said["from_mm"].as_f64().unwrap() - 9.7).abs() < 0.01, "{said}");
    let after = bench.places();
    assert!((after.0 - CLEAR_MM).abs() < 0.05 && (after.1 - before.1).abs() < 1e-9, "{after:?}");
    // Clear already: it says so again.
    let again = bench.safe(&[], &[]);
    let line = String::from_utf8(again.stdout.clone()).unwrap();
    assert!(again.status.success() && line.contains("the probe is clear after"), "{line}");
    assert_eq!(line.lines().count(), 1, "{line}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_retract_is_recorded_where_a_data_directory_is_given() {
    let bench = in_contact().await;
    let data = bench.data();
    let safe = bench.safe(&[], &["--json", "--data", data.to_str().unwrap(), "--operator", "Ada"]);
    assert!(safe.status.success(), "{}", stderr(&safe));
    let reader = Reader::open(&data).unwrap();
    let session = reader.latest_session("bench").unwrap().unwrap();
    assert_eq!(json(&safe)["session"], session.id.to_string());
    assert_eq!(reader.probe_word(&session).unwrap(), ProbeWord::Clear);
    let is_by_ada = |record: Record| match record {
        Record::Fault(fault) => fault.cause == "stopped by Ada",
        _ => false,
    };
    let records = reader.records(session.id).unwrap();
    assert!(records.iter().any(|stored| is_by_ada(stored.record().unwrap())));
    // The rig is in order for the next command.
    let home = bench.rigd(&["home"]);
    assert!(home.status.success(), "{}", stderr(&home));
    // The program before it was closed in order: there is nothing to acknowledge.
    assert!(!stderr(&home).contains("latched"), "{}", stderr(&home));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_silent_rotary_drive_does_not_hold_the_probe_in_the_sample() {
    let bench = in_contact().await;
    bench.disturb(PortId::Bus, Some(2), FaultKind::Request(RequestFault::Drop));
    let safe = bench.safe(&[PATIENT], &["--json"]);
    assert!(safe.status.success(), "{}", stderr(&safe));
    assert!(!bench.is_in_contact());
    assert!(json(&safe)["faults"][0].as_str().unwrap().starts_with("rotary stage: "));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_in_alarm_is_reset_once_and_retracted() {
    let bench = in_contact().await;
    bench.sim.with(|now, rig| {
        rig.apply_fault(now, PortId::Bus, Some(1), DeviceFault::Alarm(0x30));
    });
    let safe = bench.safe(&[PATIENT], &[]);
    assert!(safe.status.success(), "{}", stderr(&safe));
    assert!(!bench.is_in_contact());
    assert!(stderr(&safe).contains("alarm 0x30"), "{}", stderr(&safe));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_silent_linear_drive_ends_the_attempts_in_time_and_is_said() {
    let bench = in_contact().await;
    bench.disturb(PortId::Bus, Some(1), FaultKind::Request(RequestFault::Drop));
    let safe = bench.safe(&[PATIENT], &["--json"]);
    assert_eq!(safe.status.code(), Some(4), "{}", stderr(&safe));
    let said = json(&safe);
    assert_eq!(said["probe"], "unknown");
    assert!(said["duration_s"].as_f64().unwrap() < 20.0, "{said}");
    assert!(stderr(&safe).contains("do not touch the sample or the stages"), "{}", stderr(&safe));
}

/// A person pipes the answer to a program that ends before it has read it.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_probe_that_is_not_clear_is_said_and_is_the_exit_code_also_without_a_reader_of_stdout() {
    let bench = in_contact().await;
    bench.disturb(PortId::Bus, Some(1), FaultKind::Request(RequestFault::Drop));
    for format in [&["safe"][..], &["safe", "--json"]] {
        let (reader, writer) = pipe().unwrap();
        drop(reader);
        let mut command = bench.command("127.0.0.1:1", &bench.bus, &[PATIENT], format);
        let safe = command.stdout(writer).output().unwrap();
        let said = stderr(&safe);
        assert_eq!(safe.status.code(), Some(4), "{said}");
        assert!(said.contains("rigd: the probe is unknown"), "{said}");
        assert!(said.contains("the results are not printed: stdout: "), "{said}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_is_sent_while_another_program_has_the_data_directory_or_the_port() {
    let bench = in_contact().await;
    let held = Store::open(&bench.data()).unwrap();
    let safe = bench.safe(&[], &["--data", bench.data().to_str().unwrap()]);
    assert_eq!(safe.status.code(), Some(1));
    assert!(stderr(&safe).contains("in use by another rigd"), "{}", stderr(&safe));
    assert!(bench.is_in_contact());
    drop(held);

    let (_terminal, port, _lock) = held_terminal();
    let bus = format!("port = {{ tcp = \"{}\" }}", bench.bus);
    let serial = format!("port = {{ serial = \"{port}\", baud = 115200, parity = \"even\" }}");
    let safe = bench.safe(&[(&bus, &serial)], &[]);
    assert_eq!(safe.status.code(), Some(1));
    let said = stderr(&safe);
    assert!(said.contains(&format!("{port}: held by ")) && said.contains("end that program"));
    assert!(bench.is_in_contact());
}

/// The guard says it, as the disk of the data directory may be what the program was waiting for.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_replaced_program_says_that_its_rig_was_in_service_and_which_position_is_wrong() {
    let bench = in_contact().await;
    let elsewhere = bench.folder.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    let safe = |args: &[&str]| {
        let mut command =
            bench.command("127.0.0.1:1", &bench.bus, &[], &[&["safe"], args].concat());
        command.env("STATE_DIRECTORY", &elsewhere).output().unwrap()
    };
    let before = bench.places();
    // Whether the rig was in service is not known there.
    let halted = safe(&[]);
    let said = stderr(&halted);
    assert_eq!((halted.status.code(), bench.places()), (Some(4), before), "{said}");
    assert!(said.contains(elsewhere.to_str().unwrap()) && said.contains("--data"), "{said}");
    let digest = LoadedRig::load(&bench.folder.path().join("rig.toml")).unwrap().digest();
    let in_service = ["--in-service-with", &digest.to_string()];
    // It was another file that was in service: what this one says of the geometry was never tried.
    let edited = safe(&["--in-service-with", &"0".repeat(64)]);
    assert_eq!((edited.status.code(), bench.places()), (Some(4), before), "{}", stderr(&edited));
    let doubtful = safe(&[in_service[0], in_service[1], "--jump-mm", "-60", "-50", "--homing"]);
    let said = stderr(&doubtful);
    assert_eq!((doubtful.status.code(), bench.places()), (Some(4), before), "{said}");
    assert!(said.contains("the position of the linear stage may be wrong"), "{said}");
    let retracted = safe(&in_service);
    assert!(retracted.status.success(), "{}", stderr(&retracted));
    assert!((bench.places().0 - CLEAR_MM).abs() < 0.05);
}

/// A terminal that this program holds as another rigd would.
fn held_terminal() -> (OwnedFd, String, File) {
    let terminal = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&terminal).unwrap();
    unlockpt(&terminal).unwrap();
    let port = ptsname(&terminal, Vec::new()).unwrap().into_string().unwrap();
    let file = File::options().read(true).write(true).open(&port).unwrap();
    file.try_lock().unwrap();
    (terminal, port, file)
}

#[test]
fn a_simulated_rig_is_retracted_in_its_own_memory() {
    let rigd = |args: &[&str]| {
        std::process::Command::new(env!("CARGO_BIN_EXE_rigd"))
            .args(args)
            .current_dir(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
            .output()
            .unwrap()
    };
    let safe = rigd(&["safe", "--json"]);
    assert!(safe.status.success(), "{}", stderr(&safe));
    assert_eq!(json(&safe)["probe"], "clear");
    let other = rigd(&["safe", "--rig", "no-such-rig.toml"]);
    assert_eq!(other.status.code(), Some(2), "{}", stderr(&other));
}

/// The drive loses count while it moves, in such a way that the retract from there leads down.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_position_that_was_said_to_be_wrong_moves_no_probe_before_a_homing() {
    // The one that looks for its zero when it is homed.
    let bench = Bench::with_linear_drive(DriveMake::LeadshinePr, 0.001).await;
    let changes = [
        ("register_map = \"oriental-az\"", "register_map = \"leadshine-pr\""),
        ("contact_speed_mm_per_s = 0.5", "contact_speed_mm_per_s = 10"),
        PATIENT,
    ];
    let rigd = |args| bench.rigd_with(&bench.analyzer, &bench.bus, &changes, args);
    let home = ["home", "--nothing-below-probe"];
    let homed = rigd(&home);
    assert!(homed.status.success(), "{}", stderr(&homed));
    // In the middle of the move.
    let (port, unit, trigger) = (PortId::Bus, Some(1), FaultTrigger::Nth(26));
    let kind = FaultKind::Device(DeviceFault::Miscount(25.0));
    bench.sim.with(|_, rig| rig.add_fault(Fault { port, unit, kind, trigger }));
    let moved = rigd(&["move", "linear", "12"]);
    let stays_at = bench.places();
    let data = bench.data();
    let in_data = ["--data", data.to_str().unwrap()];
    let refused = |output: &std::process::Output| {
        let said = stderr(output);
        assert_eq!(output.status.code(), Some(4), "{said}");
        assert!(
            said.contains("the position of the linear stage may be wrong")
                && said.contains("check with a rule"),
            "{said}"
        );
        assert_eq!(bench.places(), stays_at, "{said}");
    };
    refused(&moved);
    // Each is a program of its own, and under its other name the rig is the same.
    let renamed = [&changes[..], &[("name = \"bench\"", "name = \"bench 2\"")]].concat();
    for changes in [&changes[..], &renamed] {
        refused(&bench.rigd_with(&bench.analyzer, &bench.bus, changes, &["home"]));
        refused(&bench.safe(changes, &in_data));
        // The journal is not written then, and read.
        refused(&bench.safe(changes, &[]));
    }
    // A homing that does not end.
    let kind = FaultKind::Device(DeviceFault::LimitSwitch);
    let trigger = FaultTrigger::Nth(20);
    bench.sim.with(|_, rig| rig.add_fault(Fault { port, unit, kind, trigger }));
    for args in [&home[..], &["home"]] {
        let refused = rigd(args);
        let said = stderr(&refused);
        assert_eq!(refused.status.code(), Some(4), "{said}");
        assert!(
            said.contains("not shown to be clear") && said.contains("check with a rule"),
            "{said}"
        );
    }
    let home = rigd(&home);
    assert!(home.status.success(), "{}", stderr(&home));
    let (tip_mm, _) = bench.places();
    assert!((tip_mm - CLEAR_MM).abs() < 0.05, "{tip_mm}");
    let safe = bench.safe(&changes, &in_data);
    assert!(safe.status.success(), "{}", stderr(&safe));
}
