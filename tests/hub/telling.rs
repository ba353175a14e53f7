//! A rig that tells viewers what it does, by a nats-server that is well, dead, killed in the middle or silent.
//!
//! Nobody ships meanwhile. Whatever the server has taken, the hub has what it had before, and the run is the same.

use std::{
    io::{BufRead, BufReader, Read},
    path::Path,
    process::Stdio,
};

use rig_hub::{
    Authority,
    live::{self, Broker, HUB_NAME, LiveServer, NatsServer},
};
use tempfile::TempDir;

use crate::{
    bench::{Bench, Counts, EVENTS, head_of_run, worker},
    support::{Hub, server},
    worker::{AT_EVENT, TOLD},
};

/// The host in the certificate of the server.
const HOST: &str = "localhost";

/// The name of the count of messages.
pub(crate) const MESSAGES: &str = "messages to viewers";

/// How the nats-server is while a run is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum NatsState {
    Well,
    /// Nobody listens at its address.
    Dead,
    /// It is killed in the middle of the run.
    Killed,
    /// It takes connections, and says nothing from the middle of the run on.
    Silent,
}

const NATS_STATES: [NatsState; 4] =
    [NatsState::Well, NatsState::Dead, NatsState::Killed, NatsState::Silent];

/// The nats-server of a hub, which is started for each run: it has to know the bench.
pub(crate) struct Nats(LiveServer);

impl Nats {
    pub(crate) async fn new(hub: &Hub) -> Self {
        let certificates = server().certificates();
        let authority = Authority::open(&certificates).unwrap();
        authority.sign_server(vec![HOST.to_owned()], "nats").unwrap();
        authority.sign_client(HUB_NAME, &certificates, "live").unwrap();
        let port = NatsServer::free_port().unwrap();
        let to = LiveServer { host: HOST.to_owned(), port, certificates };
        live::set_up(&hub.admin, &to).await.unwrap();
        Self(to)
    }

    pub(crate) const fn port(&self) -> u16 {
        self.0.port
    }

    /// How the hub itself reaches the server, which sees all laboratories.
    pub(crate) fn viewer(&self) -> Broker {
        self.0.broker()
    }

    /// Starts it with the benches that the hub has now.
    pub(crate) async fn start(&self, hub: &Hub) -> NatsServer {
        let setup = live::setup(&hub.admin).await.unwrap().unwrap();
        NatsServer::start(&self.0.certificates, &setup).unwrap()
    }

    /// Measures a run in the journal of the bench, and one that is also measured without a server.
    ///
    /// # Panics
    /// When the hub has something else afterwards, or the run is another one.
    pub(crate) async fn tell(&self, bench: &mut Bench, hub: &Hub, counts: &mut Counts) {
        let data = bench.data.path().to_owned();
        bench.is_quiet(hub).await;
        let before = (hub.contents_of(&bench.role).await, cursors(hub).await);
        self.measure(bench, &data, hub, counts).await;
        let after = (hub.contents_of(&bench.role).await, cursors(hub).await);
        assert_eq!(before, after, "the hub has something that nobody has shipped");

        let [told, alone] = [TempDir::new().unwrap(), TempDir::new().unwrap()];
        self.measure(bench, told.path(), hub, counts).await;
        let status = worker("measure", alone.path()).status().unwrap();
        assert!(status.success(), "measuring ended: {status}");
        let [head, without] = [told.path(), alone.path()].map(head_of_run);
        assert_eq!(head, without, "a run of which viewers are told is another run");
    }

    async fn measure(&self, bench: &mut Bench, data: &Path, hub: &Hub, counts: &mut Counts) {
        let state = NATS_STATES[bench.below(4) as usize];
        *counts.entry(format!("measured, nats-server {state:?}")).or_default() += 1;
        let mut server = match state {
            NatsState::Dead => None,
            _ => Some(self.start(hub).await),
        };
        let mut command = worker("measure", data);
        command.args(["--live", &self.0.port.to_string()]);
        command.args(["--tell-after", &bench.below(EVENTS).to_string()]);
        bench.identify(&mut command);
        let mut rig = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut said = BufReader::new(rig.stdout.take().unwrap());
        let mut line = String::new();
        said.read_line(&mut line).unwrap();
        assert_eq!(line.trim(), AT_EVENT);
        match (state, &server) {
            (NatsState::Killed, _) => server = None,
            (NatsState::Silent, Some(server)) => server.freeze().unwrap(),
            _ => {}
        }
        let mut rest = String::new();
        said.read_to_string(&mut rest).unwrap();
        let status = rig.wait().unwrap();
        assert!(status.success(), "measuring ended: {status}");
        drop(server);
        let told = rest.lines().find_map(|line| line.strip_prefix(TOLD)?.trim().parse().ok());
        let told: u64 = told.unwrap();
        assert!(state != NatsState::Dead || told == 0, "{told} messages to nobody");
        *counts.entry(MESSAGES.to_owned()).or_default() += told;
    }
}

/// What the hub says that it has of all journals.
async fn cursors(hub: &Hub) -> Vec<(String, i64)> {
    let select = "SELECT id::text, cursor_event FROM hub.journal ORDER BY id";
    let rows = hub.admin.query(select, &[]).await.unwrap();
    rows.iter().map(|row| (row.get(0), row.get(1))).collect()
}
