//! `rigd serve`: the daemon.

use std::{
    collections::BTreeSet,
    net::SocketAddr,
    path::{Path, PathBuf},
    time::Duration,
};

use clap::Args;
use jiff::Timestamp;
use rig_files::service_file::TlsFile;
use rig_store::{Reader, StoreError};
use rig_system::files::protection;
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;

use super::{
    Failure,
    args::BenchArgs,
    door::{Door, Listening},
    ended_runs,
    guard::{say_probe, watch_over_http},
    hub::{Hub, Telling},
    manager,
    reload::{Flags, InForce, Reloader, Told},
    screen::{say, say_clearly},
    session::{left, open},
    settings::{ServiceArgs, Settings},
    signals::Signals,
};
use crate::{
    commissioning::Commissioned,
    http::{
        self,
        access::{Access, Token},
        room::take_handles,
        tls::Tls,
    },
    loaded_rig::{LoadedRig, RigFacts},
    notify::Targets,
    operator::Operator,
    protocol_file::LoadedProtocol,
    queue,
    tokens::{Secret, Tokens},
};

#[derive(Debug, Args)]
pub(super) struct ServeArgs {
    /// Protocol file to have loaded; one can also be posted
    protocol: Option<PathBuf>,
    #[command(flatten)]
    bench: BenchArgs,
    #[command(flatten)]
    service: ServiceArgs,
}

/// Short questions to the journal are answered on threads of their own. With more of them the disk would be
/// no faster, and the allocator keeps memory for each of them.
const READERS_MAX: usize = 4;
/// Threads that build reports, exports and the folders of runs. The allocator keeps for each of them what its
/// largest document took (decision 96).
const BUILDERS_MAX: usize = 2;
/// A thread that ends and one that begins cost more than one that waits.
const IDLE_THREAD_TIME: Duration = Duration::from_secs(3600);
/// By how much the threads that answer clients, and those that build documents, give way to the rig thread.
const CLIENTS_NICE: i32 = 5;
const BUILDERS_NICE: i32 = 10;
/// A certificate that expires is told this many days before.
const WARN_DAYS: i64 = 30;
const DAY: Duration = Duration::from_secs(86_400);
/// Time limit for reading at the end of the daemon.
const READING_TIME: Duration = Duration::from_secs(1);

/// Lowers the priority of the calling thread; threads that it begins have it too.
fn give_way(by: i32) {
    if let Err(error) = rig_system::priority::give_way(by) {
        tracing::warn!(%error, "a thread that serves clients has the priority of the rig thread");
    }
}

pub(super) fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let daemon = Daemon::prepare(args)?;
    take_handles();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .on_thread_start(|| give_way(CLIENTS_NICE))
        .max_blocking_threads(READERS_MAX)
        .thread_keep_alive(IDLE_THREAD_TIME)
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let builders = tokio::runtime::Builder::new_current_thread()
        .thread_name("builder")
        .on_thread_start(|| give_way(BUILDERS_NICE))
        .max_blocking_threads(BUILDERS_MAX)
        .thread_keep_alive(IDLE_THREAD_TIME)
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let served = runtime.block_on(daemon.serve(builders.handle().clone()));
    builders.shutdown_timeout(READING_TIME);
    runtime.shutdown_timeout(READING_TIME);
    served
}

/// A daemon whose files have been read and checked. Nothing is open yet.
struct Daemon {
    settings: Settings,
    flags: Flags,
    in_force: InForce,
    port: (Listening, Option<Tls>),
    rig: LoadedRig,
    loaded: Option<LoadedProtocol>,
    access: Access,
    secret: Secret,
    targets: Option<Targets>,
    hub: Option<Hub>,
}

const CLOSING: &str =
    "rigd: ending what is under way and closing; interrupt again to leave the rig as it is";

impl Daemon {
    fn prepare(args: &ServeArgs) -> Result<Self, Failure> {
        let secret = Secret::new().map_err(|source| Failure::System { what: "secret", source })?;
        let settings = Settings::settle(&args.bench, &args.service)?;
        settings.say();
        say_protection(&settings);
        let listening = Listening::of(settings.listen.value)?;
        let access = access(&settings, listening.address(), args.bench.operator.name(), &secret)?;
        let (tls, targets) = (tls(&settings, listening.address())?, settings.targets()?);
        let hub = settings.hub.as_ref().map(Hub::of).transpose()?;
        let rig = LoadedRig::load(&settings.rig.value)?;
        let flags = Flags { bench: args.bench.clone(), service: args.service.clone() };
        let in_force = InForce::new(&flags, &settings, &rig)?;
        let (protocol, facts) = (args.protocol.as_ref(), facts(&rig, &settings));
        let loaded = protocol.map(|path| LoadedProtocol::load(path, &facts)).transpose()?;
        let port = (listening, tls);
        Ok(Self { settings, flags, in_force, port, rig, loaded, access, secret, targets, hub })
    }

