//! The program on a simulated rig that takes as long as a real one.

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::{Path, PathBuf},
    process::{Child, ChildStderr, Command, ExitStatus, Stdio},
    thread::{self, sleep},
    time::{Duration, Instant},
};

use rig_store::{ProbeWord, Reader, Record};
use rustix::process::{Pid, Signal, kill_process};

/// Nothing here takes longer.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// A simulated rig that takes as long as a real one.
pub(crate) fn real_time_rig(folder: &Path) -> PathBuf {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let text = fs::read_to_string(config.join("rigs/simulated.toml")).unwrap();
    let scene = config.join("scenes/paper.toml").canonicalize().unwrap();
    let changed = text
        .replace("\"../scenes/paper.toml\"", &format!("{:?}", scene.to_str().unwrap()))
        .replace("pace = \"virtual\"", "pace = \"real\"");
    assert!(changed.contains("pace = \"real\"") && changed.contains(scene.to_str().unwrap()));
    let path = folder.join("rig.toml");
    fs::write(&path, changed).unwrap();
    path
}

/// The program with its output on stderr.
pub(crate) struct Program {
    pub(crate) child: Child,
    pub(crate) stderr: BufReader<ChildStderr>,
    pub(crate) data: PathBuf,
}

impl Program {
    pub(crate) fn start(folder: &Path, args: &[&str]) -> Self {
        Self::start_by(Command::new(env!("CARGO_BIN_EXE_rigd")), folder, args)
    }

    /// Starts the program by a command that takes its arguments.
    pub(crate) fn start_by(mut command: Command, folder: &Path, args: &[&str]) -> Self {
        let data = folder.join("data");
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        command
            .args(args)
            .args(["--data", data.to_str().unwrap()])
            .args(["--rig", real_time_rig(folder).to_str().unwrap(), "--operator", "Ada Lovelace"])
            .current_dir(repository);
        Self::spawn(&mut command, data)
    }

    pub(crate) fn spawn(command: &mut Command, data: PathBuf) -> Self {
        let command = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Self { child, stderr, data }
    }

    /// The daemon, and the address that it prints.
    pub(crate) fn serve(folder: &Path) -> (Self, String) {
        let protocol = "config/protocols/smoke.toml";
        let mut this = Self::start(folder, &["serve", protocol, "--listen", "127.0.0.1:0"]);
        let address = this.wait_for_address();
        (this, address)
    }

    /// The address that a daemon prints.
    pub(crate) fn wait_for_address(&mut self) -> String {
        let line = self.wait_for_line("listening on");
        line.split_once("http://").unwrap().1.trim().trim_end_matches('/').to_owned()
    }

    pub(crate) fn wait_for_line(&mut self, part: &str) -> String {
        let (mut said, mut line) = (String::new(), String::new());
        while !line.contains(part) {
            line.clear();
            let length = self.stderr.read_line(&mut line).unwrap();
            said.push_str(&line);
            assert_ne!(length, 0, "the program ended first: {said}");
        }
        line
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits for a record in the journal.
    pub(crate) fn wait_for_record(&self, what: &str, is_wanted: impl Fn(&Record) -> bool) {
        wait_until(what, || {
            let events = Reader::open(&self.data).and_then(|reader| reader.events_after(0, 10_000));
            events.is_ok_and(|all| all.iter().any(|stored| is_wanted(&stored.record().unwrap())))
        });
    }

    pub(crate) fn wait_until_lowered(&self) {
        self.wait_for_record("the probe to be lowered", |record| {
            matches!(record, Record::Intent(_))
        });
    }

    pub(crate) fn end(mut self) -> (ExitStatus, String, PathBuf) {
        let mut text = String::new();
        self.stderr.read_to_string(&mut text).unwrap();
        (self.child.wait().unwrap(), text, self.data)
    }
}

/// One request on a connection of its own.
/// Waits for what happens in another program.
pub(crate) fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "gave up waiting for {what}");
        sleep(Duration::from_millis(5));
    }
}

pub(crate) fn request(address: &str, line: &str, headers: &str) -> String {
    ask(address, line, headers, "")
}

/// A request with a body in JSON.
pub(crate) fn post(address: &str, path: &str, body: &str) -> String {
    let length = body.len();
    let headers = format!("content-type: application/json\r\ncontent-length: {length}\r\n");
    ask(address, &format!("POST /api/v1/{path}"), &headers, body)
}

pub(crate) fn ask(address: &str, line: &str, headers: &str, body: &str) -> String {
    let mut client = TcpStream::connect(address).unwrap();
    let text =
        format!("{line} HTTP/1.1\r\nhost: localhost\r\n{headers}connection: close\r\n\r\n{body}");
    client.write_all(text.as_bytes()).unwrap();
    let mut answer = String::new();
    // A program that ends meanwhile closes the connection.
    _ = client.read_to_string(&mut answer);
    answer
}

/// The last session has ended in order, with the probe clear.
#[track_caller]
pub(crate) fn check_clear(data: &Path) {
    let reader = Reader::open(data).unwrap();
    let session = reader.latest_session("simulated bench").unwrap().unwrap();
    assert_eq!(session.status.name(), "completed");
    assert_eq!(reader.probe_word(&session).unwrap(), ProbeWord::Clear);
}

/// Runs all cases in parallel, because most of the time is waiting for a rig.
pub(crate) fn at_once<T: Send>(cases: impl IntoIterator<Item = T>, check: impl Fn(T) + Sync) {
    thread::scope(|scope| {
        for case in cases {
            let check = &check;
            scope.spawn(move || check(case));
        }
    });
}
