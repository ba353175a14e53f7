//! Tokens of persons and programs, the lease, and browsers.

use std::convert::Infallible;

use axum::{
    body::{Body, to_bytes},
    http::StatusCode,
};
use futures_util::stream;
use rig_engine::RigState;
use rig_store::{Reader, Record};
use rigd::tokens::{self, Role};
use serde_json::Value;
use tokio::sync::oneshot;

use super::{Daemon, REQUESTS, SECRET};

impl Daemon {
    /// Makes a token, and gives the header with it.
    fn token(&self, name: &str, role: Role) -> String {
        let secret = tokens::make(self.data.path(), &name.parse().unwrap(), role).unwrap();
        format!("Bearer {}", secret.reveal())
    }

    pub(super) async fn reaches(&self, state: RigState) {
        let mut status = self.handle.status();
        status.wait_for(|status| status.snapshot.state == state).await.unwrap();
    }

    async fn status(&self, method: &str, path: &str, headers: &[(&str, &str)]) -> StatusCode {
        self.send(method, path, headers, "").await.status()
    }

    /// Sends the head of a command, and its body only after `meanwhile`.
    async fn moves_after(&self, token: &str, meanwhile: impl Future<Output = ()>) -> StatusCode {
        let (send, sent) = oneshot::channel::<()>();
        let body = stream::once(async move {
            _ = sent.await;
            Ok::<_, Infallible>(r#"{"axis": "rotary", "to": 10}"#)
        });
        let headers = [("authorization", token), ("content-type", "application/json")];
        let moving = self.send("POST", "/api/v1/moves", &headers, Body::from_stream(body));
        let meanwhile = async {
            meanwhile.await;
            send.send(()).unwrap();
        };
        tokio::join!(biased; moving, meanwhile).0.status()
    }

    async fn json(&self, method: &str, path: &str, token: &str, body: &str) -> (StatusCode, Value) {
        let headers = [("authorization", token), ("content-type", "application/json")];
        let answer = self.send(method, path, &headers, body.to_owned()).await;
        let (parts, body) = answer.into_parts();
        let bytes = to_bytes(body, usize::MAX).await.unwrap();
        (parts.status, serde_json::from_slice(&bytes).unwrap_or(Value::Null))
    }
}

#[tokio::test]
async fn a_role_allows_what_it_says_and_a_stop_is_allowed_to_everybody() {
    let daemon = Daemon::start_with(false, true).await;
    assert_eq!(daemon.status("POST", "/api/v1/stop", &[]).await, StatusCode::OK, "no token yet");
    let ada = daemon.token("ada", Role::View);
    for (method, path) in REQUESTS {
        let expected = (StatusCode::UNAUTHORIZED, "unauthorized");
        daemon.refused(method, path, &[], "", expected).await;
    }
    for (method, path) in REQUESTS {
        let answer = daemon.send(method, path, &[("authorization", &*ada)], "").await;
        let is_refused = answer.status() == StatusCode::FORBIDDEN;
        assert_eq!(is_refused, path == "/api/v1/runs", "{method} {path}: {}", answer.status());
    }
    let json = daemon.json("POST", "/api/v1/home", &ada, r#"{"nothing_below_probe": true}"#).await;
    assert_eq!(json.0, StatusCode::FORBIDDEN);
    assert!(json.1["detail"].as_str().unwrap().contains("operate; yours has view"), "{}", json.1);
    let bob = daemon.token("bob", Role::Operate);
    daemon.reaches(RigState::Latched).await;
    // The configuration is the administrator's.
    let reload = daemon.json("POST", "/api/v1/config/reload", &bob, "").await;
    assert_eq!(reload.0, StatusCode::FORBIDDEN, "{}", reload.1);
    assert!(reload.1["detail"].as_str().unwrap().contains("admin; yours has operate"));
    let begun = daemon.json("POST", "/api/v1/acknowledge", &bob, "").await;
    assert_eq!(begun.0, StatusCode::OK, "{}", begun.1);
    tokens::revoke(daemon.data.path(), &"ada".parse().unwrap()).unwrap();
    let expected = (StatusCode::UNAUTHORIZED, "unauthorized");
    daemon.refused("POST", "/api/v1/stop", &[("authorization", &*ada)], "", expected).await;
    // From then on everything is on disk.
    daemon.handle.close().await;
    let events = Reader::open(daemon.data.path()).unwrap().events_after(0, 1000).unwrap();
    let who = |wanted: &str| {
        events.iter().find_map(|stored| match stored.record().unwrap() {
            Record::Operator(operator) if operator.action == wanted => Some(operator.who),
            _ => None,
        })
    };
    assert_eq!(who("acknowledge").as_deref(), Some("bob"));
}

#[tokio::test]
async fn one_operates_while_others_watch_and_a_take_over_is_on_record() {
    let daemon = Daemon::start_with(false, true).await;
    let (ada, bob) = (daemon.token("ada", Role::Operate), daemon.token("bob", Role::Operate));
    let chief = daemon.token("chief", Role::Admin);
    let lease = async |method: &str, token: &str, body: &str| {
        daemon.json(method, "/api/v1/lease", token, body).await
    };
    assert_eq!(lease("GET", &ada, "").await.1, serde_json::json!({"is_yours": false}));
    assert_eq!(daemon.json("POST", "/api/v1/identify", &ada, "").await.0, StatusCode::OK);
    let (status, problem) = daemon.json("POST", "/api/v1/identify", &bob, "").await;
    assert_eq!(
        (status, &problem["detail"]),
        (StatusCode::CONFLICT, &"ada operates the rig".into())
    );
    let rig = daemon.json("GET", "/api/v1/rig", &bob, "").await.1;
    assert_eq!(rig["lease"]["name"], "ada");
    assert_eq!(lease("POST", &bob, "{}").await.0, StatusCode::CONFLICT);
    assert_eq!(lease("DELETE", &bob, "").await.0, StatusCode::CONFLICT);
    let (status, taken) = lease("POST", &bob, r#"{"take_over": true}"#).await;
    assert_eq!((status, &taken["is_yours"]), (StatusCode::OK, &true.into()), "{taken}");
    assert_eq!(daemon.json("POST", "/api/v1/identify", &ada, "").await.0, StatusCode::CONFLICT);
    assert_eq!(daemon.json("POST", "/api/v1/stop", &ada, "").await.0, StatusCode::OK);
    assert_eq!(lease("DELETE", &chief, "").await.0, StatusCode::NO_CONTENT);
    assert_eq!(lease("POST", &ada, "{}").await.1["is_yours"], true);
    // From then on everything is on disk.
    daemon.handle.close().await;
    let events = Reader::open(daemon.data.path()).unwrap().events_after(0, 1000).unwrap();
    let said = |wanted: (&str, &str)| {
        events.iter().any(|stored| match stored.record().unwrap() {
            Record::Operator(operator) => (&*operator.action, &*operator.who) == wanted,
            _ => false,
        })
    };
    assert!(said(("take over from ada", "bob")) && said(("end the lease of bob", "chief")));
}

#[tokio::test]
async fn a_command_whose_body_comes_late_is_of_whoever_may_give_it_then() {
    let daemon = Daemon::start_with(false, true).await;
    let (ada, bob) = (daemon.token("ada", Role::Operate), daemon.token("bob", Role::Operate));
    assert_eq!(daemon.json("POST", "/api/v1/lease", &ada, "{}").await.0, StatusCode::OK);
    let taken_over = daemon.moves_after(&ada, async {
        let over = r#"{"take_over": true}"#;
        assert_eq!(daemon.json("POST", "/api/v1/lease", &bob, over).await.0, StatusCode::OK);
    });
    assert_eq!(taken_over.await, StatusCode::CONFLICT);
    let revoked = daemon.moves_after(&bob, async {
        tokens::revoke(daemon.data.path(), &"bob".parse().unwrap()).unwrap();
    });
    assert_eq!(revoked.await, StatusCode::UNAUTHORIZED);
    assert_eq!(daemon.moves_after(&ada, async {}).await, StatusCode::CONFLICT);
}

#[tokio::test]
async fn a_browser_comes_in_by_a_link_once_and_its_cookie_is_no_door_for_other_sites() {
    let daemon = Daemon::start_with(true, true).await;
    let ada = daemon.token("ada", Role::Operate);
    let link = daemon.json("POST", "/api/v1/links", &ada, "").await.1;
    let path = link["path"].as_str().unwrap();
    let evil = [("sec-fetch-site", "cross-site")];
    assert_eq!(daemon.status("GET", path, &evil).await, StatusCode::FORBIDDEN);
    let opened = daemon.send("GET", path, &[("accept", "text/html")], "").await;
    assert_eq!(
        (opened.status(), &opened.headers()["location"]),
        (StatusCode::SEE_OTHER, &"/".parse().unwrap())
    );
    let cookie = opened.headers()["set-cookie"].to_str().unwrap();
    assert!(
        cookie.contains("; HttpOnly; SameSite=Strict") && cookie.contains("Path=/"),
        "{cookie}"
    );
    assert_eq!(daemon.status("GET", path, &[]).await, StatusCode::GONE);
    let cookie = ("cookie", cookie.split(';').next().unwrap());
    let who = daemon.send("GET", "/api/v1/session", &[cookie], "").await;
    let who: Value =
        serde_json::from_slice(&to_bytes(who.into_body(), 999).await.unwrap()).unwrap();
    assert_eq!(who, serde_json::json!({"name": "ada", "role": "operate", "has_token": true}));
    // A command must come from a page of the daemon.
    assert_eq!(daemon.status("POST", "/api/v1/identify", &[cookie]).await, StatusCode::FORBIDDEN);
    let own = [cookie, ("origin", "http://localhost:8137")];
    assert_eq!(daemon.status("POST", "/api/v1/identify", &own).await, StatusCode::OK);
    let other_port = [cookie, ("host", "localhost:9")];
    assert_eq!(daemon.status("GET", "/api/v1/rig", &other_port).await, StatusCode::UNAUTHORIZED);
    tokens::revoke(daemon.data.path(), &"ada".parse().unwrap()).unwrap();
    assert_eq!(daemon.status("GET", "/api/v1/rig", &[cookie]).await, StatusCode::UNAUTHORIZED);
    // The page makes a cookie of the token that a person types.
    let secret = format!("Bearer {SECRET}");
    let typed = daemon.send("POST", "/api/v1/session", &[("authorization", &secret)], "").await;
    let cookie = typed.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap();
    let own = [("cookie", cookie), ("origin", "http://localhost:8137")];
    assert_eq!(daemon.status("GET", "/api/v1/rig", &own).await, StatusCode::OK);
    assert_eq!(daemon.status("DELETE", "/api/v1/session", &own).await, StatusCode::NO_CONTENT);
    assert_eq!(daemon.status("GET", "/api/v1/rig", &own).await, StatusCode::UNAUTHORIZED);
}

#[tokio::test]
async fn a_cookie_and_a_link_from_before_the_first_token_open_nothing_after_it() {
    let daemon = Daemon::start_with(false, true).await;
    let begun = daemon.send("POST", "/api/v1/session", &[], "").await;
    let cookie = begun.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap();
    let own = [("cookie", cookie), ("origin", "http://localhost:8137")];
    assert_eq!(daemon.status("GET", "/api/v1/session", &own).await, StatusCode::OK);
    let link = daemon.json("POST", "/api/v1/links", "", "").await.1;
    let link = link["path"].as_str().unwrap();
    let ada = daemon.token("ada", Role::View);
    for (method, path) in [("GET", "/api/v1/rig"), ("POST", "/api/v1/identify"), ("GET", link)] {
        let status = daemon.status(method, path, &own).await;
        assert_eq!(status, StatusCode::UNAUTHORIZED, "{method} {path}");
    }
    // What was given for a token goes on.
    let begun = daemon.send("POST", "/api/v1/session", &[("authorization", &*ada)], "").await;
    let cookie = begun.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap();
    let own = [("cookie", cookie)];
    assert_eq!(daemon.status("GET", "/api/v1/rig", &own).await, StatusCode::OK);
}

#[tokio::test]
async fn tokens_cannot_be_guessed_in_bulk_and_who_knows_one_is_not_shut_out() {
    let daemon = Daemon::start_with(true, true).await;
    let ada = daemon.token("ada", Role::View);
    let guess =
        async |guess: &str| daemon.status("GET", "/api/v1/rig", &[("authorization", guess)]).await;
    for number in 0..10 {
        assert_eq!(guess(&format!("Bearer {number}")).await, StatusCode::UNAUTHORIZED);
    }
    let expected = (StatusCode::TOO_MANY_REQUESTS, "too many requests");
    let wrong = [("authorization", "Bearer 11")];
    let answer = daemon.refused("GET", "/api/v1/rig", &wrong, "", expected).await;
    assert_eq!(answer.headers()["retry-after"], "6");
    // The secret of the file could be guessed, that of ada could not.
    assert_eq!(guess(&format!("Bearer {SECRET}")).await, StatusCode::TOO_MANY_REQUESTS);
    assert_eq!(guess(&ada).await, StatusCode::OK);
}
