//! Ships the journal to the hub of the laboratory.
//!
//! It has a thread, a runtime and a connection of its own, and reads the journal as any other reader: the rig thread does
//! nothing for it, and a hub that is slow or gone delays nothing.

use std::{
    io,
    path::{Path, PathBuf},
};

use rig_files::service_file::HubFile;
use rig_hub::{Destination, Held, ShipperError, Standing, TlsError, ship};
use rig_store::Reader;
use tokio::sync::watch;

use crate::{
    beside::{Beside, Words, tell},
    rig::Status,
};

/// The version that the hub is told.
const SOFTWARE: &str = concat!("rigd ", env!("CARGO_PKG_VERSION"));
const WORDS: Words = Words {
    fails: "the journal is not shipped to the hub, and is tried on",
    goes_on: "the journal is shipped to the hub again",
};

/// Ships for as long as it is kept.
#[derive(Debug)]
pub(crate) struct Shipper {
    standing: watch::Receiver<Standing>,
    beside: Beside,
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
        let beside = Beside::start("hub", move || async move {
            let told = tell(sender.subscribe(), |standing| standing.error.clone(), WORDS);
            tokio::select! {
                () = ship(&to, &data, SOFTWARE, status, &sender) => {}
                () = told => {}
            }
        })?;
        Ok(Self { standing, beside })
    }

    /// For the figures of the service.
    pub(crate) fn standing(&self) -> watch::Receiver<Standing> {
        self.standing.clone()
    }

    /// Waits a short time for the end of the journal, once the rig has closed. The rest is sent at the next start.
    pub(crate) async fn finish(self) {
        self.beside.finish(self.standing).await;
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
