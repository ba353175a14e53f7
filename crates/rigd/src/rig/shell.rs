//! The loop of the rig thread. Each event becomes an input of the engine, and the loop carries out
//! the effects that the engine returns.

mod journal;
mod runs;

use std::{
    panic::AssertUnwindSafe,
    path::PathBuf,
    sync::{Arc, mpsc::SyncSender},
    time::{Duration, Instant},
};

use futures_util::FutureExt;
use rig_engine::{
    Admitted, Command, Device, Effect, Engine, Event, Failure, FailureKind, Fault, Input,
    Operation, OperationId, RefusalAnswer, RigState, RunStatus,
};
use rig_link::{Clock, Transcript};
use rig_model::{Clearance, Mm, Position, RigTime, panic_message, with_causes};
use rig_protocol::StepId;
use rig_sim::SimHandle;
use rig_store::{ClockJumped, Ending, Journal, Record, RunId, RunKind, Store};
use rustix::time::{ClockId, clock_gettime};
use tokio::sync::{mpsc, oneshot, watch};

use super::{
    OpenError, Request, RequestRefusal, RunView, Setting, Status,
    amend::{self, TouchOrder},
    devices::{Axes, GatedAnalyzer},
    gate::Gate,
    heartbeat::{BEAT, Heartbeat, Noticed},
    live::LiveSweep,
    open::{HALT_WITHIN, Halt, Opened, Simulation, open_rig},
    record::{self, Recorder},
    resume::ResumeRefusal,
    slot::Slot,
    way_out::{Kept, WayOut},
};
use crate::{
    interruption::{InterruptedRig, LeftProbe},
    loaded_rig::LoadedRig,
};

/// In virtual time, where an operation takes microseconds, events reach watchers and the disk this
/// often by the wall clock. Intents do not wait for it.
const COMMIT_INTERVAL: Duration = Duration::from_millis(50);

/// Operator of the answers on a simulated rig.
const SIMULATED_PERSON: &str = "simulated person";

/// A session is sealed when it ends, and a daemon runs for months.
const SESSION: Duration = Duration::from_secs(24 * 3600);

type Opening = Result<(watch::Receiver<Status>, Option<SimHandle>), OpenError>;

/// Runs the rig until it is closed. The outcome of opening it goes to `opened`.
pub(super) fn run(
    rig: LoadedRig,
    data: PathBuf,
    mut inbox: mpsc::Receiver<Request>,
    opened: &SyncSender<Opening>,
) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .start_paused(rig.is_virtual_time())
        .build();
    let runtime = match runtime {
        Ok(runtime) => runtime,
        Err(source) => {
            _ = opened.send(Err(OpenError::Thread { source }));
            return;
        }
    };
    runtime.block_on(async {
        let file = rig.file.clone();
        let shell = match Store::open(&data) {
            Ok(store) => Shell::open(rig, store, None).await,
            Err(source) => Err(OpenError::Data { data: data.clone(), source }),
        };
        match shell {
            Ok((mut shell, status)) => {
                // The caller may have closed its end. The closed inbox then closes the rig.
                let simulation = shell.simulation().map(Simulation::handle);
                _ = opened.send(Ok((status, simulation.clone())));
                let served = AssertUnwindSafe(shell.serve(&mut inbox)).catch_unwind().await;
                if let Err(panic) = served {
                    let fault = Fault::Panicked { what: panic_message(&*panic).to_owned() };
                    let status = shell.status.clone();
                    // The ports and the journal are free for the way out.
                    drop(shell);
                    let kept = Kept { file, data, simulation };
                    leave_contact(kept, fault, &status).await;
                    refuse_all(inbox).await;
                }
            }
            Err(error) => _ = opened.send(Err(error)),
        }
    });
}

/// Retracts after a panic, and publishes that the rig is latched for good.
async fn leave_contact(kept: Kept, fault: Fault, status: &watch::Sender<Status>) {
    let publish = |state, clearance, linear| {
        status.send_modify(|view| {
            let snapshot = &mut view.snapshot;
            snapshot.state = state;
            snapshot.clearance = clearance;
            snapshot.linear = linear;
            snapshot.fault = Some(fault.clone());
            (snapshot.progress, snapshot.prompt) = (None, None);
            view.sweep = None;
            if let Some(run) = view.run.as_mut().filter(|_| state == RigState::Latched) {
                run.ending.get_or_insert(RunStatus::Faulted);
            }
        });
    };
    publish(RigState::Retracting, Clearance::Unknown, None);
    match kept.retract(fault.clone()).await {
        Ok(WayOut { clearance, linear, .. }) => publish(RigState::Latched, clearance, linear),
        Err(error) => {
            let reason = with_causes(&error);
            tracing::error!(%reason, "the probe could not be retracted");
            publish(RigState::Latched, Clearance::Unknown, None);
        }
    }
}

