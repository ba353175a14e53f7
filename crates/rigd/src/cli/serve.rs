//! `rigd serve`: the daemon.

use std::{
    collections::BTreeSet,
    io,
    net::{Ipv4Addr, SocketAddr, ToSocketAddrs},
    path::PathBuf,
    time::Duration,
};

use axum::Router;
use clap::Args;
use rig_model::with_causes;
use tokio::{
    net::{TcpListener, TcpSocket},
    runtime::Handle,
    sync::watch,
    task::JoinHandle,
};
use tokio_util::sync::CancellationToken;

use super::{
    Failure,
    args::BenchArgs,
    guard::watch_over_http,
    manager,
    screen::{say, say_clearly},
    session::{left, open},
    signals::Signals,
};
use crate::{
    endpoint::{Announced, Endpoint},
    http::{
        self,
        access::{Access, HostName, Token},
        tls::Tls,
    },
    protocol_file::LoadedProtocol,
    queue,
    rig::Status,
    run_files,
    tokens::{Secret, Tokens},
};

#[derive(Debug, Args)]
pub(super) struct ServeArgs {
    /// Protocol file to have loaded; one can also be posted
    protocol: Option<PathBuf>,
    #[command(flatten)]
    bench: BenchArgs,
    /// Address and port to listen on. Any but a loopback address needs tokens (`rigd token new`)
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8137", value_parser = address)]
    listen: SocketAddr,
    /// Another name by which clients may call this computer; can be given several times
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<HostName>,
    /// File with the token that clients must send as `Authorization: Bearer`
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Begin what waits in the queue without waiting for `rigd queue release`, unless a person or a
    /// fault has held it
    #[arg(long)]
    release_queue: bool,
    #[command(flatten)]
    tls: TlsArgs,
}

/// Whether clients must speak TLS.
#[derive(Debug, Args)]
struct TlsArgs {
    /// Speak TLS, with a certificate that the daemon makes for itself in its data directory
    #[arg(long, conflicts_with = "tls_certificate")]
    tls: bool,
    /// Speak TLS, with the certificate chain in this file (PEM), which is read again when it changes
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_certificate: Option<PathBuf>,
    /// File with the key of the certificate (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_certificate")]
    tls_key: Option<PathBuf>,
}

/// Journals are read on threads of their own. With more of them the disk would be no faster.
const READERS_MAX: usize = 8;
/// Time limit for reading at the end of the daemon.
const READING_TIME: Duration = Duration::from_secs(1);

pub(super) fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let secret = Secret::new().map_err(|source| Failure::System { what: "secret", source })?;
    let access = access(args, &secret)?;
    let tls = tls(args)?;
    let rig = args.bench.rig.load()?;
    let facts = rig.facts();
    let loaded =
        args.protocol.as_ref().map(|path| LoadedProtocol::load(path, &facts)).transpose()?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(READERS_MAX)
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let data = args.bench.data.data.clone();
    let served = runtime.block_on(async {
        let mut signals = Signals::new()?;
        // The address is bound first: a daemon that cannot be reached must not move anything.
        let door = Door::open(args.listen, tls)?;
        let (handle, thread) = open(rig, data.clone(), &mut signals).await?;
        watch_over_http(Handle::current(), handle.clone())?;
        let closing = CancellationToken::new();
        tokio::spawn(write_ended_runs(handle.status(), data.clone()));
        let shared =
            http::Shared::new(handle.clone(), facts, loaded, data.clone(), access, closing.clone());
        let opened = shared.open_queue(args.release_queue).await;
        opened.map_err(|source| Failure::File { path: data.join(queue::FILE), source })?;
        let no_more_runs = CancellationToken::new();
        tokio::spawn(shared.clone().run_queue(no_more_runs.clone()));
        let telling = tokio::spawn(manager::feed(shared.clone()));
        let keeping = tokio::spawn(shared.clone().keep_uses());
        let announced = door.announce(args, &secret);
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
        no_more_runs.cancel();
        say_clearly(
            "rigd: leaving the probe clear and closing; interrupt again to leave the rig as it is",
        );
        tokio::select! {
            () = handle.close() => {}
            () = signals.next() => return Err(left(&handle.status().borrow())),
        }
        thread.join();
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
    });
    runtime.shutdown_timeout(READING_TIME);
    served
}

