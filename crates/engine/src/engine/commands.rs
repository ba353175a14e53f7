//! Commands: their admission, and their beginning.

use rig_model::{Clearance, Deg, Mm, Position, RigLimits, RigTime};

use super::{Activity, Engine, reach::Reach};
use crate::{
    Command, CommandRefusal, Effect, Event, Failure, Fault, Jump, LeftRig, LoweringPurpose,
    Operation, SweepPurpose, TouchPlace, fault::StopReason, machine::MachineEvent,
    recovery::Preparing, run::Run, sweep::Sweep,
};

/// A command that [`Engine::admit`] has admitted. It holds for the state in which it was admitted,
/// so [`Engine::begin`] takes it before any other input reaches the engine.
#[derive(Debug)]
pub struct Admitted {
    command: Command,
    /// The move of a manual command, to targets that were checked.
    operation: Option<Operation>,
}

impl Engine {
    /// Admits a command in the present state, for [`Engine::begin`].
    ///
    /// This is the only place that decides whether a command may begin.
    ///
    /// # Errors
    /// [`CommandRefusal`] names the command and the state or the limit that forbids it.
    pub fn admit(&self, command: Command) -> Result<Admitted, CommandRefusal> {
        let is_admitted = match &command {
            Command::Prepare => matches!(self.activity, Activity::Unprepared),
            Command::HomeLinear if matches!(self.activity, Activity::Unprepared) => true,
            Command::Run(_)
            | Command::Continue { .. }
            | Command::Sweep(_)
            | Command::MoveLinear(_)
            | Command::MoveRotary(_) => matches!(self.activity, Activity::Idle),
            Command::Pause | Command::Skip(_) => {
                matches!(
                    self.activity,
                    Activity::Running(_) | Activity::Waiting(..) | Activity::Deciding(_)
                ) || matches!((&self.activity, &command), (Activity::Paused(_), Command::Skip(_)))
            }
            Command::Resume => match &self.activity {
                Activity::Paused(_) => true,
                Activity::Running(run) | Activity::Waiting(run, _) | Activity::Deciding(run) => {
                    run.is_pause_asked
                }
                _ => false,
            },
            Command::Abort => matches!(
                self.activity,
                Activity::Running(_)
                    | Activity::Waiting(..)
                    | Activity::Deciding(_)
                    | Activity::Paused(_)
                    | Activity::Sweeping(_)
                    | Activity::Moving
            ),
            Command::Answer => matches!(self.activity, Activity::Waiting(..)),
            Command::Decide { step, .. } => match &self.activity {
                Activity::Deciding(run) => {
                    run.question().is_some_and(|question| question.step == *step)
                }
                _ => false,
            },
            // Stopping is never refused.
            Command::Stop => true,
            Command::Acknowledge | Command::HomeLinear => {
                matches!(self.activity, Activity::Latched(_))
                    && (self.pending.is_none() || self.attempts.is_some())
            }
        };
        let (name, clearance) = (command.name(), self.interlock.clearance());
        if !is_admitted {
            return Err(CommandRefusal::State { command: name, state: self.state });
        }
        if matches!(command, Command::Run(_) | Command::Continue { .. } | Command::MoveRotary(_))
            && clearance != Clearance::Clear
        {
            return Err(CommandRefusal::NotClear { command: name, clearance });
        }
        if let Command::Skip(step) = &command {
            let step = step.clone();
            match self.run().and_then(|run| run.place_of(&step)) {
                Some(TouchPlace::Ahead) => {}
                Some(place) => return Err(CommandRefusal::NotAhead { step, place }),
                None => return Err(CommandRefusal::NoSuchTouch { step }),
            }
        }
        let operation = self.manual_move(&command)?;
        Ok(Admitted { command, operation })
    }

    fn run(&self) -> Option<&Run> {
        match &self.activity {
            Activity::Running(run)
            | Activity::Waiting(run, _)
            | Activity::Deciding(run)
            | Activity::Paused(run) => Some(run),
            _ => None,
        }
    }

