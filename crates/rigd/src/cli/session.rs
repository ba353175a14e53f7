//! A rig that is open during one command.

use std::path::{Path, PathBuf};

use rig_engine::{Command, Device, Fault, RigState};
use rig_store::Reader;
use tokio::sync::watch;

use super::{
    Failure,
    guard::{WayOut, watch_over},
    screen::{say, say_clearly},
    signals::Signals,
};
use crate::{
    hint,
    interruption::InterruptedRig,
    loaded_rig::LoadedRig,
    operator::Operator,
    rig::{self, OpenError, RigHandle, RigThread, Status},
};

/// A rig in service, and the person at the terminal.
pub(super) struct Session {
    pub(super) handle: RigHandle,
    pub(super) status: watch::Receiver<Status>,
    pub(super) signals: Signals,
    operator: Operator,
}

/// The action of a command on a rig whose last program may have left the probe in the sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LeftInContact {
    /// Retract: the command is there for it.
    Retract,
    /// Home each lost axis and retract: the command is there for it, and a person has stated that nothing is below the probe.
    HomeWithNothingBelow,
    /// Leave it to `rigd home`.
    Refuse,
}

/// Opens a rig, does `work` with it once it is in service, and closes it.
pub(super) fn with_rig<T>(
    rig: LoadedRig,
    data: &Path,
    operator: &Operator,
    left: LeftInContact,
    work: impl AsyncFnOnce(&mut Session) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    let outcome = runtime.block_on(async {
        let mut signals = Signals::new()?;
        let (handle, thread) = open(rig, data.to_path_buf(), &mut signals).await?;
        let (status, operator) = (handle.status(), operator.clone());
        let mut session = Session { handle, status, signals, operator };
        let outcome = match session.be_ready(left).await {
            Ok(()) => work(&mut session).await,
            Err(failure) => Err(failure),
        };
        if !matches!(outcome, Err(Failure::Left { .. })) {
            session.close().await?;
            thread.join();
        }
        outcome
    });
    // Reading the terminal cannot be interrupted; the program does not wait for it.
    runtime.shutdown_background();
    outcome
}

/// Opens a rig. Nothing moves before every device has answered; a signal that comes meanwhile is
/// obeyed as soon as they have.
pub(super) async fn open(
    rig: LoadedRig,
    data: PathBuf,
    signals: &mut Signals,
) -> Result<(RigHandle, RigThread), Failure> {
    say_what_was_left(&data, &rig);
    open_by(rig::open, rig, data, signals).await
}

/// Opens a rig in one of the ways in which it can be opened.
pub(super) async fn open_by(
    how: fn(LoadedRig, PathBuf) -> Result<(RigHandle, RigThread), OpenError>,
    rig: LoadedRig,
    data: PathBuf,
    signals: &mut Signals,
) -> Result<(RigHandle, RigThread), Failure> {
    let way_out = WayOut { rig: rig.path.clone(), digest: rig.digest(), data: data.clone() };
    let mut opening = tokio::task::spawn_blocking(move || how(rig, data));
    loop {
        tokio::select! {
            opened = &mut opening => {
                let (handle, thread) = opened.map_err(|_| OpenError::Gone)??;
                watch_over(&handle, way_out)?;
                return Ok((handle, thread));
            }
            () = signals.next() => match signals.count {
                1 => say_clearly("ending as soon as the devices have answered; interrupt again to end now"),
                _ => return Err(Failure::Interrupted),
            },
        }
    }
}

/// Reports an interrupted session before anything moves. Opening the rig reports faults of the
/// journal.
fn say_what_was_left(data: &Path, rig: &LoadedRig) {
    let left = |reader: Reader| InterruptedRig::left(&reader, &rig.file.name, rig.is_simulated());
    let left = Reader::open(data).ok().and_then(left);
    if let Some(left) = left.filter(|left| left.is_latched) {
        say(&left.message);
    }
}

/// Whether the rig was left with its probe lowered.
const fn is_lowered(fault: &Fault) -> bool {
    matches!(fault, Fault::Interrupted(left) if left.was_lowered)
}

