//! Replays a plan, one step at a time.

mod again;
#[cfg(test)]
mod tests;

use std::{collections::BTreeSet, time::Duration};

use rig_model::{Clearance, DriveLevel, RigLimits, RigTime, SweepPoint, Window};
use rig_protocol::{Action, NoLoadPolicy, Plan, Pose, Prompt, Step, StepId, Touch};
use rig_resonance::{Bench, Resonance};

use crate::{
    Event, Fault, Operation, RefusalAnswer, RunPhase, RunStatus, TouchOutcome, TouchPlace,
    TouchResult,
    contact_sense::{Neighbours, check_drift, check_reference},
    descent::{Streamed, Vigil},
    drift::{Drift, Jump},
    heights::{Change, Heights},
    interlock::Proven,
    listening::{Driven, Listening},
    machine::{MachineContext, MachineEvent, MachineStep},
    no_load::{NoLoad, Reference, confirming},
    touch::{Outlook, TouchMachine, is_value},
};

/// The operator of what the policy of the protocol decides.
const PROTOCOL: &str = "protocol";

/// A touch is taken to last this long before there was one.
const FIRST_TOUCH: Duration = Duration::from_secs(10);

/// The surroundings of a run while a touch ends.
struct Surroundings<'a> {
    now: RigTime,
    limits: &'a RigLimits,
    probe: Proven,
    notes: &'a mut Vec<Event>,
}

#[derive(Debug)]
pub(crate) struct Run {
    plan: Plan,
    index: usize,
    machine: Machine,
    no_load: Option<Resonance>,
    drift: Drift,
    /// The measured touches since the last reference.
    unreferenced: Vec<StepId>,
    /// When the last touch began, and how long it took.
    touch_begun: RigTime,
    touch_lasts: Duration,
    /// From the survey at the first no-load measurement, if the protocol asks for one.
    bench: Option<Bench>,
    /// The points that were asked for last, and their level.
    asked: Option<(Vec<SweepPoint>, DriveLevel)>,
    /// The drive of the sensor, as far as it is known.
    driven: Option<Driven>,
    /// When the sensor was last free at the latest: nothing has touched it since.
    free_since: RigTime,
    has_refusals: bool,
    neighbours: Neighbours,
    /// Heights of the surfaces so far, as soon as there is one.
    heights: Option<Heights>,
    /// Touches that a person leaves out.
    skipped: BTreeSet<StepId>,
    /// Repeats of the touch under way, and the window of its sweep if it was widened.
    repeats: u32,
    window: Option<Window>,
    /// The no-load step that was measured last.
    referenced: Option<usize>,
    /// What a person has answered about a refused touch, if a pause comes first.
    answered: Option<(RefusalAnswer, String)>,
    pub(crate) is_pause_asked: bool,
}

#[derive(Debug)]
enum Machine {
    /// Between two steps.
    Between,
    Prompting(Prompt),
    NoLoad(Box<NoLoad>),
    Touch(Box<TouchMachine>),
    /// A person is asked about this refused touch.
    Deciding(Box<TouchResult>),
    /// The reference before a refused touch is made again.
    Referring(Box<NoLoad>),
    /// The probe goes up before the next step: the plan, or a person, wants more room than the last touch left.
    Rising,
    /// After the last step, the impedance of the clear probe confirms the last touch.
    Confirming,
    /// The analyzer has flagged it: the no-load resonance confirms the last touch in its place.
    Closing(Box<NoLoad>),
}

