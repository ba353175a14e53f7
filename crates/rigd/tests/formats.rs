//! The present program on the data of each release: nothing that a release has written is lost or refused.
//!
//! `tests/service/data_of_a_release.py` makes the data of a new release; those of the old ones stay.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpListener,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use program::{PATIENCE, Program, at_once, request};
use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

/// The data of one release, in a folder that may be changed.
struct Release {
    folder: TempDir,
    expected: Value,
}

impl Release {
    fn copy(of: &Path) -> Self {
        let folder = TempDir::new().unwrap();
        copy(of, folder.path());
        let expected = fs::read_to_string(of.join("expected.json")).unwrap();
        Self { folder, expected: serde_json::from_str(&expected).unwrap() }
    }

    fn rigd(&self, args: &[&str]) -> String {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        let done = command.args(args).current_dir(self.folder.path()).output().unwrap();
        assert!(done.status.success(), "{args:?}: {}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8(done.stdout).unwrap()
    }

    fn json(&self, args: &[&str]) -> Value {
        serde_json::from_str(&self.rigd(args)).unwrap()
    }

    /// The daemon on the files of the release.
    fn serve(&self) -> (Program, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command
            .args(["serve", "protocol.toml", "--rig", "rig.toml", "--config", "service.toml"])
            .args(["--listen", "127.0.0.1:0", "--data", "data"])
            .current_dir(self.folder.path());
        let mut daemon = Program::spawn(&mut command, self.folder.path().join("data"));
        let address = daemon.wait_for_address();
        (daemon, address)
    }

    fn token(&self, role: &str) -> String {
        format!("authorization: Bearer {}\r\n", self.expected["tokens"][role].as_str().unwrap())
    }
}

fn copy(from: &Path, to: &Path) {
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            fs::create_dir(&to).unwrap();
            copy(&entry.path(), &to);
        } else {
            fs::copy(entry.path(), &to).unwrap();
        }
    }
    // A checkout may give files that the group can write.
    let tokens = to.join("tokens.json");
    if tokens.exists() {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(tokens, fs::Permissions::from_mode(0o600)).unwrap();
    }
}

/// The releases whose data are kept.
fn releases() -> Vec<PathBuf> {
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/releases");
    let releases: Vec<_> = fs::read_dir(kept).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(!releases.is_empty());
    releases
}

fn body(answer: &str) -> Value {
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 2"), "{answer}");
    serde_json::from_str(body).unwrap()
}

#[test]
fn a_journal_and_an_archive_are_read_checked_copied_and_restored() {
    at_once(releases(), |path| {
        let release = Release::copy(&path);
        let runs = release.json(&["runs", "--json", "--data", "data"]);
        let runs = runs.as_array().unwrap();
        assert!(runs.len() >= 4, "{runs:?}");
        for run in runs {
            release.rigd(&["verify", run["run_id"].as_str().unwrap(), "--data", "data"]);
        }
        let shown = release.json(&["show", "release-2", "--json", "--data", "data"]);
        let touches = shown["touch_results"].as_array().unwrap();
        assert_eq!(touches.len(), release.expected["touches"].as_object().unwrap().len());
        for touch in touches {
            let step = touch["step"].as_str().unwrap();
            assert_eq!(touch["resonance_hz"], release.expected["touches"][step], "{step}");
        }
        release.rigd(&["report", "release-2", "--data", "data"]);
        let archived = release.expected["archived"].as_str().unwrap();
        release.rigd(&["verify", archived, "--data", "archive"]);
        release.rigd(&["archive", "archive", "release-2", "--data", "data"]);
        release.rigd(&["backup", "backup", "--data", "data"]);
        release.rigd(&["restore", "backup", "--data", "restored"]);
        let restored = release.json(&["runs", "--json", "--data", "restored"]);
        assert_eq!(restored.as_array().unwrap().len(), runs.len());
    });
}

#[test]
fn a_daemon_goes_on_with_tokens_queue_notes_outbox_and_the_interrupted_run() {
    at_once(releases(), |path| {
        let release = Release::copy(&path);
        let target = TcpListener::bind("127.0.0.1:0").unwrap();
        let settings = fs::read_to_string(path.join("service.toml")).unwrap();
        let at = format!("http://{}/", target.local_addr().unwrap());
        let settings = settings.replace("http://127.0.0.1:9/", &at);
        fs::write(release.folder.path().join("service.toml"), settings).unwrap();
        let (daemon, address) = release.serve();
        let operate = release.token("operate");

        // The message that could not be sent.
        let (mut client, mut lines) = (BufReader::new(target.accept().unwrap().0), String::new());
        while !lines.contains("\r\n\r\n") {
            client.read_line(&mut lines).unwrap();
        }
        let length = lines.lines().find_map(|line| line.strip_prefix("content-length: ")).unwrap();
        let mut message = vec![0; length.parse().unwrap()];
        client.read_exact(&mut message).unwrap();
        client.get_mut().write_all(b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n").unwrap();
        let message: Value = serde_json::from_slice(&message).unwrap();
        assert_eq!((&message["event"], &message["run"]), (&"end".into(), &"release-3".into()));

        for (role, status) in [("view", 403), ("operate", 403), ("admin", 200)] {
            let answer = request(&address, "POST /api/v1/config/reload", &release.token(role));
            assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{role}: {answer}");
        }
        let queue = body(&request(&address, "GET /api/v1/queue", &operate));
        let notes: Vec<_> =
            queue["entries"].as_array().unwrap().iter().map(|entry| &entry["note"]).collect();
        assert_eq!(notes, ["first", "later"]);
        assert_eq!(queue["entries"][1]["deadline_unix_ms"], 4_000_000_000_000_u64);
        let notes = body(&request(&address, "GET /api/v1/notes", &operate));
        let note = notes.as_object().unwrap().values().next().unwrap();
        assert_eq!(note["note"], "a note\nof 30°");

        let id = release.expected["interrupted"].as_str().unwrap();
        let run = body(&request(&address, &format!("GET /api/v1/runs/{id}"), &operate));
        assert_eq!(run["status"], "interrupted");
        let ready = |line: &str| {
            let began = Instant::now();
            while !request(&address, line, &operate).starts_with("HTTP/1.1 200") {
                assert!(began.elapsed() < PATIENCE, "{line}");
            }
        };
        // It was latched by the kill.
        request(&address, "POST /api/v1/acknowledge", &operate);
        ready("GET /readyz");
        let go_on = format!("POST /api/v1/runs/{id}/continue");
        let accept = "{\"accept_changes\": true}";
        let headers = format!(
            "{operate}content-type: application/json\r\ncontent-length: {}\r\n",
            accept.len()
        );
        let answer = program::ask(&address, &go_on, &headers, accept);
        assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
        let began = Instant::now();
        loop {
            let run = body(&request(&address, &format!("GET /api/v1/runs/{id}"), &operate));
            if run["status"] == "completed" || run["status"] == "completed_with_refusals" {
                break;
            }
            assert!(began.elapsed() < PATIENCE, "{run}");
        }
        daemon.signal(Signal::TERM);
        assert!(daemon.end().0.success());
        release.rigd(&["verify", id, "--data", "data"]);
    });
}
