//! The check of the surface after the sweep of a touch.

use rig_model::Reading;
use rig_protocol::TouchSettings;
use rig_resonance::{Resonance, flagged};

use super::{Phase, TouchMachine};
use crate::{
    Contact, Event, Fault, TouchOutcome, TouchRefusal, TouchResult,
    listening::Decay,
    machine::{MachineContext, MachineEvent, MachineStep},
    slip::{SlipCheck, SlipStep},
};

impl TouchMachine {
    /// Looks for the surface again after an accepted sweep, if the protocol asks for it.
    pub(super) fn check_slip(
        &mut self,
        contact: Contact,
        loaded: &Resonance,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let TouchSettings { approach, indentation_mm, .. } = context.plan.touch;
        let measured = self.measured(contact, loaded, context);
        let Some(baseline) = self.baseline.filter(|_| approach.has_slip_check()) else {
            return self.retract(measured, context);
        };
        let (mut check, step) =
            SlipCheck::begin(contact.surface, approach, indentation_mm, baseline);
        if self.may_have_drifted(context) {
            check.doubt();
        }
        self.phase = Phase::Checking { check, contact, measured: Box::new(measured) };
        self.follow_check(step, context)
    }

    /// Takes an event of the check of the surface.
    pub(super) fn check(
        &mut self,
        event: &MachineEvent,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let step = match (&mut self.phase, event) {
            (Phase::Checking { check, .. }, MachineEvent::LinearAt(read_back)) => {
                let step = check.arrived(*read_back);
                self.arrived(*read_back, context.now);
                step
            }
            (Phase::Checking { check, .. }, MachineEvent::Readings(readings))
                if self.is_early && check.seems_to_touch(readings) =>
            {
                return self.listen(Decay::Whole, context);
            }
            (Phase::Checking { check, .. }, MachineEvent::Readings(readings)) => {
                self.is_early = false;
                check.driven().unwrap_or_else(|| {
                    let read = |_, one: &Reading| check.read(*one, &self.no_load);
                    readings.iter().fold(SlipStep::Flagged, read)
                })
            }
            (_, event) => {
                return MachineStep::Fault(event.out_of_order("a check of the surface"));
            }
        };
        self.follow_check(step, context)
    }

    fn follow_check(
        &mut self,
        step: SlipStep,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let Phase::Checking { check, contact, measured } = &self.phase else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("a check of the surface"));
        };
        let refusal = match step {
            SlipStep::Drive => {
                return MachineStep::Do(context.listening(&self.no_load).drive());
            }
            SlipStep::MoveTo(to) => {
                return context.move_linear(to, self.speed_mm_per_s(to, context));
            }
            SlipStep::Read { is_after_contact: true } => {
                let decay = if check.may_be_early() { Decay::Early } else { Decay::Whole };
                return self.listen(decay, context);
            }
            // What is left of the change of frequency is too little to hide a contact or to show one.
            SlipStep::Read { is_after_contact: false } => {
                let listening = context.listening(&self.no_load);
                return MachineStep::Do(listening.contact(None, Decay::Early));
            }
            SlipStep::Finished(Ok(())) => None,
            SlipStep::Finished(Err(slip)) => Some(TouchRefusal::Slipped(slip)),
            SlipStep::Flagged => {
                let readings: Vec<Reading> = check.trail().iter().map(|(_, one)| *one).collect();
                let Some(refusal) = flagged(&readings) else {
                    return MachineStep::Fault(Fault::MissingReadings { given: 0, asked: 1 });
                };
                Some(TouchRefusal::Sweep(Box::new(refusal)))
            }
        };
        context.notes.push(Event::SurfaceChecked { trail: check.trail().to_vec() });
        let outcome = match refusal {
            None => (**measured).clone(),
            Some(refusal) => TouchOutcome::Refused { contact: Some(*contact), refusal },
        };
        self.retract(outcome, context)
    }
}
