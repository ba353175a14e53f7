//! The queue of a daemon: order, record, restart, faults.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "queue/kills.rs"]
mod kills;
#[path = "support/preload.rs"]
mod preload;
#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    io::{Read, Write},
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use program::{PATIENCE, Program, post, real_time_rig, request};
use rig_store::{Reader, Record, RunKind};
use rustix::process::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A daemon without a loaded protocol, in real time or in virtual time.
fn serve(folder: &Path, is_real_time: bool, more: &[&str]) -> (Program, String) {
    serve_with(folder, is_real_time, more, &[])
}

/// The same with these variables.
fn serve_with(
    folder: &Path,
    is_real_time: bool,
    more: &[&str],
    variables: &[(&str, &str)],
) -> (Program, String) {
    let mut daemon = start(folder, is_real_time, more, variables);
    let address = daemon.wait_for_address();
    (daemon, address)
}

fn start(folder: &Path, is_real_time: bool, more: &[&str], variables: &[(&str, &str)]) -> Program {
    let data = folder.join("data");
    let simulated = PathBuf::from("config/rigs/simulated.toml");
    let rig = if is_real_time { real_time_rig(folder) } else { simulated };
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command
        .args(["serve", "--listen", "127.0.0.1:0", "--data", data.to_str().unwrap()])
        .args(["--rig", rig.to_str().unwrap()])
        .args(more)
        .envs(variables.iter().copied())
        .current_dir(repository());
    Program::spawn(&mut command, data)
}

/// The shipped smoke protocol under another name.
fn protocol(name: &str) -> String {
    let text = fs::read_to_string(repository().join("config/protocols/smoke.toml")).unwrap();
    let named = text
        .replace("name = \"smoke\"", &format!("name = \"{name}\""))
        .replace("indentation_mm = 0.5\n", "indentation_mm = 0.5\ndwell_s = 0.5\n");
    assert!(named.contains(&format!("\"{name}\"")));
    named
}

fn end(daemon: Program) {
    daemon.signal(Signal::TERM);
    daemon.end();
}

#[track_caller]
fn answered(answer: &str, status: u16) -> Value {
    assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{answer}");
    serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap()
}

#[track_caller]
fn add(address: &str, name: &str) -> Value {
    let form = json!({ "protocol_toml": protocol(name), "note": format!("note of {name}") });
    answered(&post(address, "queue", &form.to_string()), 201)
}

fn queue(address: &str) -> Value {
    answered(&request(address, "GET /api/v1/queue", ""), 200)
}

#[track_caller]
fn wait_for(address: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
    let began = Instant::now();
    loop {
        let seen = queue(address);
        if is_wanted(&seen) {
            return seen;
        }
        assert!(began.elapsed() < PATIENCE, "{seen}");
    }
}

/// The figures, when the daemon has judged the models of this many runs.
#[track_caller]
fn wait_until_judged(address: &str, runs: f64) -> String {
    let began = Instant::now();
    loop {
        let figures = request(address, "GET /metrics", "");
        let judged = figures.lines().filter(|line| line.starts_with("rigd_runs_judged_total{"));
        let counts: Vec<f64> =
            judged.map(|line| line.rsplit_once(' ').unwrap().1.parse().unwrap()).collect();
        assert_eq!(counts.len(), 3, "{figures}");
        if counts.iter().sum::<f64>() == runs {
            return figures;
        }
        assert!(began.elapsed() < PATIENCE, "{figures}");
    }
}

fn names(queue: &Value) -> Vec<&str> {
    let entries = queue["entries"].as_array().unwrap();
    entries.iter().map(|entry| entry["protocol"].as_str().unwrap()).collect()
}

/// The runs of a journal, the first one first, each with its status.
fn runs(data: &Path) -> Vec<(String, &'static str)> {
    let runs = Reader::open(data).unwrap().runs().unwrap();
    let runs = runs.into_iter().filter(|run| run.kind == RunKind::Run).rev();
    runs.map(|run| (run.name, run.status.name())).collect()
}

