//! The engine: one command, report or deadline in; effects out.
//!
//! ```text
//!               ┌───────────┐ prepared ┌──────┐  run, sweep  ┌─────────────────────────────┐
//!  prepare ───▶ │ Preparing │ ───────▶ │ Idle │ ───────────▶ │ Running ⇄ Waiting ⇄ Paused  │
//!               └───────────┘          └──────┘ ◀─────────── └─────────────────────────────┘
//!                 ▲      │                ▲       completed        │ abort, stop, fault
//!     acknowledge │      │ fault          │ aborted                ▼
//!               ┌─────────┐  clear or not ┌┴───────────────────────────┐
//!               │ Latched │ ◀──────────── │ Retracting                 │
//!               └─────────┘               └────────────────────────────┘
//! ```

mod attempts;
mod commands;
mod descent;
mod hold_up;
mod reach;
mod stopping;

pub use commands::Admitted;

use std::time::Duration;

use rig_model::{Clearance, Deg, Mm, Position, RigLimits, RigTime};
use rig_protocol::Prompt;

use self::{attempts::Attempts, reach::Reach};
use crate::{
    Device, Effect, Event, Failure, FailureKind, Fault, Input, Interlock, Jump, LoweringPurpose,
    Operation, OperationId, RefusedTouch, Report, RigState, RunPhase, RunStatus,
    fault::StopReason,
    machine::{MachineEvent, MachineStep},
    operation::{Pending, limit, name},
    recovery::{Preparing, Recovery, is_interruption},
    run::Run,
    sweep::{Sweep, SweepStep},
};

/// Default patience with a linear stage that does not answer: a drive starts within seconds, and a
/// person plugs a cable in again within a minute or two.
const RECOVERY_PATIENCE: Duration = Duration::from_secs(120);

/// Decides the next operation of the rig.
#[derive(Debug)]
pub struct Engine {
    limits: RigLimits,
    interlock: Interlock,
    activity: Activity,
    pending: Option<Pending>,
    wait_until: Option<RigTime>,
    /// By when the next reading of a descent must come.
    reading_by: Option<RigTime>,
    next_id: u64,
    linear: Option<Position<Mm>>,
    rotary: Option<Position<Deg>>,
    /// Whether the rotary stage was told to turn, and has not come to rest since.
    may_turn: bool,
    state: RigState,
    notes: Vec<Event>,
    /// Patience with a linear stage that does not answer on the way out of contact.
    patience: Duration,
    /// The fault noted last, so that a repeated attempt does not note it again.
    last_fault: Option<Fault>,
    reach: Reach,
    /// The same before a homing anew that is under way.
    reach_before: Option<Reach>,
    /// Attempts of the latched rig to retract.
    attempts: Option<Attempts>,
}

#[derive(Debug)]
enum Activity {
    /// No command has been given yet.
    Unprepared,
    Preparing(Preparing),
    Idle,
    Running(Box<Run>),
    Waiting(Box<Run>, Prompt),
    /// A person decides about a refused touch.
    Deciding(Box<Run>),
    Paused(Box<Run>),
    Sweeping(Box<Sweep>),
    /// A person moves one axis.
    Moving,
    /// The operation in flight is being ended; then comes the recovery.
    Stopping(StopReason, HadRun),
    Retracting(Recovery, StopReason, HadRun),
    Latched(Fault),
}

/// Whether a run was under way, so that its end must be noted.
type HadRun = bool;

/// Progress of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Progress {
    /// Name of the protocol.
    pub protocol: String,
    /// Index of the step under way.
    pub step: usize,
    /// Number of steps of the plan.
    pub steps: usize,
    /// Whether the run pauses before the next step.
    pub is_pausing: bool,
    /// What the run is doing within the step.
    pub phase: RunPhase,
}

