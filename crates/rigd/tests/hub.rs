//! A daemon that ships its journal to a hub, on a PostgreSQL of this test.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::mpsc,
    thread,
    time::Instant,
};

use program::{PATIENCE, Program, post, request};
use rig_hub::{
    Authority, BenchState, Trial, admin, connect,
    live::{self, HUB_NAME, Heard, LiveServer, NatsServer, Scope, Watch},
};
use rig_store::{Digest, Reader, RunKind};
use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;
use tokio::runtime::Runtime;

const DATABASE: &str = "rigd_hub";
const BENCH: &str = "lab/left";

/// A hub with one bench, and the files of that.
struct Hub {
    server: Trial,
    files: [PathBuf; 3],
    runtime: Runtime,
}

impl Hub {
    fn start() -> Self {
        let server = Trial::start(&TempDir::with_prefix("hub").unwrap().keep(), false).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let files = server.certify(BENCH).unwrap();
        runtime.block_on(async {
            let config = server.admin(DATABASE);
            admin::init(&config).await.unwrap();
            let (client, _task) = connect(&config, None).await.unwrap();
            admin::add_bench(&client, &BENCH.parse().unwrap()).await.unwrap();
        });
        Self { server, files, runtime }
    }

    fn section(&self, address: &str) -> String {
        let [certificate, key, authority] = self.files.each_ref().map(|path| path.display());
        format!(
            "[hub]\naddress = \"{address}\"\nbench = \"{BENCH}\"\ncertificate = \"{certificate}\"\n\
             key = \"{key}\"\nauthority = \"{authority}\"\n"
        )
    }

    fn address(&self) -> String {
        format!("localhost:{}", self.server.port())
    }

    /// Starts a nats-server for live messages.
    fn broadcast(&self) -> (NatsServer, LiveServer) {
        let certificates = self.server.certificates();
        let authority = Authority::open(&certificates).unwrap();
        authority.sign_server(vec!["localhost".to_owned()], "nats").unwrap();
        authority.sign_client(HUB_NAME, &certificates, "live").unwrap();
        let port = NatsServer::free_port().unwrap();
        let server = LiveServer { host: "localhost".to_owned(), port, certificates };
        let setup = self.runtime.block_on(async {
            let (client, _task) = connect(&self.server.admin(DATABASE), None).await.unwrap();
            live::set_up(&client, &server).await.unwrap();
            live::setup(&client).await.unwrap().unwrap()
        });
        (NatsServer::start(&server.certificates, &setup).unwrap(), server)
    }

    /// What the hub has of the bench.
    fn bench(&self) -> BenchState {
        self.runtime.block_on(async {
            let (client, _task) = connect(&self.server.admin(DATABASE), None).await.unwrap();
            let mut state = rig_hub::state(&client).await.unwrap();
            assert!(state.alarms.is_empty(), "{:?}", state.alarms);
            state.benches.remove(0)
        })
    }
}

/// A daemon on the shipped rig in virtual time, with this service file.
fn serve(folder: &Path, service: &str) -> (Program, String) {
    let (config, data) = (folder.join("service.toml"), folder.join("data"));
    fs::write(&config, service).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command
        .args(["serve", "config/protocols/smoke.toml", "--listen", "127.0.0.1:0"])
        .args(["--data", data.to_str().unwrap(), "--config", config.to_str().unwrap()])
        .args(["--rig", "config/rigs/simulated.toml"])
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    let mut daemon = Program::spawn(&mut command, data);
    let address = daemon.wait_for_address();
    (daemon, address)
}

/// Waits until the figures of a daemon are so.
#[track_caller]
fn wait_for(address: &str, is_so: impl Fn(&dyn Fn(&str) -> f64) -> bool) {
    let began = Instant::now();
    loop {
        let text = request(address, "GET /metrics", "");
        let figure = |name: &str| {
            let line = text.lines().find(|line| line.split(' ').next() == Some(name));
            line.and_then(|line| line.split(' ').nth(1)?.parse().ok()).unwrap_or(f64::NAN)
        };
        if is_so(&figure) {
            return;
        }
        let of_hub: Vec<_> = text.lines().filter(|line| line.starts_with("rigd_hub")).collect();
        assert!(began.elapsed() < PATIENCE, "{of_hub:#?}");
    }
}

