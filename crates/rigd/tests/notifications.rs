//! Notifications of a daemon: attempts, restart, targets that fail, forms.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    collections::VecDeque,
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::{TcpListener, TcpStream},
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::Command,
    sync::mpsc::{Receiver, Sender, channel},
    thread,
    time::Instant,
};

use program::{PATIENCE, Program, real_time_rig, request};
use rustix::process::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;

/// What a server does with a request.
#[derive(Debug, Clone, Copy)]
enum Deed {
    /// It closes the connection without an answer.
    Close,
    /// It reads the request and never answers.
    Hang,
    /// It answers with this status.
    Answer(u16),
}

/// A request that reached a server.
#[derive(Debug)]
struct Received {
    head: String,
    body: Value,
}

/// A server that does one thing after the other, and the last one for ever.
struct Server {
    address: String,
    received: Receiver<Received>,
}

impl Server {
    fn start(deeds: &[Deed]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let (sender, received) = channel();
        let mut deeds: VecDeque<Deed> = deeds.iter().copied().collect();
        thread::spawn(move || {
            // Connections that hang are kept open.
            let mut open = Vec::new();
            for client in listener.incoming() {
                let deed = if deeds.len() > 1 { deeds.pop_front() } else { deeds.front().copied() };
                if let Some(client) = serve(client.unwrap(), deed.unwrap(), &sender) {
                    open.push(client);
                }
            }
        });
        Self { address, received }
    }

    fn next(&self) -> Received {
        self.received.recv_timeout(PATIENCE).expect("a request")
    }
}

/// Reads a request and does with it what is asked for; gives a connection back that stays open.
fn serve(client: TcpStream, deed: Deed, sender: &Sender<Received>) -> Option<TcpStream> {
    let mut reader = BufReader::new(client);
    let (mut head, mut length) = (String::new(), 0);
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line).unwrap() == 0 || line == "\r\n" {
            break;
        }
        if let Some(text) = line.to_ascii_lowercase().strip_prefix("content-length:") {
            length = text.trim().parse().unwrap();
        }
        head.push_str(&line);
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).unwrap();
    let mut client = reader.into_inner();
    let kept = match deed {
        Deed::Close => None,
        Deed::Hang => Some(client),
        Deed::Answer(status) => {
            let answer = format!("HTTP/1.1 {status} said\r\ncontent-length: 0\r\n\r\n");
            client.write_all(answer.as_bytes()).unwrap();
            None
        }
    };
    // The test may have ended.
    _ = sender.send(Received { head, body: serde_json::from_slice(&body).unwrap() });
    kept
}

