//! The page of the laboratory shows rigs and finds runs.

use std::{
    io::{Read, Write},
    net::SocketAddr,
    time::Duration,
};

use rig_hub::{Catalogue, CatalogueError, FoundRun, Limits, Rig, Wanted, admin, serve};
use rig_store::{Ending, Journal, Prompt, PromptAnswered, PromptAsked, Record, RunKind, Store};
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;
use tokio::{join, net::TcpListener, task::spawn_blocking, time::timeout};
use tokio_postgres::{Config, error::SqlState};

use crate::support::{Hub, PATIENCE, append, command, finished, server, state};
use crate::typed::{refused, started, touched};

fn asked() -> Record {
    let prompt = Prompt::PlaceSample { sample: "<gel>".to_owned() };
    Record::PromptAsked(PromptAsked { step: "prompt/1".to_owned(), prompt })
}

async fn get(address: SocketAddr, path: &str, host: &str) -> String {
    let request = format!("GET {path} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\n\r\n");
    spawn_blocking(move || {
        let mut client = std::net::TcpStream::connect(address).unwrap();
        client.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        answer
    })
    .await
    .unwrap()
}

/// A laboratory of three benches: at one, a run waits for a person, at another rigd was closed, and one is new.
struct Laboratory {
    hub: Hub,
    left: String,
    right: String,
    data: TempDir,
    waiting: Journal,
}

async fn laboratory() -> Laboratory {
    let hub = Hub::new().await;
    let (left, right) = (hub.bench("left").await, hub.bench("right").await);
    hub.bench("new").await;
    let (data, theirs) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let store = Store::open(data.path()).unwrap();
    let mut session = store.begin(RunKind::Session, "session").unwrap();
    append(&mut session, &[state("idle")]);
    let mut run = store.begin(RunKind::Run, "smoke").unwrap();
    append(&mut run, &[started(), command("start"), state("running"), touched(), refused()]);
    append(&mut run, &[finished(Ending::CompletedWithRefusals)]);
    let mut waiting = store.begin(RunKind::Run, "three-direction").unwrap();
    append(&mut waiting, &[started(), touched(), asked()]);
    hub.ship(&left, data.path()).await.unwrap();
    let other = Store::open(theirs.path()).unwrap();
    let mut session = other.begin(RunKind::Session, "session").unwrap();
    append(&mut session, &[state("latched"), finished(Ending::Completed)]);
    hub.ship(&right, theirs.path()).await.unwrap();
    Laboratory { hub, left, right, data, waiting }
}

#[tokio::test]
async fn a_run_whose_program_was_killed_is_not_under_way() {
    let Laboratory { hub, left, data, waiting, .. } = laboratory().await;
    drop(waiting);
    // The next opening ends the session that was left, and no run.
    let store = Store::open(data.path()).unwrap();
    let mut session = store.begin(RunKind::Session, "session").unwrap();
    append(&mut session, &[state("latched")]);
    hub.ship(&left, data.path()).await.unwrap();
    let rigs = Catalogue::new(server().admin(&hub.database)).rigs().await.unwrap();
    let rig = rigs.iter().find(|rig: &&Rig| rig.bench.ends_with("left")).unwrap();
    assert_eq!((rig.state.as_deref(), rig.run.as_deref()), (Some("latched"), None));
}

