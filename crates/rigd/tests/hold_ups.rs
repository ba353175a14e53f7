//! The program is stopped for ten seconds, asked to end, and given another wall clock, in each phase
//! of a touch.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "support/preload.rs"]
mod preload;
#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    ops::Range,
    path::Path,
    process::Command,
    thread,
    time::{Duration, Instant},
};

use rig_store::{MoveReason, Reader, Record, StoredRecord, SweepPurpose};
use rustix::process::Signal;
use tempfile::TempDir;

use program::{Program, at_once, check_clear, post, request, wait_until};

/// The phases of a touch, each by the record with which it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// The no-load sweep.
    NoLoad,
    /// The probe goes down.
    Search,
    /// The surface is found, and the probe is pressed into the sample.
    Indent,
    /// The sweep in contact.
    Sweep,
    /// The probe goes up.
    Retract,
}

const PHASES: [Phase; 5] =
    [Phase::NoLoad, Phase::Search, Phase::Indent, Phase::Sweep, Phase::Retract];

impl Phase {
    fn begins_with(self, record: &Record) -> bool {
        match (self, record) {
            (Self::NoLoad, Record::StepStarted(step)) => step.step.contains("no-load"),
            (Self::Search, Record::Intent(intent)) => intent.what == MoveReason::Approach,
            (Self::Indent, Record::SurfaceFound(_)) => true,
            (Self::Sweep, Record::Moved(moved)) => {
                moved.axis == rig_store::Axis::LinearMm && moved.read_back < 9.7
            }
            (Self::Retract, Record::Sweep(sweep)) => sweep.purpose == SweepPurpose::Touch,
            _ => false,
        }
    }

    /// The program at the beginning of this phase of its first touch.
    fn reach(self, folder: &Path) -> Program {
        self.reach_by(Command::new(env!("CARGO_BIN_EXE_rigd")), folder)
    }

    fn reach_by(self, command: Command, folder: &Path) -> Program {
        let args = ["run", "config/protocols/smoke.toml"];
        let program = Program::start_by(command, folder, &args);
        program.wait_for_record(&format!("{self:?}"), |record| self.begins_with(record));
        program
    }
}

const STANDSTILL: Duration = Duration::from_secs(10);

/// Only time can make it a standstill.
fn wait() {
    let began = Instant::now();
    while began.elapsed() < STANDSTILL {
        thread::park_timeout(STANDSTILL);
    }
}

/// The program stands still in each phase of its first touch, and notices it. The shift is that of a run in virtual time,
/// which no load of this computer disturbs. The checker finds nothing, however loaded this computer is.
fn check_standstills(by: impl Fn(Phase, &Path) -> Program + Sync, lasts_s: Range<f64>) {
    /// Several times the standard deviation of a shift, and a fiftieth of the shift.
    const LIMIT_HZ: f64 = 1.0;
    let folder = TempDir::new().unwrap();
    let undisturbed = run(&folder.path().join("virtual"), &[]);
    let expected_hz = undisturbed["touch_results"][0]["shift_hz"].as_f64().unwrap();
    at_once(PHASES, |phase| {
        let folder = TempDir::new().unwrap();
        let program = by(phase, folder.path());
        program.wait_for_record("the standstill", |record| match record {
            Record::Stalled(stalled) => lasts_s.contains(&stalled.stalled_s),
            _ => false,
        });
        program.wait_for_record("the touch", |record| matches!(record, Record::TouchResult(_)));
        program.signal(Signal::TERM);
        let (status, text, data) = program.end();
        let reader = Reader::open(&data).unwrap();
        let run = reader.find("latest").unwrap();
        let verdict = rig_verify::verify(&data, &run.id.to_string()).unwrap();
        assert!(verdict.is_sound, "{phase:?}: {:?}", verdict.findings);
        assert_eq!(status.code(), Some(5), "{phase:?}: {text}");
        let shift = |stored: StoredRecord| match stored.record().unwrap() {
            Record::TouchResult(touch) => Some(touch.shift_hz),
            _ => None,
        };
        let shift_hz = reader.records(run.id).unwrap().into_iter().find_map(shift).unwrap();
        assert!((shift_hz - expected_hz).abs() < LIMIT_HZ, "{phase:?}: {shift_hz} {expected_hz}");
        assert!(text.contains("rigd was held up"), "{phase:?}: {text}");
        check_clear(&data);
        check_no_reading_of_the_standstill(&reader.records(run.id).unwrap());
    });
}

#[test]
fn ten_seconds_of_standstill_in_each_phase_of_a_touch_are_noticed_and_spoil_no_reading() {
    let by = |phase: Phase, folder: &Path| {
        let program = phase.reach(folder);
        program.signal(Signal::STOP);
        wait();
        program.signal(Signal::CONT);
        program
    };
    check_standstills(by, 9.9..20.0);
}

/// The rest of the program goes on meanwhile. Where the write comes before an operation, that one begins after it, and nothing
/// is measured again.
#[cfg(target_os = "linux")]
#[test]
fn ten_seconds_of_a_write_in_each_phase_of_a_touch_are_noticed_and_spoil_no_reading() {
    let by = |phase: Phase, folder: &Path| {
        let (blocked, library) = (folder.join("blocked"), preload::library("disk/fail.c", folder));
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.env("LD_PRELOAD", library).env("RIGD_BLOCK_WHILE", &blocked);
        let program = phase.reach_by(command, folder);
        fs::write(&blocked, "").unwrap();
        wait();
        fs::remove_file(&blocked).unwrap();
        program
    };
    // The write may begin later than the time for which it would block.
    check_standstills(by, 1.0..20.0);
}

