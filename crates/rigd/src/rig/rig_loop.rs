//! A rig without a thread of its own, for campaigns of many rigs.

use std::path::PathBuf;

use rig_store::{MemoryDisk, Store};
use tokio::sync::{mpsc, watch};

use super::{OpenError, Request, Status, proof::Purpose, shell::Shell};
use crate::{
    loaded_rig::LoadedRig,
    simulation::{SimHandle, Simulation},
};

/// A rig on the runtime of its caller. To drop it is to kill it: nothing more is sent or written.
pub struct RigLoop {
    shell: Shell,
    inbox: mpsc::Receiver<Request>,
}

impl std::fmt::Debug for RigLoop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RigLoop").finish_non_exhaustive()
    }
}

impl RigLoop {
    pub(super) async fn open(
        rig: LoadedRig,
        disk: &MemoryDisk,
        bench: Option<SimHandle>,
        inbox: mpsc::Receiver<Request>,
    ) -> Result<(Self, watch::Receiver<Status>, Option<SimHandle>), OpenError> {
        let data_error = |source| OpenError::Data { data: PathBuf::from("memory"), source };
        let store = Store::open_in_memory(disk).map_err(data_error)?;
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