/// The ports on which the daemon answers.
struct Door {
    listener: TcpListener,
    address: SocketAddr,
    tls: Option<Tls>,
    /// With TLS, for commands of this computer: their bytes stay on it.
    local: Option<(TcpListener, SocketAddr)>,
}

impl Door {
    fn open(wanted: SocketAddr, tls: Option<Tls>) -> Result<Self, Failure> {
        let bound = |wanted: SocketAddr| {
            let listener = listen(wanted)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        let failed = |source: io::Error| {
            let advice = advice(source.kind());
            Failure::Listen { address: wanted, advice, source }
        };
        let (listener, address) = bound(wanted).map_err(failed)?;
        let local = tls.as_ref().map(|_| bound((Ipv4Addr::LOCALHOST, 0).into())).transpose();
        if tls.is_none() && !address.ip().to_canonical().is_loopback() {
            say("rigd: without --tls, others on that network can read tokens and data on the way");
        }
        Ok(Self { listener, address, tls, local: local.map_err(failed)? })
    }

    /// Writes the file by which commands of this computer find the daemon.
    fn announce(&self, args: &ServeArgs, secret: &Secret) -> Option<Announced> {
        let address = self.local.as_ref().map_or(self.address, |(_, address)| *address);
        let endpoint = Endpoint::of(address, args.token_file.as_deref(), Some(secret));
        match endpoint.and_then(|endpoint| endpoint.announce(&args.bench.data.data)) {
            Ok(announced) => Some(announced),
            Err(error) => {
                say(&format!(
                    "rigd: `rigd status` and the like will not find this daemon: {error}"
                ));
                None
            }
        }
    }

    /// Its address for a person.
    fn name(&self) -> String {
        called(self.address, self.tls.is_some())
    }

    /// Answers until the daemon closes.
    fn serve(self, router: Router, closing: &CancellationToken) -> JoinHandle<()> {
        if let Some((local, _)) = self.local {
            tokio::spawn(http::serve(local, None, router.clone(), closing.clone()));
        }
        tokio::spawn(http::serve(self.listener, self.tls, router, closing.clone()))
    }
}

/// Writes the folder of each run when it has ended, until the rig is closed.
async fn write_ended_runs(mut status: watch::Receiver<Status>, data: PathBuf) {
    let mut last = None;
    while status.changed().await.is_ok() {
        let ended = status.borrow_and_update().run.as_ref().map(|run| (run.id, run.ending));
        if std::mem::replace(&mut last, ended) == ended {
            continue;
        }
        let Some((run, Some(_))) = ended else { continue };
        let data = data.clone();
        match tokio::task::spawn_blocking(move || run_files::write(&data, run)).await {
            Ok(Ok(files)) if !files.verdict.is_sound() => {
                let sentence = files.verdict.sentence;
                say(&format!("run {run} is {sentence}; `rigd verify {run}` lists them"));
            }
            Ok(Err(error)) => {
                say(&format!("the folder of run {run} cannot be written: {}", with_causes(&error)));
            }
            _ => {}
        }
    }
}

/// An address that cannot be listened on.
#[derive(Debug, thiserror::Error)]
enum BadAddress {
    #[error("expected an address or a name and a port, such as 127.0.0.1:8137 or localhost:8137")]
    Form,
    #[error("the name `{name}` has no address here; give an address of this computer")]
    Unknown { name: String },
}

/// An address, or the first one of a name. For a local name an IPv4 address is preferred, because
/// clients use it most often.
fn address(text: &str) -> Result<SocketAddr, BadAddress> {
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    let (name, port) = text.rsplit_once(':').ok_or(BadAddress::Form)?;
    let port: u16 = port.parse().map_err(|_| BadAddress::Form)?;
    if name.is_empty() || name.contains(':') {
        return Err(BadAddress::Form);
    }
    let unknown = || BadAddress::Unknown { name: name.to_owned() };
    let addresses = (name, port).to_socket_addrs().map_err(|_| unknown())?;
    addresses.min_by_key(SocketAddr::is_ipv6).ok_or_else(unknown)
}

/// Connections that the system holds until they are accepted. Beyond this number a client waits for
/// a second before it tries again, even to stop the rig.
const BACKLOG: u32 = 1024;

fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    // The port of a daemon that has just ended can be taken again.
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

const fn advice(kind: io::ErrorKind) -> &'static str {
    match kind {
        io::ErrorKind::AddrInUse => {
            "end the program that has it, such as another rigd, or choose another port with \
             --listen"
        }
        io::ErrorKind::AddrNotAvailable => "choose an address of this computer with --listen",
        io::ErrorKind::PermissionDenied => "choose a port from 1024 on with --listen",
        _ => "choose another address with --listen",
    }
}

