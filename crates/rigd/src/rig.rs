//! The rig at run time: a thread of its own that carries the engine's effects to the devices and
//! their reports back, and a handle for all other code.
//!
//! ```text
//!  HTTP, terminal ──▶ RigHandle ══ bounded channel ══▶ rig thread: engine ⇄ devices
//!                         ▲                                 │
//!                         └────────── watch of Status ◀─────┴──▶ journal
//! ```
//!
//! Only that channel and that watch are shared, so that slow, numerous or hostile web clients do
//! not affect the rig.

mod amend;
mod analyzer_alone;
mod descending;
mod devices;
mod gate;
mod heartbeat;
mod history;
mod identify;
mod inbox;
mod inspect;
mod ladder;
mod live;
mod log;
mod meters;
mod open;
mod owners;
mod pace;
mod priority;
mod proof;
mod pulse;
mod record;
mod request;
mod resume;
mod rig_loop;
mod shell;
mod slot;
mod space;
mod spans;
mod status;
mod step;
mod thread;
mod view;
mod way_out;

use std::{
    path::PathBuf,
    sync::{Arc, Weak},
};

use rig_commission::{Answer, Asked, JogAxis, Jogged, Order};
use rig_engine::{Command, CommandRefusal};
use rig_link::Clock;
use rig_model::{RigTime, SweepRequest, with_causes};
use rig_store::{RunId, StoreError};
use tokio::sync::{oneshot, watch};

pub use amend::{TouchOrder, skip};
pub(crate) use analyzer_alone::analyzer_alone;
pub(crate) use devices::{analyzer_failure, stage_failure};
pub use history::History;
pub use identify::Identified;
pub use inspect::{
    AxisFacts, AxisPosition, AxisState, DeviceFacts, DeviceSeen, Inspection, PortFacts, PortSeen,
    RoundTrips, inspect,
};
pub use ladder::{LadderError, Rung, climb};
pub use live::{LiveEstimate, LiveSweep};
pub(crate) use log::unwritable;
pub(crate) use meters::Meters;
pub use open::{DeviceError, OpenError};
pub(crate) use open::{Ports, analyzer_on, bus_settings, runtime_of};
pub use pace::{Pace, Remaining};
pub(crate) use proof::unproven_text;
pub use pulse::{Doing, Silence};
pub(crate) use resume::{Outcomes, Present, changes_since, cited, may_amend, may_resume};
pub use resume::{ResumeRefusal, SOFTWARE};
#[cfg(test)]
pub(crate) use rig_loop::open_in;
pub use rig_loop::{RigLoop, open_in_memory};
pub(crate) use shell::{CLOCK_WAS_SET, HELD_UP};
pub(crate) use space::{RESERVE_BYTES, check as check_space, free_bytes};
pub use status::{DeviceIdentity, RunView, Status};
pub(crate) use status::{PortFrames, Setting};
pub use step::NotMade;
pub use way_out::{KnownRig, WayOut, make_safe};

use self::{
    inbox::{Outbox, inbox},
    proof::Purpose,
    request::Request,
};
use crate::{loaded_rig::LoadedRig, protocol_file::LoadedProtocol, simulation::SimHandle};

/// Speaks to the rig thread.
#[derive(Debug, Clone)]
pub struct RigHandle {
    requests: Outbox,
    status: watch::Receiver<Status>,
    simulation: Option<SimHandle>,
    pulse: Weak<pulse::Pulse>,
}

/// The rig thread; dropping this does not stop it, [`RigHandle::close`] does.
#[derive(Debug)]
pub struct RigThread {
    thread: std::thread::JoinHandle<()>,
}

