//! How the program ends when it is asked to: with the probe clear, and in time.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    io::{BufReader, Read, Write},
    net::TcpStream,
    os::unix::fs::PermissionsExt,
    path::Path,
    process::{Command, Output, Stdio},
    time::{Duration, Instant},
};

use rig_store::{Axis, ProbeWord, Reader, Record};
use rustix::process::Signal;
use tempfile::TempDir;

use program::{PATIENCE, Program, at_once, check_clear, real_time_rig, request};

const SIGNALS: [Signal; 4] = [Signal::INT, Signal::TERM, Signal::HUP, Signal::QUIT];

#[test]
fn every_signal_retracts_a_probe_that_was_lowered() {
    let commands: [&[&str]; 3] = [
        &["run", "config/protocols/smoke.toml"],
        &["measure", "--min-hz", "120", "--max-hz", "165", "--at-mm", "12"],
        &["move", "linear", "12"],
    ];
    let cases = SIGNALS.into_iter().flat_map(|signal| commands.map(|args| (signal, args)));
    at_once(cases, |(signal, args)| {
        let folder = TempDir::new().unwrap();
        let program = Program::start(folder.path(), args);
        program.wait_until_lowered();
        program.signal(signal);
        let (status, text, data) = program.end();
        assert_eq!(status.code(), Some(5), "{args:?} {signal:?}: {text}");
        assert!(text.contains("interrupt again to stop everything"), "{text}");
        check_clear(&data);
    });
}

#[test]
fn the_third_signal_ends_a_run_at_once_with_the_code_of_a_signal() {
    let folder = TempDir::new().unwrap();
    let mut program = Program::start(folder.path(), &["run", "config/protocols/smoke.toml"]);
    program.wait_until_lowered();
    program.signal(Signal::INT);
    program.wait_for_line("interrupt again to stop everything");
    program.signal(Signal::INT);
    program.wait_for_line("interrupt again to leave the rig as it is");
    program.signal(Signal::INT);
    let (status, text, _) = program.end();
    assert_eq!(status.code(), Some(130), "{text}");
    assert!(text.contains("it is left as it is"), "{text}");
}

#[test]
fn every_signal_closes_the_daemon() {
    let others = [Signal::USR1, Signal::USR2, Signal::ALARM, Signal::XCPU, Signal::POWER];
    // Without a terminal, a daemon reads its configuration again on SIGHUP.
    let ending = SIGNALS.into_iter().filter(|signal| *signal != Signal::HUP);
    at_once(ending.chain(others), |signal| {
        let folder = TempDir::new().unwrap();
        let (program, _) = Program::serve(folder.path());
        program.signal(signal);
        let (status, text, data) = program.end();
        assert!(status.success(), "{signal:?}: {text}");
        check_clear(&data);
    });
}

/// The system sends a signal when a file would grow beyond its limit, which ends most programs.
#[test]
fn a_limit_of_the_size_of_files_is_a_fault_of_the_journal() {
    let folder = TempDir::new().unwrap();
    let rig = real_time_rig(folder.path());
    let simulated = fs::read_to_string(&rig).unwrap().replace("\"real\"", "\"virtual\"");
    fs::write(&rig, simulated).unwrap();
    let output = Command::new("sh")
        .args(["-c", "ulimit -f 700; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_rigd")])
        .args(["run", "config/protocols/smoke.toml"])
        .args(["--rig", rig.to_str().unwrap()])
        .args(["--data", folder.path().join("data").to_str().unwrap()])
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{text}");
    assert!(text.contains("journal: cannot be written: "), "{text}");
    assert!(text.contains("probe: clear"), "{text}");
}

#[test]
fn homing_is_ended_by_a_signal() {
    for signal in SIGNALS {
        let folder = TempDir::new().unwrap();
        let program = Program::start(folder.path(), &["home"]);
        program.wait_for_record(
            "homing to begin",
            |record| matches!(record, Record::Operator(operator) if operator.action.starts_with("home ")),
        );
        program.signal(signal);
        let (status, text, _) = program.end();
        assert_eq!(status.code(), Some(130), "{signal:?}: {text}");
    }
}

#[test]
fn clients_that_hold_half_a_request_do_not_hold_the_daemon() {
    let folder = TempDir::new().unwrap();
    let (program, address) = Program::serve(folder.path());
    let halves: [&str; 4] = [
        "",
        "GET /api/v1/rig HTT",
        "POST /api/v1/runs HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\n\
         content-length: 100\r\n\r\n{",
        "GET /api/v1/events HTTP/1.1\r\nhost: localhost\r\n\r\n",
    ];
    let clients = halves.map(|half| {
        let mut client = TcpStream::connect(&address).unwrap();
        client.write_all(half.as_bytes()).unwrap();
        client
    });
    let mut streaming = &clients[3];
    streaming.read_exact(&mut [0; 15]).unwrap();
    program.signal(Signal::TERM);
    let began = Instant::now();
    let (status, text, data) = program.end();
    assert!(status.success(), "{text}");
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
    check_clear(&data);
}