/// A daemon with this section `[notifications]`, on the shipped rig in virtual time or on this rig.
fn serve_with(folder: &Path, notifications: &str, rig: Option<&Path>) -> (Program, String) {
    let (config, data) = (folder.join("service.toml"), folder.join("data"));
    let quick = "[notifications]\nretry_after_s = 0.05\n";
    fs::write(&config, format!("{quick}{notifications}")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command
        .args(["serve", "config/protocols/smoke.toml", "--listen", "127.0.0.1:0"])
        .args(["--data", data.to_str().unwrap(), "--config", config.to_str().unwrap()])
        .arg("--rig")
        .arg(rig.unwrap_or(Path::new("config/rigs/simulated.toml")))
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    let mut daemon = Program::spawn(&mut command, data);
    let address = daemon.wait_for_address();
    (daemon, address)
}

fn webhook(name: &str, server: &Server, events: &str) -> String {
    let address = &server.address;
    format!(
        "[[notifications.targets]]\nname = \"{name}\"\nkind = \"webhook\"\n\
         url = \"http://{address}/hook?key=1\"\nevents = [{events}]\n"
    )
}

fn end(daemon: Program) {
    daemon.signal(Signal::TERM);
    let (status, text, _) = daemon.end();
    assert!(status.success(), "{text}");
}

/// Waits until the probe is shown to be clear and a run could begin.
#[track_caller]
fn wait_until_ready(address: &str) {
    let began = Instant::now();
    while !request(address, "GET /readyz", "").starts_with("HTTP/1.1 200") {
        assert!(began.elapsed() < PATIENCE, "the rig is not ready");
    }
}

/// Latches a rig that is ready, which is a fault.
#[track_caller]
fn stop(address: &str) {
    wait_until_ready(address);
    assert!(request(address, "POST /api/v1/stop", "").starts_with("HTTP/1.1 200"));
}

/// Waits until the figures have these lines.
#[track_caller]
fn wait_for_figures(address: &str, lines: &[&str]) {
    let began = Instant::now();
    loop {
        let text = request(address, "GET /metrics", "");
        if lines.iter().all(|wanted| text.lines().any(|line| line == *wanted)) {
            return;
        }
        let of_notifications: Vec<_> =
            text.lines().filter(|line| line.contains("notifications")).collect();
        assert!(began.elapsed() < PATIENCE, "{lines:?}: {of_notifications:#?}");
    }
}

#[test]
fn a_message_is_tried_until_it_is_taken_by_a_server_that_closes_hangs_and_answers_500() {
    let folder = TempDir::new().unwrap();
    let deeds = [Deed::Close, Deed::Hang, Deed::Answer(500), Deed::Answer(200)];
    let server = Server::start(&deeds);
    let text = format!("attempt_s = 0.5\n{}", webhook("chat", &server, "\"fault\""));
    let (daemon, address) = serve_with(folder.path(), &text, None);
    stop(&address);
    let tried: Vec<_> = deeds.iter().map(|_| server.next()).collect();
    let body = &tried[0].body;
    assert!(tried.iter().all(|again| again.body == *body), "{tried:?}");
    assert!(tried[0].head.starts_with("POST /hook?key=1 HTTP/1.1\r\n"), "{}", tried[0].head);
    assert_eq!((&body["event"], &body["rig"]), (&json!("fault"), &json!("simulated bench")));
    assert_eq!((&body["is_simulated"], &body["run"]), (&json!(true), &Value::Null));
    assert_eq!(body["title"], "simulated bench (simulated): fault, the rig is latched");
    assert!(body["text"].as_str().unwrap().contains("The probe is clear."), "{body}");
    wait_for_figures(
        &address,
        &[
            "rigd_notifications_waiting{target=\"chat\"} 0.0",
            "rigd_notifications_sent_total{target=\"chat\"} 1",
            "rigd_notifications_failed_total{target=\"chat\"} 3",
            "rigd_notifications_given_up_total{target=\"chat\"} 0",
        ],
    );
    end(daemon);
}

#[test]
fn a_message_is_given_up_after_its_last_attempt() {
    let folder = TempDir::new().unwrap();
    // Nobody listens at this address any more.
    let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let server = Server { address: closed.to_string(), received: channel().1 };
    let text = format!("attempts = 3\n{}", webhook("gone", &server, "\"fault\""));
    let (daemon, address) = serve_with(folder.path(), &text, None);
    stop(&address);
    wait_for_figures(
        &address,
        &[
            "rigd_notifications_waiting{target=\"gone\"} 0.0",
            "rigd_notifications_failed_total{target=\"gone\"} 3",
            "rigd_notifications_given_up_total{target=\"gone\"} 1",
        ],
    );
    end(daemon);
}

#[test]
fn after_a_kill_the_outbox_goes_on_with_the_same_message() {
    let folder = TempDir::new().unwrap();
    let server = Server::start(&[Deed::Answer(500), Deed::Answer(503), Deed::Answer(200)]);
    let text = webhook("chat", &server, "\"fault\"");
    let (mut daemon, address) = serve_with(folder.path(), &text, None);
    stop(&address);
    let first = server.next();
    daemon.child.kill().unwrap();
    daemon.child.wait().unwrap();
    let (daemon, address) = serve_with(folder.path(), &text, None);
    // The rig is latched again, which is another message.
    let again = (0..4).map(|_| server.next()).find(|again| again.body["id"] == first.body["id"]);
    assert_eq!(again.expect("the first message again").body, first.body);
    wait_for_figures(&address, &["rigd_notifications_waiting{target=\"chat\"} 0.0"]);
    end(daemon);
}

#[test]
fn a_target_that_hangs_delays_neither_the_run_nor_another_target_nor_the_end() {
    let folder = TempDir::new().unwrap();
    let (dead, alive) = (Server::start(&[Deed::Hang]), Server::start(&[Deed::Answer(200)]));
    let targets = [webhook("dead", &dead, "\"end\""), webhook("alive", &alive, "\"end\"")];
    let text = format!("attempt_s = 120\n{}", targets.concat());
    let (daemon, address) = serve_with(folder.path(), &text, None);
    for number in 1..=2 {
        wait_until_ready(&address);
        assert!(request(&address, "POST /api/v1/runs", "").starts_with("HTTP/1.1 202"));
        let told = alive.next().body;
        assert_eq!(
            (&told["event"], &told["run"]),
            (&json!("end"), &json!(format!("smoke-{number}")))
        );
        let text = told["text"].as_str().unwrap();
        assert!(text.contains("18 touches measured, 0 refused."), "{text}");
    }
    assert_eq!(dead.next().body["run"], "smoke-1");
    wait_for_figures(
        &address,
        &[
            "rigd_notifications_waiting{target=\"dead\"} 2.0",
            "rigd_notifications_failed_total{target=\"dead\"} 0",
            "rigd_notifications_sent_total{target=\"alive\"} 2",
        ],
    );
    end(daemon);
    let left: Value =
        serde_json::from_slice(&fs::read(folder.path().join("data/outbox.json")).unwrap()).unwrap();
    let of = |message: &Value| (message["target"].clone(), message["failed"].clone());
    let left: Vec<_> = left["messages"].as_array().unwrap().iter().map(of).collect();
    // The attempt under way was not waited for: it would have failed.
    assert_eq!(left, [(json!("dead"), json!(0)), (json!("dead"), json!(0))]);
}

/// A file that only its owner reads.
fn secret(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    path
}

#[test]
fn a_prompt_goes_to_ntfy_with_secrets_from_files_and_is_not_sent_after_its_run_has_ended() {
    let folder = TempDir::new().unwrap();
    let ntfy = Server::start(&[Deed::Answer(200)]);
    let slow = Server::start(&[Deed::Answer(500)]);
    let url = format!("http://{}/base/bench-7\n", ntfy.address);
    secret(folder.path(), "url", &url);
    secret(folder.path(), "token", "tk_0123456789abcdef\n");
    let target = "[[notifications.targets]]\nname = \"phone\"\nkind = \"ntfy\"\nurl_file = \"url\"\n\
                  token_file = \"token\"\nevents = [\"prompt\"]\n";
    let text = format!("attempts = 100\n{target}{}", webhook("slow", &slow, "\"prompt\""));
    let rig = real_time_rig(folder.path());
    let waits = fs::read_to_string(&rig).unwrap().replace("\"answers\"\n", "\"waits\"\n");
    assert!(waits.contains("person = \"waits\""));
    fs::write(&rig, waits).unwrap();
    let (daemon, address) = serve_with(folder.path(), &text, Some(&rig));
    wait_until_ready(&address);
    assert!(request(&address, "POST /api/v1/runs", "").starts_with("HTTP/1.1 202"));
    let Received { head, body } = ntfy.next();
    assert!(head.starts_with("POST /base/ HTTP/1.1\r\n"), "{head}");
    assert!(head.contains("authorization: Bearer tk_0123456789abcdef\r\n"), "{head}");
    assert_eq!((&body["topic"], &body["priority"]), (&json!("bench-7"), &json!(4)));
    assert_eq!(body["title"], "simulated bench (simulated): a person is needed");
    let text = body["message"].as_str().unwrap();
    assert!(text.starts_with("Put sample ") && text.ends_with("\nRun: smoke-1"), "{text}");
    // The other target still tries when the run ends.
    slow.next();
    wait_for_figures(&address, &["rigd_notifications_waiting{target=\"slow\"} 1.0"]);
    let abort = request(&address, "POST /api/v1/stop", "");
    assert!(abort.starts_with("HTTP/1.1 200"), "{abort}");
    wait_for_figures(&address, &["rigd_notifications_waiting{target=\"slow\"} 0.0"]);
    let figures = request(&address, "GET /metrics", "");
    assert!(figures.contains("rigd_notifications_sent_total{target=\"slow\"} 0"), "{figures}");
    end(daemon);
}

#[test]
fn a_mail_is_handed_to_sendmail_again_after_it_has_failed() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let program = format!(
        "#!/bin/sh\nif mkdir {tried} 2> /dev/null; then exit 75; fi\n\
         printf '%s\\n' \"$@\" > {args}\ncat > {mail}.new\nmv {mail}.new {mail}\n",
        tried = at("tried").display(),
        args = at("args").display(),
        mail = at("mail").display()
    );
    fs::write(at("sendmail"), program).unwrap();
    fs::set_permissions(at("sendmail"), fs::Permissions::from_mode(0o755)).unwrap();
    let target = "[[notifications.targets]]\nname = \"mail\"\nkind = \"mail\"\nsendmail = \"sendmail\"\n\
                  to = [\"ada@lab.example\", \"grace@lab.example\"]\nfrom = \"rigd@bench.example\"\n\
                  events = [\"fault\"]\n";
    let (daemon, address) = serve_with(folder.path(), target, None);
    stop(&address);
    wait_for_figures(
        &address,
        &[
            "rigd_notifications_sent_total{target=\"mail\"} 1",
            "rigd_notifications_failed_total{target=\"mail\"} 1",
        ],
    );
    let args = fs::read_to_string(at("args")).unwrap();
    assert_eq!(args, "-i\n-f\nrigd@bench.example\n--\nada@lab.example\ngrace@lab.example\n");
    let mail = fs::read_to_string(at("mail")).unwrap();
    for line in [
        "From: rigd@bench.example\n",
        "To: ada@lab.example, grace@lab.example\n",
        "Subject: simulated bench (simulated): fault, the rig is latched\n",
        "\n\n",
        "The probe is clear.\n",
    ] {
        assert!(mail.contains(line), "{line}: {mail}");
    }
    end(daemon);
}

