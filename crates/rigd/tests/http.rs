//! What a client of the daemon can ask for besides runs.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::path::Path;

use axum::{
    Router,
    body::{Body, to_bytes},
    http::{Request, StatusCode, header},
};
use rig_engine::StateWord;
use rig_store::{Reader, Record};
use rigd::{
    http::{Shared, router},
    loaded_rig::LoadedRig,
    rig::{self, RigHandle, RigThread},
};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

/// The shipped simulated rig behind the routes of the daemon.
struct Daemon {
    router: Router,
    handle: RigHandle,
    thread: RigThread,
    data: TempDir,
}

impl Daemon {
    async fn start() -> Self {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/rigs/simulated.toml");
        let (rig, data) = (LoadedRig::load(&file).unwrap(), TempDir::new().unwrap());
        let facts = rig.facts();
        let (handle, thread) = rig::open(rig, data.path().to_owned()).unwrap();
        let directory = data.path().to_owned();
        let shared = Shared::new(handle.clone(), facts, None, directory, CancellationToken::new());
        let daemon = Self { router: router(shared), handle, thread, data };
        daemon.wait_until_idle().await;
        daemon
    }

    async fn wait_until_idle(&self) {
        let mut status = self.handle.status();
        status.wait_for(|status| status.snapshot.state == StateWord::Idle).await.unwrap();
    }

    async fn ask(&self, method: &str, path: &str, body: &Value) -> (StatusCode, Value) {
        let request = Request::builder()
            .method(method)
            .uri(format!("/api/v1/{path}"))
            .header(header::CONTENT_TYPE, "application/json")
            .body(Body::from(body.to_string()))
            .unwrap();
        let answer = self.router.clone().oneshot(request).await.unwrap();
        let status = answer.status();
        let bytes = to_bytes(answer.into_body(), usize::MAX).await.unwrap();
        (status, serde_json::from_slice(&bytes).unwrap())
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
async fn an_axis_is_moved_within_what_the_interlock_admits() {
    let daemon = Daemon::start().await;
    assert_eq!(daemon.move_to("rotary", 30.0).await.0, StatusCode::ACCEPTED);
    assert_eq!(daemon.rig().await["rotary_deg"], 30.0);
    assert_eq!(daemon.move_to("linear", 20.0).await.0, StatusCode::ACCEPTED);
    let rig = daemon.rig().await;
    assert_eq!((&rig["linear_mm"], &rig["probe"]), (&json!(20.0), &json!("in contact")));

    let rows = [
        ("rotary", 0.0, StatusCode::CONFLICT, "while the probe is in contact"),
        ("rotary", 51.0, StatusCode::CONFLICT, "while the probe is in contact"),
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
    assert_eq!(daemon.move_to("linear", 30.0).await.0, StatusCode::ACCEPTED);
    assert_eq!(daemon.rig().await["probe"], "clear");

    let session = daemon.handle.status().borrow().session;
    let records = Reader::open(daemon.data.path()).unwrap().records(session).unwrap();
    let is_intent = |record: &Record| matches!(record, Record::Intent(intent) if intent.to == 20.0);
    assert!(records.iter().any(|stored| is_intent(&stored.record().unwrap())));
    daemon.handle.close().await;
    daemon.thread.join();
}