/// Plays the loaded protocol to its end.
#[track_caller]
fn play(address: &str) {
    let began = Instant::now();
    while !post(address, "runs", "").starts_with("HTTP/1.1 2") {
        assert!(began.elapsed() < PATIENCE, "no run begins");
    }
    let ended = |figure: &dyn Fn(&str) -> f64| {
        figure("rigd_run_touches_planned") == 0.0 && figure("rigd_touches_measured_total") > 0.0
    };
    wait_for(address, ended);
}

fn end(daemon: Program) -> PathBuf {
    daemon.signal(Signal::TERM);
    let (status, text, data) = daemon.end();
    assert!(status.success(), "{text}");
    data
}

/// The runs, the sealed ones, and the records of a journal.
fn counted(data: &Path) -> [i64; 3] {
    let runs = Reader::open(data).unwrap().runs().unwrap();
    let sealed = runs.iter().filter(|run| run.is_sealed).count();
    let records: u64 = runs.iter().map(|run| run.records).sum();
    [runs.len().try_into().unwrap(), sealed.try_into().unwrap(), records.cast_signed()]
}

/// The last digest of the first run, which covers each time of the rig's clock.
fn digest_of_run(data: &Path) -> Digest {
    let reader = Reader::open(data).unwrap();
    let runs = reader.runs().unwrap();
    let first =
        runs.iter().filter(|run| run.kind == RunKind::Run).min_by_key(|run| run.id).unwrap();
    reader.last_digest(first.id).unwrap().unwrap()
}

/// Listens until a run has ended: the state before that, and its end.
fn hear(server: &LiveServer) -> mpsc::Receiver<(Heard, Heard)> {
    let (sender, receiver) = mpsc::channel();
    let broker = server.broker();
    let (is_open, opened) = mpsc::channel();
    thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let mut watch = Watch::open(&broker, &Scope::All).await.unwrap();
            is_open.send(()).unwrap();
            let mut state = None;
            loop {
                let message = watch.next().await.unwrap();
                match (message.kind.as_deref(), &state) {
                    (None, _) => state = Some(message),
                    (Some("run_finished"), Some(state)) => {
                        return sender.send((state.clone(), message)).unwrap();
                    }
                    _ => {}
                }
            }
        });
    });
    opened.recv_timeout(PATIENCE).unwrap();
    receiver
}

fn doctor(folder: &Path, service: &str) -> Output {
    fs::create_dir_all(folder.join("config/rigd")).unwrap();
    fs::write(folder.join("config/rigd/service.toml"), service).unwrap();
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let rig = fs::read_to_string(repository.join("config/rigs/simulated.toml")).unwrap();
    let scenes = repository.join("config/scenes").canonicalize().unwrap();
    let rig = rig.replace("../scenes", scenes.to_str().unwrap());
    fs::write(folder.join("config/rigd/rig.toml"), rig).unwrap();
    Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["doctor", "--json", "--data", folder.join("data").to_str().unwrap()])
        .env("XDG_CONFIG_HOME", folder.join("config"))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// What `rigd doctor` says of the hub.
fn findings(output: &Output) -> Vec<(String, String)> {
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    let all =
        value["findings"].as_array().unwrap().iter().filter(|finding| finding["part"] == "hub");
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    all.map(|finding| (text(&finding["level"]), text(&finding["text"]))).collect()
}

#[test]
fn a_daemon_ships_its_journal_and_goes_on_after_a_crash_of_the_hub() {
    let hub = Hub::start();
    let folder = TempDir::new().unwrap();
    let service = hub.section(&hub.address());
    let (daemon, address) = serve(folder.path(), &service);
    play(&address);
    wait_for(&address, |figure| {
        figure("rigd_hub_connected") == 1.0 && figure("rigd_hub_events_behind") == 0.0
    });
    let shipped = hub.bench();
    assert_eq!((shipped.runs, shipped.sealed), (2, 1));

    // Without the hub, the rig goes on; with it, everything arrives.
    hub.server.stop().unwrap();
    wait_for(&address, |figure| figure("rigd_hub_connected") == 0.0);
    play(&address);
    wait_for(&address, |figure| {
        figure("rigd_hub_failures_total") > 1.0 && figure("rigd_hub_events_behind") > 100.0
    });
    hub.server.go_on().unwrap();
    wait_for(&address, |figure| {
        figure("rigd_hub_connected") == 1.0 && figure("rigd_hub_events_behind") == 0.0
    });
    let data = end(daemon);
    // The end of the session too: the daemon waits for it while the hub answers.
    let bench = hub.bench();
    assert_eq!([bench.runs, bench.sealed, bench.records], counted(&data));

    let found = findings(&doctor(folder.path(), &service));
    assert!(found.iter().all(|(level, text)| level == "ok" && text.contains(BENCH)), "{found:?}");
    assert_eq!(found.len(), 1);
    hub.server.stop().unwrap();
    let found = findings(&doctor(folder.path(), &service));
    assert!(matches!(&found[..], [(level, _)] if level == "problem"), "{found:?}");
    let found = findings(&doctor(folder.path(), "[hub]"));
    assert!(matches!(&found[..], [(level, _)] if level == "warning"), "{found:?}");
}