/// Answers that the rig is closed, until it is.
async fn refuse_all(mut inbox: mpsc::Receiver<Request>) {
    while let Some(request) = inbox.recv().await {
        // A request that is dropped is answered so.
        if let Request::Close { reply } = request {
            _ = reply.send(());
            return;
        }
    }
}

/// What a person reads after a hold-up.
pub(crate) const HELD_UP: &str =
    "the computer was held up; readings of that time are measured again";

/// What a person reads after a jump of the wall clock.
pub(crate) const CLOCK_WAS_SET: &str = "the wall clock was set; nothing depends on it";

/// Why nothing may begin: the journal cannot be written.
pub(crate) fn unwritable(reason: &str) -> Failure {
    let detail = format!("cannot be written: {reason}");
    Failure { device: Device::Journal, kind: FailureKind::Line, detail }
}

/// What wakes the rig thread.
enum Wake {
    Request(Option<Request>),
    Input(Input),
    /// Only time has passed.
    Beat,
}

/// The rig is being closed.
struct Closing {
    /// Receiver of the result.
    reply: Option<oneshot::Sender<()>>,
}

pub(super) struct Shell {
    engine: Engine,
    setting: Setting,
    axes: Slot<Axes>,
    analyzer: Slot<GatedAnalyzer>,
    gate: Gate,
    halt: Halt,
    /// The intent that is noted and not yet durable.
    intent: Option<Position<Mm>>,
    simulation: Option<Simulation>,
    black_boxes: [(Arc<str>, Transcript); 2],
    known_samples: Vec<(String, f64)>,
    clock: Clock,
    store: Store,
    session: (Journal, Recorder),
    session_began: RigTime,
    run: Option<(Journal, Recorder)>,
    /// The published state at the end of each step.
    view: Status,
    status: watch::Sender<Status>,
    is_virtual_time: bool,
    /// Refused before it was sent, because the journal could not be written.
    refused: Option<(OperationId, Failure)>,
    /// Why the journal refused a record; `None` after the engine has been informed.
    unwritten: Option<String>,
    is_answer_due: bool,
    last_commit: Instant,
    /// Processor time of the engine's last decision.
    thought: Duration,
    heartbeat: Heartbeat,
    /// Number of events until a panic; 0 for none.
    #[cfg(test)]
    panic_at: u64,
}

impl Shell {
    /// Opens the rig of a journal. A simulated one is at `bench`, or at a new one.
    pub(super) async fn open(
        rig: LoadedRig,
        store: Store,
        bench: Option<SimHandle>,
    ) -> Result<(Self, watch::Receiver<Status>), OpenError> {
        let is_virtual_time = rig.is_virtual_time();
        let data = store.directory().map_or_else(|| PathBuf::from("memory"), PathBuf::from);
        let data_error = |source| OpenError::Data { data: data.clone(), source };
        let left = InterruptedRig::left(&store.reader().map_err(data_error)?, &rig.file.name);
        let clock = Clock::start();
        let opened = open_rig(rig, bench, clock).await?;
        let Opened { setting, analyzer, axes, gate, halt, .. } = opened;
        let Opened { simulation, black_boxes, known_samples, patience, .. } = opened;
        let session = store.begin(RunKind::Session, &setting.rig.name).map_err(data_error)?;
        let engine = Engine::with_patience(setting.limits, patience);
        let view = Status {
            snapshot: engine.snapshot(),
            now: clock.now(),
            published: Instant::now(),
            run: None,
            session: session.id(),
            sweep: None,
            sweeps: 0,
            devices: Arc::clone(&setting.devices),
            live: None,
            state_since: clock.now(),
            first_event: 0,
            last_event: 0,
            journal_error: None,
        };
        let (status, watcher) = watch::channel(view.clone());
        let mut shell = Self {
            engine,
            setting,
            axes: Slot::new(axes),
            analyzer: Slot::new(analyzer),
            gate,
            halt,
            intent: None,
            simulation,
            black_boxes,
            known_samples,
            clock,
            store,
            session: (session, Recorder::for_session()),
            session_began: clock.now(),
            run: None,
            view,
            status,
            is_virtual_time,
            refused: None,
            unwritten: None,
            is_answer_due: false,
            last_commit: Instant::now(),
            thought: Duration::ZERO,
            heartbeat: Heartbeat::now(),
            #[cfg(test)]
            panic_at: 0,
        };
        if let Some(left) = left.filter(|left| left.is_latched) {
            let mut effects = Vec::new();
            let probe = (left.probe != LeftProbe::Clear, left.probe == LeftProbe::Lowered);
            shell.engine.latch_interrupted(left.message, probe, &mut effects);
            shell.carry_out(effects);
        }
        Ok((shell, watcher))
    }