/// No recorded reading was under way during a standstill.
#[track_caller]
fn check_no_reading_of_the_standstill(records: &[StoredRecord]) {
    /// A standstill is noticed at a beat, and begins after one.
    const BEAT_S: f64 = 0.1;
    let standstill = |stored: &StoredRecord| match stored.record().unwrap() {
        Record::Stalled(stalled) => {
            let end_s = stored.rig_us as f64 / 1e6;
            Some((end_s - stalled.stalled_s + BEAT_S, end_s - BEAT_S))
        }
        _ => None,
    };
    let standstills: Vec<(f64, f64)> = records.iter().filter_map(standstill).collect();
    assert!(!standstills.is_empty());
    let mut count = 0;
    for stored in records {
        let Record::Sweep(sweep) = stored.record().unwrap() else { continue };
        for reading in &sweep.readings {
            let begin_s = reading.started_s + reading.settle_s;
            let end_s = begin_s + reading.integration_s;
            let is_of = |&(from_s, to_s): &(f64, f64)| begin_s < to_s && from_s < end_s;
            assert!(!standstills.iter().any(is_of), "{reading:?} {standstills:?}");
            count += 1;
        }
    }
    assert!(count > 0);
}

#[test]
fn a_service_manager_that_ends_the_program_in_any_phase_of_a_touch_leaves_the_probe_clear() {
    at_once(PHASES, |phase| {
        let folder = TempDir::new().unwrap();
        let program = phase.reach(folder.path());
        program.signal(Signal::TERM);
        let (status, text, data) = program.end();
        // 7 would mean that the checker has findings.
        assert_eq!(status.code(), Some(5), "{phase:?}: {text}");
        check_clear(&data);
    });
}

/// A run, with its touches in JSON.
fn run(data: &Path, environment: &[(&str, &str)]) -> serde_json::Value {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let output = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["run", "config/protocols/smoke.toml", "--json"])
        .args(["--data", data.to_str().unwrap()])
        .envs(environment.iter().copied())
        .current_dir(repository)
        .output()
        .unwrap();
    // 7 would mean that the checker has findings.
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_wall_clock_that_jumps_to_and_fro_changes_no_result_and_is_recorded() {
    let folder = TempDir::new().unwrap();
    let library = preload::library("hold_ups/clock.c", folder.path());
    let jumping = folder.path().join("jumping");
    let preload = [("LD_PRELOAD", library.to_str().unwrap()), ("RIGD_CLOCK_JUMP_S", "86400")];
    let with_jumps = run(&jumping, &preload);
    let without = run(&folder.path().join("steady"), &[]);
    let touches = |results: &serde_json::Value| -> Vec<serde_json::Value> {
        let rows = results["touch_results"].as_array().unwrap();
        rows.iter().map(|row| serde_json::json!([row["step"], row["shift_hz"]])).collect()
    };
    assert_eq!(touches(&with_jumps), touches(&without));
    let reader = Reader::open(&jumping).unwrap();
    let run = reader.find("latest").unwrap();
    let jumps: Vec<f64> = reader
        .records(run.id)
        .unwrap()
        .into_iter()
        .filter_map(|stored| match stored.record().unwrap() {
            Record::ClockJumped(jumped) => Some(jumped.jump_s),
            _ => None,
        })
        .collect();
    let near = |jump_s: &&f64, wanted_s: f64| (**jump_s - wanted_s).abs() < 5.0;
    let forward = jumps.iter().filter(|jump_s| near(jump_s, 86400.0)).count();
    let back = jumps.iter().filter(|jump_s| near(jump_s, -86400.0)).count();
    assert!(forward > 0 && back > 0, "{jumps:?}");
    let report = fs::read_to_string(with_jumps["report"].as_str().unwrap()).unwrap();
    assert!(report.contains("the wall clock was set by +86400.0 s"));
}

/// The id of a run has its time.
#[test]
fn runs_after_the_wall_clock_was_set_back_are_sound() {
    let folder = TempDir::new().unwrap();
    let library = preload::library("hold_ups/clock.c", folder.path());
    let back = folder.path().join("back");
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.env("LD_PRELOAD", &library).env("RIGD_CLOCK_BACK", &back);
    command
        .args(["serve", "--rig", "config/rigs/simulated.toml"])
        .args(["--listen", "127.0.0.1:0", "--data"])
        .arg(folder.path().join("data"))
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    let mut daemon = Program::spawn(&mut command, folder.path().join("data"));
    let address = daemon.wait_for_address();
    let latest = || Reader::open(&daemon.data).and_then(|reader| reader.find("latest"));
    for run in 1..=3 {
        if run == 2 {
            fs::write(&back, "").unwrap();
        }
        wait_until("the rig to be idle", || {
            request(&address, "GET /api/v1/rig", "").contains("\"state\":\"idle\"")
        });
        let smoke = include_str!("../../../config/protocols/smoke.toml");
        let begun = serde_json::json!({ "protocol_toml": smoke }).to_string();
        let begun = post(&address, "runs", &begun);
        assert!(begun.starts_with("HTTP/1.1 202"), "{begun}");
        wait_until("the run to end", || {
            latest().is_ok_and(|latest| latest.number == run && latest.is_sealed)
        });
        let id = latest().unwrap().id.to_string();
        let verdict = rig_verify::verify(&daemon.data, &id).unwrap();
        assert!(verdict.is_sound, "run {run}: {:?}", verdict.findings);
    }
    daemon.signal(Signal::TERM);
    let data = daemon.data.clone();
    assert!(daemon.end().0.success());
    // The session ended before it began, and a run may have the record of the jump.
    for run in Reader::open(&data).unwrap().runs().unwrap() {
        let verdict = rig_verify::verify(&data, &run.id.to_string()).unwrap();
        assert!(verdict.is_sound, "{}: {:?}", run.name, verdict.findings);
    }
}
