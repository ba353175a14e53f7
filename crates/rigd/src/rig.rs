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
mod devices;
mod gate;
mod heartbeat;
mod history;
mod identify;
mod inspect;
mod live;
mod log;
mod open;
mod owners;
mod pace;
mod pulse;
mod record;
mod resume;
mod rig_loop;
mod shell;
mod slot;
mod space;
mod thread;
mod view;
mod way_out;

use std::{
    path::PathBuf,
    sync::{Arc, Weak},
    time::Instant,
};

use rig_engine::{Command, CommandRefusal, Snapshot};
use rig_link::{Clock, HealthMeter, Transcript};
use rig_model::{RigLimits, RigTime, SweepRequest, with_causes};
use rig_protocol::{Action, Plan, Prompt};
use rig_sim::SimHandle;
use rig_store::{MemoryDisk, RunId, StoreError};
use tokio::sync::{mpsc, oneshot, watch};

pub use amend::{TouchOrder, skip};
pub(crate) use devices::{analyzer_failure, stage_failure};
pub use history::History;
pub use identify::Identified;
pub use inspect::{
    AxisFacts, AxisPosition, AxisState, DeviceFacts, DeviceSeen, Inspection, PortFacts, PortSeen,
    RoundTrips, inspect,
};
pub use live::{LiveEstimate, LiveSweep};
pub(crate) use log::unwritable;
pub use open::{DeviceError, OpenError};
pub use pace::{Pace, Remaining};
pub use pulse::{Doing, Silence};
pub(crate) use resume::{Outcomes, changes_since};
pub use resume::{ResumeRefusal, SOFTWARE};
pub use rig_loop::RigLoop;
pub(crate) use shell::{CLOCK_WAS_SET, HELD_UP};
pub(crate) use space::free_bytes;
pub use way_out::{WayOut, make_safe};

use crate::{describe, loaded_rig::LoadedRig, protocol_file::LoadedProtocol};

/// Commands wait here while the rig thread is busy for a moment. One person and one program
/// together never have as many outstanding.
const REQUESTS_MAX: usize = 64;

/// Speaks to the rig thread.
#[derive(Debug, Clone)]
pub struct RigHandle {
    requests: mpsc::Sender<Request>,
    status: watch::Receiver<Status>,
    simulation: Option<SimHandle>,
    pulse: Weak<pulse::Pulse>,
}

/// The rig thread; dropping this does not stop it, [`RigHandle::close`] does.
#[derive(Debug)]
pub struct RigThread {
    thread: std::thread::JoinHandle<()>,
}

/// The published state of the rig.
#[derive(Debug, Clone)]
pub struct Status {
    /// The engine's view.
    pub snapshot: Snapshot,
    /// When this was so, on the rig's clock.
    pub now: RigTime,
    /// The same by the clock of the computer.
    pub published: Instant,
    /// The run under way or the last one.
    pub run: Option<RunView>,
    /// The journal of what happens between runs.
    pub session: RunId,
    /// Number of the manual sweep under way.
    pub sweep: Option<u64>,
    /// Number of manual sweeps begun in this session.
    pub sweeps: u64,
    /// Identities of the devices.
    pub devices: Arc<[DeviceIdentity; 3]>,
    /// The files and the limits of the rig.
    pub(crate) setting: Arc<Setting>,
    /// The last frames of each port.
    pub(crate) ports: Arc<[PortFrames]>,
    /// The sweep under way or the last one.
    pub live: Option<Arc<LiveSweep>>,
    /// Time of the last change of state, on the rig's clock.
    pub state_since: RigTime,
    /// The first event of this session in the journal.
    pub first_event: u64,
    /// The newest event in the journal.
    pub last_event: u64,
    /// Why the journal cannot be written any more.
    pub journal_error: Option<Arc<str>>,
    /// Since when the rig loop gives no sign of life. All else is then as it was at that time.
    pub silence: Option<Silence>,
}

