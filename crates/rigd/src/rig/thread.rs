//! The rig thread: it opens the rig, serves it, and leaves contact after a panic.

use std::{
    panic::AssertUnwindSafe,
    path::PathBuf,
    sync::{Arc, Weak, mpsc::SyncSender},
};

use futures_util::FutureExt;
use rig_engine::{Fault, RigState};
use rig_model::{Clearance, panic_message, with_causes};
use rig_store::Store;
use tokio::sync::watch;

use super::{
    OpenError, Request, Status,
    inbox::{Asked, Inbox},
    priority,
    proof::Purpose,
    pulse::{self, Pulse},
    shell::Shell,
    view::publish_way_out,
    way_out::{Kept, WayOut},
};
use crate::{
    loaded_rig::LoadedRig,
    simulation::{SimHandle, Simulation},
};

type Opened = (watch::Receiver<Status>, Option<SimHandle>, Weak<Pulse>);
type Opening = Result<Opened, OpenError>;

/// Runs the rig until it is closed. The outcome of opening it goes to `opened`.
pub(super) fn run(
    rig: LoadedRig,
    data: PathBuf,
    purpose: Purpose,
    mut inbox: Inbox,
    opened: &SyncSender<Opening>,
) {
    let is_virtual_time = rig.is_virtual_time();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .start_paused(is_virtual_time)
        .on_thread_start(priority::come_after)
        .build();
    let runtime = match runtime {
        Ok(runtime) => runtime,
        Err(source) => {
            _ = opened.send(Err(OpenError::Thread { source }));
            return;
        }
    };
    runtime.block_on(async {
        let (file, instruments) = (rig.file.clone(), rig.instruments);
        let shell = match Store::open(&data) {
            Ok(store) => Shell::open(rig, store, None, purpose).await,
            Err(source) => Err(OpenError::Data { data: data.clone(), source }),
        };
        match shell {
            Ok((mut shell, status)) => {
                // The caller may have closed its end. The closed inbox then closes the rig.
                let simulation = shell.simulation().cloned();
                let handle = simulation.as_ref().map(Simulation::handle);
                let (pulse, watched) = (shell.pulse(), shell.watched());
                if let Err(source) = pulse::watch_over(&pulse, watched.clone(), is_virtual_time) {
                    _ = opened.send(Err(OpenError::Thread { source }));
                    return;
                }
                // In virtual time a rig computes without a pause.
                if !is_virtual_time {
                    priority::come_first();
                }
                _ = opened.send(Ok((status, handle, Arc::downgrade(&pulse))));
                // It ends with the shell.
                drop(pulse);
                let served = AssertUnwindSafe(shell.serve(&mut inbox)).catch_unwind().await;
                if let Err(panic) = served {
                    let fault = Fault::Panicked { what: panic_message(&*panic).to_owned() };
                    let missing = shell.missing();
                    // The ports and the journal are free for the way out.
                    drop(shell);
                    let kept = Kept { file, instruments, data, simulation, missing };
                    leave_contact(kept, fault, &watched).await;
                    refuse_all(inbox).await;
                }
            }
            Err(error) => _ = opened.send(Err(error)),
        }
    });
}

/// Retracts after a panic, and publishes that the rig is latched for good.
async fn leave_contact(kept: Kept, fault: Fault, watched: &watch::Sender<Status>) {
    publish_way_out(watched, &fault, (RigState::Retracting, Clearance::Unknown, None));
    let (clearance, linear) = match kept.retract(fault.clone()).await {
        Ok(WayOut { clearance, linear, .. }) => (clearance, linear),
        Err(error) => {
            let reason = with_causes(&error);
            tracing::error!(%reason, "the probe could not be retracted");
            (Clearance::Unknown, None)
        }
    };
    publish_way_out(watched, &fault, (RigState::Latched, clearance, linear));
}

/// Answers that the rig is closed, until it is.
async fn refuse_all(mut inbox: Inbox) {
    while let Some(Asked { request, .. }) = inbox.recv().await {
        // A request that is dropped is answered so.
        if let Request::Close { reply } = request {
            _ = reply.send(());
            return;
        }
    }
}