/// The engine's state, for a display or a client.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// State of the rig.
    pub state: RigState,
    /// Clearance of the probe.
    pub clearance: Clearance,
    /// The linear stage as last read back.
    pub linear: Option<Position<Mm>>,
    /// The rotary stage as last read back.
    pub rotary: Option<Position<Deg>>,
    /// The run under way.
    pub progress: Option<Progress>,
    /// The open prompt.
    pub prompt: Option<Prompt>,
    /// First cause of the latch, or of the stop and the retract that are under way.
    pub fault: Option<Fault>,
    /// If the linear stage was read back elsewhere than its last moves can have led it.
    pub jump: Option<Jump>,
    /// Number of attempts of the latched rig to retract so far, while it goes on trying.
    pub attempts: Option<u32>,
    /// The refused touch about which a person is asked.
    pub refused: Option<RefusedTouch>,
}

impl Engine {
    /// An engine for a rig with these limits. Nothing moves until
    /// [`Command::Prepare`](crate::Command::Prepare).
    pub const fn new(limits: RigLimits) -> Self {
        Self::with_patience(limits, RECOVERY_PATIENCE)
    }

    /// An engine with another patience with a linear stage that does not answer on the way out of
    /// contact.
    pub const fn with_patience(limits: RigLimits, patience: Duration) -> Self {
        Self {
            limits,
            interlock: Interlock::new(limits),
            activity: Activity::Unprepared,
            pending: None,
            wait_until: None,
            reading_by: None,
            next_id: 0,
            linear: None,
            rotary: None,
            may_turn: false,
            state: RigState::Preparing,
            notes: Vec::new(),
            patience,
            last_fault: None,
            reach: Reach::Anywhere,
            reach_before: None,
            attempts: None,
        }
    }

    /// The time at which the engine needs [`Input::Tick`].
    pub fn deadline(&self) -> Option<RigTime> {
        let pending = self.pending.as_ref().map(|pending| pending.deadline);
        pending.into_iter().chain(self.wait_until).chain(self.reading_by).min()
    }

    /// The state, the axes, the run under way, the open prompt and the fault.
    pub fn snapshot(&self) -> Snapshot {
        let (progress, prompt) = match &self.activity {
            Activity::Running(run) | Activity::Paused(run) => (Some(progress(run)), None),
            Activity::Deciding(run) => (Some(progress(run)), None),
            Activity::Waiting(run, prompt) => (Some(progress(run)), Some(*prompt)),
            _ => (None, None),
        };
        let fault = match &self.activity {
            Activity::Latched(fault)
            | Activity::Stopping(StopReason::Fault(fault), _)
            | Activity::Retracting(_, StopReason::Fault(fault), _) => Some(fault.clone()),
            _ => None,
        };
        Snapshot {
            state: self.state,
            clearance: self.interlock.clearance(),
            linear: self.linear,
            rotary: self.rotary,
            progress,
            prompt,
            fault,
            jump: self.reach.jump(),
            attempts: self.attempts(),
            refused: match &self.activity {
                Activity::Deciding(run) => run.question(),
                _ => None,
            },
        }
    }

    /// Takes a report or a deadline and appends the effects that follow.
    pub fn handle(&mut self, now: RigTime, input: Input, effects: &mut Vec<Effect>) {
        match input {
            Input::Stalled(lasted) => self.stalled(now, lasted, effects),
            Input::Read(id, reading) => self.streamed(now, id, reading, effects),
            Input::Done(id, result) => {
                if result.is_ok() && self.measure_again(now, id, effects) {
                    return self.settle(effects);
                }
                // A report of another operation than the one in flight is too late.
                if let Some(pending) = self.pending.take_if(|pending| pending.id == id) {
                    self.reading_by = None;
                    self.interlock.ended(&pending.operation, result.as_ref().ok());
                    self.note_motion(&pending.operation, result.as_ref().ok());
                    self.forget_unmade_homing(&pending.operation, &result);
                    self.ended(
                        now,
                        result
                            .map_err(|failure| (is_interruption(&failure), Fault::Device(failure))),
                        effects,
                    );
                }
            }
            Input::Tick => self.tick(now, effects),
        }
        self.settle(effects);
    }