/// Address of the daemon for a browser on this computer.
fn called(address: SocketAddr, has_tls: bool) -> String {
    let scheme = if has_tls { "https" } else { "http" };
    if address.ip().is_unspecified() {
        format!("{scheme}://localhost:{}/, and on every address of this computer", address.port())
    } else {
        format!("{scheme}://{address}/")
    }
}

/// The certificate, where clients must speak TLS.
fn tls(args: &ServeArgs) -> Result<Option<Tls>, Failure> {
    let files = args.tls.tls_certificate.as_ref().zip(args.tls.tls_key.as_ref());
    if let Some((certificate, key)) = files {
        return Ok(Some(Tls::open(certificate, key)?));
    }
    if !args.tls.tls {
        return Ok(None);
    }
    let listening = args.listen.ip();
    let address = (!listening.is_unspecified()).then(|| listening.to_string());
    let allowed = args.allow_host.iter().map(ToString::to_string);
    let known = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
    let names: BTreeSet<_> = known.into_iter().chain(allowed).chain(address).collect();
    let tls = Tls::own(&args.bench.data.data, names.into_iter().collect())?;
    say(&format!("rigd: clients can trust {}", tls.certificate().display()));
    Ok(Some(tls))
}

/// The access rules. Another computer needs a token.
fn access(args: &ServeArgs, secret: &Secret) -> Result<Access, Failure> {
    let address = args.listen.ip().to_canonical();
    let token = args.token_file.as_ref().map(|path| Token::read(path)).transpose()?;
    let tokens = Tokens::open(&args.bench.data.data)?;
    if !address.is_loopback() && token.is_none() && !tokens.is_in_use() {
        return Err(Failure::NoToken { listen: args.listen });
    }
    let names = args.allow_host.iter().cloned();
    Ok(Access::new(address, names, token, args.bench.operator.name()).with_tokens(tokens, secret))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_to_listen_on_may_be_a_name() {
        let local: SocketAddr = "127.0.0.1:8140".parse().unwrap();
        assert_eq!(address("127.0.0.1:8140").unwrap(), local);
        assert_eq!(address("localhost:8140").unwrap(), local);
        assert_eq!(address("[::1]:80").unwrap(), "[::1]:80".parse().unwrap());
        for text in
            ["", "8140", ":8140", "localhost", "localhost:", "localhost:x", "::1", "a:99999"]
        {
            assert!(matches!(address(text), Err(BadAddress::Form)), "{text}");
        }
        assert!(matches!(address("no-such-host.invalid:1"), Err(BadAddress::Unknown { .. })));
    }
}