/// The published state of a run.
#[derive(Debug, Clone)]
pub struct RunView {
    /// Id of the run in the journal.
    pub id: RunId,
    /// Plan of the run.
    pub plan: Arc<Plan>,
    /// When it began, on the rig's clock.
    pub started: RigTime,
    /// Its expected duration, s.
    pub expected_s: f64,
    /// Duration of each of its steps, s.
    pub durations_s: Arc<[f64]>,
    /// When the step under way began, on the rig's clock.
    pub step_began: RigTime,
    /// Number of steps that were done before this part of the run began.
    pub first_step: usize,
    /// The touches that were done before this part of the run began.
    pub touches_before: usize,
    /// The touches that are done, also those that were refused.
    pub touches_done: usize,
    /// The touches that were refused.
    pub touches_refused: usize,
    /// Time spent waiting for people, s.
    pub pace: Pace,
    /// The touches of earlier runs of this rig.
    pub history: Arc<History>,
    /// How the run ended; `None` during the run.
    pub ending: Option<rig_engine::RunStatus>,
}

/// A device that answered.
#[derive(Debug, Clone)]
pub struct DeviceIdentity {
    /// Its role on the rig, such as `analyzer`.
    pub role: &'static str,
    /// Its reported identity.
    pub identity: String,
    /// Its counts since the rig was opened.
    pub health: HealthMeter,
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
        "the data directory has {} MiB free, and the run needs {} MiB",
        .free_bytes >> 20,
        .needed_bytes.div_ceil(1 << 20)
    )]
    NoSpace {
        /// Free space, bytes.
        free_bytes: u64,
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

/// A message to the rig thread.
#[derive(Debug)]
enum Request {
    Run {
        protocol: Box<LoadedProtocol>,
        by: String,
        key: Option<String>,
        reply: oneshot::Sender<Result<RunId, RequestRefusal>>,
    },
    Resume {
        run: RunId,
        is_confirmed: bool,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Redo {
        order: TouchOrder,
        is_confirmed: bool,
        by: String,
        reply: oneshot::Sender<Result<RunId, RequestRefusal>>,
    },
    Skip {
        order: TouchOrder,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    GiveUp {
        run: RunId,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Sweep {
        request: SweepRequest,
        by: String,
        reply: oneshot::Sender<Result<u64, RequestRefusal>>,
    },
    Command {
        command: Command,
        run: Option<RunId>,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Answer {
        run: RunId,
        step: String,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Identify {
        by: String,
        reply: oneshot::Sender<Result<identify::Answers, RequestRefusal>>,
    },
    Close {
        reply: oneshot::Sender<()>,
    },
    /// Blocks the rig thread until the other end is dropped.
    #[cfg(test)]
    Block(std::sync::mpsc::Receiver<()>),
    /// Has the rig thread panic at this event of the engine, counted from now.
    #[cfg(test)]
    PanicAt(u64),
}

/// Opens a rig on a thread of its own, and brings it into service.
///
/// Returns when every device has answered; homing and the proof that the probe is clear continue,
/// as [`Status`] shows.
///
/// # Errors
/// [`OpenError`] names the device or the directory, the attempt, and the advice.
pub fn open(rig: LoadedRig, data: PathBuf) -> Result<(RigHandle, RigThread), OpenError> {
    let (requests, inbox) = mpsc::channel(REQUESTS_MAX);
    let (opened, is_open) = std::sync::mpsc::sync_channel(1);
    let thread = std::thread::Builder::new()
        .name("rig".to_owned())
        .spawn(move || thread::run(rig, data, inbox, &opened))
        .map_err(|source| OpenError::Thread { source })?;
    match is_open.recv() {
        Ok(Ok((status, simulation, pulse))) => {
            Ok((RigHandle { requests, status, simulation, pulse }, RigThread { thread }))
        }
        Ok(Err(error)) => Err(error),
        Err(_) => Err(OpenError::Gone),
    }
}

/// Opens a simulated rig on the runtime of the caller, with its journal in memory: for campaigns of
/// many rigs. `bench` is the bench of a rig that was open before on the same runtime.
///
/// Returns when every device has answered. [`RigLoop::serve`] must be polled for anything else to
/// happen.
///
/// # Errors
/// As for [`open`].
pub async fn open_in_memory(
    rig: LoadedRig,
    disk: &MemoryDisk,
    bench: Option<SimHandle>,
) -> Result<(RigHandle, RigLoop), OpenError> {
    let (requests, inbox) = mpsc::channel(REQUESTS_MAX);
    let (rig, status, simulation) = RigLoop::open(rig, disk, bench, inbox).await?;
    // Nothing watches over a loop that its caller polls.
    Ok((RigHandle { requests, status, simulation, pulse: Weak::new() }, rig))
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

    /// Ends the current operation, leaves the probe clear, and ends the rig thread.
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

impl Status {
    /// The present time on the rig's clock. Virtual time does not pass while the rig is idle.
    pub fn present(&self, is_virtual_time: bool) -> RigTime {
        if is_virtual_time { self.now } else { self.now + self.published.elapsed() }
    }
}

impl RunView {
    /// The description of a step of this run.
    pub fn describe_step(&self, index: usize) -> String {
        describe::step(&self.plan, index)
    }

    /// The text of a prompt.
    pub fn ask(&self, prompt: &Prompt) -> String {
        describe::prompt(&self.plan, prompt)
    }

    /// Number of planned touches.
    pub fn touches_planned(&self) -> usize {
        let is_touch = |step: &&rig_protocol::Step| matches!(step.action, Action::Touch(_));
        self.plan.steps.iter().filter(is_touch).count()
    }

    /// Remaining time of the run, from the step under way on.
    pub fn remaining(&self, step: usize, now: RigTime) -> Remaining {
        let lasted_s = now.since(self.step_began.min(now)).as_secs_f64();
        self.left(step, step, now).after(lasted_s, self.left(step, step + 1, now))
    }

    /// The least time until a later step begins, s.
    pub fn until_s(&self, step: usize, later: usize, now: RigTime) -> f64 {
        let least_s = self.remaining(step, now).least_s - self.left(step, later, now).least_s;
        least_s.max(0.0)
    }

    /// The time of the steps from `from` on, as expected at the beginning of the step under way.
    fn left(&self, step: usize, from: usize, now: RigTime) -> Remaining {
        let (steps, durations_s) = (&self.plan.steps, &self.durations_s);
        let end = steps.len().min(durations_s.len());
        let part = |from: usize, to: usize| pace::Part {
            steps: &steps[from.min(to)..to],
            durations_s: &durations_s[from.min(to)..to],
        };
        let parts = (part(self.first_step, step.min(end)), part(from, end));
        let touches = self.touches_done.saturating_sub(self.touches_before);
        let began = self.step_began.min(now);
        let elapsed_s = began.since(self.started).as_secs_f64();
        self.pace.remaining(began, parts, elapsed_s, touches, &self.history)
    }
}

/// The last frames of a port, which its owner goes on writing.
#[derive(Debug, Clone)]
pub(crate) struct PortFrames {
    port: Arc<str>,
    transcript: Transcript,
}

impl PortFrames {
    /// A copy of what is there now. The owner of the port waits for the copy, which has a bounded size.
    pub(crate) fn read(&self) -> rig_store::BlackBox {
        record::frames(&self.port, &self.transcript)
    }
}

/// Facts about the rig that the rig thread keeps beside its devices.
#[derive(Debug, Clone)]
pub(crate) struct Setting {
    limits: RigLimits,
    rig: rig_store::Source,
    scene: Option<rig_store::Source>,
    devices: Arc<[DeviceIdentity; 3]>,
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
