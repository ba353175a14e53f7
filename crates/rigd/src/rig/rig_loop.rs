//! A rig without a thread of its own, for campaigns of many rigs.

use std::{path::PathBuf, sync::Weak};

use rig_store::{MemoryDisk, Store};
use tokio::sync::watch;

use super::{
    OpenError, RigHandle, Status,
    inbox::{Inbox, inbox},
    proof::Purpose,
    shell::Shell,
};
use crate::{
    loaded_rig::LoadedRig,
    simulation::{SimHandle, Simulation},
};

/// Opens a simulated rig on the runtime of the caller, with its journal in memory: for campaigns of
/// many rigs. `bench` is the bench of a rig that was open before on the same runtime.
///
/// Returns when every device has answered. [`RigLoop::serve`] must be polled for anything else to
/// happen.
///
/// # Errors
/// As for [`open`](super::open).
pub async fn open_in_memory(
    rig: LoadedRig,
    disk: &MemoryDisk,
    bench: Option<SimHandle>,
) -> Result<(RigHandle, RigLoop), OpenError> {
    let data_error = |source| OpenError::Data { data: PathBuf::from("memory"), source };
    let store = Store::open_in_memory(disk).map_err(data_error)?;
    open_on(rig, store, bench).await
}

/// Opens a simulated rig on the runtime of the caller, with its journal and its calibrations in a directory.
#[cfg(test)]
pub(crate) async fn open_in(
    rig: LoadedRig,
    data: &std::path::Path,
    bench: Option<SimHandle>,
) -> Result<(RigHandle, RigLoop), OpenError> {
    let data_error = |source| OpenError::Data { data: data.to_owned(), source };
    open_on(rig, Store::open(data).map_err(data_error)?, bench).await
}

async fn open_on(
    rig: LoadedRig,
    store: Store,
    bench: Option<SimHandle>,
) -> Result<(RigHandle, RigLoop), OpenError> {
    let (requests, inbox) = inbox();
    let (rig, status, simulation) = RigLoop::open(rig, store, bench, inbox).await?;
    // Nothing watches over a loop that its caller polls.
    Ok((RigHandle { requests, status, simulation, pulse: Weak::new() }, rig))
}

/// A rig on the runtime of its caller. To drop it is to kill it: nothing more is sent or written.
pub struct RigLoop {
    shell: Shell,
    inbox: Inbox,
}

impl std::fmt::Debug for RigLoop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RigLoop").finish_non_exhaustive()
    }
}

impl RigLoop {
    async fn open(
        rig: LoadedRig,
        store: Store,
        bench: Option<SimHandle>,
        inbox: Inbox,
    ) -> Result<(Self, watch::Receiver<Status>, Option<SimHandle>), OpenError> {
        // On the heap: a campaign polls many rigs, each within the futures of its runs.
        let opening = Box::pin(Shell::open(rig, store, bench, Purpose::Service));
        let (shell, status) = opening.await?;
        let simulation = shell.simulation().map(Simulation::handle);
        Ok((Self { shell, inbox }, status, simulation))
    }

    /// Brings the rig into service and serves its handles until it is closed.
    pub async fn serve(mut self) {
        self.shell.serve(&mut self.inbox).await;
    }
}
