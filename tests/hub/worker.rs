//! Programs of their own, which can be killed as programs are: one measures, one ships the journal, one puts objects.

use std::{
    io::Write,
    net::SocketAddr,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::mpsc,
    thread,
    time::Duration,
};

use clap::{Args, Subcommand, ValueEnum};
use rig_engine::{Command, RigState};
use rig_hub::{
    Destination, Standing,
    live::{Broker, LiveStanding, publish},
    ship,
};
use rig_ship::{Address, Label, ObjectStore, Outcome, ShipError, Shipper};
use rig_store::{Reader, RunId, RunKind, StoreError};
use rig_tests::{changed, shipped, text};
use rigd::{
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, RigHandle, Status},
};
use tokio::sync::watch;

/// What a worker says when it has come to the event at which it is to be killed.
pub(crate) const AT_EVENT: &str = "at the event";
/// What a worker says before the number of messages that it has sent to viewers.
pub(crate) const TOLD: &str = "messages:";
/// The laboratory in the names of objects.
const LAB: &str = "lab";
/// The version that the hub is told.
const SOFTWARE: &str = "rigd 0";
/// Time in which the end of the journal is shipped when a rig has closed. The rest is sent later.
const LAST_TIME: Duration = Duration::from_millis(300);
const PERSON: &str = "Ada";

#[derive(Debug, Subcommand)]
pub(crate) enum Worker {
    /// Measures a run on a simulated rig in virtual time
    #[command(hide = true)]
    Measure(MeasureArgs),
    /// Ships the journal until the hub has everything
    #[command(hide = true)]
    Ship(ShipArgs),
    /// Puts the sealed runs in an object store
    #[command(hide = true)]
    Objects(ObjectsArgs),
}

/// What is done with a run that was not ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub(crate) enum Unended {
    /// It is resumed.
    Resume,
    /// It is given up.
    GiveUp,
    /// It stays as it is.
    Leave,
}

#[derive(Debug, Args)]
pub(crate) struct MeasureArgs {
    data: PathBuf,
    /// Seed of the protocol.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[arg(long, value_enum, default_value = "leave")]
    unended: Unended,
    /// Say so once this many events are written behind the beginning of the run, and go on.
    #[arg(long)]
    tell_after: Option<u64>,
    /// Port of a nats-server for messages to viewers.
    #[arg(long)]
    live: Option<u16>,
    #[command(flatten)]
    hub: HubArgs,
}

#[derive(Debug, Args)]
pub(crate) struct ShipArgs {
    data: PathBuf,
    #[command(flatten)]
    hub: HubArgs,
}

#[derive(Debug, Args)]
pub(crate) struct HubArgs {
    /// Address of PostgreSQL; without it, nothing is shipped.
    #[arg(long)]
    hub: Option<SocketAddr>,
    #[arg(long, default_value = "")]
    database: String,
    #[arg(long, default_value = "")]
    role: String,
    /// Certificate, key and authority.
    #[arg(long = "file")]
    files: Vec<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct ObjectsArgs {
    data: PathBuf,
    store: PathBuf,
}

impl Worker {
    pub(crate) fn work(self) -> ExitCode {
        match self {
            Self::Measure(args) => args.measure(),
            Self::Ship(args) => {
                let (news, heard) = watch::channel(());
                drop(news);
                if let Some(ended) = ship_on_thread(&args.hub, &args.data, heard) {
                    _ = ended.recv();
                }
            }
            Self::Objects(args) => return put_objects(&args.data, &args.store),
        }
        ExitCode::SUCCESS
    }
}

impl HubArgs {
    /// With certificate, key and authority of a bench.
    pub(crate) fn new(hub: SocketAddr, database: &str, role: &str, files: &[PathBuf; 3]) -> Self {
        let (database, role) = (database.to_owned(), role.to_owned());
        Self { hub: Some(hub), database, role, files: files.to_vec() }
    }
}

/// Ships on a thread with a runtime of its own, as rigd does. The channel closes when it has ended.
pub(crate) fn ship_on_thread<T: Send + Sync + 'static>(
    hub: &HubArgs,
    data: &Path,
    news: watch::Receiver<T>,
) -> Option<mpsc::Receiver<()>> {
    let address = hub.hub?;
    let files = <[PathBuf; 3]>::try_from(hub.files.clone()).unwrap();
    let host = (&*address.ip().to_string(), address.port());
    let (to, data) = (Destination::new(host, &hub.database, &hub.role, files), data.to_owned());
    let (sender, ended) = mpsc::channel();
    thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let (standing, _told) = watch::channel(Standing::default());
        runtime.block_on(ship(&to, &data, SOFTWARE, news, &standing));
        drop(sender);
    });
    Some(ended)
}

/// Tells viewers what a rig does, on a thread with a runtime of its own, as rigd does. The channel closes when it has ended.
pub(crate) fn tell_on_thread<T: Clone + Send + Sync + 'static>(
    port: u16,
    hub: &HubArgs,
    data: &Path,
    status: watch::Receiver<T>,
    state: fn(&T) -> String,
) -> (mpsc::Receiver<()>, watch::Receiver<LiveStanding>) {
    let files = <[PathBuf; 3]>::try_from(hub.files.clone()).unwrap();
    let (to, bench) = (Broker::new(("localhost", port), files), hub.role.parse().unwrap());
    let data = data.to_owned();
    let (sender, ended) = mpsc::channel();
    let (told, standing) = watch::channel(LiveStanding::default());
    thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(publish(&to, &bench, &data, status, state, &told));
        drop(sender);
    });
    (ended, standing)
}