impl Session {
    /// Waits until the rig is in service.
    async fn be_ready(&mut self, left: LeftInContact) -> Result<(), Failure> {
        let mut may_home = left == LeftInContact::HomeWithNothingBelow;
        loop {
            let status = self.status.borrow_and_update().clone();
            match (status.snapshot.state, &status.snapshot.fault) {
                _ if self.signals.count > 0 => {}
                (RigState::Idle, _) => return Ok(()),
                // What was left may be a position that is wrong, which a homing alone mends.
                (RigState::Latched, Some(fault))
                    if may_home
                        && (status.snapshot.jump.is_some()
                            || hint::is_unhomed(fault)
                            || is_lowered(fault)) =>
                {
                    may_home = false;
                    self.handle.command(Command::HomeLinear, None, self.operator()).await?;
                    continue;
                }
                // A person at the bench has read the report above.
                (RigState::Latched, Some(Fault::Interrupted(rig)))
                    if !rig.was_lowered || left != LeftInContact::Refuse =>
                {
                    self.handle.command(Command::Acknowledge, None, self.operator()).await?;
                    continue;
                }
                (RigState::Latched, _) => return Err(latched(&status)),
                _ => {}
            }
            if self.signals.count > 0 {
                _ = self.handle.command(Command::Stop, None, self.operator()).await;
                return Err(Failure::Interrupted);
            }
            tokio::select! {
                changed = self.status.changed() => changed.map_err(|_| rig::RequestRefusal::Closed)?,
                () = self.signals.next() => {}
            }
        }
    }

    /// The operator, for the journal.
    pub(super) fn operator(&self) -> &str {
        self.operator.as_str()
    }

    /// Gives a command and waits until it has been carried out.
    pub(super) async fn carry_out(&mut self, command: Command) -> Result<Status, Failure> {
        self.handle.command(command, None, self.operator()).await?;
        self.finished().await
    }

    /// Waits until the command has ended well.
    pub(super) async fn finished(&mut self) -> Result<Status, Failure> {
        loop {
            let status = self.status.borrow_and_update().clone();
            match status.snapshot.state {
                RigState::Idle if self.signals.count > 0 => return Err(Failure::Aborted),
                RigState::Idle => return Ok(status),
                RigState::Latched => return Err(latched(&status)),
                _ => {}
            }
            tokio::select! {
                changed = self.status.changed() => changed.map_err(|_| rig::RequestRefusal::Closed)?,
                () = self.signals.next() => self.end_early().await?,
            }
        }
    }

    /// The first signal asks for an orderly end, the second one stops, the third one ends the
    /// program in any state of the rig.
    pub(super) async fn end_early(&self) -> Result<(), Failure> {
        let command = match self.signals.count {
            1 => Command::Abort,
            2 => Command::Stop,
            _ => return Err(left(&self.status.borrow())),
        };
        self.repeat_advice();
        // Denied when it is being ended already.
        _ = self.handle.command(command, None, self.operator()).await;
        Ok(())
    }

    /// Reports the effect of the last signal and of the next one.
    pub(super) fn repeat_advice(&self) {
        match self.signals.count {
            0 => {}
            1 => say_clearly("retracting the probe; interrupt again to stop everything"),
            _ => say_clearly(
                "stopping both axes, then retracting; interrupt again to leave the rig as it is",
            ),
        }
    }

    /// Leaves the probe clear and ends the rig thread; a second signal in the meantime ends the
    /// program in any state of the rig.
    async fn close(&mut self) -> Result<(), Failure> {
        let before = self.signals.count;
        let closed = self.handle.close();
        tokio::pin!(closed);
        loop {
            tokio::select! {
                () = &mut closed => return Ok(()),
                () = self.signals.next() => {
                    if self.signals.count > before + 1 {
                        return Err(left(&self.status.borrow()));
                    }
                    say_clearly("closing the rig; interrupt again to leave it as it is");
                }
            }
        }
    }
}

/// The program ends although the rig is not at rest. Says the last known position of the probe.
pub(super) fn left(status: &Status) -> Failure {
    let snapshot = &status.snapshot;
    Failure::Left { state: snapshot.state, probe: snapshot.clearance, linear: snapshot.linear }
}

/// The rig is latched. Prints the reason and the advice.
pub(super) fn latched(status: &Status) -> Failure {
    let fault = status.snapshot.fault.as_ref();
    let hint = fault.map(|fault| hint::latched(&status.snapshot, fault).at_a_terminal());
    let cause = fault.map_or_else(|| "a fault".to_owned(), ToString::to_string);
    let is_of_journal =
        matches!(fault, Some(Fault::Device(failure)) if failure.device == Device::Journal);
    let unrecorded = if is_of_journal {
        "; the journal could not record that, and `rigd runs` says what it recorded last"
    } else {
        ""
    };
    Failure::Latched {
        cause: format!(
            "{cause}\nprobe: {}{unrecorded}\n{}",
            status.snapshot.clearance.text(),
            hint.unwrap_or_default()
        ),
    }
}
