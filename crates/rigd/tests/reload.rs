//! A daemon reads its configuration again while it runs.

// systemd is of Linux.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpListener,
    os::unix::{fs::PermissionsExt, net::UnixDatagram},
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::mpsc::{Receiver, channel},
    thread,
    time::Instant,
};

use program::{PATIENCE, Program, real_time_rig, request};
use rig_store::{Reader, Record};
use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

/// A daemon whose files are in a folder of its own.
struct Bench {
    folder: TempDir,
    daemon: Option<Program>,
    address: String,
    /// What the service manager is told.
    told: Receiver<String>,
}

impl Bench {
    /// Starts it with this service file.
    fn start(service: &str) -> Self {
        let folder = TempDir::new().unwrap();
        let (data, rig) = (folder.path().join("data"), real_time_rig(folder.path()));
        let manager = UnixDatagram::bind(folder.path().join("notify")).unwrap();
        let (sender, told) = channel();
        // It is always read, as by systemd: a full socket would hold the daemon.
        thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(length) = manager.recv(&mut bytes) {
                let text = String::from_utf8_lossy(&bytes[..length]).into_owned();
                if sender.send(text).is_err() {
                    return;
                }
            }
        });
        fs::write(folder.path().join("service.toml"), service).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command
            .args(["serve", "config/protocols/smoke.toml", "--operator", "Ada"])
            .args(["--data", data.to_str().unwrap(), "--rig", rig.to_str().unwrap()])
            .args(["--config", folder.path().join("service.toml").to_str().unwrap()])
            .env("NOTIFY_SOCKET", folder.path().join("notify"))
            .env_remove("WATCHDOG_USEC")
            .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
        let mut daemon = Program::spawn(&mut command, data);
        // Of all addresses of this computer, this one.
        let line = daemon.wait_for_line("listening on");
        let port = line.split_once("http://").unwrap().1.split_once(':').unwrap().1;
        let port: String = port.chars().take_while(char::is_ascii_digit).collect();
        let address = format!("127.0.0.1:{port}");
        Self { folder, daemon: Some(daemon), address, told }
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }

    fn daemon(&self) -> &Program {
        self.daemon.as_ref().unwrap()
    }

    fn service(&self, text: &str) {
        fs::write(self.path("service.toml"), text).unwrap();
    }

    fn rigd(&self, args: &[&str]) -> Output {
        let data = self.path("data");
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(args).args(["--data", data.to_str().unwrap()]).output().unwrap()
    }

    /// What `rigd config reload` prints.
    #[track_caller]
    fn reload(&self) -> String {
        let output = self.rigd(&["config", "reload", "--operator", "Grace"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// What it says when it is refused.
    #[track_caller]
    fn refused(&self) -> String {
        let output = self.rigd(&["config", "reload", "--operator", "Grace"]);
        assert!(!output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
        String::from_utf8(output.stderr).unwrap()
    }

    fn get(&self, headers: &str) -> String {
        request(&self.address, "GET /api/v1/rig", headers)
    }

    /// What the journal says of reloads, the first one first.
    fn notes(&self) -> Vec<String> {
        let events = Reader::open(&self.path("data")).unwrap().events_after(0, 10_000).unwrap();
        let note = |record| match record {
            Record::Operator(done) => Some(format!("{}: {}", done.who, done.action)),
            _ => None,
        };
        let notes = events.iter().filter_map(|stored| note(stored.record().unwrap()));
        notes.filter(|note| note.contains("configuration")).collect()
    }

    /// Waits until the service manager is told something. A daemon whose parent ignores SIGHUP, as under `nohup`, is
    /// never told of a signal.
    #[track_caller]
    fn told(&self, word: &str) {
        let began = Instant::now();
        while !self.told.recv_timeout(PATIENCE).unwrap().contains(word) {
            assert!(began.elapsed() < PATIENCE, "the service manager was not told {word:?}");
        }
    }

    /// Waits for an answer of the daemon.
    #[track_caller]
    fn wait_for(&self, what: &str, is_wanted: impl Fn(&str) -> bool) -> String {
        let began = Instant::now();
        loop {
            let answer = request(&self.address, what, "");
            if is_wanted(&answer) {
                return answer;
            }
            assert!(began.elapsed() < PATIENCE, "{answer}");
        }
    }

    #[track_caller]
    fn wait_until_ready(&self) {
        self.wait_for("GET /readyz", |answer| answer.starts_with("HTTP/1.1 200"));
    }

    #[track_caller]
    fn stop(&self) {
        self.wait_until_ready();
        assert!(request(&self.address, "POST /api/v1/stop", "").starts_with("HTTP/1.1 200"));
        self.wait_for("GET /api/v1/rig", |rig| rig.contains("\"state\":\"latched\""));
    }

    fn end(mut self) {
        let daemon = self.daemon.take().unwrap();
        daemon.signal(Signal::TERM);
        let (status, text, _) = daemon.end();
        assert!(status.success(), "{text}");
    }
}

const LISTEN: &str = "listen = \"127.0.0.1:0\"\n";

/// A secret for everybody, which others cannot read.
fn secret(path: &Path, text: &str) {
    fs::write(path, text).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o600)).unwrap();
}

fn bearer(token: &str) -> String {
    format!("authorization: Bearer {token}\r\n")
}

#[test]
fn what_is_safe_changes_and_what_needs_a_restart_stays_and_is_told() {
    let bench = Bench::start(LISTEN);
    let named = |bench: &Bench| {
        let address = bench.address.clone();
        let mut client = std::net::TcpStream::connect(address).unwrap();
        client
            .write_all(
                b"GET /api/v1/rig HTTP/1.1\r\nhost: lab.example\r\nconnection: close\r\n\r\n",
            )
            .unwrap();
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        answer
    };
    assert!(named(&bench).starts_with("HTTP/1.1 421"));
    assert_eq!(bench.reload(), "nothing has changed\n");
    bench.service(
        "listen = \"127.0.0.1:1\"\nallow_hosts = [\"lab.example\"]\nrelease_queue = true\n",
    );
    let rig = fs::read_to_string(bench.path("rig.toml")).unwrap();
    let other = rig.replacen("name = \"simulated bench\"", "name = \"another bench\"", 1);
    assert_ne!(rig, other);
    fs::write(bench.path("rig.toml"), other).unwrap();
    let said = bench.reload();
    assert!(said.contains("changed: allow_hosts, from none to lab.example\n"), "{said}");
    for kept in [
        "needs a restart: listen, still 127.0.0.1:0 and not 127.0.0.1:1: its port is open",
        "needs a restart: release_queue, still false and not true: it says what happens",
        "needs a restart: name, still \"simulated bench\" and not \"another bench\": motion",
    ] {
        assert!(said.contains(kept), "{kept}: {said}");
    }
    assert!(named(&bench).starts_with("HTTP/1.1 200"));
    assert!(bench.get("").contains("simulated bench"));
    // What waits for a restart is told again, what has changed is not.
    let again = bench.reload();
    assert!(!again.contains("changed:") && again.contains("needs a restart: listen"), "{again}");
    assert_eq!(
        bench.notes(),
        [
            "Grace: reload the configuration: nothing changes",
            "Grace: reload the configuration: allow_hosts; only with a restart: listen, release_queue, name",
            "Grace: reload the configuration: nothing changes; only with a restart: listen, release_queue, name",
        ]
    );
    // As a program sees it.
    let answer = request(&bench.address, "POST /api/v1/config/reload", "");
    let answer: Value = serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap();
    assert_eq!(answer["kept"][0]["wanted"], "127.0.0.1:1");
    bench.end();
}

#[test]
fn a_file_with_a_fault_changes_nothing_and_its_place_is_said() {
    let bench = Bench::start(LISTEN);
    for (text, fault) in [
        ("allow_hosts = [\"http://a\"]\n", "service.toml:2:15: allow_hosts: expected the name"),
        ("allow_host = [\"a\"]\n", "did you mean `allow_hosts`?"),
        ("token_file = \"none\"\n", "none: No such file"),
        ("[[notifications.targets]]\nname = \"a\"\nkind = \"webhook\"\n", "service.toml:2:1"),
    ] {
        bench.service(&format!("{LISTEN}{text}"));
        let said = bench.refused().replace("\n  ", " ");
        assert!(said.contains("the configuration is as it was") && said.contains(fault), "{said}");
        let last = bench.notes().pop().unwrap();
        assert!(last.starts_with("Grace: reload the configuration: refused, "), "{last}");
    }
    bench.service(LISTEN);
    let rig = bench.path("rig.toml");
    let text = fs::read_to_string(&rig).unwrap();
    fs::write(&rig, text.replacen("pace = \"real\"", "pace = \"fast\"", 1)).unwrap();
    let said = bench.refused();
    assert!(said.contains("rig.toml:") && said.contains("fast"), "{said}");
    assert!(bench.get("").starts_with("HTTP/1.1 200"), "nobody needs a token");
    bench.end();
}

#[test]
fn the_service_manager_reloads_by_a_signal_also_during_a_run() {
    let bench = Bench::start(LISTEN);
    bench.told("READY=1");
    bench.wait_until_ready();
    assert!(request(&bench.address, "POST /api/v1/runs", "").starts_with("HTTP/1.1 202"));
    bench.daemon().wait_until_lowered();
    bench.service(&format!("{LISTEN}allow_hosts = [\"lab.example\"]\n"));
    bench.daemon().signal(Signal::HUP);
    bench.told("RELOADING=1\nMONOTONIC_USEC=");
    bench.told("READY=1");
    assert_eq!(bench.notes(), ["SIGHUP: reload the configuration: allow_hosts"]);
    let rig = bench.get("");
    assert!(rig.contains("\"running\"") || rig.contains("\"waiting"), "{rig}");
    bench.end();
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/service/rigd.service");
    let unit = fs::read_to_string(unit).unwrap();
    assert!(unit.contains("ExecReload=/usr/bin/rigd config reload --data /var/lib/rigd\n"));
}

#[test]
fn another_secret_for_everybody_replaces_the_one_before() {
    let bench = Bench::start(LISTEN);
    let (first, second) = ("first-secret-for-all", "second-secret-for-all");
    assert!(bench.get("").starts_with("HTTP/1.1 200"));
    secret(&bench.path("token"), first);
    bench.service(&format!("{LISTEN}token_file = \"token\"\n"));
    assert!(bench.reload().contains("changed: token_file, from not set to "));
    assert!(bench.get("").starts_with("HTTP/1.1 401"));
    assert!(bench.get(&bearer(first)).starts_with("HTTP/1.1 200"));
    let answer = request(&bench.address, "POST /api/v1/session", &bearer(first));
    let cookie = answer.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    let cookie = format!("cookie: {}\r\n", cookie.split_once(';').unwrap().0);
    assert!(bench.get(&cookie).starts_with("HTTP/1.1 200"), "{answer}");
    // Its content alone.
    secret(&bench.path("token"), second);
    assert!(bench.get(&bearer(second)).starts_with("HTTP/1.1 401"));
    assert!(bench.reload().contains("changed: token_file, the content of "));
    assert!(bench.get(&bearer(second)).starts_with("HTTP/1.1 200"));
    assert!(bench.get(&bearer(first)).starts_with("HTTP/1.1 401"));
    assert!(bench.get(&cookie).starts_with("HTTP/1.1 401"), "it came in by the first one");
    bench.end();
}

#[test]
fn a_daemon_that_others_can_reach_does_not_lose_its_last_token() {
    let folder = TempDir::new().unwrap();
    let token = folder.path().join("token");
    secret(&token, "a-secret-for-everybody");
    let file = |line: &str| format!("listen = \"0.0.0.0:0\"\n{line}");
    let bench = Bench::start(&file(&format!("token_file = {token:?}\n")));
    bench.service(&file(""));
    let said = bench.refused();
    assert!(said.contains("could move the rig"), "{said}");
    assert!(bench.get("").starts_with("HTTP/1.1 401"));
    bench.end();
}

#[test]
fn people_are_told_from_the_reload_on_and_not_what_was_before() {
    let bench = Bench::start(LISTEN);
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    bench.stop();
    assert!(!request(&bench.address, "GET /metrics", "").contains("rigd_notifications"));
    let port = server.local_addr().unwrap().port();
    bench.service(&format!(
        "{LISTEN}[[notifications.targets]]\nname = \"chat\"\nkind = \"webhook\"\n\
         url = \"http://127.0.0.1:{port}/\"\nevents = [\"fault\"]\n"
    ));
    let said = bench.reload();
    assert!(said.contains("changed: notifications."), "{said}");
    let figures = request(&bench.address, "GET /metrics", "");
    assert!(figures.contains("rigd_notifications_sent_total{target=\"chat\"} 0"), "{figures}");
    assert!(request(&bench.address, "POST /api/v1/acknowledge", "").starts_with("HTTP/1.1 200"));
    bench.stop();
    let (mut client, _) = server.accept().unwrap();
    client.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut lines = BufReader::new(client.try_clone().unwrap()).lines();
    let mut length = 0;
    for line in lines.by_ref().map_while(Result::ok).take_while(|line| !line.is_empty()) {
        let name = line.to_ascii_lowercase();
        length = name.strip_prefix("content-length: ").map_or(length, |of| of.parse().unwrap());
    }
    assert!(length > 0);
    client.write_all(b"HTTP/1.1 204 No Content\r\ncontent-length: 0\r\n\r\n").unwrap();
    drop(lines);
    // One message: the stop before the reload is not told.
    let sent = "rigd_notifications_sent_total{target=\"chat\"} 1";
    let figures = bench.wait_for("GET /metrics", |figures| figures.contains(sent));
    assert!(figures.contains("rigd_notifications_waiting{target=\"chat\"} 0"), "{figures}");
    bench.service(LISTEN);
    assert!(bench.reload().contains("changed: notifications."));
    assert!(!request(&bench.address, "GET /metrics", "").contains("rigd_notifications"));
    bench.end();
}
