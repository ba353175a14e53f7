//! The files of the page, and its requests.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{net::Ipv4Addr, path::Path};

use axum::{
    Router,
    body::{Body, BodyDataStream, to_bytes},
    http::{Request, Response, StatusCode, header},
};
use futures_util::{StreamExt, future::join_all};
use rig_engine::RigState;
use rig_files::rig_file::{Connection, SimulatedPerson};
use rigd::{
    http::{Shared, access::Access, router},
    loaded_rig::LoadedRig,
    rig::{self, RigHandle, RigThread},
};
use serde_json::Value;
use tempfile::TempDir;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

struct Daemon {
    router: Router,
    handle: RigHandle,
    thread: RigThread,
    _data: TempDir,
}

impl Daemon {
    async fn start(person: SimulatedPerson) -> Self {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/rigs/simulated.toml");
        let mut rig = LoadedRig::load(&file).unwrap();
        if let Connection::Simulated(simulation) = &mut rig.file.connection {
            simulation.person = person;
        }
        let (facts, data) = (rig.facts(), TempDir::new().unwrap());
        let (handle, thread) = rig::open(rig, data.path().to_owned()).unwrap();
        let directory = data.path().to_owned();
        let operator = "the lab".parse().unwrap();
        let access = Access::new(Ipv4Addr::LOCALHOST.into(), [], None, operator);
        let closing = CancellationToken::new();
        let shared = Shared::new(
            handle.clone(),
            facts,
            None,
            directory,
            access,
            tokio::runtime::Handle::current(),
            closing,
        );
        let daemon = Self { router: router(shared), handle, thread, _data: data };
        daemon.wait_for(RigState::Idle).await;
        daemon
    }

    async fn wait_for(&self, state: RigState) {
        let mut status = self.handle.status();
        status.wait_for(|status| status.snapshot.state == state).await.unwrap();
    }

    async fn close(self) {
        self.handle.close().await;
        self.thread.join();
    }

    async fn send(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &str,
    ) -> Response<Body> {
        let mut request =
            Request::builder().method(method).uri(path).header(header::HOST, "localhost");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.router
            .clone()
            .oneshot(request.body(Body::from(body.to_owned())).unwrap())
            .await
            .unwrap()
    }

    async fn post(&self, path: &str, content_type: &str, body: &str) -> (StatusCode, Value) {
        let headers = [("content-type", content_type)];
        let answer = self.send("POST", &format!("/api/v1/{path}"), &headers, body).await;
        let status = answer.status();
        let bytes = to_bytes(answer.into_body(), usize::MAX).await.unwrap();
        (status, serde_json::from_slice(&bytes).unwrap_or_default())
    }

    async fn get(&self, path: &str) -> Value {
        let answer = self.send("GET", &format!("/api/v1/{path}"), &[], "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
        let bytes = to_bytes(answer.into_body(), usize::MAX).await.unwrap();
        serde_json::from_slice(&bytes).unwrap()
    }
}

fn smoke() -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/protocols/smoke.toml");
    std::fs::read_to_string(file).unwrap()
}

#[tokio::test]
async fn the_page_is_served_with_its_type_its_tag_and_a_strict_policy() {
    let daemon = Daemon::start(SimulatedPerson::Answers).await;
    let files = [
        ("/", "text/html; charset=utf-8"),
        ("/page.js", "text/javascript; charset=utf-8"),
        ("/page.css", "text/css; charset=utf-8"),
        ("/icon.svg", "image/svg+xml"),
    ];
    for (path, content_type) in files {
        let answer = daemon.send("GET", path, &[("accept", "text/html")], "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
        assert_eq!(answer.headers()[header::CONTENT_TYPE], content_type, "{path}");
        let policy = answer.headers()[header::CONTENT_SECURITY_POLICY].to_str().unwrap().to_owned();
        assert!(policy.contains("default-src 'none'") && policy.contains("script-src 'self'"));
        assert!(!policy.contains("unsafe"), "{policy}");
        let tag = answer.headers()[header::ETAG].to_str().unwrap().to_owned();
        let bytes = to_bytes(answer.into_body(), usize::MAX).await.unwrap();
        let text = String::from_utf8(bytes.to_vec()).unwrap();
        // The name of the SVG vocabulary and links to licences are no addresses that are asked.
        let asks = text.replace("http://www.w3.org", "").contains("src=\"http");
        assert!(!text.is_empty() && !asks, "{path}");
        let headers = [("accept", "text/html"), ("if-none-match", &*tag)];
        let again = daemon.send("GET", path, &headers, "").await;
        assert_eq!(again.status(), StatusCode::NOT_MODIFIED, "{path}");
        assert!(to_bytes(again.into_body(), usize::MAX).await.unwrap().is_empty());
    }
    daemon.close().await;
}

#[tokio::test]
async fn a_protocol_is_checked_without_moving_anything() {
    let daemon = Daemon::start(SimulatedPerson::Answers).await;
    let (status, plan) = daemon.post("protocols/check", "application/toml", &smoke()).await;
    assert_eq!(status, StatusCode::OK, "{plan}");
    assert_eq!((&plan["protocol"], &plan["touches"]), (&"smoke".into(), &18.into()));
    let steps = plan["steps"].as_array().unwrap();
    let touches = steps.iter().filter(|step| step["action"] == "touch").count();
    assert_eq!(touches, 18);
    let total_s: f64 = steps.iter().map(|step| step["duration_s"].as_f64().unwrap()).sum();
    assert!((total_s - plan["duration_s"].as_f64().unwrap()).abs() < 1e-9 * total_s);
    let wrong = smoke().replace("indentation_mm = 0.5", "indentation_mm = 5");
    let (status, problem) = daemon.post("protocols/check", "application/toml", &wrong).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(problem["faults"][0]["line"].as_u64().unwrap() > 1, "{problem}");
    let (status, _) = daemon.post("protocols/check", "application/toml", "").await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "no protocol is loaded");
    assert_eq!(daemon.get("runs").await, Value::Array(Vec::new()));
    daemon.close().await;
}