    /// A homing anew that has moved nothing says nothing of the position.
    fn forget_unmade_homing(&mut self, operation: &Operation, result: &Result<Report, Failure>) {
        let Some(before) = self.reach_before.take() else { return };
        if matches!(operation, Operation::HomeLinear { .. })
            && let Err(Failure { device, kind, .. }) = result
            && (*kind == FailureKind::Unmoved || *device == Device::Interlock)
        {
            self.reach = before;
        }
    }

    /// An operation has ended: with a report, or with a fault that may be a mere interruption.
    fn ended(
        &mut self,
        now: RigTime,
        result: Result<Report, (bool, Fault)>,
        effects: &mut Vec<Effect>,
    ) {
        match (&mut self.activity, result) {
            (Activity::Stopping(..), result) => {
                // A real failure outweighs an orderly abort.
                if let Err((false, fault)) = result {
                    self.escalate(fault);
                }
                self.recover(now, effects);
            }
            (Activity::Retracting(..), result) => {
                self.retracting(now, result.map_err(|(_, fault)| fault), effects);
            }
            (Activity::Latched(_), result) => {
                self.attempt_ended(now, result.map_err(|(_, fault)| fault), effects);
            }
            (_, Err((_, fault))) => self.stop(now, StopReason::Fault(fault), effects),
            (Activity::Preparing(stage), Ok(Report::Unhomed)) => {
                *stage = Preparing::HomingUpwards;
                let operation = stage.operation(&self.limits);
                self.issue(now, operation, effects);
            }
            (&mut Activity::Preparing(stage), Ok(report)) => {
                if let Report::LinearAt(found) = report {
                    if stage == Preparing::FindingLinear
                        && let Err(fault) = self.reach.find(found, &self.limits.linear)
                    {
                        return self.stop(now, StopReason::Fault(fault), effects);
                    }
                    self.linear = Some(found);
                    self.reach = Reach::at(found);
                }
                self.preparing(now, effects);
            }
            (Activity::Moving, Ok(_)) => self.activity = Activity::Idle,
            (Activity::Sweeping(sweep), Ok(Report::Measured(readings))) => {
                let step = sweep.measured(now, &readings, &mut self.notes);
                self.follow_sweep(now, step, effects);
            }
            (_, Ok(report)) => self.advance_run(now, MachineEvent::from(report), effects),
        }
    }

    fn tick(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        self.miss_reading(now, effects);
        if self.wait_until.is_some_and(|until| until <= now) {
            self.wait_until = None;
            match self.activity {
                Activity::Retracting(..) => self.wait_is_over(now, effects),
                Activity::Latched(_) => self.try_again(now, effects),
                _ => self.advance_run(now, MachineEvent::Waited, effects),
            }
        }
        let Some(pending) = self.pending.as_mut().filter(|pending| pending.deadline <= now) else {
            return;
        };
        let fault = Fault::Overdue { what: name(&pending.operation) };
        if pending.is_interrupted {
            // The operation was interrupted and does not end. Nothing else can be sent, so nothing
            // may move.
            pending.deadline = RigTime::from_micros(u64::MAX);
            self.interlock.ended(&pending.operation, None);
            self.freeze(fault);
        } else if matches!(self.activity, Activity::Retracting(..) | Activity::Latched(_)) {
            self.interrupt(now, effects);
            self.escalate(fault);
        } else {
            self.stop(now, StopReason::Fault(fault), effects);
        }
    }