    pub(super) async fn serve(&mut self, inbox: &mut mpsc::Receiver<Request>) {
        // Latched, the rig waits for a person instead.
        _ = self.command(Command::Prepare, "rigd");
        let mut closing: Option<Closing> = None;
        loop {
            if let Some(closing) = closing.take_if(|_| self.is_at_rest()) {
                self.end_session();
                if let Some(reply) = closing.reply {
                    _ = reply.send(());
                }
                return;
            }
            self.renew_session();
            if self.is_answer_due {
                self.is_answer_due = false;
                // A prompt that has been ended meanwhile needs no answer.
                let refused = self.engine.snapshot().refused;
                let answer = refused.map_or(Command::Answer, |touch| Command::Decide {
                    step: touch.step,
                    answer: RefusalAnswer::Skip,
                });
                _ = self.command(answer, SIMULATED_PERSON);
                continue;
            }
            if let Some((id, failure)) = self.refused.take() {
                self.handle(Input::Done(id, Err(failure)));
                continue;
            }
            // The order is fixed, so that a run replays: people first, then devices, then time.
            let wake = tokio::select! {
                biased;
                request = inbox.recv(), if closing.is_none() => Wake::Request(request),
                (id, ended) = self.axes.ended() => Wake::Input(Input::Done(id, ended)),
                (id, ended) = self.analyzer.ended() => Wake::Input(Input::Done(id, ended)),
                () = until(self.clock, self.engine.deadline()) => Wake::Input(Input::Tick),
                () = beat(self.is_virtual_time) => Wake::Beat,
            };
            // Before the report of a measurement that it may have spoilt.
            self.notice_hold_ups();
            match wake {
                Wake::Request(Some(Request::Close { reply })) => {
                    closing = Some(self.begin_to_close(Some(reply)));
                }
                Wake::Request(Some(request)) => {
                    self.halt_if_asked(&request).await;
                    self.take(request);
                }
                // All handles are closed, and the probe must not stay in the sample.
                Wake::Request(None) => closing = Some(self.begin_to_close(None)),
                Wake::Input(input) => self.handle(input),
                Wake::Beat => {}
            }
        }
    }

    /// In virtual time no time passes while the computer is held up.
    fn notice_hold_ups(&mut self) {
        let Noticed { stalled, jump_s } = self.heartbeat.beat();
        if let Some(lasted) = stalled.filter(|_| !self.is_virtual_time) {
            tracing::warn!(seconds = lasted.as_secs_f64(), "{HELD_UP}");
            self.handle(Input::Stalled(lasted));
        }
        if let Some(jump_s) = jump_s {
            tracing::warn!(jump_s, "{CLOCK_WAS_SET}");
            self.append(&Record::ClockJumped(ClockJumped { jump_s }));
        }
    }

    pub(super) const fn simulation(&self) -> Option<&Simulation> {
        self.simulation.as_ref()
    }

    fn begin_to_close(&mut self, reply: Option<oneshot::Sender<()>>) -> Closing {
        // It is refused if nothing is in progress, which has no consequence.
        _ = self.command(Command::Abort, "rigd");
        Closing { reply }
    }

    fn end_session(&mut self) {
        let end = Record::RunFinished(rig_store::RunFinished { status: Ending::Completed });
        if let Err(error) = self.session.0.append(self.clock.now().as_micros(), &end) {
            self.journal_failed(&error);
        }
        self.commit();
    }

