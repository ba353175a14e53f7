//! The commands that speak to a running daemon, which they find by its data directory.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;
#[expect(dead_code, reason = "another test uses more of it")]
#[path = "support/terminal.rs"]
mod terminal;

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    os::unix::fs::PermissionsExt,
    path::Path,
    process::{Child, Command, Output, Stdio},
};

use program::{Program, check_clear};
use rig_model::Orientation;
use rig_store::{Reader, Record};
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;
use terminal::{Bench, Terminal, narrow};

const TOKEN: &str = "0123456789abcdef0123456789abcdef";

fn command(data: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.args(args).arg("--data").arg(data).stdin(Stdio::null());
    command
}

fn rigd(data: &Path, args: &[&str]) -> Output {
    command(data, args).output().unwrap()
}

/// Runs a command that must end with this code, and gives its two outputs as one text.
#[track_caller]
fn check(data: &Path, args: &[&str], code: i32) -> String {
    let output = rigd(data, args);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(code), "{args:?}: {text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{args:?}: {text}");
    text + std::str::from_utf8(&output.stderr).unwrap()
}

/// Begins a run over HTTP.
fn begin(address: &str) {
    let mut stream = TcpStream::connect(address).unwrap();
    let request = format!(
        "POST /api/v1/runs HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {TOKEN}\r\n\
         Content-Length: 0\r\nConnection: close\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
}

fn watch(data: &Path) -> (Child, BufReader<impl Read>) {
    let mut child =
        command(data, &["watch"]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap());
    wait_for(&mut lines, "idle");
    (child, lines)
}

fn wait_for(lines: &mut impl BufRead, part: &str) {
    let mut line = String::new();
    while !line.contains(part) {
        line.clear();
        assert_ne!(lines.read_line(&mut line).unwrap(), 0, "ended before {part}");
    }
}

#[test]
fn a_run_of_a_daemon_is_watched_paused_resumed_aborted_and_stopped_from_a_terminal() {
    let folder = TempDir::new().unwrap();
    let token = folder.path().join("token");
    fs::write(&token, TOKEN).unwrap();
    fs::set_permissions(&token, fs::Permissions::from_mode(0o600)).unwrap();
    let data = folder.path().join("data");
    let none = check(&data, &["status"], 1);
    assert!(none.contains("no daemon serves"), "{none}");

    let args = ["serve", "config/protocols/smoke.toml", "--listen", "127.0.0.1:0", "--token-file"];
    let mut daemon =
        Program::start(folder.path(), &[&args[..], &[token.to_str().unwrap()]].concat());
    let line = daemon.wait_for_line("listening on");
    let address = line.split_once("http://").unwrap().1.trim().trim_end_matches('/').to_owned();
    let (mut watching, mut lines) = watch(&data);
    let status = check(&data, &["status"], 0);
    assert!(status.contains("SIMULATED"), "{status}");
    assert_eq!(status.matches("requests, all answered; last answer").count(), 3, "{status}");
    for wanted in ["pause", "resume", "abort", "answer"] {
        assert!(check(&data, &[wanted], 3).contains("no run is under way"));
    }
    begin(&address);
    wait_for(&mut lines, "running");
    let status = check(&data, &["status"], 0);
    assert!(status.contains("running") && status.contains("0 of 18 measured"), "{status}");
    // The simulated person may be answering a prompt just now.
    let said = || String::from_utf8(rigd(&data, &["answer"]).stderr).unwrap();
    assert!((0..100).any(|_| said().contains("no prompt is open")), "{}", said());
    check(&data, &["pause", "--operator", "Grace Hopper"], 0);
    wait_for(&mut lines, "paused");
    check(&data, &["resume"], 0);
    wait_for(&mut lines, "running");
    let status = check(&data, &["abort"], 0);
    assert!(status.contains("idle") && status.contains("clear"), "{status}");
    assert_eq!(watching.wait().unwrap().code(), Some(5));

    let status = check(&data, &["stop"], 0);
    assert!(status.contains("latched") && status.contains("`rigd acknowledge`"), "{status}");
    assert_eq!(rigd(&data, &["watch"]).status.code(), Some(4));
    assert!(check(&data, &["acknowledge"], 0).contains("idle"));
    check(&data, &["stop"], 0);
    assert!(check(&data, &["acknowledge", "--nothing-below-probe"], 0).contains("idle"));
    daemon.signal(Signal::TERM);
    let (status, _, data) = daemon.end();
    assert!(status.success());
    check(&data, &["status"], 1);
    check_clear(&data);
    let records = Reader::open(&data).unwrap().events_after(0, 10_000).unwrap();
    let by_grace =
        |record: &Record| matches!(record, Record::Operator(it) if it.who == "Grace Hopper");
    assert!(records.iter().any(|stored| by_grace(&stored.record().unwrap())));
}

/// A person who watches at a terminal, and answers prompts and refused touches from another one.
fn answer(bench: &Bench, folder: &Path) {
    let data = folder.join("data");
    let mut daemon = command(&data, &["serve", "--listen", "127.0.0.1:0"])
        .args([&bench.protocol, Path::new("--rig"), &bench.rig])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(daemon.stderr.take().unwrap());
    let mut lines = said.by_ref().lines().map(Result::unwrap);
    let line = lines.find(|line| line.contains("listening on")).unwrap();
    let address = line.split_once("http://").unwrap().1.trim().trim_end_matches('/').to_owned();
    let mut watching = Terminal::open(&["watch".as_ref(), "--data".as_ref(), &data], 80);
    watching.wait_for_text("idle");
    begin(&address);
    watching.wait_for_text("Put sample 1 under the probe. Then `rigd answer`.");
    assert!(check(&data, &["answer", "skip"], 2).contains("no touch was refused"));
    bench.person.place_sample("1").unwrap();
    check(&data, &["answer"], 0);
    watching.wait_for_text("about its own axis. Then `rigd answer`.");
    bench.person.turn_sensor(Orientation::Left);
    check(&data, &["answer"], 0);
    watching.wait_for_text("touch main/1/left/0/1 was refused");
    assert!(check(&data, &["answer"], 2).contains("`widen`, `repeat`, `skip` or `abort`"));
    assert!(check(&data, &["status"], 0).contains("was refused"));
    check(&data, &["answer", "widen"], 0);
    watching.wait_for_text("\u{2713} main/1/left/0/1");
    watching.wait_for_text("Put sample 2 under the probe. Then `rigd answer`.");
    bench.person.place_sample("2").unwrap();
    check(&data, &["answer"], 0);
    watching.wait_for_text("touch main/2/left/0/1 was refused");
    check(&data, &["answer", "skip"], 0);
    assert_eq!(watching.end(), Some(6), "{}", watching.text());
    assert!(watching.text().contains("1 of 2 touches measured"), "{}", watching.text());
    kill_process(Pid::from_child(&daemon), Signal::TERM).unwrap();
    assert!(daemon.wait().unwrap().success());
    check_clear(&data);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_daemon_asks_is_answered_from_a_terminal() {
    let folder = TempDir::new().unwrap();
    let bench = Bench::start(folder.path(), &narrow()).await;
    tokio::task::spawn_blocking(move || answer(&bench, folder.path())).await.unwrap();
}

#[test]
fn the_help_of_every_command_fits_80_columns() {
    let help = |args: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let commands = help(&["--help"]);
    let commands = commands.lines().skip_while(|line| *line != "Commands:").skip(1);
    let commands: Vec<_> = commands.map_while(|line| line.split_whitespace().next()).collect();
    assert!(commands.len() > 30, "{commands:?}");
    for command in commands {
        let text = [help(&["--help"]), help(&[command, "--help"])].concat();
        let long = text.lines().find(|line| line.chars().count() > 80);
        assert_eq!(long, None, "{command}");
    }
    assert!(help(&["completions", "bash"]).contains("acknowledge"));
    assert!(help(&["man"]).contains(".TH rigd 1"));
    let folder = TempDir::new().unwrap();
    help(&["man", folder.path().to_str().unwrap()]);
    assert!(folder.path().join("rigd-acknowledge.1").exists());
}
