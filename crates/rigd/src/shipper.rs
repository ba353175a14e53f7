//! Ships the journal to the hub of the laboratory.
//!
//! It has a thread, a runtime and a connection of its own, and reads the journal as any other reader: the rig thread does
//! nothing for it, and a hub that is slow or gone delays nothing.

use std::{
    io,
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use rig_files::service_file::HubFile;
use rig_hub::{Destination, Held, ShipperError, Standing, TlsError, ship};
use rig_store::Reader;
use tokio::{sync::watch, time::timeout};
use tokio_util::sync::CancellationToken;

use crate::rig::Status;

/// The version that the hub is told.
const SOFTWARE: &str = concat!("rigd ", env!("CARGO_PKG_VERSION"));
/// By how much the thread gives way to the rig thread.
const NICE: i32 = 10;
/// Time in which the end of the journal is shipped when the daemon ends. The rest is sent at its next start.
const LAST_TIME: Duration = Duration::from_secs(2);

/// Ships for as long as it is kept.
#[derive(Debug)]
pub(crate) struct Shipper {
    standing: watch::Receiver<Standing>,
    ending: CancellationToken,
    thread: Option<thread::JoinHandle<()>>,
}

/// The hub of a service file.
///
/// # Errors
/// [`TlsError`] for a certificate or a key that cannot be used.
pub(crate) fn destination(file: &HubFile) -> Result<Destination, TlsError> {
    let files = [&file.certificate, &file.key, &file.authority].map(Clone::clone);
    let address = (file.host.as_str(), file.port);
    let destination = Destination::new(address, &file.database, &file.bench, files);
    destination.check()?;
    Ok(destination)
}

impl Shipper {
    /// Begins to ship the journal in `data`, until the rig has closed.
    ///
    /// # Errors
    /// The system has no thread.
    pub(crate) fn start(
        to: Destination,
        data: PathBuf,
        status: watch::Receiver<Status>,
    ) -> io::Result<Self> {
        let (sender, standing) = watch::channel(Standing::default());
        let ending = CancellationToken::new();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let end = ending.clone();
        let work = move || {
            if let Err(error) = rustix::process::nice(NICE) {
                tracing::warn!(%error, "the thread of the hub has the priority of the rig thread");
            }
            runtime.block_on(async {
                let ship = ship(&to, &data, SOFTWARE, status, &sender);
                tokio::select! {
                    () = ship => {}
                    () = tell(sender.subscribe()) => {}
                    () = end.cancelled() => {}
                }
            });
            // A name that is being looked up cannot be interrupted; the program does not wait for it.
            runtime.shutdown_background();
        };
        let thread = Some(thread::Builder::new().name("hub".to_owned()).spawn(work)?);
        Ok(Self { standing, ending, thread })
    }

    /// For the figures of the service.
    pub(crate) fn standing(&self) -> watch::Receiver<Standing> {
        self.standing.clone()
    }

    /// Waits a short time for the end of the journal, once the rig has closed.
    pub(crate) async fn finish(shipper: Option<Self>) {
        let Some(mut shipper) = shipper else { return };
        let mut standing = shipper.standing.clone();
        let ended = async { while standing.changed().await.is_ok() {} };
        if timeout(LAST_TIME, ended).await.is_err() {
            shipper.ending.cancel();
        }
        shipper.join();
    }

    fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            _ = thread.join();
        }
    }
}

impl Drop for Shipper {
    fn drop(&mut self) {
        self.ending.cancel();
        self.join();
    }
}

/// Logs when shipping fails and when it goes on, not each attempt.
async fn tell(mut standing: watch::Receiver<Standing>) {
    let mut told = None;
    while standing.changed().await.is_ok() {
        let Standing { error, event, .. } = standing.borrow_and_update().clone();
        match (&error, &told) {
            (Some(error), None) => {
                tracing::warn!(error, "the journal is not shipped to the hub, and is tried on");
            }
            (None, Some(_)) => tracing::warn!(event, "the journal is shipped to the hub again"),
            _ => {}
        }
        told = error;
    }
}

/// Asks what the hub has of the journal in `data`.
///
/// # Errors
/// [`ShipperError`].
pub(crate) fn held(to: &Destination, data: &Path) -> Result<(Held, u64), ShipperError> {
    let reader = Reader::open(data).map_err(rig_hub::InletError::from)?;
    let last_event = reader.last_event().map_err(rig_hub::InletError::from)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(ShipperError::Runtime)?;
    Ok((runtime.block_on(to.held(&reader))?, last_event))
}