    /// Begins another session after a day, between runs, so that the one before is sealed.
    fn renew_session(&mut self) {
        let now = self.clock.now();
        let is_between = self.run.is_none()
            && self.engine.snapshot().state == RigState::Idle
            && self.is_at_rest();
        if !is_between
            || now.since(self.session_began) < SESSION
            || self.view.journal_error.is_some()
        {
            return;
        }
        self.end_session();
        self.session_began = now;
        match self.store.begin(RunKind::Session, &self.setting.rig.name) {
            Ok(journal) => {
                self.view.session = journal.id();
                self.view.first_event = 0;
                // Sweeps are counted on, so that no number means two of them.
                self.session.0 = journal;
            }
            Err(error) => self.journal_failed(&error),
        }
        self.publish();
    }

    /// No further event is expected. A latched rig may have an operation in progress that never
    /// answers.
    fn is_at_rest(&self) -> bool {
        match self.engine.snapshot().state {
            RigState::Idle => !self.axes.is_busy() && !self.analyzer.is_busy(),
            state => state == RigState::Latched,
        }
    }

    fn take(&mut self, request: Request) {
        // The caller may have closed its end. Its command is carried out.
        match request {
            Request::Run { protocol, by, key, reply } => {
                _ = reply.send(self.start_run(&protocol, &by, key));
            }
            Request::Resume { run, is_confirmed, by, reply } => {
                _ = reply.send(self.resume_run(run, is_confirmed, &by));
            }
            Request::Redo { order, is_confirmed, by, reply } => {
                _ = reply.send(self.redo(&order, is_confirmed, &by));
            }
            Request::Skip { order, by, reply } => {
                _ = reply.send(self.skip(&order, &by));
            }
            Request::GiveUp { run, by, reply } => {
                let rig_us = self.clock.now().as_micros();
                let given_up = self.store.give_up(run, rig_us, &by);
                _ = reply.send(given_up.map_err(|error| ResumeRefusal::from(error).into()));
            }
            Request::Sweep { request, by, reply } => {
                let result = self.command(Command::Sweep(request), &by);
                let number = result.map(|()| self.view.sweeps);
                _ = reply.send(number);
            }
            Request::Command { command, run, by, reply } => {
                let under_way = self.run.as_ref().map(|(journal, _)| journal.id());
                let result = match run {
                    Some(run) if under_way != Some(run) => Err(RequestRefusal::NotUnderWay { run }),
                    _ => self.command(command, &by),
                };
                _ = reply.send(result);
            }
            Request::Answer { run, step, by, reply } => {
                _ = reply.send(self.answer(run, step, &by));
            }
            Request::Close { reply } => _ = reply.send(()),
            #[cfg(test)]
            Request::PanicAt(event) => self.panic_at = event,
        }
        // A request that met a failure of the disk has closed the journal.
        if let Err(error) = self.store.epoch() {
            self.journal_failed(&error);
            self.publish();
        }
    }

    fn answer(&mut self, run: RunId, step: String, by: &str) -> Result<(), RequestRefusal> {
        let Some((journal, recorder)) = &self.run else {
            return Err(RequestRefusal::NotUnderWay { run });
        };
        if journal.id() != run {
            return Err(RequestRefusal::NotUnderWay { run });
        }
        if recorder.step_id().as_deref() != Some(&*step) {
            return Err(RequestRefusal::NotAsked { step });
        }
        self.command(Command::Answer, by)
    }

    /// Leaves a touch out. In the run under way it must not have begun.
    fn skip(&mut self, order: &TouchOrder, by: &str) -> Result<(), RequestRefusal> {
        let rig_us = self.clock.now().as_micros();
        let under_way = self.run.as_ref().map(|(journal, _)| journal.id());
        if under_way != Some(order.run) {
            return Ok(amend::skip(&self.store, order, by, rig_us)?);
        }
        let admitted = self.engine.admit(Command::Skip(StepId(order.step.clone())))?;
        self.gate.operator(by, false)?;
        // What is recorded, the run can read.
        self.commit();
        amend::write_skip(&self.store, order, by, rig_us)?;
        self.begin(admitted, by);
        Ok(())
    }

    fn command(&mut self, command: Command, by: &str) -> Result<(), RequestRefusal> {
        let is_sweep = matches!(command, Command::Sweep(_));
        let is_acknowledgement = matches!(command, Command::Acknowledge);
        let admitted = self.engine.admit(command)?;
        self.gate.operator(by, is_acknowledgement)?;
        if is_sweep {
            self.view.sweeps = self.session.1.begin_sweep();
            self.view.sweep = Some(self.view.sweeps);
        }
        self.begin(admitted, by);
        Ok(())
    }