    async fn serve(self, builders: Handle) -> Result<(), Failure> {
        let Self { settings, flags, in_force, port, rig, loaded, access, secret, targets, hub } =
            self;
        let (listening, tls) = port;
        let (data, facts) = (settings.data.value.clone(), facts(&rig, &settings));
        let (mut signals, hangups) = Signals::of_daemon()?;
        // The address is bound first: a daemon that cannot be reached must not move anything.
        let door = Door::open(listening, tls)?;
        let before = last_event(&data)?;
        let commissioned = Commissioned::of(&rig, data.clone());
        let (handle, thread) = open(rig, data.clone(), &mut signals).await?;
        watch_over_http(Handle::current(), handle.clone())?;
        let closing = CancellationToken::new();
        let told = Told::start(targets, &settings, &facts, handle.status(), before)?;
        let shared = http::Shared::new(
            handle.clone(),
            facts,
            loaded,
            data.clone(),
            access,
            builders,
            closing.clone(),
        );
        shared.open_commissioning(&handle, commissioned);
        tokio::spawn(ended_runs::write(shared.clone(), handle.status(), data.clone()));
        show_certificate(&door, &shared);
        let opened = shared.open_queue(settings.release_queue.value).await;
        opened.map_err(|source| Failure::File { path: data.join(queue::FILE), source })?;
        // Ends what begins something by itself.
        let nothing_more = CancellationToken::new();
        tokio::spawn(shared.clone().run_queue(nothing_more.clone()));
        let to_hub = hub.map(|hub| hub.start(&shared, &data)).transpose()?;
        let reloader = Reloader::new(flags, in_force, shared.clone(), told);
        let reloading = tokio::spawn(reloader.serve(hangups, nothing_more.clone()));
        let telling = tokio::spawn(manager::feed(shared.clone()));
        let keeping = tokio::spawn(shared.clone().keep_uses());
        let announced = door.announce(&settings, &secret);
        let (name, router) = (door.name(), http::router(shared));
        let mut serving = door.serve(router, &closing);
        let mut has_http_ended = false;
        if signals.count == 0 {
            say(&format!("rigd: listening on {name}"));
            manager::ready();
            tokio::select! {
                () = signals.next() => {}
                _ = &mut serving => has_http_ended = true,
            }
        }
        manager::stopping();
        telling.abort();
        nothing_more.cancel();
        say_clearly(CLOSING);
        tokio::select! {
            () = handle.close() => {}
            () = signals.next() => return Err(left(&handle.status().borrow())),
        }
        thread.join();
        say_probe(&handle.status().borrow());
        Telling::finish(to_hub).await;
        // The end of the last run is in the outbox then.
        drop(reloading.await);
        drop(announced);
        if has_http_ended {
            return Err(Failure::HttpEnded);
        }
        closing.cancel();
        tokio::select! {
            _ = futures_util::future::join(serving, keeping) => {}
            () = signals.next() => {}
        }
        Ok(())
    }
}

/// Says what protects the files with secrets, where rigd does not see to it itself.
fn say_protection(settings: &Settings) {
    let key = match &settings.tls.value {
        TlsFile::Files { key, .. } => Some(key),
        TlsFile::Off | TlsFile::SelfSigned => None,
    };
    let files = [Some(&settings.data.value), settings.token_file.value.as_ref(), key];
    for text in files.into_iter().flatten().filter_map(|path| protection(path)) {
        say(&format!("rigd: {text}"));
    }
}

/// Shows and watches when the certificate expires, where clients must speak TLS.
fn show_certificate(door: &Door, shared: &http::Shared) {
    if let Some(tls) = door.tls() {
        shared.show_certificate(tls);
        tokio::spawn(watch_certificate(tls.clone()));
    }
}

/// The certificate, where clients must speak TLS.
fn tls(settings: &Settings, listening: SocketAddr) -> Result<Option<Tls>, Failure> {
    match &settings.tls.value {
        TlsFile::Off => return Ok(None),
        TlsFile::Files { certificate, key } => return Ok(Some(Tls::open(certificate, key)?)),
        TlsFile::SelfSigned => {}
    }
    let ip = listening.ip();
    let address = (!ip.is_unspecified()).then(|| ip.to_string());
    let allowed = settings.allow_hosts.value.iter().map(ToString::to_string);
    let known = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
    let names: BTreeSet<_> = known.into_iter().chain(allowed).chain(address).collect();
    let tls = Tls::own(&settings.data.value, names.into_iter().collect())?;
    say(&format!("rigd: clients can trust {}", tls.certificate().display()));
    Ok(Some(tls))
}

/// Warns before the certificate expires, at the start and once a day, for as long as the daemon runs.
async fn watch_certificate(tls: Tls) {
    let mut daily = tokio::time::interval(DAY);
    loop {
        daily.tick().await;
        let Some(left) = tls.expires().map(|at| at.duration_since(Timestamp::now())) else {
            continue;
        };
        let certificate = tls.certificate().display();
        match left.as_hours() / 24 {
            _ if left.is_negative() => {
                tracing::warn!("the certificate {certificate} has expired: clients refuse it");
            }
            days @ ..=WARN_DAYS => tracing::warn!(
                "the certificate {certificate} expires in {days} days: put a renewed one and its key in place"
            ),
            _ => {}
        }
    }
}

/// What protocols are checked against: the rig, and the calibrations that its runs cite.
fn facts(rig: &LoadedRig, settings: &Settings) -> RigFacts {
    rig.facts().with_data(&settings.data.value)
}

/// The last event of the journal; 0 before the first one.
fn last_event(data: &Path) -> Result<u64, Failure> {
    match Reader::open(data).and_then(|reader| reader.last_event()) {
        Err(StoreError::NoJournal) => Ok(0),
        found => found.map_err(|source| Failure::Data { data: data.to_path_buf(), source }),
    }
}

/// The access rules. Another computer needs a token.
fn access(
    settings: &Settings,
    listen: SocketAddr,
    operator: Operator,
    secret: &Secret,
) -> Result<Access, Failure> {
    let address = listen.ip().to_canonical();
    let token = settings.token_file.value.as_ref().map(|path| Token::read(path)).transpose()?;
    let tokens = Tokens::open(&settings.data.value)?;
    if !address.is_loopback() && token.is_none() && !tokens.is_in_use() {
        return Err(Failure::NoToken { listen });
    }
    let names = settings.allow_hosts.value.iter().cloned();
    Ok(Access::new(address, names, token, operator).with_tokens(tokens, secret))
}
