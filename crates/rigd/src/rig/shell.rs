//! The loop of the rig thread. Each event becomes an input of the engine, and the loop carries out
//! the effects that the engine returns.

mod commissioning;
mod requests;
mod runs;

use std::{
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use rig_engine::{
    Admitted, Command, Effect, Engine, Event, Fault, Input, LeftRig, Operation, OperationId,
    RefusalAnswer, RigState,
};
use rig_interlock::Proven;
use rig_link::{Clock, Transcript};
use rig_model::{Mm, Position, RigTime};
use rig_store::{ClockJumped, Record, Store};
use rig_system::clocks;
use tokio::sync::{oneshot, watch};

use super::{
    OpenError, PortFrames, Request, Setting, Status,
    gate::Gate,
    heartbeat::{BEAT, Heartbeat, Noticed},
    inbox::{Asked, Inbox},
    log::{Log, unwritable},
    open::{Opened, open_rig},
    owners::{Owners, Said},
    proof::{Proof, Purpose, Uncommissioned},
    pulse::{Doing, Pulse},
    record,
    spans::Spans,
    until,
    view::View,
};
use crate::{
    interruption::{InterruptedRig, LeftProbe},
    loaded_rig::LoadedRig,
    simulation::{BenchPerson, SimHandle, Simulation},
};

/// In virtual time, where an operation takes microseconds, events reach watchers and the disk this
/// often by the wall clock. Intents do not wait for it.
const COMMIT_INTERVAL: Duration = Duration::from_millis(50);

/// Operator of the answers on a simulated rig.
const SIMULATED_PERSON: &str = "simulated person";

/// What a person reads after a hold-up.
pub(crate) const HELD_UP: &str =
    "rigd was held up; what it was measuring in that time is measured again";

/// What a person reads after a jump of the wall clock.
pub(crate) const CLOCK_WAS_SET: &str = "the wall clock was set; nothing depends on it";

/// What wakes the rig thread.
enum Wake {
    Request(Option<Asked>),
    Input(Input),
    /// Time has passed, or devices are free again.
    Beat,
}

/// The rig is being closed.
struct Closing {
    /// Who waits for it.
    replies: Vec<oneshot::Sender<()>>,
}

pub(super) struct Shell {
    engine: Engine,
    setting: Setting,
    owners: Owners,
    gate: Gate,
    /// The intent that is noted and not yet durable.
    intent: Option<Position<Mm>>,
    /// What calibrations of the rig rest on.
    /// `None` for a rig that is commissioned.
    uncommissioned: Option<Uncommissioned>,
    /// How the last program left a rig that is not commissioned, until it is.
    left: Option<LeftRig>,
    /// The simulated person, while the rig is commissioned.
    person: Option<BenchPerson>,
    simulation: Option<Simulation>,
    black_boxes: [(Arc<str>, Transcript); 2],
    known_samples: Vec<(String, f64)>,
    clock: Clock,
    log: Log,
    view: View,
    spans: Spans,
    is_virtual_time: bool,
    is_answer_due: bool,
    /// Processor time of the engine's last decision, if somebody reads it.
    thought: Duration,
    heartbeat: Heartbeat,
    /// Number of events until a panic; 0 for none.
    #[cfg(test)]
    panic_at: u64,
    /// Last, so that a close that blocks is noticed.
    pulse: Arc<Pulse>,
}

impl Shell {
    /// Opens the rig of a journal. A simulated one is at `bench`, or at a new one.
    pub(super) async fn open(
        rig: LoadedRig,
        store: Store,
        bench: Option<SimHandle>,
        purpose: Purpose,
    ) -> Result<(Self, watch::Receiver<Status>), OpenError> {
        let is_virtual_time = rig.is_virtual_time();
        let data = store.directory().map_or_else(|| PathBuf::from("memory"), PathBuf::from);
        let data_error = |source| OpenError::Data { data: data.clone(), source };
        let name = rig.file.name.clone();
        let reader = store.reader().map_err(data_error)?;
        let left = InterruptedRig::left(&reader, &name, rig.is_simulated());
        let clock = Clock::start();
        let proof = Proof::of(&rig, store.directory());
        let uncommissioned = Uncommissioned::new(rig.basis(), store.directory(), purpose, &proof);
        let proven = match purpose {
            Purpose::Service => proof.proven,
            Purpose::Commissioning => proof.proven.min(Proven::Scales),
        };
        let opened = open_rig(rig, bench, clock, proven).await?;
        let Opened { setting, analyzer, streamed, mut axes, gate, halt, .. } = opened;
        axes.is_rotary_doubtful = reader.is_rotary_faulted_since_service(&name).unwrap_or(true);
        let Opened { simulation, black_boxes, known_samples, patience, .. } = opened;
        let pulse = Arc::new(Pulse::default());
        let log = Log::open(store, name, clock, &pulse, &setting.meters).map_err(data_error)?;
        let engine = Engine::with_patience(setting.limits, patience);
        let ports = black_boxes.clone().map(|(port, transcript)| PortFrames { port, transcript });
        let ports = Arc::new(ports) as Arc<[PortFrames]>;
        let (view, watcher) = View::new(engine.snapshot(), clock.now(), &log, &setting, ports);
        let mut shell = Self {
            engine,
            setting,
            owners: Owners::new(axes, analyzer, streamed, halt),
            gate,
            intent: None,
            person: uncommissioned
                .as_ref()
                .zip(simulation.as_ref())
                .and_then(|(rig, simulation)| simulation.person(rig.attempts())),
            uncommissioned,
            left: None,
            simulation,
            black_boxes,
            known_samples,
            clock,
            log,
            view,
            spans: Spans::default(),
            is_virtual_time,
            is_answer_due: false,
            thought: Duration::ZERO,
            heartbeat: Heartbeat::now(),
            #[cfg(test)]
            panic_at: 0,
            pulse,
        };
        shell.latch_uncommissioned(left.as_ref().and_then(|left| left.jump));
        shell.left = left.filter(|left| left.is_latched).map(|left| {
            let InterruptedRig { probe, message, jump, .. } = left;
            let (may_touch, was_lowered) = (probe != LeftProbe::Clear, probe == LeftProbe::Lowered);
            LeftRig { message, may_touch, was_lowered, jump }
        });
        if shell.uncommissioned.is_none() {
            shell.latch_interrupted();
        }
        Ok((shell, watcher))
    }

    /// Latches a rig that the last program did not leave in order; one that is not commissioned, when it is. Returns whether
    /// it did.
    fn latch_interrupted(&mut self) -> bool {
        let Some(left) = self.left.take() else { return false };
        let mut effects = Vec::new();
        self.engine.latch_interrupted(left, &mut effects);
        self.carry_out(effects);
        true
    }

    pub(super) async fn serve(&mut self, inbox: &mut Inbox) {
        self.begin_service();
        let mut closing: Option<Closing> = None;
        let mut is_open = true;
        loop {
            if let Some(closing) = closing.take_if(|_| self.is_at_rest()) {
                self.log.end_session();
                for reply in closing.replies {
                    _ = reply.send(());
                }
                return;
            }
            if self.is_idle() && self.log.is_session_old() {
                self.pulse.beat(Doing::Recording);
                self.log.renew_session(RigState::Idle);
                self.publish();
            }
            if std::mem::take(&mut self.is_answer_due) {
                self.answer_for_person();
                continue;
            }
            self.pulse.beat(Doing::Waiting);
            let waits_from = Instant::now();
            // The order is fixed, so that a run replays: people first, then devices, then time.
            let wake = tokio::select! {
                biased;
                request = inbox.recv(), if is_open => Wake::Request(request),
                said = self.owners.said() => match said {
                    Said::Free => Wake::Beat,
                    Said::Ended(id, ended) => {
                        self.spans.end(id, &ended);
                        Wake::Input(Input::Done(id, ended))
                    }
                    Said::Read(id, reading) => Wake::Input(Input::Read(id, reading)),
                },
                () = until(self.clock, self.engine.deadline()) => Wake::Input(Input::Tick),
                () = beat(self.is_virtual_time) => {
                    self.setting.meters.woke_late(waits_from.elapsed().saturating_sub(BEAT));
                    Wake::Beat
                }
            };
            self.pulse.beat(Doing::Deciding);
            // Before the report of a measurement that it may have spoilt.
            if let Some(lasted) = self.notice_hold_up() {
                self.handle(Input::Stalled(lasted));
            }
            match wake {
                Wake::Request(Some(Asked { request: Request::Close { reply }, .. })) => {
                    closing.get_or_insert_with(|| self.begin_to_close()).replies.push(reply);
                }
                // Only a stop is served to the end: the axes may be homing still.
                Wake::Request(Some(Asked { at, request }))
                    if closing.is_none() || request.is_stop() =>
                {
                    self.halt_if_asked(&request, at).await;
                    self.take(request);
                }
                Wake::Request(Some(_)) => {}
                Wake::Request(None) => {
                    is_open = false;
                    // All handles are closed, and the probe must not stay in the sample.
                    closing.get_or_insert_with(|| self.begin_to_close());
                }
                Wake::Input(input) => self.handle(input),
                Wake::Beat => {}
            }
        }
    }

    /// Brings the rig into service; latched, it waits for a person instead.
    fn begin_service(&mut self) {
        if self.engine.snapshot().state == RigState::Latched {
            return;
        }
        let sees_nothing_below =
            self.simulation.as_ref().is_some_and(Simulation::sees_nothing_below);
        let (first, by) = if sees_nothing_below {
            (Command::HomeLinear, SIMULATED_PERSON)
        } else {
            (Command::Prepare, "rigd")
        };
        _ = self.command(first, by);
    }

    pub(super) const fn simulation(&self) -> Option<&Simulation> {
        self.simulation.as_ref()
    }

    /// What publishes if the rig thread fails or is silent.
    pub(super) fn watched(&self) -> watch::Sender<Status> {
        self.view.watched()
    }

    pub(super) fn pulse(&self) -> Arc<Pulse> {
        Arc::clone(&self.pulse)
    }

    /// For how long nothing was done since the last beat, if it was long; notes a jump of the wall clock. In virtual time no time
    /// passes while the computer is held up.
    fn notice_hold_up(&mut self) -> Option<Duration> {
        let Noticed { stalled, jump_s } = self.heartbeat.beat();
        if let Some(jump_s) = jump_s {
            tracing::warn!(jump_s, "{CLOCK_WAS_SET}");
            self.log.append(&Record::ClockJumped(ClockJumped { jump_s }));
        }
        let stalled = stalled.filter(|_| !self.is_virtual_time);
        if let Some(lasted) = stalled {
            tracing::warn!(seconds = lasted.as_secs_f64(), "{HELD_UP}");
            self.gate.held_up(lasted);
        }
        stalled
    }

    fn begin_to_close(&mut self) -> Closing {
        if self.uncommissioned.is_some() {
            self.stop_step();
        }
        // It is refused if nothing is in progress, and while the rig is prepared, which is then waited for.
        _ = self.command(Command::Abort, "rigd");
        Closing { replies: Vec::new() }
    }

    fn is_idle(&self) -> bool {
        self.engine.snapshot().state == RigState::Idle && !self.owners.are_busy()
    }

    /// No further event is expected. A latched rig may have an operation in progress that never
    /// answers.
    fn is_at_rest(&self) -> bool {
        let has_step = self.uncommissioned.is_some() && self.owners.are_busy();
        (self.engine.snapshot().state == RigState::Latched && !has_step) || self.is_idle()
    }

    fn is_retracting(&self) -> bool {
        self.engine.snapshot().state == RigState::Retracting
    }

    /// The simulated person answers.
    fn answer_for_person(&mut self) {
        let refused = self.engine.snapshot().refused;
        let answer = refused.map_or(Command::Answer, |touch| Command::Decide {
            step: touch.step,
            answer: RefusalAnswer::Skip,
        });
        // A prompt that has been ended meanwhile needs no answer.
        _ = self.command(answer, SIMULATED_PERSON);
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
        self.pulse.beat(Doing::Deciding);
        let begun = is_traced().then(clocks::of_thread);
        let decision = decide(&mut self.engine, self.clock.now());
        self.thought =
            begun.map_or(Duration::ZERO, |begun| clocks::of_thread().saturating_sub(begun));
        decision
    }

    fn carry_out(&mut self, effects: Vec<Effect>) {
        let had_ended = self.view.has_ended();
        let begins = effects.iter().any(|effect| matches!(effect, Effect::Do(..)));
        for effect in effects {
            match effect {
                Effect::Note(event) => self.note(&event),
                Effect::Commit => self.commit_intent(),
                Effect::Interrupt => self.owners.interrupt(),
                Effect::EndDescent => self.owners.end_descent(),
                Effect::Do(id, operation) => self.start(id, operation),
            }
        }
        let state = self.engine.snapshot().state;
        let is_busy = matches!(state, RigState::Running | RigState::Preparing);
        // In memory a commit costs nothing, and the wall clock must have no influence on a run.
        let is_due = !self.is_virtual_time
            || self.log.store().directory().is_none()
            || self.log.since_commit() >= COMMIT_INTERVAL;
        if !is_busy || is_due {
            self.commit();
        }
        if begins && let Some(lasted) = self.notice_hold_up() {
            // What begins here has not waited for a slow disk: it runs from the next wake on.
            self.note(&Event::Stalled { lasted, is_measured_again: false });
        }
        if self.log.error().is_some() && !had_ended && self.view.has_ended() {
            self.view.run_is_incomplete();
        }
        self.latch_unrecorded();
        self.publish();
    }

    /// An idle rig whose journal cannot be written is latched.
    fn latch_unrecorded(&mut self) {
        let Some(reason) = self.log.error() else { return };
        let mut effects = Vec::new();
        self.engine.latch_unrecorded(unwritable(reason), &mut effects);
        for effect in effects {
            if let Effect::Note(event) = effect {
                self.note(&event);
            }
        }
    }

    fn commit(&mut self) {
        self.spans.present().in_scope(|| self.log.commit());
    }

    /// Makes an intent durable, and tells the interlock when it is.
    fn commit_intent(&mut self) {
        self.commit();
        if let Some(down_to) = self.intent.take().filter(|_| self.log.is_complete()) {
            self.gate.intent_is_durable(down_to);
        }
    }

    /// Starts an operation. Without a journal only the way out of contact is allowed.
    fn start(&mut self, id: OperationId, operation: Operation) {
        let is_way_out = match &operation {
            Operation::StopMotion
            | Operation::StopRotary
            | Operation::FindLinear { .. }
            | Operation::HomeUpwards => true,
            // To the clear position from below, or to where the probe is above it.
            Operation::MoveLinear { target, .. } => {
                let linear = &self.setting.limits.linear;
                let to = target.position();
                let at = self.engine.snapshot().linear;
                linear.rest_target().position() <= to
                    && at.is_none_or(|at| at <= to.offset(linear.tolerance()))
            }
            _ => false,
        };
        if !is_way_out && let Some(failure) = self.log.failure() {
            self.owners.refuse(id, failure);
        } else {
            self.spans.begin(id, &operation);
            self.owners.start(id, operation);
        }
    }

    fn note(&mut self, event: &Event) {
        #[cfg(test)]
        {
            assert!(self.panic_at != 1, "injected");
            self.panic_at = self.panic_at.saturating_sub(1);
        }
        match event {
            Event::Intent { down_to, .. } => self.intent = Some(*down_to),
            Event::StateChanged(RigState::Latched) => self.gate.latched(),
            Event::Planned { readings, work } => {
                let seconds = self.thought.as_secs_f64();
                tracing::trace!(target: "rigd::planned", readings, work, seconds);
            }
            _ => {}
        }
        if let (Some(simulation), Some((_, recorder))) = (&self.simulation, self.log.run()) {
            self.is_answer_due |= simulation.answers(event);
            simulation.follow(event, recorder.samples());
        }
        self.view.note(event, self.clock.now());
        self.log.note(event);
        self.spans.note(event, || self.log.run().and_then(|(_, recorder)| recorder.step_id()));
        if let Event::Faulted { fault, .. } = event {
            self.open_black_boxes(fault);
        }
    }

    /// Records the last frames of the ports. On a simulated rig only after faults of devices: all
    /// other faults can be replayed from the seed.
    fn open_black_boxes(&mut self, fault: &Fault) {
        if self.simulation.is_some() && !matches!(fault, Fault::Device(_)) {
            return;
        }
        for (port, transcript) in &self.black_boxes {
            self.log.append(&record::black_box(port, transcript));
        }
    }

    fn publish(&mut self) {
        self.view.publish(self.engine.snapshot(), self.clock.now(), &self.log);
    }
}

/// Whether somebody reads the processor time of decisions.
fn is_traced() -> bool {
    tracing::enabled!(target: "rigd::planned", tracing::Level::TRACE)
}

/// Waits for the next beat; for ever in virtual time, which waiting would only move on.
async fn beat(is_virtual_time: bool) {
    if is_virtual_time {
        return std::future::pending().await;
    }
    tokio::time::sleep(BEAT).await;
}