    fn begin(&mut self, admitted: Admitted, by: &str) {
        let mut effects = Vec::new();
        self.think(|engine, now| engine.begin(now, admitted, by, &mut effects));
        self.carry_out(effects);
    }

    fn handle(&mut self, input: Input) {
        let mut effects = Vec::new();
        self.think(|engine, now| engine.handle(now, input, &mut effects));
        self.carry_out(effects);
    }

    fn think<T>(&mut self, decide: impl FnOnce(&mut Engine, RigTime) -> T) -> T {
        let begun = processor_time();
        let decision = decide(&mut self.engine, self.clock.now());
        self.thought = processor_time().saturating_sub(begun);
        decision
    }

    fn carry_out(&mut self, effects: Vec<Effect>) {
        let had_ended = self.has_ended();
        for effect in effects {
            match effect {
                Effect::Note(event) => self.note(&event),
                Effect::Commit => self.commit_intent(),
                Effect::Interrupt => self.interrupt(),
                Effect::Do(id, operation) => self.start(id, operation),
            }
        }
        let state = self.engine.snapshot().state;
        let is_busy = matches!(state, RigState::Running | RigState::Preparing);
        // In memory a commit costs nothing, and the wall clock must have no influence on a run.
        let is_due = !self.is_virtual_time
            || self.store.directory().is_none()
            || self.last_commit.elapsed() >= COMMIT_INTERVAL;
        if !is_busy || is_due {
            self.commit();
        }
        if !had_ended && self.has_ended() && self.view.journal_error.is_some() {
            // Its last records are not on disk.
            self.view_run(|view| view.ending = Some(RunStatus::Faulted));
        }
        self.publish();
    }

    fn has_ended(&self) -> bool {
        self.view.run.as_ref().is_some_and(|view| view.ending.is_some())
    }

    /// Makes an intent durable, and tells the interlock when it is.
    fn commit_intent(&mut self) {
        self.commit();
        let is_durable = self.view.journal_error.is_none() && self.unwritten.is_none();
        if let Some(down_to) = self.intent.take().filter(|_| is_durable) {
            self.gate.intent_is_durable(down_to);
        }
    }

    fn start(&mut self, id: OperationId, operation: Operation) {
        let is_way_out = match &operation {
            Operation::StopMotion | Operation::FindLinear { .. } => true,
            Operation::MoveLinear { target, .. } => {
                *target == self.setting.limits.linear.rest_target()
            }
            _ => false,
        };
        if !is_way_out && let Some(failure) = self.journal_failure() {
            self.refused = Some((id, failure));
            return;
        }
        match &operation {
            Operation::Measure { .. } => self.analyzer.start(id, operation),
            _ => self.axes.start(id, operation),
        }
    }

    /// Ends the operation in progress. A moving axis stops at once, even while its bus is busy.
    fn interrupt(&mut self) {
        self.analyzer.interrupt();
        if self.axes.is_busy() {
            self.axes.interrupt();
            drop(self.halt.now());
        }
    }

    /// Stops the axes before anything is decided or written, if a request asks for that.
    async fn halt_if_asked(&self, request: &Request) {
        let Request::Command { command: command @ (Command::Stop | Command::Abort), run, .. } =
            request
        else {
            return;
        };
        let is_other = run.is_some_and(|run| self.run.as_ref().is_none_or(|(j, _)| j.id() != run));
        // A stop would lead to the retract that is in progress.
        let is_retracting = self.engine.snapshot().state == RigState::Retracting;
        if is_other || is_retracting || self.engine.admit(command.clone()).is_err() {
            return;
        }
        self.gate.stop_asked();
        // A line that takes longer gets them when it can; the decision must not wait for it.
        if tokio::time::timeout(HALT_WITHIN, self.halt.now()).await.is_ok() {
            self.gate.stop_sent();
        }
    }

    /// Why nothing may begin without a journal; a refused record is reported once.
    fn journal_failure(&mut self) -> Option<Failure> {
        let closed = self.view.journal_error.as_ref().map(|reason| unwritable(reason));
        closed.or_else(|| {
            let detail = self.unwritten.take()?;
            Some(Failure { device: Device::Journal, kind: FailureKind::Refused, detail })
        })
    }