    /// The move that a person asks for, within the limits. The probe goes down slowly.
    fn manual_move(&self, command: &Command) -> Result<Option<Operation>, CommandRefusal> {
        let RigLimits { linear, rotary, motion, .. } = &self.limits;
        let operation = match *command {
            Command::MoveRotary(to) => Operation::MoveRotary {
                target: rotary.target(to).map_err(CommandRefusal::RotaryTarget)?,
                speed_deg_per_s: motion.rotary_speed_deg_per_s,
            },
            Command::MoveLinear(to) => {
                let target = linear.target(to).map_err(CommandRefusal::LinearTarget)?;
                let rest = linear.rest_target().position();
                let is_lowering = to < rest;
                match self.interlock.proven().tilt {
                    Some(tilt) => self.check_depth(to, tilt)?,
                    None if is_lowering => {
                        return Err(CommandRefusal::TiltUnknown { wanted: to, rest });
                    }
                    None => {}
                }
                let speed_mm_per_s = if is_lowering {
                    motion.contact_speed_mm_per_s
                } else {
                    motion.travel_speed_mm_per_s
                };
                Operation::MoveLinear { target, speed_mm_per_s }
            }
            _ => return Ok(None),
        };
        Ok(Some(operation))
    }

    /// Refuses a target of the linear stage that is too deep at this tilt.
    fn check_depth(&self, to: Position<Mm>, tilt: Position<Deg>) -> Result<(), CommandRefusal> {
        let floor = self.limits.floor_at(tilt);
        if to < floor {
            return Err(CommandRefusal::TooDeep { wanted: to, floor });
        }
        let lowest = self.limits.lowest_of_one_move(self.linear, tilt);
        if to < lowest {
            return Err(CommandRefusal::TooFar { wanted: to, lowest });
        }
        Ok(())
    }

    /// Begins a command of `by` that was admitted in the present state, and appends its effects.
    pub fn begin(&mut self, now: RigTime, admitted: Admitted, by: &str, effects: &mut Vec<Effect>) {
        let Admitted { command, operation } = admitted;
        // An answer has an event of its own.
        if !matches!(command, Command::Answer | Command::Decide { .. }) {
            self.notes.push(Event::Operator { action: command.name(), by: by.to_owned() });
        }
        match command {
            Command::Prepare | Command::Acknowledge => {
                self.prepare(now, Preparing::FindingLinear, effects);
            }
            Command::HomeLinear => {
                // A fault before may have been one of the position.
                let anew = matches!(self.activity, Activity::Latched(_));
                self.prepare(now, Preparing::HomingLinear { anew }, effects);
            }
            Command::Run(plan) => self.begin_run(now, Run::new(*plan, 0, false), effects),
            Command::Continue { plan, from, has_refusals } => {
                self.begin_run(now, Run::new(*plan, from, has_refusals), effects);
            }
            Command::Sweep(request) => {
                let context = (&self.limits, &mut self.notes);
                let (sweep, step) =
                    Sweep::begin(now, SweepPurpose::Manual, &request, None, context);
                self.activity = Activity::Sweeping(Box::new(sweep));
                self.follow_sweep(now, step, effects);
            }
            Command::MoveLinear(_) | Command::MoveRotary(_) => {
                self.move_manually(now, operation, effects);
            }
            Command::Skip(step) => {
                if let Activity::Running(run)
                | Activity::Waiting(run, _)
                | Activity::Deciding(run)
                | Activity::Paused(run) = &mut self.activity
                {
                    run.skip(step);
                }
            }
            Command::Pause | Command::Resume => self.pause(now, &command, effects),
            Command::Abort => {
                self.stop(now, StopReason::Abort { by: by.to_owned() }, effects);
            }
            Command::Decide { answer, .. } => {
                let event = MachineEvent::Decided { answer, by: by.to_owned() };
                self.advance_run(now, event, effects);
            }
            Command::Answer => {
                let event = MachineEvent::Answered { by: by.to_owned() };
                self.advance_run(now, event, effects);
            }
            Command::Stop => {
                let fault = Fault::Stopped { by: by.to_owned() };
                self.stop(now, StopReason::Fault(fault), effects);
            }
        }
        self.settle(effects);
    }