#[test]
fn a_daemon_that_ends_says_of_a_probe_that_was_lowered_by_hand_that_it_is_not_clear() {
    let folder = TempDir::new().unwrap();
    let (program, address) = Program::serve(folder.path());
    program.wait_for_record(
        "service",
        |record| matches!(record, Record::StateChanged(change) if change.state == "idle"),
    );
    let order = r#"{"axis": "linear", "to": 23.5}"#;
    let length = order.len();
    let headers = format!("content-type: application/json\r\ncontent-length: {length}\r\n");
    let lowered = program::ask(&address, "POST /api/v1/moves", &headers, order);
    assert!(lowered.starts_with("HTTP/1.1 202 "), "{lowered}");
    program.wait_for_record("the move", |record| match record {
        Record::Moved(moved) => moved.axis == Axis::LinearMm && moved.read_back < 23.6,
        _ => false,
    });
    let began = Instant::now();
    while !request(&address, "GET /api/v1/rig", "").contains("\"state\":\"idle\"") {
        assert!(began.elapsed() < PATIENCE, "the move does not end");
    }
    program.signal(Signal::TERM);
    let (status, text, _) = program.end();
    assert!(status.success(), "{text}");
    assert!(text.contains("the probe is not clear") && text.contains("`rigd safe`"), "{text}");
}

#[test]
fn a_second_signal_ends_the_daemon_at_once_and_says_where_the_probe_is() {
    let folder = TempDir::new().unwrap();
    let (mut program, address) = Program::serve(folder.path());
    program.wait_for_record(
        "service",
        |record| matches!(record, Record::StateChanged(change) if change.state == "idle"),
    );
    let begun = request(&address, "POST /api/v1/runs", "x-operator: Grace Hopper\r\n");
    assert!(begun.starts_with("HTTP/1.1 202 "), "{begun}");
    program.wait_until_lowered();
    program.signal(Signal::TERM);
    program.wait_for_line("interrupt again");
    program.signal(Signal::TERM);
    let began = Instant::now();
    let (status, text, data) = program.end();
    assert_eq!(status.code(), Some(130), "{text}");
    assert!(began.elapsed() < Duration::from_secs(1), "{:?}", began.elapsed());
    assert!(text.contains("it is left as it is, and the probe is lowered"), "{text}");
    let reader = Reader::open(&data).unwrap();
    let run = reader.find("latest").unwrap();
    let left = reader.interruption(&run).unwrap().unwrap();
    assert!(matches!(left.probe, ProbeWord::MayTouch { .. }), "{left:?}");
    let asked = reader.records(run.id).unwrap().into_iter().find_map(|stored| {
        match stored.record().unwrap() {
            Record::Operator(operator) => Some((operator.action, operator.who)),
            _ => None,
        }
    });
    assert_eq!(asked.unwrap(), ("run".to_owned(), "Grace Hopper".to_owned()));
}