#[test]
fn a_secret_that_others_can_read_and_a_wrong_url_are_refused_at_the_start() {
    let folder = TempDir::new().unwrap();
    let open = secret(folder.path(), "open", "0123456789abcdef\n");
    fs::set_permissions(open, fs::Permissions::from_mode(0o644)).unwrap();
    secret(folder.path(), "url", "ftp://host.example/topic\n");
    let target = "[[notifications.targets]]\nname = \"a\"\nkind = \"webhook\"\n";
    let config = folder.path().join("service.toml");
    for (keys, fault) in [
        ("url = \"http://h/\"\ntoken_file = \"open\"\n", "has mode 644"),
        ("url = \"http://h/\"\ntoken_file = \"gone\"\n", "target a of the notifications"),
        ("url_file = \"url\"\n", "has no URL of http or https"),
    ] {
        fs::write(&config, format!("{target}{keys}")).unwrap();
        let data = folder.path().join("data");
        let output = Command::new(env!("CARGO_BIN_EXE_rigd"))
            .args(["serve", "--listen", "127.0.0.1:0", "--rig", "config/rigs/simulated.toml"])
            .args(["--data", data.to_str().unwrap(), "--config", config.to_str().unwrap()])
            .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{keys}: {said}");
        assert!(said.contains(fault), "{keys}: {said}");
    }
}

