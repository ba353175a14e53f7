//! Live messages on a real nats-server, which these tests start beside PostgreSQL.

use std::{
    fs,
    path::{Path, PathBuf},
    thread,
};

use rig_hub::{
    Authority, BenchName, TrialError, admin,
    doctor::{self, Level},
    live::{
        self, Broker, HUB_NAME, LiveError, LiveServer, LiveStanding, NatsServer, Scope, Watch,
        publish, viewer_name,
    },
};
use rig_store::{RunKind, Store};
use tempfile::TempDir;
use tokio::sync::watch;

use crate::support::{Hub, append, command, state};

/// A hub with a nats-server, which has the benches and viewers that are there when it is started.
struct Broadcast {
    hub: Hub,
    directory: TempDir,
    server: LiveServer,
}

impl Broadcast {
    async fn new() -> Self {
        let (hub, directory) = (Hub::new().await, TempDir::with_prefix("live").unwrap());
        let authority = Authority::open_or_make(directory.path()).unwrap();
        authority.sign_server(vec!["localhost".to_owned()], "nats").unwrap();
        authority.sign_client(HUB_NAME, directory.path(), "live").unwrap();
        let port = NatsServer::free_port().unwrap();
        let certificates = directory.path().to_path_buf();
        let server = LiveServer { host: "localhost".to_owned(), port, certificates };
        live::set_up(&hub.admin, &server).await.unwrap();
        Self { hub, directory, server }
    }

    async fn start(&self) -> NatsServer {
        let setup = live::setup(&self.hub.admin).await.unwrap().unwrap();
        NatsServer::start(self.directory.path(), &setup).unwrap()
    }

    /// How the owner of a certificate with this name reaches the server.
    fn as_name(&self, name: &str) -> Broker {
        let authority = Authority::open(self.directory.path()).unwrap();
        let out = self.directory.path().join(name.replace(['/', ':'], "-"));
        let [certificate, key] = authority.sign_client(name, &out, "client").unwrap();
        Broker::new(("localhost", self.server.port), [certificate, key, authority.certificate()])
    }

    async fn watch(&self, scope: &str) -> Watch {
        Watch::open(&self.server.broker(), &scope.parse().unwrap()).await.unwrap()
    }
}

/// A rig that tells what it does until this is dropped.
struct Rig {
    news: watch::Sender<u32>,
    standing: watch::Receiver<LiveStanding>,
}

