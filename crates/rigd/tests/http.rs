//! Requests of a client, other than runs.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "http/amendments.rs"]
mod amendments;
#[path = "http/devices.rs"]
mod devices;
#[path = "http/interface.rs"]
mod interface;
#[path = "http/streams.rs"]
mod streams;

use std::{net::Ipv4Addr, path::Path};

use axum::{
    Router,
    body::{Body, to_bytes},
    http::{Request, StatusCode, header},
    response::Response,
};
use rig_engine::{Command, RigState};
use rig_files::rig_file::{Connection, SimulatedPerson};
use rig_store::{Reader, Record, Store};
use rigd::{
    http::{Shared, access::Access, router},
    loaded_rig::{LoadedRig, RigFacts},
    rig::{self, RigHandle, RigThread, Status},
};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

const SMOKE: &str = include_str!("../../../config/protocols/smoke.toml");

/// The routes of a rig; documents are built on the blocking threads of `builders`.
fn routes(handle: &RigHandle, facts: RigFacts, data: &TempDir, builders: Handle) -> Router {
    let (directory, closing) = (data.path().to_owned(), CancellationToken::new());
    let access = Access::new(Ipv4Addr::LOCALHOST.into(), [], None, "the lab".parse().unwrap());
    router(Shared::new(handle.clone(), facts, None, directory, access, builders, closing))
}

/// The shipped simulated rig behind the routes of the daemon.
struct Daemon {
    router: Router,
    handle: RigHandle,
    thread: RigThread,
    data: TempDir,
}

impl Daemon {
    async fn start() -> Self {
        Self::start_with(SimulatedPerson::Answers).await
    }

    async fn start_with(person: SimulatedPerson) -> Self {
        Self::start_in(TempDir::new().unwrap(), person).await
    }

    /// Closes the daemon, and starts it again on the same data.
    async fn restart(self) -> Self {
        self.restart_after(|_| {}).await
    }

    /// The same, with something done to the data directory between.
    async fn restart_after(self, work: impl FnOnce(&Path)) -> Self {
        self.handle.close().await;
        self.thread.join();
        work(self.data.path());
        Self::start_in(self.data, SimulatedPerson::Answers).await
    }

    async fn close(self) {
        self.handle.close().await;
        self.thread.join();
    }

    async fn start_in(data: TempDir, person: SimulatedPerson) -> Self {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/rigs/simulated.toml");
        let mut rig = LoadedRig::load(&file).unwrap();
        if let Connection::Simulated(simulation) = &mut rig.file.connection {
            simulation.person = person;
        }
        let facts = rig.facts();
        let (handle, thread) = rig::open(rig, data.path().to_owned()).unwrap();
        let router = routes(&handle, facts, &data, Handle::current());
        let daemon = Self { router, handle, thread, data };
        daemon.wait_until_idle().await;
        daemon
    }

    /// A sweep that a touch names is in the list of its run, and can be had.
    async fn check_sweep(&self, of_run: &str, number: &Value) {
        let (_, list) = self.ask("GET", of_run, &Value::Null).await;
        let is_listed = |line: &Value| line["number"] == *number;
        assert!(list.as_array().unwrap().iter().any(is_listed), "{number}: {list}");
        let (status, sweep) = self.ask("GET", &format!("{of_run}/{number}"), &Value::Null).await;
        assert_eq!((status, &sweep["number"]), (StatusCode::OK, number), "{sweep}");
    }

    #[track_caller]
    fn check_sound(&self, ids: &[&str]) {
        for id in ids {
            let verdict = rig_verify::verify(self.data.path(), id).unwrap();
            assert!(verdict.is_sound, "{id}: {:#?}", verdict.findings);
        }
    }

    async fn wait_until_idle(&self) {
        let mut status = self.handle.status();
        status.wait_for(|status| status.snapshot.state == RigState::Idle).await.unwrap();
    }

    async fn ask(&self, method: &str, path: &str, body: &Value) -> (StatusCode, Value) {
        self.send(method, path, body, &[]).await
    }

