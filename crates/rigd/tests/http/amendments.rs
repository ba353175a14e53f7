//! Runs that are continued, amended and given up.

use super::*;

#[tokio::test]
async fn a_touch_that_is_left_out_is_neither_to_be_measured_nor_measured() {
    let daemon = Daemon::start().await;
    let (_, begun) = daemon.ask("POST", "runs", &json!({ "protocol_toml": SMOKE })).await;
    let run = |what: &str| format!("runs/{}/{what}", begun["id"].as_str().unwrap());
    let mut rig = daemon.handle.status();
    let has_touches =
        |status: &rig::Status| status.run.as_ref().is_some_and(|run| run.touches_done >= 2);
    rig.wait_for(has_touches).await.unwrap();
    let is_paused = |status: &rig::Status| status.snapshot.state == RigState::Paused;
    assert_eq!(daemon.ask("POST", &run("pause"), &json!({})).await.0, StatusCode::ACCEPTED);
    rig.wait_for(is_paused).await.unwrap();
    let before = progress(&daemon).await;
    let (_, plan) = daemon.ask("GET", &run("plan"), &Value::Null).await;
    let steps = plan["steps"].as_array().unwrap();
    let is_touch = |step: &&Value| step["action"] == "touch";
    let last = steps.iter().rfind(is_touch).unwrap_or_else(|| panic!("{plan}"));
    let skip = json!({ "step": last["step"], "why": "it is dry" });
    assert_eq!(daemon.ask("POST", &run("skip"), &skip).await.0, StatusCode::NO_CONTENT);
    let planned = |run: &Value| run["touches_planned"].as_u64().unwrap();
    let is_less = |status: &rig::Status| {
        status.run.as_ref().is_some_and(|run| run.touches_planned() as u64 == planned(&before) - 1)
    };
    rig.wait_for(is_less).await.unwrap();
    let after = progress(&daemon).await;
    let to_go = |run: &Value| run["remaining_s"][0].as_f64().unwrap();
    assert!(to_go(&after) < to_go(&before), "{before} {after}");

    assert_eq!(daemon.ask("POST", &run("abort"), &json!({})).await.0, StatusCode::ACCEPTED);
    daemon.wait_until_idle().await;
    assert_eq!(daemon.ask("POST", &run("continue"), &json!({})).await.0, StatusCode::ACCEPTED);
    let status = daemon.handle.status().borrow().clone();
    let run = status.run.unwrap();
    assert_eq!((run.touches_planned() as u64, run.touches_skipped), (planned(&after), 1));
    assert_eq!(Some(run.touches_before as u64), after["touches_measured"].as_u64());
    daemon.wait_until_idle().await;
    let run = daemon.handle.status().borrow().run.clone().unwrap();
    assert_eq!(run.touches_done, run.touches_planned());
    daemon.close().await;
}

/// Each amendment is answered with what is true of it, and with nothing else.
async fn check_amendments_of_a_run_under_way(daemon: &Daemon, id: &str) {
    let step = json!({ "step": "main/1/front/0/1", "why": "it slipped" });
    let nowhere = json!({ "step": "main/7/front/0/1", "why": "it slipped" });
    let blank = json!({ "step": "main/1/front/0/1", "why": " " });
    let conflict = StatusCode::CONFLICT;
    for (what, body, expected, said) in [
        ("skip", &step, conflict, "touch main/1/front/0/1 has begun"),
        (
            "skip",
            &nowhere,
            StatusCode::NOT_FOUND,
            "the run under way has no touch main/7/front/0/1",
        ),
        ("redo", &step, conflict, "cannot measure a touch again while the rig is paused"),
        ("skip", &blank, StatusCode::UNPROCESSABLE_ENTITY, "why: the reason is empty"),
        ("redo", &blank, StatusCode::UNPROCESSABLE_ENTITY, "why: the reason is empty"),
    ] {
        let (status, problem) = daemon.ask("POST", &format!("runs/{id}/{what}"), body).await;
        assert_eq!(status, expected, "{what} {body}: {problem}");
        assert!(problem["detail"].as_str().unwrap().starts_with(said), "{what}: {problem}");
    }
}

/// Measures the first touch of a run again, and gives the id of the amendment.
async fn check_redo(daemon: &Daemon, id: &str, step: &Value) -> String {
    let answer = daemon.answer("POST", &format!("runs/{id}/redo"), step, &[]).await;
    assert_eq!(answer.status(), StatusCode::ACCEPTED);
    let location = answer.headers()[header::LOCATION].to_str().unwrap().to_owned();
    let redone = to_bytes(answer.into_body(), usize::MAX).await.unwrap();
    let redone: Value = serde_json::from_slice(&redone).unwrap();
    let amendment = redone["id"].as_str().unwrap();
    assert_ne!(amendment, id);
    let (_, plan) = daemon.ask("GET", &format!("runs/{amendment}/plan"), &Value::Null).await;
    assert_eq!((&plan["touches"], plan["steps"].as_array().unwrap().len()), (&1.into(), 4));
    daemon.wait_until_idle().await;
    let row = first_touch(daemon, location.strip_prefix("/api/v1/").unwrap()).await;
    assert_eq!(row["amended"], "redo by the lab: it slipped", "{row}");
    amendment.to_owned()
}

async fn first_touch(daemon: &Daemon, path: &str) -> Value {
    daemon.ask("GET", path, &Value::Null).await.1["results"]["touch_results"][0].clone()
}

