//! Streams of events, and requests that take a processor for a while.

use std::sync::mpsc;

use axum::http::Response;
use futures_util::StreamExt;

use super::*;

/// The kinds of the events until the mark, and the kinds after it until the end of a run.
async fn kinds(answer: Response<Body>) -> (Vec<String>, Vec<String>) {
    let (mut stream, mut text) = (answer.into_body().into_data_stream(), String::new());
    let (mut before, mut after, mut is_live) = (Vec::new(), Vec::new(), false);
    loop {
        text.push_str(std::str::from_utf8(&stream.next().await.unwrap().unwrap()).unwrap());
        while let Some((event, rest)) = text.split_once("\n\n") {
            let kind = event.lines().find_map(|line| line.strip_prefix("event: "));
            let kind = kind.unwrap_or_default().to_owned();
            text = rest.to_owned();
            match (kind.as_str(), is_live) {
                ("now_live", _) => is_live = true,
                ("run_finished", true) => return (before, after),
                (_, false) => before.push(kind),
                (_, true) => after.push(kind),
            }
        }
    }
}

#[tokio::test]
async fn events_come_by_topic_with_a_mark_where_they_become_live() {
    let daemon = Daemon::start().await;
    daemon.run_to_its_end(SMOKE).await;
    let path = "/api/v1/events?topics=run,measurement";
    let answer = daemon.raw("GET", path, &[("last-event-id", "0")]).await;
    daemon.begin(SMOKE).await;
    let (before, after) = kinds(answer).await;
    for kind in before.iter().chain(&after) {
        let known = ["run_", "surface_", "sweep", "touch_"];
        assert!(known.iter().any(|begin| kind.starts_with(begin)), "{kind}");
    }
    let touches = |kinds: &[String]| kinds.iter().filter(|kind| *kind == "touch_result").count();
    assert_eq!((touches(&before), touches(&after)), (18, 18));
    assert_eq!(before.iter().filter(|kind| *kind == "run_finished").count(), 1);
    let wrong = daemon.raw("GET", "/api/v1/events?topics=run,weather", &[]).await;
    assert_eq!(wrong.status(), StatusCode::BAD_REQUEST);
    daemon.close().await;
}

/// The events of a stream, with their ids.
struct Events {
    stream: axum::body::BodyDataStream,
    text: String,
}

impl Events {
    fn of(answer: Response<Body>) -> Self {
        assert_eq!(answer.status(), StatusCode::OK);
        Self { stream: answer.into_body().into_data_stream(), text: String::new() }
    }

    /// The id and the kind of the next event.
    async fn next(&mut self) -> (Option<u64>, String) {
        loop {
            if let Some((event, _)) = self.text.split_once("\n\n") {
                let of = |name| event.lines().find_map(|line| line.strip_prefix(name));
                let found = (of("id: ").map(|id| id.parse().unwrap()), of("event: "));
                let found = found.1.map(|kind| (found.0, kind.to_owned()));
                let end = event.len() + 2;
                drop(self.text.drain(..end));
                if let Some(found) = found {
                    return found;
                }
            }
            let part = self.stream.next().await.unwrap().unwrap();
            self.text.push_str(std::str::from_utf8(&part).unwrap());
        }
    }

    /// The kinds up to this one.
    async fn until(&mut self, last: &str) -> Vec<String> {
        let mut kinds = Vec::new();
        while kinds.last().is_none_or(|kind| kind != last) {
            kinds.push(self.next().await.1);
        }
        kinds
    }
}

fn begin_of_stream(last: &str) -> [(&str, &str); 1] {
    [("last-event-id", last)]
}

#[tokio::test]
async fn a_run_that_is_given_up_on_an_idle_rig_comes_as_an_event_and_the_mark_with_it() {
    let daemon = Daemon::start().await;
    let id = daemon.begin(SMOKE).await;
    daemon.handle.command(Command::Abort, None, "test").await.unwrap();
    daemon.wait_until_idle().await;
    let daemon = daemon.restart().await;
    let mut live = Events::of(daemon.raw("GET", "/api/v1/events", &[]).await);
    assert_eq!(live.next().await.1, "now_live");
    let (status, problem) = daemon.ask("POST", &format!("runs/{id}/give-up"), &json!({})).await;
    assert_eq!(status, StatusCode::NO_CONTENT, "{problem}");
    // Nothing else happens on the rig.
    assert_eq!(live.until("run_finished").await, ["given_up", "run_finished"]);
    let mut from_journal =
        Events::of(daemon.raw("GET", "/api/v1/events?topics=run", &begin_of_stream("0")).await);
    let kinds = from_journal.until("now_live").await;
    assert_eq!(kinds.iter().filter(|kind| *kind == "given_up").count(), 1, "{kinds:?}");
    daemon.close().await;
}

#[tokio::test]
async fn a_client_that_has_seen_more_than_the_journal_has_gets_what_happens_from_now_on() {
    let daemon = Daemon::start().await;
    let ahead = begin_of_stream("1000000");
    let mut events = Events::of(daemon.raw("GET", "/api/v1/events", &ahead).await);
    assert_eq!(events.next().await.1, "now_live");
    let newest = daemon.handle.status().borrow().last_event;
    daemon.move_to("rotary", 10.0).await;
    let (id, _) = events.next().await;
    assert_eq!(id, Some(newest + 1));
    daemon.close().await;
}

#[tokio::test]
async fn a_stop_does_not_wait_for_a_protocol_that_is_laid_out() {
    let mut daemon = Daemon::start().await;
    let builders = tokio::runtime::Builder::new_current_thread().max_blocking_threads(1).build();
    let builders = builders.unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/rigs/simulated.toml");
    let facts = LoadedRig::load(&file).unwrap().facts();
    daemon.router = routes(&daemon.handle, facts, &daemon.data, builders.handle().clone());
    // The only thread that lays protocols out has something else to do.
    let (free, busy) = mpsc::channel::<()>();
    let held = builders.handle().spawn_blocking(move || busy.recv());
    let protocol = json!({ "protocol_toml": SMOKE });
    let (plan, run, queue) = tokio::join!(
        biased;
        daemon.ask("POST", "protocols/check", &protocol),
        daemon.ask("POST", "queue", &protocol),
        async {
            let stopped = daemon.raw("POST", "/api/v1/stop", &[]).await;
            assert_eq!(stopped.status(), StatusCode::OK);
            drop(free);
        }
    );
    assert_eq!((plan.0, run.0), (StatusCode::OK, StatusCode::CREATED), "{plan:?} {run:?}");
    _ = (held.await, queue);
    builders.shutdown_background();
    daemon.close().await;
}