#[test]
fn a_hub_that_is_gone_or_never_answers_costs_a_run_nothing() {
    let hub = Hub::start();
    let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    // It takes connections, and says nothing.
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut digests = Vec::new();
    for address in [None, Some(closed), Some(silent.local_addr().unwrap())] {
        let folder = TempDir::new().unwrap();
        let service = address.map(|address| hub.section(&address.to_string()));
        let (daemon, of_daemon) = serve(folder.path(), &service.unwrap_or_default());
        play(&of_daemon);
        digests.push(digest_of_run(&end(daemon)));
    }
    assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
}

#[test]
fn viewers_see_a_run_and_a_nats_server_that_is_frozen_silent_or_gone_costs_it_nothing() {
    let hub = Hub::start();
    let (nats, server) = hub.broadcast();
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let silent = format!("localhost:{}", silent.local_addr().unwrap().port());
    let address = format!("localhost:{}", server.port);
    let with_live = |live: &str| format!("{}live = \"{live}\"\n", hub.section(&hub.address()));
    let is_shipped = |figure: &dyn Fn(&str) -> f64| {
        figure("rigd_hub_connected") == 1.0 && figure("rigd_hub_events_behind") == 0.0
    };
    let mut digests = Vec::new();

    let folder = TempDir::new().unwrap();
    let heard = hear(&server);
    let (daemon, of_daemon) = serve(folder.path(), &with_live(&address));
    wait_for(&of_daemon, |figure| figure("rigd_live_connected") == 1.0);
    play(&of_daemon);
    let (last_state, ended) = heard.recv_timeout(PATIENCE).unwrap();
    assert_eq!(last_state.bench.to_string(), BENCH);
    let state: Value = serde_json::from_str(&last_state.document).unwrap();
    assert!(state["state"].is_string() && state["devices"].is_array(), "{state}");
    let event: Value = serde_json::from_str(&ended.document).unwrap();
    assert_eq!(event["record"]["status"], "completed");
    let found = findings(&doctor(folder.path(), &with_live(&address)));
    assert!(found.len() == 2 && found.iter().all(|(level, _)| level == "ok"), "{found:?}");

    digests.push(digest_of_run(&end(daemon)));

    // The server stands still while a daemon is connected to it.
    let folder = TempDir::new().unwrap();
    let (daemon, of_daemon) = serve(folder.path(), &with_live(&address));
    wait_for(&of_daemon, |figure| figure("rigd_live_connected") == 1.0);
    nats.freeze().unwrap();
    play(&of_daemon);
    wait_for(&of_daemon, is_shipped);
    digests.push(digest_of_run(&end(daemon)));
    drop(nats);

    for live in [None, Some(silent), Some(address)] {
        let folder = TempDir::new().unwrap();
        let service = live.map_or_else(|| hub.section(&hub.address()), |live| with_live(&live));
        let (daemon, of_daemon) = serve(folder.path(), &service);
        play(&of_daemon);
        wait_for(&of_daemon, is_shipped);
        digests.push(digest_of_run(&end(daemon)));
    }
    assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
}

#[test]
fn files_that_cannot_be_used_stop_the_daemon_before_the_rig_is_opened() {
    let folder = TempDir::new().unwrap();
    let config = folder.path().join("service.toml");
    fs::write(
        &config,
        "[hub]\naddress = \"h:1\"\nbench = \"a/b\"\ncertificate = \"gone.pem\"\nkey = \"k\"\nauthority = \"ca\"\n",
    )
    .unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["serve", "--data", folder.path().join("data").to_str().unwrap()])
        .args(["--rig", "config/rigs/simulated.toml", "--config", config.to_str().unwrap()])
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("gone.pem"), "{said}");
    assert!(!folder.path().join("data").exists());
}
