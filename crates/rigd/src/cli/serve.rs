//! `rigd serve`: the daemon.

use std::{io, net::SocketAddr, path::PathBuf, time::Duration};

use clap::Args;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use super::{
    DataArgs, Failure, OperatorArgs, RigArgs,
    screen::{say, say_clearly},
    session::{left, open},
    signals::Signals,
};
use crate::{
    http::{
        self,
        doors::{Doors, HostName, Token},
    },
    protocol_file::LoadedProtocol,
};

#[derive(Debug, Args)]
pub(super) struct ServeArgs {
    /// Protocol file to have loaded; one can also be posted
    protocol: Option<PathBuf>,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    /// Address and port to listen on. Any but a loopback address needs --token-file
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8137")]
    listen: SocketAddr,
    /// Another name by which clients may call this computer; can be given several times
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<HostName>,
    /// File with the token that clients must send as `Authorization: Bearer`
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    #[command(flatten)]
    operator: OperatorArgs,
}

/// Journals are read on threads of their own. With more of them the disk would be no faster.
const READERS_MAX: usize = 8;
/// How long reading may go on when the daemon ends.
const READING_TIME: Duration = Duration::from_secs(1);

pub(super) fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let doors = doors(args)?;
    let rig = args.rig.load()?;
    let facts = rig.facts();
    let loaded =
        args.protocol.as_ref().map(|path| LoadedProtocol::load(path, &facts)).transpose()?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(READERS_MAX)
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let data = args.data.data.clone();
    let served = runtime.block_on(async {
        let mut signals = Signals::new()?;
        // The address is taken first: a daemon that nobody can reach must not move anything.
        let failed = |source: io::Error| Failure::System { what: "listening", source };
        let listener = TcpListener::bind(args.listen).await.map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let (handle, thread) = open(rig, data.clone(), &mut signals).await?;
        let closing = CancellationToken::new();
        let shared = http::Shared::new(handle.clone(), facts, loaded, data, doors, closing.clone());
        let serving = tokio::spawn(http::serve(listener, http::router(shared), closing.clone()));
        if signals.count == 0 {
            say(&format!("rigd: listening on http://{address}/"));
            signals.next().await;
        }
        say_clearly(
            "rigd: leaving the probe clear and closing; interrupt again to leave the rig as it is",
        );
        tokio::select! {
            () = handle.close() => {}
            () = signals.next() => return Err(left(&handle.status().borrow())),
        }
        thread.join();
        closing.cancel();
        tokio::select! {
            _ = serving => {}
            () = signals.next() => {}
        }
        Ok(())
    });
    runtime.shutdown_timeout(READING_TIME);
    served
}

/// Who may come in. From another computer, only whoever knows the token.
fn doors(args: &ServeArgs) -> Result<Doors, Failure> {
    let address = args.listen.ip().to_canonical();
    let token = args.token_file.as_ref().map(|path| Token::read(path)).transpose()?;
    if !address.is_loopback() && token.is_none() {
        return Err(Failure::NoToken { listen: args.listen });
    }
    Ok(Doors::new(address, args.allow_host.iter().cloned(), token, args.operator.name()))
}