impl Run {
    /// A run of the steps from this index on.
    pub(crate) fn new(plan: Plan, index: usize, has_refusals: bool) -> Self {
        Self {
            plan,
            index,
            machine: Machine::Between,
            no_load: None,
            drift: Drift::default(),
            unreferenced: Vec::new(),
            touch_begun: RigTime::ZERO,
            touch_lasts: FIRST_TOUCH,
            bench: None,
            asked: None,
            driven: None,
            free_since: RigTime::ZERO,
            has_refusals,
            neighbours: Neighbours::default(),
            heights: None,
            skipped: BTreeSet::new(),
            repeats: 0,
            window: None,
            referenced: None,
            answered: None,
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

    /// What the run is doing within its step.
    pub(crate) fn phase(&self) -> RunPhase {
        match &self.machine {
            Machine::Between => RunPhase::Between,
            Machine::Prompting(_) => RunPhase::Prompt,
            Machine::NoLoad(machine) | Machine::Referring(machine) if !machine.is_sweeping() => {
                RunPhase::Rotation
            }
            Machine::NoLoad(_) | Machine::Referring(_) => RunPhase::NoLoadSweep,
            Machine::Touch(machine) => machine.run_phase(),
            Machine::Deciding(_) => RunPhase::Prompt,
            Machine::Rising => RunPhase::Retract,
            Machine::Confirming | Machine::Closing(_) => RunPhase::Confirmation,
        }
    }

    /// Where a touch is; `None` if the plan does not have it.
    pub(crate) fn place_of(&self, step: &StepId) -> Option<TouchPlace> {
        let has_begun = !matches!(self.machine, Machine::Between | Machine::Rising);
        let next = self.index + usize::from(has_begun);
        let is_it = |one: &Step| one.id == *step && matches!(one.action, Action::Touch(_));
        let index = self.plan.steps.iter().position(is_it)?;
        Some(if self.skipped.contains(step) {
            TouchPlace::LeftOut
        } else if index < next {
            TouchPlace::Begun
        } else {
            TouchPlace::Ahead
        })
    }

    /// A person leaves a touch out that has not begun.
    pub(crate) fn skip(&mut self, step: StepId) {
        self.skipped.insert(step);
    }

    /// Whether a step is not made: a touch that is left out, or the reference of it alone.
    fn is_left_out(&self, index: usize) -> bool {
        let is_skipped = |step: &Step| {
            matches!(step.action, Action::Touch(_)) && self.skipped.contains(&step.id)
        };
        let Some(step) = self.plan.steps.get(index) else { return false };
        let is_alone = matches!(step.action, Action::NoLoad(_))
            && matches!(self.plan.no_load, NoLoadPolicy::EveryTouch | NoLoadPolicy::ByDrift)
            && !self.is_needed_anyway(index);
        is_skipped(step) || is_alone && self.plan.steps.get(index + 1).is_some_and(is_skipped)
    }

    /// By drift, the reference after a person was at the bench is also that of the touches behind a skipped one.
    fn is_needed_anyway(&self, index: usize) -> bool {
        self.plan.no_load == NoLoadPolicy::ByDrift && !self.plan.is_by_drift(index)
    }

    /// Whether the next step is a touch behind a step of its reference.
    fn is_after_reference(&self) -> bool {
        let action = |index: usize| self.plan.steps.get(index).map(|step| &step.action);
        let before = self.index.checked_sub(1).and_then(action);
        matches!((before, action(self.index)), (Some(Action::NoLoad(_)), Some(Action::Touch(_))))
    }

    /// Whether the next step is a touch whose reference has just been measured: no pause comes in between.
    fn is_referenced(&self) -> bool {
        self.is_after_reference() && self.referenced == self.index.checked_sub(1)
    }

    /// Whether the next step is a reference for which the drift does not ask.
    fn is_not_due(&self, now: RigTime) -> bool {
        self.plan.is_by_drift(self.index) && self.no_load.is_some() && !self.is_due_by_drift(now)
    }

    /// Whether the drift asks for a reference before a touch that begins now.
    fn is_due_by_drift(&self, now: RigTime) -> bool {
        self.drift.asks_for_reference(now, self.touch_lasts, self.plan.drift_limit_hz())
    }

    pub(crate) fn advance(
        &mut self,
        now: RigTime,
        event: MachineEvent,
        limits: &RigLimits,
        probe: Proven,
        notes: &mut Vec<Event>,
    ) -> MachineStep<RunStatus> {
        let (plan, bench, drift, driven) = (&self.plan, self.bench, &self.drift, self.drive());
        let mut context = MachineContext { now, plan, limits, probe, bench, drift, driven, notes };
        let step = match &mut self.machine {
            Machine::Rising if probe.clearance != Clearance::Clear => {
                MachineStep::Fault(event.out_of_order("a retract"))
            }
            Machine::Between | Machine::Rising => {
                self.machine = Machine::Between;
                return self.next_step(now, limits, probe, notes);
            }
            Machine::Prompting(prompt) => {
                let step = prompting(*prompt, event, &mut context);
                if matches!(step, MachineStep::Done(())) {
                    let change = Change::of(*prompt);
                    self.changed(change);
                }
                step
            }
            Machine::Confirming => match confirming(&event, self.no_load.as_ref()) {
                Ok(true) => return self.confirmed(now, limits, probe, notes),
                Ok(false) => {
                    self.machine = Machine::Closing(Box::new(NoLoad::here()));
                    return self.advance(now, MachineEvent::Begin, limits, probe, notes);
                }
                Err(fault) => MachineStep::Fault(fault),
            },
            Machine::NoLoad(machine) | Machine::Referring(machine) | Machine::Closing(machine) => {
                let step = machine.advance(event, self.no_load.as_ref(), &mut context);
                let step = step.and_then(|reference| self.referred(&reference, notes));
                match (&self.machine, step) {
                    (Machine::Referring(_), MachineStep::Done(())) => {
                        return self.touch_again(&mut Surroundings { now, limits, probe, notes });
                    }
                    (Machine::Closing(_), MachineStep::Done(())) => {
                        return self.confirmed(now, limits, probe, notes);
                    }
                    (_, step) => step,
                }
            }
            Machine::Touch(machine) => {
                let left = machine.left_at(&context);
                match machine.advance(event, &mut context) {
                    MachineStep::Done(result) => {
                        self.free_since = left;
                        let mut around = Surroundings { now, limits, probe, notes };
                        return self.touched(result, &mut around);
                    }
                    step => step.and_then(|_| MachineStep::Done(())),
                }
            }
            Machine::Deciding(result) => {
                let result = (**result).clone();
                return self.answered(
                    result,
                    event,
                    &mut Surroundings { now, limits, probe, notes },
                );
            }
        };
        if let MachineStep::Fault(fault) = &step {
            self.doubt(fault, notes);
        }
        step.and_then(|()| {
            self.machine = Machine::Between;
            self.index += 1;
            self.next_step(now, limits, probe, notes)
        })
    }

    /// The last touch is confirmed.
    fn confirmed(
        &mut self,
        now: RigTime,
        limits: &RigLimits,
        probe: Proven,
        notes: &mut Vec<Event>,
    ) -> MachineStep<RunStatus> {
        self.neighbours.confirmed();
        self.machine = Machine::Between;
        self.next_step(now, limits, probe, notes)
    }

    /// The free sensor has been measured. The first of its resonances that is a jump tells of the touches before them all:
    /// after it the drift begins anew, and the next ones are none.
    fn referred(
        &mut self,
        Reference { found, bench }: &Reference,
        notes: &mut Vec<Event>,
    ) -> MachineStep<()> {
        let approach = self.plan.touch.approach;
        let (mut jump, mut moved) = (None, Ok(()));
        for (at, resonance) in found {
            moved = check_reference(self.no_load.as_ref(), resonance, &approach);
            let found = self.drift.measured(*at, resonance.resonance_hz, resonance.sigma_hz);
            jump = jump.or(found);
            if moved.is_err() {
                break;
            }
            self.no_load = Some(*resonance);
        }
        self.referenced = Some(self.index);
        let touches = std::mem::take(&mut self.unreferenced);
        if let Some(Jump { off_hz, sigma_hz }) = jump.filter(|_| !touches.is_empty()) {
            notes.push(Event::ReferenceJumped { off_hz, sigma_hz, touches });
        }
        if let Err(fault) = moved {
            return MachineStep::Fault(Fault::ContactSense(fault));
        }
        self.bench = *bench;
        let moves_hz = |seconds| self.drift.moves_hz(seconds);
        let checked = self
            .no_load
            .as_ref()
            .map(|no_load| check_drift(no_load, moves_hz, approach.contact_threshold));
        if let Some(Err(fault)) = checked {
            return MachineStep::Fault(Fault::ContactSense(fault));
        }
        MachineStep::Done(())
    }

    /// A person has changed the sample or the sensor.
    fn changed(&mut self, change: Change) {
        self.neighbours.changed();
        self.heights.iter_mut().for_each(|heights| heights.changed(change));
        if change == Change::Turned {
            self.drift.turned();
        }
    }

    /// A fault may contradict the last touch.
    fn doubt(&mut self, fault: &Fault, notes: &mut Vec<Event>) {
        let is_end = matches!(self.machine, Machine::Closing(_));
        if let Some(doubted) = self.neighbours.contradicted_by(fault, is_end) {
            self.has_refusals = true;
            notes.push(Event::TouchDoubted(Box::new(doubted)));
        }
    }

    /// The drive of the sensor, since it has been free.
    fn drive(&self) -> Option<Driven> {
        self.driven.map(|driven| Driven { since: driven.since.max(self.free_since), ..driven })
    }

    /// Remembers what is measured next.
    pub(crate) fn asks(&mut self, step: &MachineStep<RunStatus>) {
        if let MachineStep::Do(Operation::Measure { points, level }) = step {
            self.asked = Some((points.clone(), *level));
        }
    }

    /// What an event says of the drive of the sensor and of the sample. A person makes the sensor vibrate, and may have
    /// swept while the run was paused.
    pub(crate) fn follow_person(&mut self, now: RigTime, event: &MachineEvent) {
        match event {
            MachineEvent::Readings(readings) => {
                let asked = self.asked.take().filter(|(points, level)| {
                    points.len() <= readings.len() && *level == self.plan.contact_sweep.level
                });
                let last = readings.last().filter(|last| is_value(last));
                self.driven = asked.zip(last).and_then(|((points, _), last)| {
                    let frequency_hz = points.last()?.frequency_hz;
                    Some(Driven { frequency_hz, since: last.started })
                });
            }
            MachineEvent::Answered { .. }
                if !matches!(self.machine, Machine::Prompting(Prompt::PlaceSample { .. })) =>
            {
                self.free_since = now;
            }
            MachineEvent::Resumed => {
                self.driven = None;
                // The person who paused may have touched the sample.
                self.changed(Change::Placed);
            }
            MachineEvent::Decided { .. } => self.driven = None,
            _ => {}
        }
    }

    /// By when the first reading of a descent that begins now must come.
    pub(crate) fn first_reading_by(&self, now: RigTime) -> Option<RigTime> {
        let Machine::Touch(machine) = &self.machine else { return None };
        machine.first_reading_by(now)
    }

    pub(crate) fn streamed(&mut self, now: RigTime, streamed: Streamed) -> Vigil {
        let Machine::Touch(machine) = &mut self.machine else { return Vigil::Halt };
        machine.streamed(now, streamed)
    }

    fn finish_touch(
        &mut self,
        result: TouchResult,
        around: &mut Surroundings<'_>,
    ) -> MachineStep<RunStatus> {
        self.note_touch(result, around);
        (self.repeats, self.window) = (0, None);
        self.machine = Machine::Between;
        self.index += 1;
        let Surroundings { now, limits, probe, notes } = around;
        self.next_step(*now, limits, *probe, notes)
    }

    fn note_touch(&mut self, result: TouchResult, around: &mut Surroundings<'_>) {
        self.has_refusals |= result.is_refused();
        self.touch_lasts = around.now.since(self.touch_begun);
        if !result.is_refused() {
            self.unreferenced.push(result.step.clone());
        }
        let pose = result.touch.pose;
        let geometry = &around.limits.geometry;
        let expected = geometry.surface_at(pose.direction, pose.angle);
        if let TouchOutcome::Measured { contact, .. }
        | TouchOutcome::Refused { contact: Some(contact), .. } = &result.outcome
        {
            let above_mm = contact.surface.position.value() - expected.value();
            let tolerance_mm = geometry.surface_tolerance_mm;
            let heights = self.heights.get_or_insert_with(|| Heights::new(tolerance_mm));
            heights.found(geometry, pose.direction.rotary_position(pose.angle), above_mm);
        }
        self.neighbours.finished(&result, expected);
        around.notes.push(Event::TouchFinished(Box::new(result)));
    }

    /// What the touches before and the plan say of a touch.
    fn outlook(&self, touch: &Touch, limits: &RigLimits) -> Outlook {
        let tilt = touch.pose.direction.rotary_position(touch.pose.angle);
        let predict = |heights: &Heights| heights.predict(&limits.geometry, tilt);
        Outlook {
            offset_mm: self.neighbours.offset_mm(),
            predicted: self.heights.as_ref().and_then(predict),
            is_first: self.heights.is_none(),
            next: self.next_pose(),
        }
    }

    /// The pose to which the sample turns after the present step, if no person comes in between.
    fn next_pose(&self) -> Option<Pose> {
        let next =
            (self.index + 1..self.plan.steps.len()).find(|index| !self.is_left_out(*index))?;
        pose(&self.plan.steps[next])
    }

    /// Begins the next step, or pauses before it, or ends the run.
    fn next_step(
        &mut self,
        now: RigTime,
        limits: &RigLimits,
        probe: Proven,
        notes: &mut Vec<Event>,
    ) -> MachineStep<RunStatus> {
        while self.is_left_out(self.index) {
            self.index += 1;
        }
        let step = self.plan.steps.get(self.index);
        let is_pause_asked = self.is_pause_asked && !self.is_referenced();
        let clear = probe.clear_before(step.filter(|_| !is_pause_asked).and_then(pose), limits);
        if !probe.is_above(clear, limits) {
            self.machine = Machine::Rising;
            return MachineStep::Retract(limits.linear.rest_target());
        }
        let Some(step) = step else {
            if let Some(no_load) = self.no_load.filter(|_| self.neighbours.is_open()) {
                self.machine = Machine::Confirming;
                let (plan, driven) = (&self.plan, self.drive());
                let listening = Listening { now, no_load: &no_load, plan, driven };
                return MachineStep::Do(listening.both());
            }
            if self.is_pause_asked {
                return MachineStep::Pause;
            }
            return MachineStep::Done(if self.has_refusals {
                RunStatus::CompletedWithRefusals
            } else {
                RunStatus::Completed
            });
        };
        if is_pause_asked {
            if self.is_after_reference() {
                // It may be due afterwards.
                self.index -= 1;
            }
            return MachineStep::Pause;
        }
        if self.is_not_due(now) {
            self.index += 1;
            return self.next_step(now, limits, probe, notes);
        }
        self.touch_begun = now;
        self.machine = match step.action {
            Action::Prompt(prompt) => Machine::Prompting(prompt),
            Action::NoLoad(pose) => Machine::NoLoad(Box::new(NoLoad::new(pose))),
            Action::Touch(_) => match self.touch_of_step(limits) {
                Ok(machine) => machine,
                Err(fault) => return MachineStep::Fault(fault),
            },
        };
        notes.push(Event::StepStarted { index: self.index });
        self.advance(now, MachineEvent::Begin, limits, probe, notes)
    }
}

/// The pose of a step; a prompt has none.
const fn pose(step: &Step) -> Option<Pose> {
    match step.action {
        Action::Prompt(_) => None,
        Action::NoLoad(pose) => Some(pose),
        Action::Touch(touch) => Some(touch.pose),
    }
}

/// A sample is placed on a level stage; the sensor is turned wherever the stage is.
fn prompting(
    prompt: Prompt,
    event: MachineEvent,
    context: &mut MachineContext<'_>,
) -> MachineStep<()> {
    match (event, prompt) {
        (MachineEvent::Begin, Prompt::PlaceSample { .. }) => {
            MachineStep::Do(Operation::MoveRotary {
                target: context.limits.rotary.rest_target(),
                speed_deg_per_s: context.limits.motion.rotary_speed_deg_per_s,
            })
        }
        (MachineEvent::Begin, Prompt::TurnSensor { .. }) | (MachineEvent::RotaryAt(_), _) => {
            context.notes.push(Event::PromptAsked(prompt));
            MachineStep::Ask(prompt)
        }
        (MachineEvent::Answered { by }, _) => {
            context.notes.push(Event::PromptAnswered { prompt, by });
            MachineStep::Done(())
        }
        (event, _) => MachineStep::Fault(event.out_of_order("a prompt")),
    }
}
