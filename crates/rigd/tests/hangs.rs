//! A rig loop that stands still, here in a write to the journal that does not return.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/bench.rs"]
mod bench;
#[path = "support/preload.rs"]
mod preload;
#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;
#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/short_runs.rs"]
mod short_runs;

use std::fs;

use rustix::process::Signal;

use bench::Bench;
use program::{PATIENCE, Program, post, request, wait_until};

/// What a person does about a daemon that does not answer.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Person {
    PressesStopAll,
    /// The service manager, or a person at the terminal.
    EndsTheProgram,
}

fn check(person: Person, bench: &Bench) {
    short_runs::run_short(bench.folder.path(), 1);
    let list = short_runs::json(&bench.folder.path().join("data"), &["runs"]);
    let earlier = list[0]["run_id"].as_str().unwrap();
    bench.sim.with(|now, rig| rig.world().place_sample(now, "3")).unwrap();
    let blocked = bench.folder.path().join("blocked");
    let library = preload::library("disk/fail.c", bench.folder.path());
    let fast = ("contact_speed_mm_per_s = 0.5", "contact_speed_mm_per_s = 10");
    let args = ["serve", "--listen", "127.0.0.1:0"];
    let mut command = bench.command(&bench.analyzer, &bench.bus, &[fast], &args);
    command.env("LD_PRELOAD", library).env("RIGD_BLOCK_WHILE", &blocked);
    let mut program = Program::spawn(&mut command, bench.folder.path().join("data"));
    let address = program.wait_for_address();
    let lower = || post(&address, "moves", r#"{"axis": "linear", "to": 9.7}"#);
    wait_until("the rig to be in service", || lower().starts_with("HTTP/1.1 202 "));
    wait_until("the probe to touch", || bench.is_in_contact());
    let is_idle = || request(&address, "GET /api/v1/rig", "").contains("\"state\":\"idle\"");
    wait_until("the move to end", is_idle);

    fs::write(&blocked, "").unwrap();
    let unanswered = match person {
        Person::PressesStopAll => post(&address, "sweeps", r#"{"min_hz": 120, "max_hz": 165}"#),
        // A request that writes by itself.
        Person::EndsTheProgram => {
            let touch = r#"{"step": "main/1/left/30/1", "why": "a hair"}"#;
            post(&address, &format!("runs/{earlier}/skip"), touch)
        }
    };
    assert!(unanswered.starts_with("HTTP/1.1 503 "), "{unanswered}");
    let rig = request(&address, "GET /api/v1/rig", "");
    for said in [&unanswered, &rig] {
        assert!(said.contains("the rig loop has not answered since "), "{said}");
        assert!(said.contains("when it used the data directory"), "{said}");
    }
    // The watchdog of a service manager is fed for as long as this is well.
    let health = request(&address, "GET /healthz", "");
    assert!(health.starts_with("HTTP/1.1 503 ") && health.contains("does not answer"), "{health}");
    program.wait_for_line("the rig loop has not answered since ");
    assert!(bench.is_in_contact());
    match person {
        Person::PressesStopAll => drop(post(&address, "stop", "")),
        Person::EndsTheProgram => program.signal(Signal::TERM),
    }
    let (status, text, _) = program.end();
    assert_eq!(status.code(), Some(4), "{text}");
    assert!(text.contains("rigd was ended, and the probe is clear"), "{text}");
    assert!(!bench.is_in_contact());
    // The block has no end of its own.
    assert!(blocked.exists());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_loop_that_stands_still_is_said_and_left_by_another_program() {
    let mut checks = tokio::task::JoinSet::new();
    for person in [Person::PressesStopAll, Person::EndsTheProgram] {
        let bench = Bench::start().await;
        checks.spawn_blocking(move || check(person, &bench));
    }
    tokio::time::timeout(PATIENCE, checks.join_all()).await.unwrap();
}
