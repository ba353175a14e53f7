//! Replays a plan, one step at a time.

use std::time::Duration;

use rig_model::{Bench, Clearance, Deg, Mm, Position, Reading, RigTime, Window};
use rig_protocol::{Action, Plan, Pose, Prompt};
use rig_resonance::{Prior, Resonance, Verdict};

use crate::{
    Event, Fault, LoweringPurpose, Operation, RunStatus, SweepPurpose,
    search::Surface,
    sweep::{DRIFT, Sweep, SweepTurn},
    touch::TouchMachine,
};

/// What a machine wants next.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Turn<T> {
    /// Do this.
    Do(Operation),
    /// Note the intent to lower the probe, make it durable, and allow it.
    Declare { down_to: Position<Mm>, purpose: LoweringPurpose },
    /// Let this much time pass.
    Wait(Duration),
    /// Ask a person and wait for the answer.
    Ask(Prompt),
    /// Wait for a person to go on.
    Pause,
    /// Done.
    Done(T),
    /// It cannot go on.
    Fault(Fault),
}

impl<T> Turn<T> {
    /// The same turn of another machine; `done` says what the end of this one means there.
    fn and_then<U>(self, done: impl FnOnce(T) -> Turn<U>) -> Turn<U> {
        match self {
            Self::Do(operation) => Turn::Do(operation),
            Self::Declare { down_to, purpose } => Turn::Declare { down_to, purpose },
            Self::Wait(duration) => Turn::Wait(duration),
            Self::Ask(prompt) => Turn::Ask(prompt),
            Self::Pause => Turn::Pause,
            Self::Fault(fault) => Turn::Fault(fault),
            Self::Done(value) => done(value),
        }
    }
}

/// What a machine is told.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum News {
    Begin,
    LinearAt(Position<Mm>),
    RotaryAt(Position<Deg>),
    Readings(Vec<Reading>),
    Stopped,
    Declared,
    Waited,
    Answered { by: String },
    Resumed,
}

impl News {
    /// The fault of being told this at a moment when it makes no sense: a bug, met safely.
    pub(crate) fn out_of_order(&self, during: &'static str) -> Fault {
        let what = match self {
            Self::Begin => "a beginning",
            Self::LinearAt(_) => "a position of the linear stage",
            Self::RotaryAt(_) => "a position of the rotary stage",
            Self::Readings(_) => "readings",
            Self::Stopped => "a standstill",
            Self::Declared => "a declaration",
            Self::Waited => "the end of a wait",
            Self::Answered { .. } => "an answer",
            Self::Resumed => "a resumption",
        };
        Fault::OutOfOrder { what, during }
    }
}

/// What a machine can see and write to.
pub(crate) struct Context<'a> {
    pub(crate) now: RigTime,
    pub(crate) plan: &'a Plan,
    pub(crate) bench: &'a Bench,
    pub(crate) clearance: Clearance,
    pub(crate) notes: &'a mut Vec<Event>,
}

impl Context<'_> {
    pub(crate) fn rotate_to<T>(&self, pose: Pose) -> Turn<T> {
        match self.bench.rotary.target(pose.direction.rotary_position(pose.angle)) {
            Ok(target) => Turn::Do(Operation::MoveRotary {
                target,
                speed_deg_per_s: self.bench.limits.rotary_speed_deg_per_s,
            }),
            Err(error) => Turn::Fault(Fault::RotaryTarget(error)),
        }
    }

    pub(crate) fn move_linear<T>(&self, to: Position<Mm>, speed_mm_per_s: f64) -> Turn<T> {
        match self.bench.linear.target(to) {
            Ok(target) => Turn::Do(Operation::MoveLinear { target, speed_mm_per_s }),
            Err(error) => Turn::Fault(Fault::LinearTarget(error)),
        }
    }

    pub(crate) fn retract<T>(&self) -> Turn<T> {
        Turn::Do(retract(self.bench))
    }

    pub(crate) fn surface_not_found(&mut self, trail: Vec<(Position<Mm>, Reading)>) {
        self.notes.push(Event::SurfaceNotFound { trail });
    }

    pub(crate) fn surface_found(&mut self, surface: Surface, trail: Vec<(Position<Mm>, Reading)>) {
        let Surface { position, sigma_mm } = surface;
        self.notes.push(Event::SurfaceFound { position, sigma_mm, trail });
    }
}

/// The move that takes the probe clear. It is always allowed.
pub(crate) fn retract(bench: &Bench) -> Operation {
    Operation::MoveLinear {
        target: bench.linear.rest_target(),
        speed_mm_per_s: bench.limits.travel_speed_mm_per_s,
    }
}

/// The no-load resonance is tried this often before the run gives up.
const NO_LOAD_ATTEMPTS: u32 = 2;

#[derive(Debug)]
pub(crate) struct Run {
    plan: Plan,
    index: usize,
    machine: Machine,
    no_load: Option<Resonance>,
    has_refusals: bool,
    pub(crate) is_pause_asked: bool,
}

#[derive(Debug)]
enum Machine {
    /// Between two steps.
    Between,
    Prompting(Prompt),
    NoLoad(Box<NoLoad>),
    Touch(Box<TouchMachine>),
}

impl Run {
    pub(crate) const fn new(plan: Plan) -> Self {
        Self {
            plan,
            index: 0,
            machine: Machine::Between,
            no_load: None,
            has_refusals: false,
            is_pause_asked: false,
        }
    }

    pub(crate) const fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The step under way, or the next one.
    pub(crate) const fn index(&self) -> usize {
        self.index
    }