impl MeasureArgs {
    fn measure(&self) {
        let rig = LoadedRig::load(&shipped("config/rigs/simulated.toml")).unwrap();
        let protocol = protocol(&rig, self.seed);
        let (handle, thread) = rig::open(rig, self.data.clone()).unwrap();
        let shipping = ship_on_thread(&self.hub, &self.data, handle.status());
        let state = |status: &Status| format!("{{\"event\":{}}}", status.last_event);
        let tell = |port| tell_on_thread(port, &self.hub, &self.data, handle.status(), state);
        let telling = self.live.map(tell);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async {
            ready(&handle).await;
            let reader = Reader::open(&self.data).unwrap();
            for run in reader.runs().unwrap() {
                if run.kind == RunKind::Run && !run.is_sealed {
                    self.go_on(&handle, run.id).await;
                }
            }
            let begun = handle.status().borrow().last_event;
            let run = handle.run(protocol, PERSON).await.unwrap();
            if let Some(events) = self.tell_after {
                let mut status = handle.status();
                let is_there = |status: &Status| status.last_event >= begun + events;
                _ = status.wait_for(|status| is_there(status) || is_ended(status, run)).await;
                println!("{AT_EVENT}");
                std::io::stdout().flush().unwrap();
            }
            ended(&handle, run).await;
            handle.close().await;
        });
        thread.join();
        drop(handle);
        if let Some(shipping) = shipping {
            _ = shipping.recv_timeout(LAST_TIME);
        }
        if let Some((ended, standing)) = telling {
            _ = ended.recv_timeout(LAST_TIME);
            println!("{TOLD} {}", standing.borrow().messages);
        }
    }

    async fn go_on(&self, handle: &RigHandle, run: RunId) {
        // A run that was killed before its first record can be neither resumed nor given up.
        match self.unended {
            Unended::Leave => {}
            Unended::GiveUp => _ = handle.give_up(run, PERSON).await,
            Unended::Resume => {
                if handle.resume(run, true, PERSON).await.is_ok() {
                    ended(handle, run).await;
                    ready(handle).await;
                }
            }
        }
    }
}

/// Four touches, of which the seed decides two.
fn protocol(rig: &LoadedRig, seed: u64) -> LoadedProtocol {
    let seed = format!("seed = {seed}");
    let changes = [
        ("directions = [\"front\", \"back\", \"left\"]", "directions = [\"left\"]"),
        ("angles_deg = [0, 45]", "angles_deg = [30]"),
        ("trials = 6", "trials = 2"),
        ("seed = 1", &*seed),
    ];
    let text = changed(&text("config/protocols/smoke.toml"), &changes);
    LoadedProtocol::check("short", &text, &rig.facts()).unwrap_or_else(|faults| panic!("{faults}"))
}

/// Measures the protocol of the paper in this journal.
pub(crate) async fn measure_paper(data: &Path) {
    let rig = LoadedRig::load(&shipped("config/rigs/simulated.toml")).unwrap();
    let text = text("config/protocols/three-direction.toml");
    let protocol = LoadedProtocol::check("three-direction", &text, &rig.facts());
    let protocol = protocol.unwrap_or_else(|faults| panic!("{faults}"));
    let (handle, thread) = rig::open(rig, data.to_owned()).unwrap();
    ready(&handle).await;
    let run = handle.run(protocol, PERSON).await.unwrap();
    ended(&handle, run).await;
    handle.close().await;
    thread.join();
}

/// Waits until the rig takes orders. After a kill it asks a person to look.
async fn ready(handle: &RigHandle) {
    let mut status = handle.status();
    loop {
        let is_moment =
            |status: &Status| matches!(status.snapshot.state, RigState::Idle | RigState::Latched);
        let state = status.wait_for(is_moment).await.unwrap().snapshot.state;
        if state == RigState::Idle {
            return;
        }
        handle.command(Command::Acknowledge, None, PERSON).await.unwrap();
        _ = status.wait_for(|status| status.snapshot.state != RigState::Latched).await;
    }
}

fn is_ended(status: &Status, run: RunId) -> bool {
    status.run.as_ref().is_some_and(|view| view.id == run && view.ending.is_some())
}

async fn ended(handle: &RigHandle, run: RunId) {
    handle.status().wait_for(|status| is_ended(status, run)).await.unwrap();
}

/// A run, and what became of it on its way to the object store.
pub(crate) type Put = (RunId, Result<Outcome, ShipError>);

/// Puts every sealed run in a folder; the exit code says whether all of them are there.
fn put_objects(data: &Path, store: &Path) -> ExitCode {
    let Ok(all) = objects(data, store) else { return ExitCode::FAILURE };
    let is_there = |(run, put): Put| match put {
        Ok(Outcome::Shipped { .. } | Outcome::Present { .. }) => true,
        Ok(Outcome::Clash { object }) => panic!("{object} is another object of run {run}"),
        Err(_) => false,
    };
    if all.into_iter().all(is_there) { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Puts every sealed run in a folder, and says what became of each.
pub(crate) fn objects(data: &Path, store: &Path) -> Result<Vec<Put>, StoreError> {
    let reader = Reader::open(data)?;
    let lab: Label = LAB.parse().unwrap();
    let store = ObjectStore::at(Address::Folder(store.to_owned())).unwrap();
    let shipper = Shipper::new(store, lab, None, None);
    let sealed = reader.runs()?.into_iter().filter(|run| run.is_sealed);
    Ok(sealed.map(|run| (run.id, shipper.ship(&reader, &run))).collect())
}