impl Rig {
    fn tell(broker: Broker, bench: &str, data: &Path) -> Self {
        let (news, of_rig) = watch::channel(0);
        let (sender, standing) = watch::channel(LiveStanding::default());
        let (bench, data): (BenchName, PathBuf) = (bench.parse().unwrap(), data.to_path_buf());
        // As in the daemon: on a thread of its own, since a journal is read by one thread.
        thread::spawn(move || {
            let runtime =
                tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            let state = |number: &u32| format!(r#"{{"number":{number}}}"#);
            runtime.block_on(publish(&broker, &bench, &data, of_rig, state, &sender));
        });
        Self { news, standing }
    }

    async fn wait_for(&mut self, is_so: impl FnMut(&LiveStanding) -> bool) -> LiveStanding {
        self.standing.wait_for(is_so).await.unwrap().clone()
    }
}

#[tokio::test]
async fn viewers_hear_states_and_events_of_their_laboratory() {
    let all = Broadcast::new().await;
    let bench = all.hub.bench("left.2").await;
    let lab = bench.split('/').next().unwrap().to_owned();
    let viewer: BenchName = format!("{lab}/ada").parse().unwrap();
    live::add_viewer(&all.hub.admin, &viewer).await.unwrap();
    live::add_viewer(&all.hub.admin, &"other/bob".parse().unwrap()).await.unwrap();
    let _server = all.start().await;

    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut session = store.begin(RunKind::Session, "session").unwrap();
    append(&mut session, &[state("idle")]);
    let viewer = all.as_name(&viewer_name(&viewer));
    let mut heard = Watch::open(&viewer, &Scope::Lab(lab.clone())).await.unwrap();
    let mut of_hub = all.watch(&bench).await;
    let mut rig = Rig::tell(all.as_name(&bench), &bench, data.path());
    rig.wait_for(|standing| standing.is_connected).await;
    // What was there before is no news.
    let first = heard.next().await.unwrap();
    assert_eq!((first.bench.to_string(), first.kind), (bench.clone(), None));
    assert_eq!(first.document, r#"{"number":0}"#);

    append(&mut session, &[command("\u{1f9ea} \"µ\"\n")]);
    rig.news.send_replace(1);
    let mut states = Vec::new();
    let event = loop {
        let message = heard.next().await.unwrap();
        if message.kind.is_some() {
            break message;
        }
        states.push(message.document);
    };
    assert!(states.iter().all(|state| state == r#"{"number":0}"#), "{states:?}");
    assert_eq!(event.kind.as_deref(), Some("operator"));
    let document: serde_json::Value = serde_json::from_str(&event.document).unwrap();
    assert_eq!(document["record"]["action"], "\u{1f9ea} \"µ\"\n");
    assert_eq!(document["seq"], 2);
    // The state repeats without news.
    for _ in 0..2 {
        assert_eq!(heard.next().await.unwrap().document, r#"{"number":1}"#);
    }
    while of_hub.next().await.unwrap().kind.is_none() {}

    // A viewer of another laboratory is refused, and hears nothing by asking for everything either.
    let stranger = all.as_name(&viewer_name(&"other/bob".parse().unwrap()));
    for scope in [Scope::Lab(lab), Scope::Bench(bench.parse().unwrap()), Scope::All] {
        let refused = Watch::open(&stranger, &scope).await.unwrap().next().await;
        let Err(LiveError::Trouble { event, .. }) = refused else {
            panic!("{scope:?}: {refused:?}")
        };
        assert!(event.to_lowercase().contains("permissions violation"), "{event}");
    }
}

#[tokio::test]
async fn a_bench_tells_of_itself_alone_and_a_stranger_of_nothing() {
    let all = Broadcast::new().await;
    let (left, right) = (all.hub.bench("left").await, all.hub.bench("right").await);
    let revoked = all.hub.bench("revoked").await;
    admin::revoke_bench(&all.hub.admin, &revoked.parse().unwrap()).await.unwrap();
    let _server = all.start().await;
    let data = TempDir::new().unwrap();
    let _store = Store::open(data.path()).unwrap();

    let mut of_right = all.watch(&right).await;
    let mut forged = Rig::tell(all.as_name(&left), &right, data.path());
    let standing = forged.wait_for(|standing| standing.error.is_some()).await;
    let said = standing.error.unwrap().to_lowercase();
    assert!(said.contains("permissions violation"), "{said}");
    for name in [revoked.as_str(), "unknown/bench", "viewer:unknown/ada"] {
        let refused = all.as_name(name).try_out().await;
        assert!(matches!(refused, Err(LiveError::Connect { .. })), "{name}: {refused:?}");
    }
    // Signed by another authority, with the right name.
    let other = TempDir::new().unwrap();
    let authority = Authority::open_or_make(other.path()).unwrap();
    let [certificate, key] = authority.sign_client(&right, other.path(), "client").unwrap();
    let trusted = all.directory.path().join("ca.pem");
    let broker = Broker::new(("localhost", all.server.port), [certificate, key, trusted]);
    assert!(matches!(broker.try_out().await, Err(LiveError::Connect { .. })));

    // Nothing of all this was heard: the first message is that of the bench itself.
    let _rig = Rig::tell(all.as_name(&right), &right, data.path());
    assert_eq!(of_right.next().await.unwrap().document, r#"{"number":0}"#);
}

#[tokio::test]
async fn what_happens_without_a_server_is_left_out_and_a_rig_is_heard_again() {
    let all = Broadcast::new().await;
    let bench = all.hub.bench("left").await;
    let server = all.start().await;
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut session = store.begin(RunKind::Session, "session").unwrap();
    let mut rig = Rig::tell(all.as_name(&bench), &bench, data.path());
    rig.wait_for(|standing| standing.is_connected).await;

    drop(server);
    rig.wait_for(|standing| standing.error.is_some()).await;
    append(&mut session, &vec![command("nobody hears this"); 3]);
    let _server = all.start().await;
    let mut heard = all.watch(&bench).await;
    let standing = rig.wait_for(|standing| standing.is_connected).await;
    assert_eq!((standing.left_out, standing.error), (3, None));
    assert!(standing.failures > 0);
    assert_eq!(heard.next().await.unwrap().kind, None, "a state comes first");

    // More than a line takes at once is left out too.
    append(&mut session, &vec![command("fast"); 1000]);
    rig.news.send_replace(1);
    let standing = rig.wait_for(|standing| standing.left_out > 3).await;
    assert_eq!(standing.left_out, 3 + 1000 - 256);
}

#[tokio::test]
async fn the_hub_says_which_rigs_are_heard() {
    let all = Broadcast::new().await;
    let (heard, silent) = (all.hub.bench("heard").await, all.hub.bench("silent").await);
    let live = async || {
        let findings = doctor::findings(&all.hub.admin).await.unwrap();
        let found = findings.into_iter().find(|finding| finding.check == "live messages");
        found.map(|finding| (finding.level, finding.text)).unwrap()
    };
    let (level, text) = live().await;
    assert_eq!(level, Level::Warning);
    assert!(text.contains("cannot be reached"), "{text}");
    let _server = all.start().await;
    let data = TempDir::new().unwrap();
    let _store = Store::open(data.path()).unwrap();
    let _rig = Rig::tell(all.as_name(&heard), &heard, data.path());
    all.hub.ship(&heard, data.path()).await.unwrap();
    assert_eq!(
        live().await,
        (Level::Ok, format!("rigs heard by localhost:{}: 1", all.server.port))
    );
    let mut state = rig_hub::state(&all.hub.admin).await.unwrap();
    assert_eq!(state.live, None);
    state.listen(&all.hub.admin).await.unwrap();
    assert_eq!(state.live.unwrap().heard, [heard]);

    let other = TempDir::new().unwrap();
    let _store = Store::open(other.path()).unwrap();
    all.hub.ship(&silent, other.path()).await.unwrap();
    let (level, text) = live().await;
    assert_eq!(level, Level::Warning);
    assert!(
        text.contains(&format!("not heard by localhost:{}: {silent}", all.server.port)),
        "{text}"
    );
}

#[tokio::test]
async fn a_configuration_that_the_server_refuses_is_told() {
    let all = Broadcast::new().await;
    // It cannot read this key.
    fs::write(all.directory.path().join("nats.key"), "no key").unwrap();
    let setup = live::setup(&all.hub.admin).await.unwrap().unwrap();
    let refused = NatsServer::start(all.directory.path(), &setup);
    assert!(
        matches!(refused, Err(TrialError::Program { program: "nats-server", .. })),
        "{refused:?}"
    );
}