    pub(crate) fn advance(
        &mut self,
        now: RigTime,
        news: News,
        bench: &Bench,
        clearance: Clearance,
        notes: &mut Vec<Event>,
    ) -> Turn<RunStatus> {
        let mut context = Context { now, plan: &self.plan, bench, clearance, notes };
        let turn = match &mut self.machine {
            Machine::Between => return self.next_step(now, bench, clearance, notes),
            Machine::Prompting(prompt) => prompting(*prompt, news, &mut context),
            Machine::NoLoad(machine) => {
                let last = self.no_load.as_ref();
                machine.advance(news, last, &mut context).and_then(|resonance| {
                    self.no_load = Some(resonance);
                    Turn::Done(())
                })
            }
            Machine::Touch(machine) => machine.advance(news, &mut context).and_then(|result| {
                self.has_refusals |= result.is_refused();
                context.notes.push(Event::TouchFinished(Box::new(result)));
                Turn::Done(())
            }),
        };
        turn.and_then(|()| {
            self.machine = Machine::Between;
            self.index += 1;
            self.next_step(now, bench, clearance, notes)
        })
    }

    /// Begins the next step, or pauses before it, or ends the run.
    fn next_step(
        &mut self,
        now: RigTime,
        bench: &Bench,
        clearance: Clearance,
        notes: &mut Vec<Event>,
    ) -> Turn<RunStatus> {
        let Some(step) = self.plan.steps.get(self.index) else {
            return Turn::Done(if self.has_refusals {
                RunStatus::CompletedWithRefusals
            } else {
                RunStatus::Completed
            });
        };
        if self.is_pause_asked {
            return Turn::Pause;
        }
        self.machine = match step.action {
            Action::Prompt(prompt) => Machine::Prompting(prompt),
            Action::NoLoad(pose) => {
                Machine::NoLoad(Box::new(NoLoad { pose, sweep: None, attempt: 0 }))
            }
            Action::Touch(touch) => match &self.no_load {
                Some(no_load) => {
                    Machine::Touch(Box::new(TouchMachine::new(step.id.clone(), touch, no_load)))
                }
                None => return Turn::Fault(Fault::NoReferenceBefore { step: step.id.clone() }),
            },
        };
        notes.push(Event::StepStarted { index: self.index });
        self.advance(now, News::Begin, bench, clearance, notes)
    }
}

/// A sample is placed on a level stage; the sensor is turned wherever the stage is.
fn prompting(prompt: Prompt, news: News, context: &mut Context<'_>) -> Turn<()> {
    match (news, prompt) {
        (News::Begin, Prompt::PlaceSample { .. }) => Turn::Do(Operation::MoveRotary {
            target: context.bench.rotary.rest_target(),
            speed_deg_per_s: context.bench.limits.rotary_speed_deg_per_s,
        }),
        (News::Begin, Prompt::TurnSensor { .. }) | (News::RotaryAt(_), _) => {
            context.notes.push(Event::PromptAsked(prompt));
            Turn::Ask(prompt)
        }
        (News::Answered { by }, _) => {
            context.notes.push(Event::PromptAnswered { prompt, by });
            Turn::Done(())
        }
        (news, _) => Turn::Fault(news.out_of_order("a prompt")),
    }
}

/// Rotates to the pose and measures the free sensor there.
#[derive(Debug)]
struct NoLoad {
    pose: Pose,
    sweep: Option<Sweep>,
    /// Attempts begun so far.
    attempt: u32,
}

impl NoLoad {
    fn advance(
        &mut self,
        news: News,
        last: Option<&Resonance>,
        context: &mut Context<'_>,
    ) -> Turn<Resonance> {
        let turn = match (news, &mut self.sweep) {
            (News::Begin, _) => return context.rotate_to(self.pose),
            (News::RotaryAt(_), _) => self.begin(last, context),
            (News::Readings(readings), Some(sweep)) => {
                sweep.measured(context.now, &readings, context.notes)
            }
            (news, _) => return Turn::Fault(news.out_of_order("a no-load measurement")),
        };
        self.follow(turn, context)
    }

    /// Begins a sweep; the first one near the last reference, where there is one.
    fn begin(&mut self, last: Option<&Resonance>, context: &mut Context<'_>) -> SweepTurn {
        self.attempt += 1;
        let request = &context.plan.no_load_sweep;
        let prior = last.map(|last| {
            let (low_hz, high_hz) =
                (last.resonance_hz * (1.0 - DRIFT), last.resonance_hz * (1.0 + DRIFT));
            let min_hz = request.window.min_hz.max(low_hz);
            let max_hz = request.window.max_hz.min(high_hz);
            Prior::moved(last, Window { min_hz, max_hz })
        });
        let (sweep, turn) =
            Sweep::begin(context.now, SweepPurpose::NoLoad, request, prior.as_ref(), context.notes);
        self.sweep = Some(sweep);
        turn
    }

    fn follow(&mut self, mut turn: SweepTurn, context: &mut Context<'_>) -> Turn<Resonance> {
        loop {
            let refusal = match turn {
                SweepTurn::Measure(operation) => return Turn::Do(operation),
                SweepTurn::Fault(fault) => return Turn::Fault(fault),
                SweepTurn::Finished(outcome) => match outcome.verdict {
                    Verdict::Accepted(resonance) => return Turn::Done(resonance),
                    Verdict::Refused(refusal) => refusal,
                },
            };
            if self.attempt >= NO_LOAD_ATTEMPTS {
                let reason = refusal.to_string();
                return Turn::Fault(Fault::NoReference { attempts: self.attempt, reason });
            }
            // Without the belief that may have misled it.
            turn = self.begin(None, context);
        }
    }
}