#[test]
fn a_first_start_with_targets_on_an_old_journal_tells_nothing_of_before() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve_with(folder.path(), "", None);
    run_to_its_end(&address, 1);
    end(daemon);
    let server = Server::start(&[Deed::Answer(200)]);
    let text = webhook("chat", &server, "\"end\", \"fault\"");
    let (daemon, address) = serve_with(folder.path(), &text, None);
    run_to_its_end(&address, 2);
    assert_eq!(server.next().body["run"], "smoke-2");
    end(daemon);
    // Without targets nobody is told, later neither.
    let (daemon, address) = serve_with(folder.path(), "", None);
    run_to_its_end(&address, 3);
    end(daemon);
    let (daemon, address) = serve_with(folder.path(), &text, None);
    run_to_its_end(&address, 4);
    assert_eq!(server.next().body["run"], "smoke-4");
    end(daemon);
}

/// Runs the loaded protocol.
#[track_caller]
fn run_to_its_end(address: &str, number: u32) {
    wait_until_ready(address);
    assert!(request(address, "POST /api/v1/runs", "").starts_with("HTTP/1.1 202"));
    let began = Instant::now();
    let ended = format!(r#""name":"smoke-{number}","protocol":"smoke","status":"completed""#);
    loop {
        let rig = request(address, "GET /api/v1/runs", "");
        if rig.replace(char::is_whitespace, "").contains(&ended) {
            return;
        }
        assert!(began.elapsed() < PATIENCE, "{rig}");
    }
}
