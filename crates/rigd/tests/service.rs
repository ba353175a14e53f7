//! The daemon under a service manager: what it tells, what it shows, and its files.

// systemd is of Linux.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs::{self, File},
    net::TcpListener,
    os::{
        fd::{AsFd, AsRawFd},
        unix::net::UnixDatagram,
    },
    path::Path,
    process::{Command, Stdio},
    time::Instant,
};

use program::{PATIENCE, Program, check_clear, real_time_rig, request};
use rustix::{
    io::{FdFlags, fcntl_setfd},
    process::Signal,
};
use serde_json::Value;
use tempfile::TempDir;

/// A daemon on a real-time rig whose service manager is this test.
fn serve_for(folder: &Path, watchdog_us: &str) -> (Program, String, UnixDatagram) {
    let path = folder.join("notify");
    let manager = UnixDatagram::bind(&path).unwrap();
    manager.set_read_timeout(Some(PATIENCE)).unwrap();
    let data = folder.join("data");
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command
        .args(["serve", "config/protocols/smoke.toml", "--listen", "127.0.0.1:0"])
        .args(["--data", data.to_str().unwrap()])
        .args(["--rig", real_time_rig(folder).to_str().unwrap()])
        .env("NOTIFY_SOCKET", &path)
        .env("WATCHDOG_USEC", watchdog_us)
        .env_remove("WATCHDOG_PID")
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    let mut daemon = Program::spawn(&mut command, data);
    let address = daemon.wait_for_address();
    (daemon, address, manager)
}

/// The next message with this word.
#[track_caller]
fn told(manager: &UnixDatagram, word: &str) -> String {
    let (began, mut bytes) = (Instant::now(), [0; 4096]);
    loop {
        assert!(began.elapsed() < PATIENCE, "the service manager was not told {word:?}");
        let length = manager.recv(&mut bytes).unwrap();
        let text = String::from_utf8_lossy(&bytes[..length]).into_owned();
        if text.contains(word) {
            return text;
        }
    }
}

/// Waits until a run could begin.
fn wait_until_ready(address: &str) {
    let began = Instant::now();
    while !request(address, "GET /readyz", "").starts_with("HTTP/1.1 200") {
        assert!(began.elapsed() < PATIENCE, "the rig is not ready");
    }
}

fn body(answer: &str) -> &str {
    answer.split_once("\r\n\r\n").unwrap().1
}

#[test]
fn the_manager_is_told_ready_alive_and_stopping_and_the_streams_end() {
    let folder = TempDir::new().unwrap();
    let (daemon, address, manager) = serve_for(folder.path(), "400000");
    told(&manager, "READY=1");
    let alive = told(&manager, "WATCHDOG=1");
    assert!(alive.contains("STATUS="), "{alive}");
    wait_until_ready(&address);
    assert!(request(&address, "POST /api/v1/runs", "").starts_with("HTTP/1.1 202"));
    let running = told(&manager, "touches of");
    assert!(running.contains("WATCHDOG=1"), "{running}");
    daemon.wait_until_lowered();
    let stream = std::thread::spawn(move || request(&address, "GET /api/v1/events", ""));
    daemon.signal(Signal::TERM);
    told(&manager, "STOPPING=1");
    let (status, text, data) = daemon.end();
    assert!(status.success(), "{text}");
    // The stream has ended with the daemon, and not by a time limit of the client.
    drop(stream.join().unwrap());
    check_clear(&data);
}

#[test]
fn a_latched_rig_is_not_ready_and_no_reason_to_restart_the_daemon() {
    let folder = TempDir::new().unwrap();
    let (daemon, address, manager) = serve_for(folder.path(), "400000");
    wait_until_ready(&address);
    assert!(request(&address, "POST /api/v1/stop", "").starts_with("HTTP/1.1 200"));
    told(&manager, "STATUS=latched");
    let ready = request(&address, "GET /readyz", "");
    assert!(ready.starts_with("HTTP/1.1 503"), "{ready}");
    let problem: Value = serde_json::from_str(body(&ready)).unwrap();
    assert_eq!(problem["detail"], "the rig is latched after a fault");
    assert!(request(&address, "GET /healthz", "").starts_with("HTTP/1.1 200"));
    told(&manager, "WATCHDOG=1");
    daemon.signal(Signal::TERM);
    assert!(daemon.end().0.success());
}