#[tokio::test]
async fn rigs_are_listed_with_what_waits_and_runs_are_found_by_what_they_have() {
    let Laboratory { hub, left, right, .. } = laboratory().await;
    let catalogue = Catalogue::new(server().admin(&hub.database));
    let rigs = catalogue.rigs().await.unwrap();
    let rig =
        |name: &str| rigs.iter().find(|rig: &&Rig| rig.bench.ends_with(name)).unwrap().clone();
    assert_eq!(rigs.len(), 3);
    let shown = rig("left");
    assert_eq!(shown.state.as_deref(), Some("running"));
    assert_eq!(shown.run.as_deref(), Some("three-direction"));
    assert_eq!((shown.touches_done, shown.touches), (Some(1), Some(2)));
    assert_eq!(shown.waits.as_deref(), Some("place sample <gel>"));
    assert_eq!(rig("right").state.as_deref(), Some("closed"));
    assert_eq!((rig("new").state, rig("new").last_seen), (None, None));

    let all = Wanted::default();
    let named = |runs: Vec<FoundRun>| runs.into_iter().map(|run| run.protocol).collect::<Vec<_>>();
    let both = ["three-direction", "smoke"];
    assert_eq!(named(catalogue.runs(&all).await.unwrap()), both, "sessions are no runs");
    let smoke = &catalogue.runs(&all).await.unwrap()[1];
    assert_eq!((smoke.measured, smoke.refused, smoke.is_sealed), (1, 1, true));
    assert_eq!(
        (smoke.samples.join(" "), smoke.operators.join(" ")),
        ("agar gel".into(), "ada".into())
    );
    let text = str::to_owned;
    for (wanted, found) in [
        (Wanted { sample: text("AGA"), ..all.clone() }, &both[..]),
        (Wanted { sample: text("steel"), ..all.clone() }, &[]),
        (Wanted { sample: text("%"), ..all.clone() }, &[]),
        (Wanted { protocol: text("smo"), ..all.clone() }, &both[1..]),
        (Wanted { operator: text("ada"), ..all.clone() }, &both[1..]),
        (Wanted { status: text("running"), ..all.clone() }, &both[..1]),
        (Wanted { bench: right.clone(), ..all.clone() }, &[]),
        (Wanted { bench: left.clone(), limit: Some(1), ..all.clone() }, &both[..1]),
        (Wanted { from: text("2020"), until: text("2999-01"), ..all.clone() }, &both[..]),
        (Wanted { from: text("2999"), ..all.clone() }, &[]),
        (Wanted { protocol: text("'; DROP TABLE hub.run; --"), ..all.clone() }, &[]),
    ] {
        assert_eq!(named(catalogue.runs(&wanted).await.unwrap()), found, "{wanted:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_page_and_its_json_are_served_to_clients_that_know_the_name() {
    let Laboratory { hub, left, data, mut waiting, .. } = laboratory().await;
    let catalogue = Catalogue::new(server().admin(&hub.database));
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(serve(listener, catalogue, vec!["hub.lab.example".to_owned()]));
    let page = get(address, "/", "hub.lab.example").await;
    assert!(
        page.starts_with("HTTP/1.1 200") && page.contains("place sample &lt;gel&gt;"),
        "{page}"
    );
    assert!(!page.contains("<gel>") && !page.contains("<script"));
    let found = get(address, "/runs?protocol=smo", "localhost").await;
    assert!(found.contains("value=\"smo\"") && found.matches("<td title=").count() == 1, "{found}");
    let json = get(address, "/api/v1/runs?status=running", "127.0.0.1").await;
    assert!(json.contains("\"protocol\":\"three-direction\"") && !json.contains("smoke"), "{json}");
    let json = get(address, "/api/v1/rigs", "127.0.0.1").await;
    assert!(json.contains("\"waits\":\"place sample <gel>\""), "{json}");
    assert!(get(address, "/api/v1/runs?sampel=x", "localhost").await.starts_with("HTTP/1.1 400"));
    assert!(get(address, "/", "evil.example").await.starts_with("HTTP/1.1 403"));

    append(
        &mut waiting,
        &[Record::PromptAnswered(PromptAnswered {
            step: "prompt/1".to_owned(),
            by: "ada".to_owned(),
        })],
    );
    hub.ship(&left, data.path()).await.unwrap();
    let json = get(address, "/api/v1/rigs", "127.0.0.1").await;
    assert!(!json.contains("place sample"), "{json}");
}

/// Gives each run of the laboratory a verdict and a stiffness of the reference sample.
async fn judged(hub: &Hub, verdict: &str, stiffness_mpa: f64) {
    let insert = "INSERT INTO hub.result (run, model_verdict) SELECT id, $1 FROM hub.run
                  WHERE kind = 'run' AND seal IS NOT NULL ON CONFLICT DO NOTHING";
    hub.admin.execute(insert, &[&verdict]).await.unwrap();
    let insert = "INSERT INTO hub.stiffness SELECT run, 'agar', $1, 0.001, 0.104 FROM hub.result
                  ON CONFLICT DO NOTHING";
    hub.admin.execute(insert, &[&stiffness_mpa]).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn runs_are_found_by_verdict_and_benches_compared_by_their_reference_samples() {
    let Laboratory { hub, left, right, .. } = laboratory().await;
    judged(&hub, "strained", 0.105).await;
    admin::set_page(&hub.admin, &left.parse().unwrap(), "http://left.example:8137").await.unwrap();
    let theirs = TempDir::new().unwrap();
    let other = Store::open(theirs.path()).unwrap();
    for _ in 0..2 {
        let mut run = other.begin(RunKind::Run, "smoke").unwrap();
        append(&mut run, &[started(), touched(), finished(Ending::Completed)]);
    }
    hub.ship(&right, theirs.path()).await.unwrap();
    judged(&hub, "holds", 0.102).await;
    let catalogue = Catalogue::new(server().admin(&hub.database));
    let of = |verdict: &str| Wanted { verdict: verdict.to_owned(), ..Wanted::default() };
    for (verdict, runs) in [("holds", 2), ("strained", 1), ("rejected", 0), ("", 4)] {
        assert_eq!(catalogue.runs(&of(verdict)).await.unwrap().len(), runs, "{verdict}");
    }
    let strained = catalogue.runs(&of("strained")).await.unwrap().remove(0);
    let report = format!("http://left.example:8137/api/v1/runs/{}/report", strained.run_id);
    assert_eq!(strained.report.as_deref(), Some(&*report));
    assert_eq!(strained.object, None);

    let references = catalogue.references().await.unwrap();
    let [agar] = &references[..] else { panic!("{references:?}") };
    let found = agar.reproducibility.unwrap();
    assert_eq!((found.benches, found.results, agar.charts.len()), (2, 3, 2));
    assert!((found.mean - 0.103).abs() < 1e-12 && found.repeatability.value < 1e-12, "{found:?}");
    let update =
        "UPDATE hub.result SET model_verdict = 'rejected' WHERE model_verdict = 'strained'";
    hub.admin.batch_execute(update).await.unwrap();
    assert_eq!(catalogue.references().await.unwrap()[0].charts.len(), 1, "a rejected model");

    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(serve(listener, catalogue, Vec::new()));
    let page = get(address, "/", "localhost").await;
    assert!(page.contains("<a href=\"http://left.example:8137\">"), "{page}");
    let page = get(address, "/runs?verdict=rejected", "localhost").await;
    assert!(page.contains(&report) && page.contains("value=\"rejected\" selected"), "{page}");
    let page = get(address, "/compare", "localhost").await;
    assert!(page.contains("needs two benches") && page.contains("<svg"), "{page}");
    let json = get(address, "/api/v1/references", "localhost").await;
    assert!(
        json.contains("\"sample\":\"agar\"") && json.contains("\"stiffness_mpa\":0.102"),
        "{json}"
    );
}

#[tokio::test]
async fn the_catalogue_can_change_nothing_and_comes_back_after_its_connection_has_ended() {
    let hub = Hub::new().await;
    let catalogue = Catalogue::new(server().admin(&hub.database));
    assert_eq!(catalogue.rigs().await.unwrap(), []);
    let end = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity
               WHERE datname = current_database() AND pid <> pg_backend_pid()";
    assert_eq!(hub.admin.query(end, &[]).await.unwrap().len(), 1);
    let left = "SELECT count(*) FROM pg_stat_activity
                WHERE datname = current_database() AND pid <> pg_backend_pid()";
    let ended =
        async { while hub.admin.query_one(left, &[]).await.unwrap().get::<_, i64>(0) > 0 {} };
    timeout(Duration::from_secs(60), ended).await.expect("the connection does not end");
    // The first request may meet the end of the connection.
    _ = catalogue.rigs().await;
    hub.bench("left").await;
    assert_eq!(catalogue.rigs().await.unwrap().len(), 1);
}

#[tokio::test]
async fn a_postgresql_that_says_nothing_is_an_error_within_the_time_limit() {
    let silent = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let mut config = Config::new();
    config.host("127.0.0.1").port(silent.local_addr().unwrap().port()).user("postgres");
    let within = Duration::from_millis(100);
    let catalogue = Catalogue::within(Limits { connect: within, ..Limits::default() }, config);
    // One that waits for the attempt of the other has the same limit.
    let [rigs, references] = timeout(PATIENCE, async {
        let (rigs, references) = join!(catalogue.rigs(), catalogue.references());
        [rigs.unwrap_err(), references.unwrap_err()]
    })
    .await
    .unwrap();
    for error in [rigs, references] {
        assert_eq!(error.to_string(), "PostgreSQL has given no connection within 0.1 s");
    }
}

/// A process that stands still until this ends.
struct Frozen(Pid);

impl Frozen {
    fn new(process: i32) -> Self {
        let process = Pid::from_raw(process).unwrap();
        kill_process(process, Signal::STOP).unwrap();
        Self(process)
    }
}

impl Drop for Frozen {
    fn drop(&mut self) {
        kill_process(self.0, Signal::CONT).unwrap();
    }
}

#[tokio::test]
async fn a_postgresql_that_does_not_answer_is_left_and_connected_to_again() {
    let hub = Hub::new().await;
    let limits = Limits { answer: Duration::from_secs(1), ..Limits::default() };
    let catalogue = Catalogue::within(limits, server().admin(&hub.database));
    let reads = async || catalogue.rigs().await.is_ok();
    hub.until("the catalogue reads", reads).await;
    let process = "SELECT pid FROM pg_stat_activity
                   WHERE datname = current_database() AND pid <> pg_backend_pid() ORDER BY backend_start DESC LIMIT 1";
    let process = hub.admin.query_one(process, &[]).await.unwrap().get(0);
    let frozen = Frozen::new(process);
    let error = timeout(PATIENCE, catalogue.rigs()).await.unwrap().unwrap_err();
    assert_eq!(error.to_string(), "PostgreSQL has not answered within 1 s");
    hub.until("the catalogue reads by another connection", reads).await;
    drop(frozen);
}

#[tokio::test]
async fn a_statement_that_takes_too_long_is_ended_by_the_server() {
    let hub = Hub::new().await;
    let limits = Limits { statement: Duration::from_millis(300), ..Limits::default() };
    let catalogue = Catalogue::within(limits, server().admin(&hub.database));
    let reads = async || catalogue.rigs().await.is_ok();
    hub.until("the catalogue reads", reads).await;
    hub.admin.batch_execute("BEGIN; LOCK TABLE hub.live").await.unwrap();
    let error = timeout(PATIENCE, catalogue.rigs()).await.unwrap().unwrap_err();
    let CatalogueError::Refused(error) = error else { panic!("{error:?}") };
    assert_eq!(error.code(), Some(&SqlState::QUERY_CANCELED), "{error:?}");
    hub.admin.batch_execute("COMMIT").await.unwrap();
    hub.until("the catalogue reads again", reads).await;
}