    /// A person is asked something. A simulated one answers at once.
    fn person_asked(&mut self) {
        let now = self.clock.now();
        self.view_run(|view| view.pace.asked(now));
        self.is_answer_due =
            self.simulation.as_ref().is_some_and(|simulation| simulation.is_answering);
    }

    fn person_answered(&mut self) {
        let now = self.clock.now();
        self.view_run(|view| view.pace.answered(now));
    }

    fn note(&mut self, event: &Event) {
        #[cfg(test)]
        {
            assert!(self.panic_at != 1, "injected");
            self.panic_at = self.panic_at.saturating_sub(1);
        }
        match event {
            Event::Intent { down_to, .. } => self.intent = Some(*down_to),
            Event::PromptAsked(prompt) => {
                self.person_asked();
                if self.is_answer_due {
                    self.perform(prompt);
                }
            }
            Event::RefusalAsked { .. } => self.person_asked(),
            Event::RefusalAnswered { .. } => self.person_answered(),
            Event::Planned { readings, work } => {
                let seconds = self.thought.as_secs_f64();
                tracing::trace!(target: "rigd::planned", readings, work, seconds);
            }
            Event::PromptAnswered { prompt, .. } => {
                self.person_answered();
                if self.simulation.as_ref().is_some_and(|simulation| !simulation.is_answering) {
                    self.perform(prompt);
                }
            }
            &Event::SweepBegun { purpose, request } => {
                let serial = self.view.live.as_ref().map_or(1, |last| last.serial + 1);
                self.view.live = Some(Arc::new(LiveSweep::begin(serial, purpose, request)));
            }
            Event::Measured { readings, estimate } => {
                if let Some(live) = &mut self.view.live {
                    Arc::make_mut(live).add(readings, estimate.as_ref());
                }
            }
            Event::TouchFinished(result) => self.view_run(|view| {
                view.touches_done += 1;
                view.touches_refused += usize::from(result.is_refused());
            }),
            Event::TouchDoubted(_) => self.view_run(|view| view.touches_refused += 1),
            Event::RunFinished(ending) => self.view_run(|view| view.ending = Some(*ending)),
            Event::SweepFinished(outcome)
                if outcome.purpose == rig_engine::SweepPurpose::Manual =>
            {
                self.view.sweep = None;
            }
            // One that was aborted or failed is never finished.
            Event::StateChanged(word) if *word != RigState::Running => {
                self.view.sweep = None;
                if *word == RigState::Latched {
                    self.gate.latched();
                }
            }
            _ => {}
        }
        let (_, recorder) = self.run.as_mut().unwrap_or(&mut self.session);
        let Some(record) = recorder.record(event) else { return };
        self.append(&record);
        if let Event::Faulted { fault, .. } = event {
            self.open_black_boxes(fault);
        }
        if matches!(record, Record::RunFinished(_)) {
            self.commit();
            self.run = None;
        }
    }

    /// Lets the simulated technician carry out a prompt.
    fn perform(&self, prompt: &rig_protocol::Prompt) {
        if let (Some(simulation), Some((_, recorder))) = (&self.simulation, &self.run) {
            simulation.perform(prompt, recorder.samples());
        }
    }

    fn view_run(&mut self, change: impl FnOnce(&mut RunView)) {
        if let Some(view) = &mut self.view.run {
            change(view);
        }
    }

    /// Publishes the status. If the rig is idle, the journal is committed first.
    fn publish(&mut self) {
        self.view.now = self.clock.now();
        self.view.published = Instant::now();
        let snapshot = self.engine.snapshot();
        let last = &self.view.snapshot;
        if (snapshot.state, snapshot.prompt) != (last.state, last.prompt) {
            self.view.state_since = self.view.now;
        }
        self.view.snapshot = snapshot;
        self.status.send_replace(self.view.clone());
    }
}

/// Processor time of this thread, which does not depend on other load.
fn processor_time() -> Duration {
    clock_gettime(ClockId::ThreadCPUTime).try_into().unwrap_or_default()
}

/// Waits for the next beat; for ever in virtual time, which waiting would only move on.
async fn beat(is_virtual_time: bool) {
    if is_virtual_time {
        return std::future::pending().await;
    }
    tokio::time::sleep(BEAT).await;
}

/// Waits until a time on the rig's clock; for ever, when there is none.
pub(super) async fn until(clock: Clock, deadline: Option<RigTime>) {
    match deadline {
        Some(deadline) => tokio::time::sleep(deadline.since(clock.now())).await,
        None => std::future::pending().await,
    }
}