    async fn send(
        &self,
        method: &str,
        path: &str,
        body: &Value,
        headers: &[(&str, &str)],
    ) -> (StatusCode, Value) {
        let answer = self.answer(method, path, body, headers).await;
        let status = answer.status();
        let bytes = to_bytes(answer.into_body(), usize::MAX).await.unwrap();
        let is_empty = bytes.is_empty();
        (status, if is_empty { Value::Null } else { serde_json::from_slice(&bytes).unwrap() })
    }

    async fn answer(
        &self,
        method: &str,
        path: &str,
        body: &Value,
        headers: &[(&str, &str)],
    ) -> Response {
        let mut request = Request::builder()
            .method(method)
            .uri(format!("/api/v1/{path}"))
            .header(header::HOST, "localhost")
            .header(header::CONTENT_TYPE, "application/json");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(Body::from(body.to_string())).unwrap();
        self.router.clone().oneshot(request).await.unwrap()
    }

    async fn move_to(&self, axis: &str, to: f64) -> (StatusCode, Value) {
        let answer = self.ask("POST", "moves", &json!({ "axis": axis, "to": to })).await;
        self.wait_until_idle().await;
        answer
    }

    async fn rig(&self) -> Value {
        self.ask("GET", "rig", &Value::Null).await.1
    }
}

#[tokio::test]
async fn an_array_is_never_taken_for_the_members_of_a_form() {
    let daemon = Daemon::start().await;
    for (path, body) in [
        ("lease", json!([true])),
        ("runs", json!(["name = \"x\""])),
        ("runs/latest/redo", json!(["main/1/front/0/1", "it slipped", false])),
        ("runs/latest/skip", json!(["main/1/front/0/1", "it slipped", false])),
        ("home", json!([true])),
        ("moves", json!(["linear", 30.0])),
        ("sweeps", json!([120, 165])),
    ] {
        let (status, problem) = daemon.ask("POST", path, &body).await;
        assert!(status.is_client_error(), "{path}: {status} {problem}");
        let said = problem["detail"].as_str().unwrap();
        assert!(said.contains("expected a JSON object"), "{path}: {said}");
    }
    for (path, body, said) in [
        (
            "runs",
            json!({ "protocol_toml": 5 }),
            "protocol_toml: invalid type: integer `5`, expected a string",
        ),
        (
            "queue",
            json!({ "protocol_toml": 5 }),
            "protocol_toml: invalid type: integer `5`, expected a string",
        ),
        (
            "sweeps",
            json!({ "min_hz": "120", "max_hz": 165 }),
            "min_hz: invalid type: string \"120\", expected a number",
        ),
    ] {
        let (status, problem) = daemon.ask("POST", path, &body).await;
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{path}: {problem}");
        assert!(problem["detail"].as_str().unwrap().starts_with(said), "{path}: {problem}");
    }
    daemon.close().await;
}