/// Why a request was not taken.
#[derive(Debug, Clone, thiserror::Error)]
pub enum RequestRefusal {
    /// The state forbids it.
    #[error(transparent)]
    Command(#[from] CommandRefusal),
    /// It names a run that is not the one under way.
    #[error("run {run} is not under way")]
    NotUnderWay {
        /// The run named.
        run: RunId,
    },
    /// The journal cannot be written, so nothing may begin.
    #[error("the journal cannot be written: {reason}")]
    Journal {
        /// The error of the store.
        reason: Arc<str>,
    },
    /// The run cannot be resumed or amended.
    #[error(transparent)]
    Resume(Arc<ResumeRefusal>),
    /// The disk has no room for the run.
    #[error(
        "the data directory has {} MB free, and {} MB are needed: twice the {} MB that the run may take, and {} MB \
         in reserve for the rest of the journal",
        .free_bytes / 1_000_000,
        .needed_bytes.div_ceil(1_000_000),
        .run_bytes.div_ceil(1_000_000),
        RESERVE_BYTES.div_ceil(1_000_000)
    )]
    NoSpace {
        /// Free space, bytes.
        free_bytes: u64,
        /// Expected size of the run, bytes.
        run_bytes: u64,
        /// Needed space, bytes.
        needed_bytes: u64,
    },
    /// The interlock refuses it.
    #[error(transparent)]
    Interlock(#[from] rig_interlock::Refusal),
    /// The answer is for another prompt than the open one.
    #[error("there is no open prompt at step {step}")]
    NotAsked {
        /// The step named.
        step: String,
    },
    /// Signs, scales or geometry of the bench are not shown.
    #[error("the rig is not commissioned: {missing}")]
    NotCommissioned {
        /// The steps that are missing, and why.
        missing: Arc<str>,
    },
    /// Steps of commissioning are not for a rig in service.
    #[error("the rig is commissioned and in service")]
    InService,
    /// One step at a time.
    #[error("a step of an axis is under way")]
    StepUnderWay,
    /// The devices are being identified already.
    #[error("the devices are being identified")]
    Identifying,
    /// The rig loop gives no sign of life.
    #[error("{0}; the request waits, and may still be carried out")]
    Silent(Silence),
    /// The rig thread has ended.
    #[error("the rig has been closed")]
    Closed,
}

/// Opens a rig on a thread of its own, and brings it into service.
///
/// Returns when every device has answered; homing and the proof that the probe is clear continue,
/// as [`Status`] shows.
///
/// # Errors
/// [`OpenError`] names the device or the directory, the attempt, and the advice.
pub fn open(rig: LoadedRig, data: PathBuf) -> Result<(RigHandle, RigThread), OpenError> {
    open_for(rig, data, Purpose::Service)
}

/// Opens a rig to commission it: no device is given a setting, the rig is not brought into service, and it moves
/// only by steps.
///
/// # Errors
/// As for [`open`].
pub fn open_to_commission(
    rig: LoadedRig,
    data: PathBuf,
) -> Result<(RigHandle, RigThread), OpenError> {
    open_for(rig, data, Purpose::Commissioning)
}

fn open_for(
    rig: LoadedRig,
    data: PathBuf,
    purpose: Purpose,
) -> Result<(RigHandle, RigThread), OpenError> {
    let (requests, inbox) = inbox();
    let (opened, is_open) = std::sync::mpsc::sync_channel(1);
    let thread = std::thread::Builder::new()
        .name("rig".to_owned())
        .spawn(move || thread::run(rig, data, purpose, inbox, &opened))
        .map_err(|source| OpenError::Thread { source })?;
    match is_open.recv() {
        Ok(Ok((status, simulation, pulse))) => {
            Ok((RigHandle { requests, status, simulation, pulse }, RigThread { thread }))
        }
        Ok(Err(error)) => Err(error),
        Err(_) => Err(OpenError::Gone),
    }
}

impl RigThread {
    /// Waits until the thread has ended.
    pub fn join(self) {
        // A panic has been reported by the panic hook already.
        _ = self.thread.join();
    }
}

impl RigHandle {
    /// The present status and its changes.
    pub fn status(&self) -> watch::Receiver<Status> {
        self.status.clone()
    }