    /// Latches before the rig is first prepared, because the last program did not end in order: at once, or when a rig is
    /// commissioned that was latched because it was not. [`Command::Acknowledge`] prepares it. Does nothing later.
    pub fn latch_interrupted(&mut self, left: LeftRig, effects: &mut Vec<Effect>) {
        match self.activity {
            Activity::Unprepared => self.reach = Reach::left(left.jump),
            Activity::Latched(Fault::NotCommissioned { .. }) => {}
            _ => return,
        }
        if left.may_touch {
            self.interlock.assume_contact();
        }
        let (fault, clearance) = (Fault::Interrupted(left), self.interlock.clearance());
        self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
        self.activity = Activity::Latched(fault);
        self.settle(effects);
    }

    /// Latches before the rig is first prepared, because its drives are not shown to move as the rig file says.
    /// [`Command::Acknowledge`] prepares it; the caller gives that command when they are. `jump` is that of the last program. Does
    /// nothing later.
    pub fn latch_uncommissioned(
        &mut self,
        missing: String,
        jump: Option<Jump>,
        effects: &mut Vec<Effect>,
    ) {
        if matches!(self.activity, Activity::Unprepared) {
            self.reach = Reach::left(jump);
            let (fault, clearance) =
                (Fault::NotCommissioned { missing }, self.interlock.clearance());
            self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
            self.activity = Activity::Latched(fault);
            self.settle(effects);
        }
    }

    /// Latches an idle rig whose records cannot be kept any more. Does nothing in another state: there
    /// the next operation brings the failure.
    pub fn latch_unrecorded(&mut self, failure: Failure, effects: &mut Vec<Effect>) {
        if matches!(self.activity, Activity::Idle) {
            let (fault, clearance) = (Fault::Device(failure), self.interlock.clearance());
            self.notes.push(Event::Faulted { fault: fault.clone(), clearance });
            self.activity = Activity::Latched(fault);
            self.settle(effects);
        }
    }

    fn begin_run(&mut self, now: RigTime, run: Run, effects: &mut Vec<Effect>) {
        let mut run = Box::new(run);
        let step = self.advance(now, &mut run, MachineEvent::Begin);
        self.activity = Activity::Running(run);
        self.follow_run(now, step, effects);
    }

    /// Moves one axis for a person. A move of the probe below its clear position is declared first.
    fn move_manually(
        &mut self,
        now: RigTime,
        operation: Option<Operation>,
        effects: &mut Vec<Effect>,
    ) {
        let Some(operation) = operation else { return };
        if let Operation::MoveLinear { target, .. } = &operation {
            let to = target.position();
            if to < self.limits.linear.rest_target().position() {
                self.declare(to, LoweringPurpose::ByHand, effects);
            }
        }
        self.activity = Activity::Moving;
        self.issue(now, operation, effects);
    }

    fn pause(&mut self, now: RigTime, command: &Command, effects: &mut Vec<Effect>) {
        let is_pause = matches!(command, Command::Pause);
        match &mut self.activity {
            Activity::Running(run) | Activity::Waiting(run, _) | Activity::Deciding(run) => {
                run.is_pause_asked = is_pause;
            }
            Activity::Paused(run) => {
                run.is_pause_asked = is_pause;
                self.replace_run(Activity::Running);
                self.advance_run(now, MachineEvent::Resumed, effects);
            }
            _ => {}
        }
    }

    /// Brings the rig into service. A sample may be below the probe, however the rig was left: only a
    /// person can see that none is.
    pub(super) fn prepare(&mut self, now: RigTime, first: Preparing, effects: &mut Vec<Effect>) {
        if self.end_attempts(now, first, effects) {
            return;
        }
        if matches!(first, Preparing::HomingLinear { .. }) {
            self.interlock.state_nothing_below();
        }
        self.last_fault = None;
        self.activity = Activity::Preparing(first);
        self.issue(now, first.operation(&self.limits), effects);
    }
}