/// What people and the daemon did, as the journal has it.
fn actions(data: &Path) -> Vec<String> {
    let events = Reader::open(data).unwrap().events_after(0, 10_000).unwrap();
    let action = |record| match record {
        Record::Operator(done) => Some(format!("{}: {}", done.who, done.action)),
        _ => None,
    };
    events.iter().filter_map(|stored| action(stored.record().unwrap())).collect()
}

#[test]
fn a_released_queue_runs_in_its_order_and_is_held_when_it_is_empty() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve(folder.path(), false, &["--operator", "Ada"]);
    let held = add(&address, "one");
    assert_eq!(held["hold"]["kind"], "start");
    // What needs a person is told before anything begins.
    let asked = &held["entries"][0]["prompts"][0];
    assert!(asked["prompt"].as_str().unwrap().starts_with("Put sample"), "{held}");
    assert_eq!((&asked["after_s"], &held["entries"][0]["by"]), (&json!(0.0), &json!("Ada")));
    for name in ["two", "three", "four"] {
        add(&address, name);
    }
    let moved = answered(&post(&address, "queue/3/move", r#"{"place": 1}"#), 200);
    assert_eq!(names(&moved), ["three", "one", "two", "four"]);
    let begins = |entry: usize| moved["entries"][entry]["begins_in_s"].as_f64().unwrap();
    assert!(begins(0) == 0.0 && begins(1) > 60.0 && begins(2) > begins(1));
    let left = answered(&request(&address, "DELETE /api/v1/queue/4", ""), 200);
    assert_eq!(names(&left), ["three", "one", "two"]);
    assert!(runs(&daemon.data).is_empty());
    answered(&post(&address, "queue/release", ""), 200);
    let done = wait_for(&address, |queue| queue["hold"]["kind"] == "empty");
    assert!(names(&done).is_empty() && done.get("run").is_none());
    let completed = |name: &str| (name.to_owned(), "completed");
    assert_eq!(runs(&daemon.data), ["three", "one", "two"].map(completed));
    // An entry that is added now waits for the next release.
    assert_eq!(add(&address, "five")["hold"]["kind"], "empty");
    let done = actions(&daemon.data);
    for action in [
        "Ada: add entry 1 of the queue, one",
        "Ada: move entry 3 of the queue to place 1",
        "Ada: cancel entry 4 of the queue, four",
        "Ada: release the queue",
        "rigd: hold the queue: no entry waits",
    ] {
        assert!(done.iter().any(|done| done == action), "{action}: {done:?}");
    }
    // Each run has its folder, also one that began and ended while the folder before it was written.
    let figures = wait_until_judged(&address, 3.0);
    assert!(figures.contains("rigd_queue_entries 1") && figures.contains("rigd_queue_held 1"));
    assert_eq!(fs::read_dir(daemon.data.join("runs")).unwrap().count(), 3);
    end(daemon);
    // Each run is sound, also behind another one of the same session.
    let data = folder.path().join("data");
    let reader = Reader::open(&data).unwrap();
    for run in reader.runs().unwrap() {
        let verdict = rig_verify::verify(&data, &run.id.to_string()).unwrap();
        assert!(verdict.is_sound, "{run}: {:#?}", verdict.findings);
    }
}

#[test]
fn a_queue_survives_a_kill_and_begins_nothing_by_itself_afterwards() {
    let folder = TempDir::new().unwrap();
    let (mut daemon, address) = serve(folder.path(), true, &[]);
    add(&address, "one");
    add(&address, "two");
    answered(&post(&address, "queue/release", ""), 200);
    daemon.wait_until_lowered();
    assert_eq!(names(&queue(&address)), ["two"]);
    daemon.child.kill().unwrap();
    daemon.child.wait().unwrap();
    // Even a daemon that is asked to begin by itself waits for a person after that.
    let (daemon, address) = serve(folder.path(), true, &["--release-queue"]);
    let left = queue(&address);
    assert_eq!((names(&left), &left["hold"]["kind"]), (vec!["two"], &json!("fault")));
    assert_eq!(runs(&daemon.data).len(), 1);
    end(daemon);
}

#[test]
fn after_a_restart_the_queue_waits_for_a_person_unless_the_daemon_is_told_otherwise() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve(folder.path(), false, &[]);
    add(&address, "one");
    end(daemon);
    let (daemon, address) = serve(folder.path(), false, &[]);
    let held = queue(&address);
    assert_eq!((names(&held), &held["hold"]["kind"]), (vec!["one"], &json!("start")));
    end(daemon);
    let (daemon, address) = serve(folder.path(), false, &["--release-queue"]);
    wait_for(&address, |queue| queue["hold"]["kind"] == "empty");
    assert_eq!(runs(&daemon.data), [("one".to_owned(), "completed")]);
    end(daemon);
}