    /// Carries out the next step of a run.
    fn follow_run(
        &mut self,
        now: RigTime,
        step: MachineStep<RunStatus>,
        effects: &mut Vec<Effect>,
    ) {
        match step {
            MachineStep::Do(operation) => self.issue(now, operation, effects),
            MachineStep::Retract(target) => {
                self.interlock.retract_to(target);
                let speed_mm_per_s = self.limits.motion.travel_speed_mm_per_s;
                self.issue(now, Operation::MoveLinear { target, speed_mm_per_s }, effects);
            }
            MachineStep::Declare { down_to, purpose } => {
                self.declare(down_to, purpose, effects);
                self.advance_run(now, MachineEvent::Declared, effects);
            }
            MachineStep::Wait(duration) => self.wait_until = Some(now + duration),
            MachineStep::Ask(prompt) => self.replace_run(|run| Activity::Waiting(run, prompt)),
            MachineStep::Decide => self.replace_run(Activity::Deciding),
            MachineStep::Abort { by } => self.stop(now, StopReason::Abort { by }, effects),
            MachineStep::Pause => self.replace_run(Activity::Paused),
            MachineStep::Done(status) => {
                self.notes.push(Event::RunFinished(status));
                self.activity = Activity::Idle;
            }
            MachineStep::Fault(fault) => self.stop(now, StopReason::Fault(fault), effects),
        }
    }

    fn follow_sweep(&mut self, now: RigTime, step: SweepStep, effects: &mut Vec<Effect>) {
        match step {
            SweepStep::Measure(operation) => self.issue(now, operation, effects),
            SweepStep::Finished(_) => self.activity = Activity::Idle,
            SweepStep::Fault(fault) => self.stop(now, StopReason::Fault(fault), effects),
        }
    }

    /// Makes the intent to lower the probe durable, and allows it.
    fn declare(
        &mut self,
        down_to: Position<Mm>,
        purpose: LoweringPurpose,
        effects: &mut Vec<Effect>,
    ) {
        self.notes.push(Event::Intent { down_to, purpose });
        self.flush(effects);
        effects.push(Effect::Commit);
        self.interlock.declare(down_to);
    }

    /// Sends an operation, if the interlock admits it.
    fn issue(&mut self, now: RigTime, operation: Operation, effects: &mut Vec<Effect>) {
        if let Err(error) = self.interlock.admit(&operation) {
            return self.stop(now, StopReason::Fault(Fault::Interlock(error)), effects);
        }
        let id = OperationId(self.next_id);
        self.next_id += 1;
        if matches!(operation, Operation::HomeLinear { anew: true }) {
            self.reach_before = Some(self.reach);
        }
        self.reach.extend(&operation, &self.limits.linear);
        if matches!(operation, Operation::MoveRotary { .. } | Operation::PrepareRotary) {
            (self.rotary, self.may_turn) = (None, true);
        }
        self.expect_readings(now, &operation);
        let deadline = now + limit(&operation, self.linear_mm(), self.rotary_deg());
        self.pending = Some(Pending {
            id,
            operation: operation.clone(),
            deadline,
            is_interrupted: false,
            repeats: 0,
            is_held_up: false,
        });
        self.flush(effects);
        effects.push(Effect::Do(id, operation));
    }

    fn advance_run(&mut self, now: RigTime, event: MachineEvent, effects: &mut Vec<Effect>) {
        let activity = std::mem::replace(&mut self.activity, Activity::Idle);
        match activity {
            Activity::Running(mut run)
            | Activity::Waiting(mut run, _)
            | Activity::Deciding(mut run) => {
                let step = self.advance(now, &mut run, event);
                self.activity = Activity::Running(run);
                self.follow_run(now, step, effects);
            }
            other => {
                let during = other.state().name();
                self.activity = other;
                let fault = event.out_of_order(during);
                self.stop(now, StopReason::Fault(fault), effects);
            }
        }
    }

    fn advance(
        &mut self,
        now: RigTime,
        run: &mut Run,
        event: MachineEvent,
    ) -> MachineStep<RunStatus> {
        run.follow_person(now, &event);
        let probe = self.interlock.proven();
        let step = run.advance(now, event, &self.limits, probe, &mut self.notes);
        run.asks(&step);
        step
    }

