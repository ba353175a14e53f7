//! A rig that is open for as long as one command takes.

use std::path::Path;

use rig_engine::{Command, StateWord};
use tokio::sync::watch;

use super::{Failure, table::note};
use crate::{
    hint,
    loaded_rig::LoadedRig,
    rig::{self, RigHandle, Status},
};

/// A rig in service, and the person at the terminal.
pub(super) struct Session {
    pub(super) handle: RigHandle,
    pub(super) status: watch::Receiver<Status>,
    pub(super) interrupts: Interrupts,
}

/// Opens a rig, does `work` with it once it is in service, and closes it.
pub(super) fn with_rig<T>(
    rig: LoadedRig,
    data: &Path,
    work: impl AsyncFnOnce(&mut Session) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let (handle, thread) = rig::open(rig, data.to_path_buf())?;
    let outcome = runtime.block_on(async {
        let outcome = begin(&handle, work).await;
        handle.close().await;
        outcome
    });
    thread.join();
    // Reading the terminal cannot be interrupted; the program does not wait for it.
    runtime.shutdown_background();
    outcome
}

async fn begin<T>(
    handle: &RigHandle,
    work: impl AsyncFnOnce(&mut Session) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let (handle, status) = (handle.clone(), handle.status());
    let mut session = Session { handle, status, interrupts: Interrupts::new()? };
    session.be_ready().await?;
    work(&mut session).await
}

impl Session {
    /// Waits until the rig is in service.
    async fn be_ready(&mut self) -> Result<(), Failure> {
        loop {
            {
                let status = self.status.borrow_and_update();
                match status.snapshot.state {
                    StateWord::Idle => return Ok(()),
                    StateWord::Latched => return Err(latched(&status)),
                    _ => {}
                }
            }
            tokio::select! {
                changed = self.status.changed() => changed.map_err(|_| rig::Refusal::Closed)?,
                () = self.interrupts.next() => {
                    _ = self.handle.command(Command::Stop, None, "terminal").await;
                    return Err(Failure::Interrupted);
                }
            }
        }
    }

    /// Gives a command and waits until it has been carried out.
    pub(super) async fn carry_out(&mut self, command: Command) -> Result<Status, Failure> {
        self.handle.command(command, None, "terminal").await?;
        self.finished().await
    }

    /// Waits until what was begun has ended well.
    pub(super) async fn finished(&mut self) -> Result<Status, Failure> {
        loop {
            let status = self.status.borrow_and_update().clone();
            match status.snapshot.state {
                StateWord::Idle if self.interrupts.count > 0 => return Err(Failure::Aborted),
                StateWord::Idle => return Ok(status),
                StateWord::Latched => return Err(latched(&status)),
                _ => {}
            }
            tokio::select! {
                changed = self.status.changed() => changed.map_err(|_| rig::Refusal::Closed)?,
                () = self.interrupts.next() => self.end_early().await,
            }
        }
    }

    /// The first interrupt asks for an orderly end, every other one stops.
    pub(super) async fn end_early(&self) {
        let command = if self.interrupts.count == 1 { Command::Abort } else { Command::Stop };
        note("retracting the probe; interrupt again to stop everything");
        // Denied when it is being ended already.
        _ = self.handle.command(command, None, "terminal").await;
    }
}

/// That the rig is latched, with what to do about it.
pub(super) fn latched(status: &Status) -> Failure {
    let fault = status.snapshot.fault.as_ref();
    let hint = fault.map(|fault| hint::after(fault, status.snapshot.clearance).at_a_terminal());
    let cause = fault.map_or_else(|| "a fault".to_owned(), ToString::to_string);
    Failure::Latched {
        cause: format!(
            "{cause}\nprobe: {}\n{}",
            status.snapshot.clearance.name(),
            hint.unwrap_or_default()
        ),
    }
}

/// Interrupts of the person at the terminal.
pub(super) struct Interrupts {
    terminate: tokio::signal::unix::Signal,
    pub(super) count: u32,
}

impl Interrupts {
    fn new() -> Result<Self, Failure> {
        use tokio::signal::unix::{SignalKind, signal};
        let terminate = signal(SignalKind::terminate())
            .map_err(|source| Failure::System { what: "signals", source })?;
        Ok(Self { terminate, count: 0 })
    }

    pub(super) async fn next(&mut self) {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = self.terminate.recv() => {}
        }
        self.count += 1;
    }
}