#[tokio::test]
async fn an_axis_is_moved_within_what_the_interlock_admits() {
    let daemon = Daemon::start().await;
    assert_eq!(daemon.move_to("rotary", 30.0).await.0, StatusCode::ACCEPTED);
    assert_eq!(daemon.rig().await["rotary_deg"], 30.0);
    assert_eq!(daemon.move_to("linear", 20.0).await.0, StatusCode::ACCEPTED);
    let rig = daemon.rig().await;
    assert_eq!((&rig["linear_mm"], &rig["probe"]), (&json!(20.0), &json!("in contact")));

    let rows = [
        ("rotary", 0.0, StatusCode::CONFLICT, "while the probe is lowered, and may be in contact"),
        ("rotary", 51.0, StatusCode::CONFLICT, "while the probe is lowered, and may be in contact"),
        ("linear", 46.0, StatusCode::UNPROCESSABLE_ENTITY, "outside the soft limits"),
        ("linear", 9.0, StatusCode::UNPROCESSABLE_ENTITY, "the deepest that a touch may go"),
        ("sideways", 1.0, StatusCode::UNPROCESSABLE_ENTITY, "unknown variant `sideways`"),
    ];
    for (axis, to, expected, reason) in rows {
        let (status, problem) = daemon.move_to(axis, to).await;
        assert_eq!(status, expected, "{axis} {to}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(reason), "{problem}");
    }
    assert_eq!(daemon.rig().await["linear_mm"], 20.0);
    assert_eq!(daemon.move_to("linear", 24.5).await.0, StatusCode::ACCEPTED);
    assert_eq!(daemon.rig().await["probe"], "clear");

    let session = daemon.handle.status().borrow().session;
    let records = Reader::open(daemon.data.path()).unwrap().records(session).unwrap();
    let is_intent = |record: &Record| matches!(record, Record::Intent(intent) if intent.to == 20.0);
    assert!(records.iter().any(|stored| is_intent(&stored.record().unwrap())));
    daemon.close().await;
}

#[tokio::test]
async fn the_journal_says_who_asked() {
    let daemon = Daemon::start().await;
    let order = json!({ "axis": "linear", "to": 30.0 });
    for name in [None, Some("Ada Lovelace"), Some("J\u{fc}rgen")] {
        let header = name.map(|name| ("x-operator", name));
        let (status, rig) = daemon.send("POST", "moves", &order, header.as_slice()).await;
        assert_eq!(status, StatusCode::ACCEPTED, "{rig}");
        daemon.wait_until_idle().await;
    }
    let refused = daemon.send("POST", "moves", &order, &[("x-operator", "<b>")]).await;
    assert_eq!(refused.0, StatusCode::BAD_REQUEST, "{}", refused.1);
    // A stop is accepted under any name.
    let stopped = daemon.send("POST", "stop", &Value::Null, &[("x-operator", "<b>")]).await;
    assert_eq!(stopped.0, StatusCode::OK, "{}", stopped.1);
    let is_latched = |status: &Status| status.snapshot.state == RigState::Latched;
    daemon.handle.status().wait_for(is_latched).await.unwrap();
    for (form, expected) in [
        (json!({ "nothing_below_probe": false }), StatusCode::UNPROCESSABLE_ENTITY),
        (Value::Null, StatusCode::UNPROCESSABLE_ENTITY),
        (json!({ "nothing_below_probe": true }), StatusCode::OK),
    ] {
        let home = daemon.send("POST", "home", &form, &[("x-operator", "Ada Lovelace")]).await;
        assert_eq!(home.0, expected, "{form}: {}", home.1);
    }
    daemon.wait_until_idle().await;

    let session = daemon.handle.status().borrow().session;
    let records = Reader::open(daemon.data.path()).unwrap().records(session).unwrap();
    let asked = records.iter().filter_map(|stored| match stored.record().unwrap() {
        Record::Operator(operator) => Some((operator.action, operator.who)),
        _ => None,
    });
    let expected = [
        ("home with nothing below the probe", "simulated person"),
        ("move the linear stage", "the lab"),
        ("move the linear stage", "Ada Lovelace"),
        ("move the linear stage", "J\u{fc}rgen"),
        ("stop", "the lab"),
        ("home with nothing below the probe", "Ada Lovelace"),
    ];
    let asked: Vec<_> = asked.collect();
    let asked: Vec<_> = asked.iter().map(|(what, who)| (what.as_str(), who.as_str())).collect();
    assert_eq!(asked, expected);
    daemon.close().await;
}

#[tokio::test]
async fn a_sweep_that_was_aborted_is_not_taken_for_the_next_one_and_none_is_made_up() {
    let mut daemon = Daemon::start().await;
    // Enough points that the sweep cannot end before the abort.
    let long = json!({
        "min_hz": 120, "max_hz": 165, "points": 10_000, "settle_s": 7, "time_limit_s": 86_400,
    });
    let (status, first) = daemon.ask("POST", "sweeps", &long).await;
    assert_eq!(status, StatusCode::ACCEPTED, "{first}");
    daemon.handle.command(Command::Abort, None, "test").await.unwrap();
    daemon.wait_until_idle().await;
    let (_, second) = daemon.ask("POST", "sweeps", &json!({ "min_hz": 120, "max_hz": 165 })).await;
    daemon.wait_until_idle().await;
    let session = second["id"].as_str().unwrap().rsplit_once('-').unwrap().0;
    for is_restarted in [false, true] {
        if is_restarted {
            daemon = daemon.restart().await;
        }
        for (sweep, expected) in [(&first, "failed"), (&second, "accepted")] {
            let path = format!("sweeps/{}", sweep["id"].as_str().unwrap());
            assert_eq!(daemon.ask("GET", &path, &Value::Null).await.1["status"], expected);
        }
        for number in [0, 3] {
            let path = format!("sweeps/{session}-{number}");
            let (status, problem) = daemon.ask("GET", &path, &Value::Null).await;
            assert_eq!(status, StatusCode::NOT_FOUND, "{path}: {problem}");
        }
    }
    daemon.close().await;
}

#[tokio::test]
async fn an_archived_run_is_listed_and_its_readings_are_gone() {
    let daemon = Daemon::start().await;
    let smoke = include_str!("../../../config/protocols/smoke.toml");
    let run = daemon.ask("POST", "runs", &json!({ "protocol_toml": smoke })).await.1;
    daemon.wait_until_idle().await;
    let id = run["id"].as_str().unwrap().to_owned();
    let daemon = daemon
        .restart_after(|data| {
            let store = Store::open(data).unwrap();
            store.archive(id.parse().unwrap(), "/archive/smoke-1", "somebody").unwrap();
        })
        .await;
    let runs = daemon.ask("GET", "runs", &Value::Null).await.1;
    assert_eq!((runs.as_array().unwrap().len(), &runs[0]["name"]), (1, &"smoke-1".into()));
    for what in ["", "/plan", "/sweeps", "/report", "/export?format=csv"] {
        let (status, problem) = daemon.ask("GET", &format!("runs/{id}{what}"), &Value::Null).await;
        assert_eq!(status, StatusCode::GONE, "{what}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains("/archive/smoke-1"), "{problem}");
    }
    let redo = json!({ "step": "main/1/left/45/1", "why": "it slipped" });
    let (status, problem) = daemon.ask("POST", &format!("runs/{id}/redo"), &redo).await;
    assert_eq!(status, StatusCode::CONFLICT, "{problem}");
    // The rig goes on: another run can be made.
    let run = daemon.ask("POST", "runs", &json!({ "protocol_toml": smoke })).await.1;
    daemon.wait_until_idle().await;
    let path = format!("runs/{}", run["id"].as_str().unwrap());
    let found = daemon.ask("GET", &path, &Value::Null).await.1;
    assert_eq!((&found["results"]["is_sound"], &found["name"]), (&true.into(), &"smoke-2".into()));
    daemon.close().await;
}

#[tokio::test]
async fn a_run_is_found_as_soon_as_it_has_an_id() {
    let daemon = Daemon::start().await;
    let protocol = include_str!("../../../config/protocols/three-direction.toml");
    for _ in 0..5 {
        // A record without urgency is committed later.
        daemon.move_to("rotary", 0.0).await;
        let (status, run) = daemon.ask("POST", "runs", &json!({ "protocol_toml": protocol })).await;
        assert_eq!(status, StatusCode::ACCEPTED, "{run}");
        let path = format!("runs/{}", run["id"].as_str().unwrap());
        let (status, found) = daemon.ask("GET", &path, &Value::Null).await;
        assert_eq!(status, StatusCode::OK, "{found}");
        daemon.handle.command(Command::Abort, None, "test").await.unwrap();
        daemon.wait_until_idle().await;
    }
    daemon.close().await;
}

#[tokio::test]
async fn an_idempotency_key_is_known_after_a_restart() {
    let (smoke, other) = (
        include_str!("../../../config/protocols/smoke.toml"),
        include_str!("../../../config/protocols/three-direction.toml"),
    );
    let mut daemon = Daemon::start().await;
    let mut runs = Vec::new();
    for round in 0..2 {
        let post = async |key: &str, text: &str| {
            let order = json!({ "protocol_toml": text });
            let answer = daemon.send("POST", "runs", &order, &[("idempotency-key", key)]).await;
            daemon.wait_until_idle().await;
            answer
        };
        let (first, second) = (post("monday", smoke).await, post("monday", smoke).await);
        assert_eq!((first.0, &first.1), (StatusCode::ACCEPTED, &second.1), "round {round}");
        runs.push(first.1["id"].clone());
        let (status, problem) = post("monday", other).await;
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{problem}");
        for key in ["", &"k".repeat(256), "\u{e4}"] {
            assert_eq!(post(key, smoke).await.0, StatusCode::BAD_REQUEST, "{key}");
        }
        daemon = daemon.restart().await;
    }
    assert_eq!(runs[0], runs[1]);
    let all = daemon.ask("GET", "runs", &Value::Null).await.1;
    assert_eq!(all.as_array().unwrap().len(), 1, "{all}");
    daemon.close().await;
}

/// What is told of the run under way.
async fn progress(daemon: &Daemon) -> Value {
    let (status, rig) = daemon.ask("GET", "rig", &Value::Null).await;
    assert_eq!(status, StatusCode::OK, "{rig}");
    rig["run"].clone()
}

#[tokio::test]
async fn a_person_may_note_something_about_a_run_and_change_it() {
    let daemon = Daemon::start().await;
    let smoke = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/protocols/smoke.toml"),
    );
    let (status, begun) =
        daemon.ask("POST", "runs", &json!({ "protocol_toml": smoke.unwrap() })).await;
    assert_eq!(status, StatusCode::ACCEPTED);
    let id = begun["id"].as_str().unwrap();
    let path = format!("runs/{id}/note");
    for note in [json!({ "note": "gel is 3 days old" }), json!({ "note": "", "is_starred": true })]
    {
        assert_eq!(daemon.ask("PUT", &path, &note).await.0, StatusCode::NO_CONTENT);
        let (_, notes) = daemon.ask("GET", "notes", &Value::Null).await;
        assert_eq!(notes[id]["note"], note["note"]);
        assert_eq!(notes[id]["is_starred"], note.get("is_starred").is_some());
    }
    let long = json!({ "note": "a".repeat(2001) });
    let unprocessable = StatusCode::UNPROCESSABLE_ENTITY;
    for (bad, status) in [
        (&long, StatusCode::BAD_REQUEST),
        (&json!({ "text": "" }), unprocessable),
        (&json!([1]), unprocessable),
    ] {
        assert_eq!(daemon.ask("PUT", &path, bad).await.0, status);
    }
    let other = path.replace(id, "01900000-0000-7000-8000-000000000000");
    assert_eq!(daemon.ask("PUT", &other, &json!({})).await.0, StatusCode::NOT_FOUND);
    assert_eq!(daemon.ask("PUT", &path, &json!({})).await.0, StatusCode::NO_CONTENT);
    assert_eq!(daemon.ask("GET", "notes", &Value::Null).await.1, json!({}));
    // The present rig is the rig of the run.
    let (_, since) = daemon.ask("GET", &format!("runs/{id}/changes"), &Value::Null).await;
    assert_eq!(since["changes"], json!([]));
    assert!(since["free_bytes"].as_u64().unwrap() > 0);
    // What went over the ports can be read.
    let (_, frames) = daemon.ask("GET", "frames", &Value::Null).await;
    let ports = frames["ports"].as_array().unwrap();
    assert_eq!(ports.len(), 2);
    for port in ports {
        let frames = port["frames"].as_array().unwrap();
        let is_sent = |wanted: bool| frames.iter().any(|frame| frame["is_sent"] == wanted);
        assert!(is_sent(true) && is_sent(false), "{port}");
    }
    daemon.close().await;
}