    fn replace_run(&mut self, make: impl FnOnce(Box<Run>) -> Activity) {
        let activity = std::mem::replace(&mut self.activity, Activity::Idle);
        self.activity = match activity {
            Activity::Running(run) | Activity::Waiting(run, _) | Activity::Paused(run) => make(run),
            other => other,
        };
    }

    fn preparing(&mut self, now: RigTime, effects: &mut Vec<Effect>) {
        let Activity::Preparing(stage) = self.activity else { return };
        match stage.next() {
            Some(next) => {
                self.activity = Activity::Preparing(next);
                self.issue(now, next.operation(&self.limits), effects);
            }
            None => self.activity = Activity::Idle,
        }
    }

    fn note_motion(&mut self, operation: &Operation, report: Option<&Report>) {
        match (operation, report) {
            (Operation::MoveLinear { target, .. }, Some(&Report::LinearAt(read_back))) => {
                self.linear = Some(read_back);
                self.reach = Reach::at(read_back);
                let target = target.position();
                let is_clear = self.interlock.clearance() == Clearance::Clear;
                self.notes.push(Event::LinearMoved { target, read_back, is_clear });
            }
            (Operation::MoveRotary { target, .. }, Some(&Report::RotaryAt(read_back))) => {
                (self.rotary, self.may_turn) = (Some(read_back), false);
                let target = target.position();
                self.notes.push(Event::RotaryMoved { target, read_back });
            }
            // The record of a descent has its readings too, and is that of the run.
            (Operation::Descend { .. }, Some(&Report::Descended { at, .. })) => {
                self.linear = Some(at);
                self.reach = Reach::at(at);
            }
            (Operation::HomeLinear { .. }, Some(&Report::LinearAt(read_back)))
            | (_, Some(&Report::LinearHomed(read_back))) => {
                self.linear = Some(read_back);
                self.reach = Reach::at(read_back);
            }
            (Operation::PrepareRotary, Some(&Report::RotaryAt(read_back))) => {
                (self.rotary, self.may_turn) = (Some(read_back), false);
            }
            (_, Some(Report::Stopped(_))) => self.may_turn = false,
            (_, Some(&Report::RotaryStopped(read_back))) => {
                (self.rotary, self.may_turn) = (read_back, false);
            }
            _ => {}
        }
    }

    /// Notes a change of state, and turns the notes into effects.
    fn settle(&mut self, effects: &mut Vec<Effect>) {
        let state = self.activity.state();
        if state != self.state {
            self.state = state;
            self.notes.push(Event::StateChanged(state));
        }
        self.flush(effects);
    }

    fn flush(&mut self, effects: &mut Vec<Effect>) {
        effects.extend(self.notes.drain(..).map(Effect::Note));
    }

    fn linear_mm(&self) -> f64 {
        let travel = self.limits.linear.travel();
        travel.max.value() - travel.min.value()
    }

    fn rotary_deg(&self) -> f64 {
        let travel = self.limits.rotary.travel();
        travel.max.value() - travel.min.value()
    }
}

impl Activity {
    const fn state(&self) -> RigState {
        match self {
            Self::Unprepared | Self::Preparing(_) => RigState::Preparing,
            Self::Idle => RigState::Idle,
            Self::Running(_) | Self::Sweeping(_) | Self::Moving => RigState::Running,
            Self::Waiting(..) | Self::Deciding(_) => RigState::WaitingForPerson,
            Self::Paused(_) => RigState::Paused,
            Self::Stopping(..) | Self::Retracting(..) => RigState::Retracting,
            Self::Latched(_) => RigState::Latched,
        }
    }
}

fn progress(run: &Run) -> Progress {
    let plan = run.plan();
    Progress {
        protocol: plan.name.clone(),
        step: run.index(),
        steps: plan.steps.len(),
        is_pausing: run.is_pause_asked,
        phase: run.phase(),
    }
}