#[test]
fn figures_count_what_happened_in_the_form_that_prometheus_reads() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = Program::serve(folder.path());
    wait_until_ready(&address);
    assert!(request(&address, "POST /api/v1/runs", "").starts_with("HTTP/1.1 202"));
    daemon.wait_for_record("a touch", |record| matches!(record, rig_store::Record::TouchResult(_)));
    let answer = request(&address, "GET /metrics", "");
    assert!(answer.contains("content-type: application/openmetrics-text"), "{answer}");
    let text = body(&answer);
    let value = |name: &str| -> f64 {
        let mut lines = text.lines().filter_map(|line| line.rsplit_once(' '));
        let line = lines.find(|(of, _)| *of == name);
        line.unwrap_or_else(|| panic!("{name}: {text}")).1.parse().unwrap()
    };
    assert!(value("rigd_touches_measured_total") >= 1.0);
    assert!(value("rigd_sweeps_total{outcome=\"accepted\"}") >= 1.0);
    assert!(value("rigd_device_requests_total{device=\"linear stage\"}") > 10.0);
    let round_trips = "rigd_device_round_trip_seconds_count{device=\"analyzer\"}";
    assert!(value(round_trips) > 10.0 && value("rigd_journal_commit_seconds_count") > 10.0);
    assert!((100.0..200.0).contains(&value("rigd_resonance_hertz")));
    // The sensor without a sample: the scene has a Q of some tens, and drifts by little in a minute.
    assert!((130.0..150.0).contains(&value("rigd_no_load_resonance_hertz")));
    assert!((1e-4..0.1).contains(&value("rigd_no_load_resonance_sigma_hertz")));
    assert!((5.0..500.0).contains(&value("rigd_no_load_quality_factor")));
    assert!(value("rigd_no_load_drift_hertz").abs() < 1.0);
    assert!(value("rigd_disk_free_bytes") > 0.0 && text.ends_with("# EOF\n"));
    // Every figure of the dashboard and of the alerts exists.
    let service = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/service");
    let asked: String = ["grafana.json", "alerts.yml"]
        .map(|file| fs::read_to_string(service.join(file)).unwrap())
        .concat();
    let is_name = |letter: char| letter.is_ascii_lowercase() || letter == '_';
    let names = asked.split(|letter| !is_name(letter)).filter(|word| word.starts_with("rigd_"));
    for name in names.filter(|name| !name.contains("refused") && !name.contains("faults")) {
        assert!(text.contains(name), "{name}");
    }
    daemon.signal(Signal::TERM);
    assert!(daemon.end().0.success());
}

/// A daemon that is given `count` sockets from this one on, as systemd gives them.
fn serve_on<S: AsFd>(folder: &Path, socket: &S, count: &str) -> Program {
    fcntl_setfd(socket, FdFlags::empty()).unwrap();
    let data = folder.join("data");
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command
        // The settings name an address of another computer (RFC 5737).
        .args(["serve", "config/protocols/smoke.toml", "--listen", "192.0.2.1:8137"])
        .args(["--data", data.to_str().unwrap()])
        .args(["--rig", real_time_rig(folder).to_str().unwrap()])
        .env("LISTEN_FDS", count)
        .env("LISTEN_FDS_FIRST_FD", socket.as_fd().as_raw_fd().to_string())
        .env_remove("LISTEN_PID")
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    Program::spawn(&mut command, data)
}

#[test]
fn a_socket_of_the_service_manager_comes_before_the_settings() {
    let folder = TempDir::new().unwrap();
    let socket = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut daemon = serve_on(folder.path(), &socket, "1");
    let address = daemon.wait_for_address();
    assert_eq!(address, socket.local_addr().unwrap().to_string());
    drop(socket);
    wait_until_ready(&address);
    daemon.signal(Signal::TERM);
    let (status, text, _) = daemon.end();
    assert!(status.success(), "{text}");
}

#[test]
fn sockets_that_cannot_be_served_are_refused() {
    let folder = TempDir::new().unwrap();
    let refused = |daemon: Program, word: &str| {
        let (status, text, _) = daemon.end();
        assert_eq!(status.code(), Some(1), "{text}");
        assert!(text.contains(word), "{text}");
    };
    let socket = TcpListener::bind("127.0.0.1:0").unwrap();
    refused(serve_on(folder.path(), &socket, "2"), "gives 2 sockets");
    let file = File::open("/dev/null").unwrap();
    refused(serve_on(folder.path(), &file, "1"), "is not a socket");
    // Other computers reach this one.
    let everywhere = TcpListener::bind("0.0.0.0:0").unwrap();
    let (status, text, _) = serve_on(folder.path(), &everywhere, "1").end();
    assert!(!status.success() && text.contains("rigd token new"), "{text}");
}

#[test]
fn the_unit_is_hardened_as_systemd_itself_judges() {
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/service/rigd.service");
    let judged = Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--threshold=20", "--no-pager"])
        .arg(&unit)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    // Where there is no systemd, the gate of another machine judges.
    if let Ok(status) = judged {
        assert!(status.success(), "the exposure of the unit is above 2.0");
    }
    let text = fs::read_to_string(unit).unwrap();
    for line in ["Type=notify", "WatchdogSec=60", "ExecStopPost=/usr/bin/rigd safe"] {
        assert!(text.contains(line), "{line}");
    }
}
