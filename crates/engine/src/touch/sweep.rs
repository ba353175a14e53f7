//! The sweep of a touch in contact.

use rig_model::{SweepRequest, Window};
use rig_resonance::{Bench, FitOutcome, Prior};

use super::{Phase, RETRIES, TouchMachine};
use crate::{
    Contact, Halfway, SweepPurpose, TouchOutcome, TouchRefusal, TouchResult,
    contact_sense::check_shift,
    machine::{MachineContext, MachineEvent, MachineStep},
    sweep::{DRIFT, Sweep, SweepStep},
};

impl TouchMachine {
    pub(super) fn sweep(
        &mut self,
        contact: Contact,
        retries_left: u32,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let planned = context.plan.contact_sweep;
        let request = &SweepRequest { window: self.window.unwrap_or(planned.window), ..planned };
        // A refused sweep is repeated without the prior, which may be wrong. The sensor is the same.
        let prior = if retries_left == RETRIES {
            self.stiffened(request.window, context.bench)
        } else {
            Prior::anywhere(request.window, context.bench).of_sensor(&self.no_load)
        };
        let (sweep, step) = Sweep::begin(
            context.now,
            SweepPurpose::Touch,
            request,
            Some(&prior),
            (context.limits, context.notes),
        );
        self.phase = Phase::Sweeping { contact, sweep: Box::new(sweep), retries_left };
        self.swept(step, context)
    }

    /// The prior of the sensor in contact: a contact adds stiffness, so the resonance can only
    /// rise, apart from the drift since the reference.
    fn stiffened(&self, window: Window, bench: Option<Bench>) -> Prior {
        let free_hz = self.no_load.resonance_hz;
        let min_hz = window.min_hz.max(free_hz * (1.0 - DRIFT)).min(window.max_hz);
        Prior::moved(&self.no_load, Window { min_hz, ..window }, bench)
    }

    pub(super) fn swept(
        &mut self,
        step: SweepStep,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let Phase::Sweeping { contact, retries_left, .. } = self.phase else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("a sweep in contact"));
        };
        match step {
            SweepStep::Measure(operation) => MachineStep::Do(operation),
            SweepStep::Fault(fault) => MachineStep::Fault(fault),
            SweepStep::Finished(sweep) => {
                let outcome = match sweep.outcome {
                    FitOutcome::Accepted(loaded) => {
                        let threshold = context.plan.touch.approach.contact_threshold;
                        match check_shift(&self.no_load, &loaded, threshold) {
                            Ok(()) if self.is_halfway_due(context) => {
                                self.halfway = Some(Halfway { contact, loaded });
                                return self.indent(contact.surface, context);
                            }
                            Ok(()) => return self.check_slip(contact, &loaded, context),
                            Err(refusal) => {
                                TouchOutcome::Refused { contact: Some(contact), refusal }
                            }
                        }
                    }
                    FitOutcome::Refused(_) if retries_left > 0 => {
                        return self.sweep(contact, retries_left - 1, context);
                    }
                    FitOutcome::Refused(refusal) => {
                        let refusal = TouchRefusal::Sweep(Box::new(refusal));
                        TouchOutcome::Refused { contact: Some(contact), refusal }
                    }
                };
                self.retract(outcome, context)
            }
        }
    }

    /// Whether the smaller depth is still to be measured.
    const fn is_halfway_due(&self, context: &MachineContext<'_>) -> bool {
        context.plan.touch.halfway_mm.is_some() && self.halfway.is_none()
    }
}
