//! Spans that a collector receives: `cargo test -p rigd --features otel --test otel`.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader, Read, Write},
    net::TcpListener,
    path::Path,
    process::Command,
    sync::mpsc::{self, Receiver},
    thread,
    time::Instant,
};

use program::{PATIENCE, Program, request};
use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

/// The span of a client, as the specification of the trace context writes it.
const TRACE: &str = "0af7651916cd43dd8448eb211c80319c";
const PARENT: &str = "b7ad6b7169203331";

/// A collector that answers with this status, and the bodies that it gets.
fn collector(status: &'static str) -> (String, Receiver<Value>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (tell, told) = mpsc::channel();
    thread::spawn(move || {
        for client in listener.incoming() {
            let mut client = BufReader::new(client.unwrap());
            let (mut line, mut length) = (String::new(), 0);
            client.read_line(&mut line).unwrap();
            assert!(line.starts_with("POST /v1/traces HTTP/1.1"), "{line}");
            while line != "\r\n" {
                line.clear();
                client.read_line(&mut line).unwrap();
                if let Some(("content-length", value)) = line.trim().split_once(": ") {
                    length = value.parse().unwrap();
                }
            }
            let mut body = vec![0; length];
            client.read_exact(&mut body).unwrap();
            let answer = format!(
                "HTTP/1.1 {status}\r\ncontent-type: application/json\r\ncontent-length: 2\r\n\r\n{{}}"
            );
            client.get_mut().write_all(answer.as_bytes()).unwrap();
            if tell.send(serde_json::from_slice(&body).unwrap()).is_err() {
                return;
            }
        }
    });
    (address, told)
}

/// A daemon in virtual time whose spans go to a collector.
fn begin(folder: &TempDir, collector: &str) -> Program {
    let data = folder.path().join("data");
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command
        .args(["serve", "config/protocols/smoke.toml", "--listen", "127.0.0.1:0"])
        .args(["--rig", "config/rigs/simulated.toml", "--data", data.to_str().unwrap()])
        .env("OTEL_EXPORTER_OTLP_ENDPOINT", collector)
        .env("OTEL_BSP_SCHEDULE_DELAY", "100")
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    Program::spawn(&mut command, data)
}

/// The same, when a run can begin.
fn serve(folder: &TempDir, collector: &str) -> (Program, String) {
    let mut daemon = begin(folder, collector);
    let address = daemon.wait_for_address();
    let began = Instant::now();
    while !request(&address, "GET /readyz", "").starts_with("HTTP/1.1 200") {
        assert!(began.elapsed() < PATIENCE, "the rig is not ready");
    }
    (daemon, address)
}

/// A span with the attributes that are text.
#[derive(Debug)]
struct Span {
    name: String,
    trace: String,
    id: String,
    parent: String,
    attributes: BTreeMap<String, Value>,
}

fn spans(bodies: &[Value]) -> Vec<Span> {
    let mut spans = Vec::new();
    let list = |value: &Value, key: &str| value[key].as_array().unwrap().clone();
    for resource in bodies.iter().flat_map(|body| list(body, "resourceSpans")) {
        let of_resource = attributes(&resource["resource"]);
        assert_eq!(of_resource["service.name"]["stringValue"], "rigd");
        assert_eq!(of_resource["service.version"]["stringValue"], env!("CARGO_PKG_VERSION"));
        for span in list(&resource, "scopeSpans").iter().flat_map(|scope| list(scope, "spans")) {
            let text = |key: &str| span[key].as_str().unwrap_or_default().to_owned();
            spans.push(Span {
                name: text("name"),
                trace: text("traceId"),
                id: text("spanId"),
                parent: text("parentSpanId"),
                attributes: attributes(&span),
            });
        }
    }
    spans
}

fn attributes(of: &Value) -> BTreeMap<String, Value> {
    let all = of["attributes"].as_array().cloned().unwrap_or_default();
    all.into_iter()
        .map(|one| (one["key"].as_str().unwrap().to_owned(), one["value"].clone()))
        .collect()
}

#[test]
fn a_collector_gets_the_run_with_its_steps_and_operations_and_the_request_under_its_client() {
    let folder = TempDir::new().unwrap();
    let (at, told) = collector("200 OK");
    let (daemon, address) = serve(&folder, &format!("http://{at}"));
    let parent = format!("traceparent: 00-{TRACE}-{PARENT}-01\r\nx-operator: Ada\r\n");
    let begun = request(&address, "POST /api/v1/runs", &parent);
    assert!(begun.starts_with("HTTP/1.1 202"), "{begun}");
    daemon.wait_for_record("the end of the run", |record| {
        matches!(record, rig_store::Record::RunFinished(_))
    });
    daemon.signal(Signal::TERM);
    let (status, text, _) = daemon.end();
    assert!(status.success() && !text.contains("WARN"), "{text}");
    let all = spans(&told.try_iter().collect::<Vec<_>>());
    let named = |name: &str| all.iter().filter(|span| span.name == name).collect::<Vec<_>>();
    let [run] = named("run")[..] else { panic!("{all:?}") };
    assert_eq!(run.attributes["rig.ending"]["stringValue"], "completed");
    let steps: Vec<_> = all.iter().filter(|span| span.name.starts_with("step ")).collect();
    let measured = |step: &&&Span| {
        step.attributes.get("rig.outcome").is_some_and(|of| of["stringValue"] == "measured")
    };
    assert!(steps.iter().all(|step| step.parent == run.id && step.trace == run.trace), "{steps:?}");
    assert!(steps.iter().any(|step| measured(&step)), "{steps:?}");
    for operation in ["measure", "move linear", "commit"] {
        let of_steps = |span: &&Span| steps.iter().any(|step| step.id == span.parent);
        assert!(named(operation).into_iter().any(|span| of_steps(&span)), "{operation}: {all:?}");
    }
    let [posted] = named("POST /api/v1/runs")[..] else { panic!("{all:?}") };
    assert_eq!((posted.trace.as_str(), posted.parent.as_str()), (TRACE, PARENT));
    assert_eq!(posted.attributes["http.response.status_code"]["intValue"], "202");
}

#[test]
fn a_collector_that_refuses_or_is_gone_is_told_once_and_costs_nothing_else() {
    let (refusing, _told) = collector("503 Service Unavailable");
    let gone = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    for at in [refusing, gone] {
        let folder = TempDir::new().unwrap();
        let (mut daemon, address) = serve(&folder, &format!("http://{at}"));
        let warning = daemon.wait_for_line("spans cannot be exported");
        assert!(warning.contains(&at), "{warning}");
        assert!(request(&address, "POST /api/v1/runs", "").starts_with("HTTP/1.1 202"));
        daemon.wait_for_record("the end of the run", |record| {
            matches!(record, rig_store::Record::RunFinished(_))
        });
        daemon.signal(Signal::TERM);
        let (status, text, _) = daemon.end();
        assert!(status.success() && !text.contains("spans cannot be exported"), "{text}");
    }
}

#[test]
fn a_collector_by_tls_is_refused_with_what_to_do() {
    let folder = TempDir::new().unwrap();
    let mut daemon = begin(&folder, "https://collector.example:4318");
    let said = daemon.wait_for_line("no spans are exported");
    assert!(said.contains("OTEL_EXPORTER_OTLP_ENDPOINT=https://collector.example:4318"), "{said}");
    daemon.wait_for_address();
    daemon.signal(Signal::TERM);
    assert!(daemon.end().0.success());
}
