//! What a daemon tells the hub of its laboratory: its journal, and to viewers what the rig does.

use std::path::Path;

use rig_files::service_file::HubFile;
use rig_hub::Destination;

use super::Failure;
use crate::{
    http,
    live::{Audience, Live},
    rig::Status,
    shipper::{self, Shipper},
};

/// A hub whose files have been read and checked.
pub(super) struct Hub {
    destination: Destination,
    audience: Option<Audience>,
}

/// The threads that tell the hub.
pub(super) struct Telling {
    shipper: Shipper,
    live: Option<Live>,
}

impl Hub {
    /// The hub of a service file.
    ///
    /// # Errors
    /// [`Failure`] for files or a name that cannot be used.
    pub(super) fn of(file: &HubFile) -> Result<Self, Failure> {
        Ok(Self { destination: shipper::destination(file)?, audience: Audience::of(file)? })
    }

    /// Begins to ship the journal in `data`, and to tell viewers what the rig does.
    ///
    /// # Errors
    /// [`Failure::System`] without a thread.
    pub(super) fn start(self, shared: &http::Shared, data: &Path) -> Result<Telling, Failure> {
        let no_thread = |what| move |source| Failure::System { what, source };
        let (data, status) = (data.to_path_buf(), shared.watch_status());
        let shipper = Shipper::start(self.destination, data.clone(), status.clone())
            .map_err(no_thread("thread of the hub"))?;
        shared.show_hub(shipper.standing());
        let rig = shared.clone();
        let document = move |status: &Status| rig.document(status);
        let start = |to| Live::start(to, data, status, document);
        let live = self.audience.map(start).transpose();
        let live = live.map_err(no_thread("thread of the live messages"))?;
        if let Some(live) = &live {
            shared.show_live(live.standing());
        }
        Ok(Telling { shipper, live })
    }
}

impl Telling {
    /// Waits a short time for the end of the journal and the last state, once the rig has closed.
    pub(super) async fn finish(telling: Option<Self>) {
        let Some(Self { shipper, live }) = telling else { return };
        tokio::join!(shipper.finish(), async {
            if let Some(live) = live {
                live.finish().await;
            }
        });
    }
}
