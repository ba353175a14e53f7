//! What comes after a touch: the policy of the protocol, or a person, decides about a refused one, which may be made again.

use rig_model::{RigLimits, RigTime};
use rig_protocol::{Action, NoLoadPolicy, RefusalPolicy, Step};

use super::{Machine, PROTOCOL, Run, Surroundings};
use crate::{
    Event, Fault, RefusalAnswer, RefusedTouch, RunStatus, TouchOutcome, TouchResult,
    heights::Change,
    machine::{MachineEvent, MachineStep},
    no_load::NoLoad,
    refusal::widened,
    touch::TouchMachine,
};

impl Run {
    /// The refused touch about which a person is asked.
    pub(crate) fn question(&self) -> Option<RefusedTouch> {
        let Machine::Deciding(result) = &self.machine else { return None };
        let TouchOutcome::Refused { refusal, .. } = &result.outcome else { return None };
        Some(RefusedTouch { step: result.step.clone(), reason: refusal.to_string() })
    }

    /// A touch is done and the probe is clear. The policy of the protocol decides about a refused one.
    pub(super) fn touched(
        &mut self,
        result: TouchResult,
        around: &mut Surroundings<'_>,
    ) -> MachineStep<RunStatus> {
        let TouchOutcome::Refused { refusal, .. } = &result.outcome else {
            return self.finish_touch(result, around);
        };
        let answer = match self.plan.touch.on_refusal {
            RefusalPolicy::Ask => {
                around.notes.push(Event::RefusalAsked { refusal: refusal.clone() });
                self.machine = Machine::Deciding(Box::new(result));
                return MachineStep::Decide;
            }
            RefusalPolicy::Repeat if self.repeats == 0 => RefusalAnswer::Repeat,
            RefusalPolicy::Widen if self.repeats == 0 => RefusalAnswer::Widen,
            RefusalPolicy::Abort => RefusalAnswer::Abort,
            _ => return self.finish_touch(result, around),
        };
        self.decided(result, answer, None, around)
    }

    /// A person has answered about this refused touch, now or before a pause.
    pub(super) fn answered(
        &mut self,
        result: TouchResult,
        event: MachineEvent,
        around: &mut Surroundings<'_>,
    ) -> MachineStep<RunStatus> {
        let answered = match event {
            MachineEvent::Decided { answer, by } => Ok((answer, by)),
            event => self.answered.take().ok_or(event),
        };
        match answered {
            Ok(answered) if self.is_pause_asked && answered.0.is_again() => {
                self.answered = Some(answered);
                MachineStep::Pause
            }
            Ok((answer, by)) => self.decided(result, answer, Some(by), around),
            Err(event) => MachineStep::Fault(event.out_of_order("a refused touch")),
        }
    }

    /// Does what a person or the protocol has decided about a refused touch.
    pub(super) fn decided(
        &mut self,
        result: TouchResult,
        answer: RefusalAnswer,
        person: Option<String>,
        around: &mut Surroundings<'_>,
    ) -> MachineStep<RunStatus> {
        // A person may have any name.
        let was_person_there = person.is_some();
        let by = person.unwrap_or_else(|| PROTOCOL.to_owned());
        if answer == RefusalAnswer::Widen {
            let window = self.window.unwrap_or(self.plan.contact_sweep.window);
            self.window = Some(widened(window, around.limits));
        }
        let window = self.window.filter(|_| answer == RefusalAnswer::Widen);
        if let TouchOutcome::Refused { refusal, .. } = &result.outcome {
            let (by, refusal) = (by.clone(), refusal.clone());
            around.notes.push(Event::RefusalAnswered { answer, by, refusal, window });
        }
        match answer {
            RefusalAnswer::Widen | RefusalAnswer::Repeat => {
                self.repeats += 1;
                if was_person_there {
                    // Who was asked was at the bench.
                    self.changed(Change::Placed);
                }
                if !self.is_reference_due(around.now, was_person_there) {
                    return self.touch_again(around);
                }
                self.machine = Machine::Referring(Box::new(NoLoad::new(result.touch.pose)));
                let Surroundings { now, limits, probe, notes } = around;
                self.advance(*now, MachineEvent::Begin, limits, *probe, notes)
            }
            RefusalAnswer::Skip => self.finish_touch(result, around),
            RefusalAnswer::Abort => {
                self.note_touch(result, around);
                around.notes.push(Event::Operator { action: "abort", by: by.clone() });
                MachineStep::Abort { by }
            }
        }
    }

    /// Whether a touch that is made again needs a reference, as a planned one would: the planned ones have their own after a
    /// person was at the bench, and by drift whenever the drift asks for it.
    fn is_reference_due(&self, now: RigTime, was_person_there: bool) -> bool {
        match self.plan.no_load {
            NoLoadPolicy::Once => false,
            _ if was_person_there => true,
            NoLoadPolicy::ByDrift => self.is_due_by_drift(now),
            NoLoadPolicy::EveryTouch | NoLoadPolicy::EveryPose | NoLoadPolicy::EverySample => false,
        }
    }

    /// Makes the touch of the present step again.
    pub(super) fn touch_again(&mut self, around: &mut Surroundings<'_>) -> MachineStep<RunStatus> {
        match self.touch_of_step(around.limits) {
            Ok(machine) => self.machine = machine,
            Err(fault) => return MachineStep::Fault(fault),
        }
        let Surroundings { now, limits, probe, notes } = around;
        self.advance(*now, MachineEvent::Begin, limits, *probe, notes)
    }

    /// The touch of the present step, at its beginning.
    pub(super) fn touch_of_step(&self, limits: &RigLimits) -> Result<Machine, Fault> {
        let step = self.plan.steps.get(self.index);
        let Some(Step { id, action: Action::Touch(touch) }) = step else {
            return Err(MachineEvent::Begin.out_of_order("a step without a touch"));
        };
        let Some(no_load) = &self.no_load else {
            return Err(Fault::NoReferenceBefore { step: id.clone() });
        };
        let outlook = self.outlook(touch, limits);
        let machine = TouchMachine::new(id.clone(), *touch, no_load, outlook, self.window);
        Ok(Machine::Touch(Box::new(machine)))
    }
}