    /// Whether the rig thread takes requests.
    pub(crate) fn is_open(&self) -> bool {
        !self.requests.is_closed()
    }

    /// The simulated bench, in which faults are injected; `None` for a real rig.
    pub const fn simulation(&self) -> Option<&SimHandle> {
        self.simulation.as_ref()
    }

    /// Replays a protocol.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn run(&self, protocol: LoadedProtocol, by: &str) -> Result<RunId, RequestRefusal> {
        self.keyed_run(protocol, by, None).await
    }

    /// The same, with the idempotency key of the request, which the journal keeps.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn keyed_run(
        &self,
        protocol: LoadedProtocol,
        by: &str,
        key: Option<String>,
    ) -> Result<RunId, RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        let (protocol, by) = (Box::new(protocol), by.to_owned());
        self.ask(Request::Run { protocol, by, key, reply }, answer).await?
    }

    /// Resumes a run that had not been completed, at its next touch without an outcome.
    /// `is_confirmed` accepts the changes since.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn resume(
        &self,
        run: RunId,
        is_confirmed: bool,
        by: &str,
    ) -> Result<(), RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        let by = by.to_owned();
        self.ask(Request::Resume { run, is_confirmed, by, reply }, answer).await?
    }

    /// Measures a touch of a run again, and returns the id of the amendment. `is_confirmed` accepts
    /// the changes since the run.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn redo(
        &self,
        order: TouchOrder,
        is_confirmed: bool,
        by: &str,
    ) -> Result<RunId, RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        let by = by.to_owned();
        self.ask(Request::Redo { order, is_confirmed, by, reply }, answer).await?
    }

    /// Leaves a touch of a run out.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn skip(&self, order: TouchOrder, by: &str) -> Result<(), RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::Skip { order, by: by.to_owned(), reply }, answer).await?
    }

    /// Gives up a run that had not been completed, and seals it.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn give_up(&self, run: RunId, by: &str) -> Result<(), RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::GiveUp { run, by: by.to_owned(), reply }, answer).await?
    }

    /// Measures one resonance at the present pose and returns the number of the sweep.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn sweep(&self, request: SweepRequest, by: &str) -> Result<u64, RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::Sweep { request, by: by.to_owned(), reply }, answer).await?
    }

    /// Gives a command; with `run`, only if that run is under way.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has changed then.
    pub async fn command(
        &self,
        command: Command,
        run: Option<RunId>,
        by: &str,
    ) -> Result<(), RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::Command { command, run, by: by.to_owned(), reply }, answer).await?
    }

    /// Answers the prompt of this step of this run.
    ///
    /// # Errors
    /// [`RequestRefusal`], after which nothing has changed. A prompt of another step stays open.
    pub async fn answer(&self, run: RunId, step: String, by: &str) -> Result<(), RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::Answer { run, step, by: by.to_owned(), reply }, answer).await?
    }

    /// Asks each device of an idle rig again who it is. Nothing moves.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing was asked then. What a device answers is in the result.
    pub async fn identify(&self, by: &str) -> Result<Vec<Identified>, RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        let answers = self.ask(Request::Identify { by: by.to_owned(), reply }, answer).await??;
        let mut all = Vec::new();
        for answer in answers {
            all.extend(answer.await.map_err(|_| RequestRefusal::Closed)?);
        }
        Ok(all)
    }

    /// Has a drive of a rig that is not in service do something, and waits for its end. A person has confirmed it, and that
    /// nothing is below the probe. The drive says why it did not do it.
    ///
    /// # Errors
    /// [`RequestRefusal`]; nothing has moved then.
    pub async fn drive(
        &self,
        order: Order,
        by: &str,
    ) -> Result<Result<Jogged, NotMade>, RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        let request = Request::Commission { order, by: by.to_owned(), reply };
        let ended = self.ask(request, answer).await??;
        ended.await.map_err(|_| RequestRefusal::Closed)
    }

    /// A gauge has shown that the last step of an axis was about as long as its drive says: a longer one may follow.
    ///
    /// # Errors
    /// [`RequestRefusal`].
    pub async fn step_seen(&self, axis: JogAxis, by: &str) -> Result<(), RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::StepSeen { axis, by: by.to_owned(), reply }, answer).await?
    }

    /// The answer of the simulated person; `None` where a real person answers.
    ///
    /// # Errors
    /// [`RequestRefusal`].
    pub async fn ask_simulated(&self, asked: Asked) -> Result<Option<Answer>, RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::AskSimulated { asked, reply }, answer).await
    }

    /// A user has answered. What the user says is done with the hand, such as pressing the emergency stop, is then done on
    /// a simulated bench.
    ///
    /// # Errors
    /// [`RequestRefusal`].
    pub async fn answered(&self, asked: Asked, answer: Answer) -> Result<(), RequestRefusal> {
        let (reply, done) = oneshot::channel();
        self.ask(Request::Answered { asked, answer, reply }, done).await
    }

    /// Has the rig read its calibrations again, and returns what is still missing. A rig that was opened for
    /// service goes into service when nothing is.
    ///
    /// # Errors
    /// [`RequestRefusal`].
    pub async fn read_calibrations(&self, by: &str) -> Result<Option<Arc<str>>, RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::ReadCalibrations { by: by.to_owned(), reply }, answer).await
    }

    /// Records what a person did that is no command to the rig, such as taking over the lease.
    ///
    /// # Errors
    /// [`RequestRefusal`]; it is not on record then.
    pub async fn note(&self, action: String, by: &str) -> Result<(), RequestRefusal> {
        let (reply, answer) = oneshot::channel();
        self.ask(Request::Note { action, by: by.to_owned(), reply }, answer).await?
    }

    /// Ends what is under way, which retracts the probe, and ends the rig thread. A probe that was lowered by hand stays
    /// where it is.
    pub async fn close(&self) {
        let (reply, answer) = oneshot::channel();
        // A rig that is closed already is closed.
        _ = self.ask(Request::Close { reply }, answer).await;
    }

    async fn ask<T>(
        &self,
        request: Request,
        answer: oneshot::Receiver<T>,
    ) -> Result<T, RequestRefusal> {
        let is_way_out = matches!(
            request,
            Request::Close { .. }
                | Request::Command { command: Command::Stop | Command::Abort, .. }
        );
        let asked = async {
            self.requests.send(request).await.map_err(|_| RequestRefusal::Closed)?;
            answer.await.map_err(|_| RequestRefusal::Closed)
        };
        let mut status = self.status.clone();
        tokio::select! {
            biased;
            answered = asked => answered,
            silence = silent(&mut status) => {
                if let Some(pulse) = self.pulse.upgrade().filter(|_| is_way_out) {
                    pulse.give_up();
                }
                Err(RequestRefusal::Silent(silence))
            }
        }
    }
}

impl From<StoreError> for RequestRefusal {
    fn from(error: StoreError) -> Self {
        Self::Journal { reason: with_causes(&error).into() }
    }
}

impl From<ResumeRefusal> for RequestRefusal {
    fn from(refusal: ResumeRefusal) -> Self {
        Self::Resume(Arc::new(refusal))
    }
}

/// Waits until the rig loop is silent; for ever, when it has ended.
async fn silent(status: &mut watch::Receiver<Status>) -> Silence {
    let silence = status.wait_for(|status| status.silence.is_some()).await;
    match silence.ok().and_then(|status| status.silence) {
        Some(silence) => silence,
        None => std::future::pending().await,
    }
}

/// Waits until a time on the rig's clock; for ever, when there is none.
async fn until(clock: Clock, deadline: Option<RigTime>) {
    match deadline {
        Some(deadline) => tokio::time::sleep(deadline.since(clock.now())).await,
        None => std::future::pending().await,
    }
}
