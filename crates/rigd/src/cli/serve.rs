//! `rigd serve`: the daemon.

use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use super::{Failure, ServeArgs, table::note};
use crate::{http, protocol_file::LoadedProtocol, rig};

pub(super) fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let facts = rig.facts();
    let loaded =
        args.protocol.as_ref().map(|path| LoadedProtocol::load(path, &facts)).transpose()?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    // The address is taken first: a daemon that nobody can reach must not move anything.
    let listener = runtime
        .block_on(TcpListener::bind(args.listen))
        .map_err(|source| Failure::System { what: "listening", source })?;
    let address =
        listener.local_addr().map_err(|source| Failure::System { what: "listening", source })?;
    let (handle, thread) = rig::open(rig, args.data.data.clone())?;
    let closing = CancellationToken::new();
    let shared =
        http::Shared::new(handle.clone(), facts, loaded, args.data.data.clone(), closing.clone());
    note(&format!("rigd: listening on http://{address}/api/v1/"));
    let served = runtime.block_on(async {
        let stopping = {
            let (handle, closing) = (handle.clone(), closing.clone());
            async move {
                interrupted().await;
                note("rigd: leaving the probe clear and closing");
                handle.close().await;
                closing.cancel();
            }
        };
        axum::serve(listener, http::router(shared)).with_graceful_shutdown(stopping).await
    });
    thread.join();
    served.map_err(|source| Failure::System { what: "serving", source })
}

/// Waits until the daemon is asked to end.
async fn interrupted() {
    use tokio::signal::unix::{SignalKind, signal};
    let terminated = async {
        match signal(SignalKind::terminate()) {
            Ok(mut terminate) => _ = terminate.recv().await,
            Err(_) => std::future::pending().await,
        }
    };
    tokio::select! {
        _ = tokio::signal::ctrl_c() => {}
        () = terminated => {}
    }
}