#[tokio::test]
async fn a_late_answer_does_not_answer_the_next_prompt() {
    let daemon = Daemon::start(SimulatedPerson::Waits).await;
    let (_, run) = daemon.post("runs", "application/toml", &smoke()).await;
    let id = run["id"].as_str().unwrap().to_owned();
    daemon.wait_for(RigState::WaitingForPerson).await;
    let first = daemon.get("rig").await["asked"].clone();
    assert_eq!((&first["what"], &first["number"]), (&"place_sample".into(), &1.into()));
    let step = first["step"].as_str().unwrap();
    let path = format!("runs/{id}/answer?step={step}");
    let (status, _) = daemon.post(&path, "application/json", "").await;
    assert_eq!(status, StatusCode::ACCEPTED);
    let mut status = daemon.handle.status();
    let second = loop {
        let asked = daemon.get("rig").await["asked"].clone();
        if asked["number"] == 2 {
            break asked;
        }
        status.changed().await.unwrap();
    };
    // A second person answers the earlier prompt.
    let (status, problem) = daemon.post(&path, "application/json", "").await;
    assert_eq!((status, &problem["title"]), (StatusCode::CONFLICT, &"not asked".into()));
    assert_eq!(daemon.get("rig").await["asked"], second);
    let plan = daemon.get(&format!("runs/{id}/plan")).await;
    assert_eq!(plan["steps"][1]["step"], second["step"]);
    daemon.close().await;
}

#[tokio::test]
async fn each_of_many_streams_sees_the_readings_as_they_come_and_those_are_of_the_journal() {
    let daemon = Daemon::start(SimulatedPerson::Answers).await;
    // With this many, the time between two events of a stream depends on their number.
    let mut streams = Vec::new();
    for _ in 0..60 {
        let answer = daemon.send("GET", "/api/v1/events?live=true", &[], "").await;
        streams.push(answer.into_body().into_data_stream());
    }
    daemon.post("sweeps", "application/json", r#"{"min_hz": 120, "max_hz": 165}"#).await;
    join_all(streams.into_iter().map(follow_a_sweep)).await;
    daemon.close().await;
}

/// Reads a stream until the journal has the sweep and the live readings have caught up with it.
async fn follow_a_sweep(mut stream: BodyDataStream) {
    let (mut text, mut live, mut journal) = (String::new(), Vec::new(), None);
    let mut sigmas = Vec::new();
    while journal.as_ref().is_none_or(|all: &Vec<f64>| live.len() < all.len()) {
        text.push_str(std::str::from_utf8(&stream.next().await.unwrap().unwrap()).unwrap());
        while let Some((event, rest)) = text.split_once("\n\n") {
            let (kind, data) = kind_and_data(event);
            text = rest.to_owned();
            let frequency = |reading: &Value| reading["frequency_hz"].as_f64().unwrap();
            let frequencies = |of: &Value| of.as_array().unwrap().iter().map(frequency).collect();
            if kind == "live_sweep" {
                assert_eq!(data["from"][0], live.len());
                live.extend::<Vec<f64>>(frequencies(&data["readings"]));
                let estimates = data["estimates"].as_array().unwrap();
                sigmas.extend(estimates.iter().map(|e| e["sigma_hz"].as_f64().unwrap()));
            } else if kind == "sweep" {
                journal = Some(frequencies(&data["record"]["readings"]));
            }
        }
    }
    assert_eq!(Some(live), journal);
    assert!(sigmas.last() < sigmas.first(), "{sigmas:?}");
}

fn kind_and_data(event: &str) -> (String, Value) {
    let field = |name: &str| event.lines().find_map(|line| line.strip_prefix(name));
    let data = field("data: ").map(|data| serde_json::from_str(data).unwrap());
    (field("event: ").unwrap_or_default().to_owned(), data.unwrap_or_default())
}