/// What another command says of the data and the rig of a program.
fn ask(folder: &Path, args: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.args(args).args(["--data", folder.join("data").to_str().unwrap()]);
    if matches!(args[0], "doctor" | "home") {
        command.args(["--rig", folder.join("rig.toml").to_str().unwrap()]);
    }
    let output = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn a_run_that_was_killed_in_contact_is_not_passed_over_in_silence() {
    const SAYS: &str = "smoke-1 was interrupted at ";
    const OPEN: &str = "; the probe may be in the sample (";
    let folder = TempDir::new().unwrap();
    let program = Program::start(folder.path(), &["run", "config/protocols/smoke.toml"]);
    program.wait_until_lowered();
    // A run is running as long as its program is alive.
    let (_, runs, notes) = ask(folder.path(), &["runs"]);
    assert!(runs.contains("running") && notes.is_empty(), "{runs}{notes}");
    let (_, show, _) = ask(folder.path(), &["show", "latest"]);
    assert!(show.contains("running") && !show.contains("interrupted"), "{show}");
    let (_, doctor, _) = ask(folder.path(), &["doctor"]);
    assert!(doctor.contains("in use by another rigd") && !doctor.contains("probe:"), "{doctor}");

    program.signal(Signal::KILL);
    program.end();
    // Asking changes nothing: it is said every time.
    for _ in 0..2 {
        let (code, doctor, _) = ask(folder.path(), &["doctor"]);
        assert_eq!(code, Some(1), "{doctor}");
        let line = doctor.lines().find(|line| line.contains(SAYS)).unwrap();
        assert!(line.starts_with("problem") && line.contains(OPEN), "{line}");
        assert!(line.contains(" UTC in step "), "{line}");
        let (_, runs, notes) = ask(folder.path(), &["runs"]);
        assert!(runs.contains("interrupted") && !runs.contains("running"), "{runs}");
        assert!(notes.contains(SAYS) && notes.contains(OPEN), "{notes}");
        let (_, show, _) = ask(folder.path(), &["show", "smoke-1"]);
        assert!(show.contains("interrupted at ") && show.contains(OPEN), "{show}");
        let (_, show, _) = ask(folder.path(), &["show", "latest", "--json"]);
        let show: serde_json::Value = serde_json::from_str(&show).unwrap();
        assert_eq!(show["status"], "interrupted");
        assert_eq!(show["interruption"]["probe"], "may be in contact");
        assert!(show["interruption"]["step"].as_str().unwrap().starts_with("main/"), "{show}");
    }

    let (code, _, notes) = ask(folder.path(), &["home"]);
    assert!(code == Some(0) && notes.contains(SAYS) && notes.contains(OPEN), "{notes}");
    let (code, doctor, _) = ask(folder.path(), &["doctor"]);
    assert!(code == Some(0) && doctor.contains("the probe was left clear"), "{doctor}");
    let (_, _, notes) = ask(folder.path(), &["runs"]);
    assert_eq!(notes, "");
    let (_, show, _) = ask(folder.path(), &["show", "smoke-1"]);
    assert!(
        show.contains("may have been in the sample; a later read-back showed it clear"),
        "{show}"
    );
}

#[test]
fn hanging_up_is_ignored_where_that_was_asked_for() {
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    let rig = real_time_rig(folder.path());
    let script = "trap '' HUP; exec \"$@\"";
    let mut child = Command::new("sh")
        .args(["-c", script, "sh", env!("CARGO_BIN_EXE_rigd"), "move", "linear", "23.5"])
        .args(["--data", data.to_str().unwrap(), "--rig", rig.to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let stderr = BufReader::new(child.stderr.take().unwrap());
    let program = Program { child, stderr, data };
    program.wait_until_lowered();
    program.signal(Signal::HUP);
    let (status, text, _) = program.end();
    assert!(status.success(), "{text}");
}

#[test]
fn a_stop_gets_through_when_every_connection_is_taken() {
    let folder = TempDir::new().unwrap();
    // So few handles leave room for no stream, and for 128 connections.
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -n 384; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_rigd")]);
    let args = ["serve", "--listen", "127.0.0.1:0"];
    let mut program = Program::start_by(limited, folder.path(), &args);
    let address = program.wait_for_address();
    // As many as there may be; each keeps its place for five seconds.
    let held: Vec<TcpStream> = (0..128).map(|_| TcpStream::connect(&address).unwrap()).collect();
    let refused = request(&address, "GET /api/v1/rig", "");
    assert!(refused.starts_with("HTTP/1.1 503 "), "{refused}");
    assert!(refused.contains("application/problem+json"), "{refused}");
    let stopped = request(&address, "POST /api/v1/stop", "");
    assert!(stopped.starts_with("HTTP/1.1 200 "), "{stopped}");
    drop(held);
    program.signal(Signal::TERM);
    let (_, text, _) = program.end();
    assert!(text.contains("closing"), "{text}");
}

#[test]
fn a_daemon_on_every_address_can_be_called_and_asks_for_its_token() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("token");
    fs::write(&path, "0123456789abcdef\n").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    let token = path.to_str().unwrap();
    let args = ["serve", "--listen", "0.0.0.0:0", "--token-file", token];
    let mut program = Program::start(folder.path(), &args);
    let line = program.wait_for_line("listening on");
    let address = line.split_once("http://").unwrap().1.split_once('/').unwrap().0.to_owned();
    assert!(address.starts_with("localhost:"), "{line}");
    let path = "GET /api/v1/rig";
    assert!(request(&address, path, "").starts_with("HTTP/1.1 401 "));
    let wrong = request(&address, path, "authorization: Bearer 0123456789abcdeX\r\n");
    assert!(wrong.starts_with("HTTP/1.1 401 "), "{wrong}");
    let right = request(&address, path, "authorization: Bearer 0123456789abcdef\r\n");
    assert!(right.starts_with("HTTP/1.1 200 "), "{right}");
    program.signal(Signal::TERM);
    assert!(program.end().0.success());
}

#[test]
fn what_would_open_the_rig_to_a_network_is_refused() {
    let serve = |args: &[&str]| -> Output {
        Command::new(env!("CARGO_BIN_EXE_rigd")).arg("serve").args(args).output().unwrap()
    };
    let (folder, missing) = (TempDir::new().unwrap(), "no-such-file");
    let path = folder.path().join("token");
    fs::write(&path, "0123456789abcdef").unwrap();
    let open = path.to_str().unwrap();
    let rows: [(&[&str], &str); 6] = [
        (&["--listen", "0.0.0.0:0"], "`rigd token new NAME --data DIR`"),
        (&["--listen", "[::]:0"], "`rigd token new NAME --data DIR`"),
        (&["--listen", "192.0.2.1:80"], "`rigd token new NAME --data DIR`"),
        (&["--token-file", missing], missing),
        (&["--listen", "0.0.0.0:0", "--token-file", open], "chmod 600"),
        (&["--allow-host", "http://bench"], "without port or path"),
    ];
    for (args, reason) in rows {
        let output = serve(args);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(text.contains(reason), "{args:?}: {text}");
    }
}