#[tokio::test]
async fn a_run_is_continued_amended_and_given_up_over_http() {
    let daemon = Daemon::start().await;
    let protocol = json!({ "protocol_toml": SMOKE });
    let (status, begun) = daemon.ask("POST", "runs", &protocol).await;
    assert_eq!(status, StatusCode::ACCEPTED, "{begun}");
    let id = begun["id"].as_str().unwrap().to_owned();
    let run = |what: &str| format!("runs/{id}/{what}");
    let (status, refusal) = daemon.ask("POST", &run("continue"), &json!({})).await;
    assert_eq!(status, StatusCode::CONFLICT, "{refusal}");
    let mut rig = daemon.handle.status();
    let has_touches =
        |status: &rig::Status| status.run.as_ref().is_some_and(|run| run.touches_done >= 2);
    rig.wait_for(has_touches).await.unwrap();
    let step = json!({ "step": "main/1/front/0/1", "why": "it slipped" });
    assert_eq!(daemon.ask("POST", &run("pause"), &json!({})).await.0, StatusCode::ACCEPTED);
    let is_paused = |status: &rig::Status| status.snapshot.state == RigState::Paused;
    rig.wait_for(is_paused).await.unwrap();
    check_amendments_of_a_run_under_way(&daemon, &id).await;
    assert_eq!(daemon.ask("POST", &run("abort"), &json!({})).await.0, StatusCode::ACCEPTED);
    daemon.wait_until_idle().await;
    let (_, runs) = daemon.ask("GET", "runs", &Value::Null).await;
    assert_eq!((&runs[0]["status"], &runs[0]["is_resumable"]), (&"aborted".into(), &true.into()));

    let unknown = json!({ "accept_change": true });
    let (status, problem) = daemon.ask("POST", &run("continue"), &unknown).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{problem}");
    let (status, continued) = daemon.ask("POST", &run("continue"), &json!({})).await;
    assert_eq!((status, &continued["id"]), (StatusCode::ACCEPTED, &id.as_str().into()));
    let (_, plan) = daemon.ask("GET", &run("plan"), &Value::Null).await;
    assert_eq!(
        (&plan["touches"], plan["steps"].as_array().unwrap().len() > 40),
        (&18.into(), true)
    );
    let is_ended =
        |status: &rig::Status| status.run.as_ref().is_some_and(|run| run.ending.is_some());
    rig.wait_for(is_ended).await.unwrap();
    daemon.wait_until_idle().await;
    let (_, detail) = daemon.ask("GET", &format!("runs/{id}"), &Value::Null).await;
    assert_eq!(
        (&detail["status"], &detail["results"]["touches"]),
        (&"completed".into(), &18.into())
    );
    for what in ["continue", "give-up"] {
        let (status, refusal) = daemon.ask("POST", &run(what), &json!({})).await;
        assert_eq!(status, StatusCode::CONFLICT, "{refusal}");
        assert!(refusal["detail"].as_str().unwrap().contains("sealed"), "{refusal}");
        assert!(refusal["hint"].as_str().unwrap().contains("redo measures one touch"), "{refusal}");
    }

    let amendment = check_redo(&daemon, &id, &step).await;
    let amended = async || first_touch(&daemon, &format!("runs/{id}")).await;
    let row = amended().await;
    daemon.check_sweep(&run("sweeps"), &row["sweep"]).await;
    assert_eq!(daemon.ask("POST", &run("skip"), &step).await.0, StatusCode::NO_CONTENT);
    assert_eq!(amended().await["status"], "skipped");
    let nowhere = json!({ "step": "main/7/front/0/1", "why": "it slipped" });
    for what in ["redo", "skip"] {
        assert_eq!(daemon.ask("POST", &run(what), &nowhere).await.0, StatusCode::NOT_FOUND);
    }
    // Aborting the run was not about the touch that was measured again.
    daemon.check_sound(&[&id, &amendment]);
    // Amendments are no runs of the list.
    let (_, runs) = daemon.ask("GET", "runs", &Value::Null).await;
    assert_eq!(runs.as_array().unwrap().len(), 1);
    daemon.close().await;
}

#[tokio::test]
async fn a_damaged_run_is_refused_with_what_helps() {
    let daemon = Daemon::start().await;
    let (_, begun) = daemon.ask("POST", "runs", &json!({ "protocol_toml": SMOKE })).await;
    let id = begun["id"].as_str().unwrap();
    let mut rig = daemon.handle.status();
    let has_touches =
        |status: &rig::Status| status.run.as_ref().is_some_and(|run| run.touches_done >= 2);
    rig.wait_for(has_touches).await.unwrap();
    let abort = daemon.ask("POST", &format!("runs/{id}/abort"), &json!({})).await;
    assert_eq!(abort.0, StatusCode::ACCEPTED);
    daemon.wait_until_idle().await;
    let database = rusqlite::Connection::open(daemon.data.path().join("rigd.db")).unwrap();
    let damage = "UPDATE records SET payload = replace(payload, '0', '1') WHERE kind = 'sweep'";
    assert!(database.execute(damage, []).unwrap() > 0);
    let touch = json!({ "step": "main/1/front/0/1", "why": "it slipped" });
    for (what, body) in [("continue", &json!({})), ("redo", &touch), ("skip", &touch)] {
        let (status, problem) = daemon.ask("POST", &format!("runs/{id}/{what}"), body).await;
        assert_eq!(status, StatusCode::INTERNAL_SERVER_ERROR, "{what}: {problem}");
        let hint = problem["hint"].as_str().unwrap_or_default();
        assert!(hint.contains("`rigd salvage NEW --data DIR`"), "{what}: {problem}");
    }
    daemon.close().await;
}