#[test]
fn a_stop_holds_the_queue_and_the_next_entry_waits() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve(folder.path(), true, &[]);
    add(&address, "one");
    add(&address, "two");
    answered(&post(&address, "queue/release", ""), 200);
    daemon.wait_until_lowered();
    assert!(request(&address, "POST /api/v1/stop", "").starts_with("HTTP/1.1 200"));
    let held = wait_for(&address, |queue| !queue["hold"].is_null());
    assert_eq!((names(&held), &held["hold"]["kind"]), (vec!["two"], &json!("fault")));
    assert_eq!(runs(&daemon.data).len(), 1);
    end(daemon);
}

/// Waits until the rig is idle and the probe is so.
#[track_caller]
fn wait_for_probe(address: &str, probe: &str) {
    let began = Instant::now();
    loop {
        let rig = answered(&request(address, "GET /api/v1/rig", ""), 200);
        if rig["state"] == "idle" && rig["probe"] == probe {
            return;
        }
        assert!(began.elapsed() < PATIENCE, "{rig}");
    }
}

#[test]
fn a_probe_that_was_lowered_by_hand_holds_the_queue() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve(folder.path(), false, &[]);
    add(&address, "one");
    wait_for_probe(&address, "clear");
    answered(&post(&address, "moves", r#"{"axis": "linear", "to": 20.0}"#), 202);
    wait_for_probe(&address, "in contact");
    let ready = answered(&request(&address, "GET /readyz", ""), 503);
    assert_eq!(ready["detail"], "the probe is not clear");
    answered(&post(&address, "queue/release", ""), 200);
    let held = wait_for(&address, |queue| queue["hold"]["kind"] == "fault");
    let reason = held["hold"]["reason"].as_str().unwrap();
    assert!(reason.contains("cannot run while the probe is lowered"), "{held}");
    assert_eq!(names(&held), ["one"]);
    assert!(runs(&daemon.data).is_empty());
    answered(&post(&address, "moves", r#"{"axis": "linear", "to": 24.5}"#), 202);
    wait_for_probe(&address, "clear");
    answered(&post(&address, "queue/release", ""), 200);
    wait_for(&address, |queue| queue["hold"]["kind"] == "empty");
    assert_eq!(runs(&daemon.data), [("one".to_owned(), "completed")]);
    end(daemon);
}

#[test]
fn a_change_that_cannot_be_made_is_refused() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve(folder.path(), false, &[]);
    add(&address, "one");
    let toml = protocol("late");
    let late = json!({ "protocol_toml": toml, "deadline_unix_ms": 1_000 }).to_string();
    let long = json!({ "protocol_toml": toml, "note": "x".repeat(2001) }).to_string();
    for (path, body, status) in [
        ("queue", late.as_str(), 422),
        ("queue", &long, 400),
        ("queue", "{}", 422),
        ("queue", r#"{"protocol_toml": "name = 1"}"#, 422),
        ("queue", "[]", 422),
        ("queue", r#"{"notes": ""}"#, 422),
        ("queue/9/move", r#"{"place": 1}"#, 404),
        ("queue/x/move", r#"{"place": 1}"#, 404),
        ("queue/1/move", r#"{"place": 0}"#, 422),
        ("queue/1/move", r#"{"place": 2}"#, 422),
        ("queue/1/move", "[1]", 422),
    ] {
        answered(&post(&address, path, body), status);
    }
    answered(&request(&address, "DELETE /api/v1/queue/1", ""), 200);
    answered(&request(&address, "DELETE /api/v1/queue/1", ""), 404);
    // A released queue without an entry would begin the next one at once.
    answered(&post(&address, "queue/release", ""), 409);
    assert_eq!(runs(&daemon.data), []);
    end(daemon);
}

/// A request to add a protocol, with an idempotency key.
fn add_keyed(address: &str, key: &str, body: &str) -> String {
    let length = body.len();
    let headers = format!(
        "content-type: application/json\r\ncontent-length: {length}\r\nidempotency-key: {key}\r\n"
    );
    let mut client = std::net::TcpStream::connect(address).unwrap();
    let head =
        format!("POST /api/v1/queue HTTP/1.1\r\nhost: localhost\r\n{headers}connection: close");
    client.write_all(format!("{head}\r\n\r\n{body}").as_bytes()).unwrap();
    let mut answer = String::new();
    client.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn a_repeated_request_with_a_key_adds_one_entry_also_after_its_run_and_a_restart() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve(folder.path(), false, &[]);
    let body = json!({ "protocol_toml": protocol("one"), "note": "n" }).to_string();
    assert_eq!(names(&answered(&add_keyed(&address, "k", &body), 201)), ["one"]);
    assert_eq!(names(&answered(&add_keyed(&address, "k", &body), 200)), ["one"]);
    let other = json!({ "protocol_toml": protocol("one"), "note": "m" }).to_string();
    let refused = answered(&add_keyed(&address, "k", &other), 422);
    assert!(refused["detail"].as_str().unwrap().contains("Idempotency-Key k"), "{refused}");
    answered(&add_keyed(&address, &"k".repeat(256), &body), 400);
    // Of many at once, one adds an entry.
    let added = std::thread::scope(|scope| {
        let ask = || scope.spawn(|| add_keyed(&address, "many", &body));
        let asked: Vec<_> = (0..8).map(|_| ask()).collect();
        asked.into_iter().map(|asked| asked.join().unwrap()).collect::<Vec<_>>()
    });
    assert!(added.iter().all(|answer| answer.starts_with("HTTP/1.1 20")), "{added:?}");
    assert_eq!(names(&queue(&address)), ["one", "one"]);
    answered(&post(&address, "queue/release", ""), 200);
    wait_for(&address, |queue| queue["hold"]["kind"] == "empty");
    assert_eq!(names(&answered(&add_keyed(&address, "k", &body), 200)), [""; 0]);
    end(daemon);
    let (daemon, address) = serve(folder.path(), false, &[]);
    assert_eq!(names(&answered(&add_keyed(&address, "k", &body), 200)), [""; 0]);
    assert_eq!(runs(&daemon.data).len(), 2);
    end(daemon);
}

#[test]
fn a_deadline_that_is_missed_or_will_be_is_said_before_its_turn() {
    let folder = TempDir::new().unwrap();
    let (daemon, address) = serve(folder.path(), true, &[]);
    let first = add(&address, "one");
    let duration_s = first["entries"][0]["duration_s"].as_f64().unwrap();
    // It could end in time if it began now, and not behind the first one.
    let takes = Duration::from_secs_f64(duration_s) + Duration::from_secs(20);
    let deadline = (SystemTime::now() + takes).duration_since(UNIX_EPOCH).unwrap().as_millis();
    let form = json!({ "protocol_toml": protocol("two"), "deadline_unix_ms": deadline });
    let told = answered(&post(&address, "queue", &form.to_string()), 201);
    let entry = &told["entries"][1];
    let late_s = entry["late_s"].as_f64().unwrap();
    assert!((duration_s - 25.0..duration_s - 19.0).contains(&late_s), "{told}");
    assert_eq!((&entry["is_missed"], &told["missed"]), (&json!(false), &json!(0)));
    assert!(told["entries"][0].get("late_s").is_none(), "{told}");
    // On the terminal too.
    let list = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["queue", "list", "--data", daemon.data.to_str().unwrap()])
        .output()
        .unwrap();
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(text.contains("entry 2 would end ") && text.contains("after its deadline"), "{text}");
    end(daemon);
    // A deadline that passes while nobody releases the queue: the file has one of long ago.
    let file = folder.path().join("data/queue.json");
    let mut kept: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    kept["entries"][1]["deadline_unix_ms"] = json!(1_000);
    fs::write(&file, kept.to_string()).unwrap();
    let (daemon, address) = serve(folder.path(), true, &[]);
    let told = queue(&address);
    assert_eq!((&told["entries"][1]["is_missed"], &told["missed"]), (&json!(true), &json!(1)));
    end(daemon);
}

/// Now, by the clock of the computer, ms since 1970.
fn now_unix_ms() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    u64::try_from(now.as_millis()).unwrap()
}

#[test]
fn a_run_that_ends_after_its_deadline_is_told_and_noted() {
    let folder = TempDir::new().unwrap();
    let rig = folder.path().join("waits.toml");
    let simulated = fs::read_to_string(repository().join("config/rigs/simulated.toml")).unwrap();
    let scenes = repository().join("config/scenes").canonicalize().unwrap();
    let waits = simulated
        .replace("\"../scenes/", &format!("\"{}/", scenes.display()))
        .replace("\"answers\"\n", "\"waits\"\n");
    assert!(waits.contains("person = \"waits\""));
    fs::write(&rig, waits).unwrap();
    let data = folder.path().join("data");
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command
        .args(["serve", "--listen", "127.0.0.1:0", "--release-queue"])
        .args(["--data", data.to_str().unwrap(), "--rig", rig.to_str().unwrap()])
        .current_dir(repository());
    let mut daemon = Program::spawn(&mut command, data.clone());
    let address = daemon.wait_for_address();
    // In virtual time a run takes no time until a person is asked. On a slow computer it begins too late for the
    // first deadlines, and is left out.
    let mut begun = None;
    for left_ms in [1_000, 2_000, 4_000, 8_000, 16_000] {
        let deadline = now_unix_ms() + left_ms;
        let form = json!({ "protocol_toml": protocol("late"), "deadline_unix_ms": deadline });
        let answer = post(&address, "queue", &form.to_string());
        if !answer.starts_with("HTTP/1.1 201") {
            continue;
        }
        // If the entry has begun already, the queue is empty.
        let released = post(&address, "queue/release", "");
        let is_known = ["HTTP/1.1 200", "HTTP/1.1 409"].iter().any(|one| released.starts_with(one));
        assert!(is_known, "{released}");
        let seen = wait_for(&address, |seen| {
            seen.get("run").is_some()
                || seen["entries"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .all(|entry| entry["is_missed"] == true)
        });
        if let Some(run) = seen["run"].as_str() {
            begun = Some((run.to_owned(), deadline));
            break;
        }
    }
    let (run, deadline) = begun.expect("a run began before its deadline");
    assert_eq!(queue(&address)["late"], json!([]));
    while now_unix_ms() <= deadline {
        assert_eq!(queue(&address)["run"], run.as_str(), "it waits for a person");
    }
    assert!(post(&address, &format!("runs/{run}/abort"), "").starts_with("HTTP/1.1 202"));
    let told = wait_for(&address, |seen| seen["late"].as_array().unwrap().len() == 1);
    let late = &told["late"][0];
    assert_eq!((&late["run"], &late["protocol"]), (&json!(run), &json!("late")));
    assert_eq!(late["deadline_unix_ms"], deadline);
    assert!(late["ended_unix_ms"].as_u64().unwrap() > deadline);
    let list = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["queue", "list", "--data", data.to_str().unwrap()])
        .output()
        .unwrap();
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(text.contains(&run) && text.contains("after its deadline"), "{text}");
    end(daemon);
    let reader = Reader::open(&data).unwrap();
    let noted = reader.events_after(0, u32::MAX).unwrap().into_iter().any(|stored| {
        matches!(stored.record(), Ok(Record::Operator(operator))
            if operator.action.starts_with(&format!("run {run} of entry ")) && operator.action.ends_with(" s after its deadline"))
    });
    assert!(noted);
}
