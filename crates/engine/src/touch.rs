//! One touch, from clear to clear.
//!
//! ```text
//! rotate ─▶ baseline ─▶ declare ─▶ search ─▶ declare ─▶ indent ─▶ dwell ─▶ sweep ─▶ retract ─▶ done
//!           (clear)     (intent    (down in  (intent                         │ ▲
//!                       on disk)   steps)    on disk)                        └─┘ once more if refused
//! ```
//!
//! Every failure ends in a [`Fault`]; the engine then stops, retracts and latches.

use std::time::Duration;

use rig_model::{
    Clearance, Deg, Impedance, Mm, PointResult, Position, Reading, SweepPoint, Window,
};
use rig_protocol::{StepId, Touch};
use rig_resonance::{FitOutcome, Prior, Resonance, flagged};

use crate::{
    Contact, Fault, LoweringPurpose, Operation, SweepPurpose, TouchOutcome, TouchResult,
    machine::{MachineContext, MachineEvent, MachineStep},
    search::{Search, SearchStep, Surface},
    sweep::{DRIFT, Sweep, SweepStep},
};

/// The baseline is read after this many time constants of the ring-down, so that the residual
/// transient (e⁻⁸ = 0.03 %) is far below any contact threshold.
const BASELINE_TIME_CONSTANTS: f64 = 8.0;

/// After the probe has left the sample, the vibration decays for this many time constants, to e⁻⁵ =
/// 0.7 % of the change by the contact.
const AFTER_CONTACT_TIME_CONSTANTS: f64 = 5.0;

/// A refused sweep in contact is repeated this often before the touch is refused.
const RETRIES: u32 = 1;

#[derive(Debug)]
pub(crate) struct TouchMachine {
    step: StepId,
    touch: Touch,
    no_load: Resonance,
    /// The rotary stage as last read back.
    rotary: Position<Deg>,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    Rotating,
    Baseline,
    Declaring { baseline: Impedance },
    Searching(Search),
    DeclaringIndentation { surface: Surface },
    Indenting { surface: Surface },
    Dwelling(Contact),
    Sweeping { contact: Contact, sweep: Box<Sweep>, retries_left: u32 },
    Retracting(Box<TouchOutcome>),
}

impl TouchMachine {
    pub(crate) fn new(step: StepId, touch: Touch, no_load: &Resonance) -> Self {
        let rotary = touch.pose.direction.rotary_position(touch.pose.angle);
        Self { step, touch, no_load: *no_load, rotary, phase: Phase::Rotating }
    }

    pub(crate) fn advance(
        &mut self,
        event: MachineEvent,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        match (&mut self.phase, event) {
            (Phase::Rotating, MachineEvent::Begin) => context.rotate_to(self.touch.pose),
            (Phase::Rotating, MachineEvent::RotaryAt(read_back)) => {
                self.rotary = read_back;
                self.phase = Phase::Baseline;
                self.listen(BASELINE_TIME_CONSTANTS * self.time_constant_s(), context)
            }
            (Phase::Baseline, MachineEvent::Readings(readings)) => {
                let last = readings.last().map(|last| last.measured);
                let Some(PointResult::Value(baseline)) = last else {
                    let here = context.limits.linear.rest_target().position();
                    let trail = readings.iter().map(|reading| (here, *reading)).collect();
                    return self.unreadable(trail, context);
                };
                self.phase = Phase::Declaring { baseline };
                let down_to = Search::floor(&context.plan.touch.approach, self.expected(context));
                MachineStep::Declare { down_to, purpose: LoweringPurpose::FindSurface }
            }
            (&mut Phase::Declaring { baseline }, MachineEvent::Declared) => {
                let approach = context.plan.touch.approach;
                let (search, step) = Search::begin(approach, self.expected(context), baseline);
                self.phase = Phase::Searching(search);
                let speed = context.limits.motion.travel_speed_mm_per_s;
                self.follow(step, speed, context)
            }
            (Phase::Searching(search), MachineEvent::LinearAt(read_back)) => {
                let step = search.arrived(read_back);
                let speed = context.limits.motion.contact_speed_mm_per_s;
                self.follow(step, speed, context)
            }
            (Phase::Searching(search), MachineEvent::Readings(readings)) => {
                let step = readings.iter().fold(SearchStep::Flagged, |_, one| search.read(*one));
                let speed = context.limits.motion.contact_speed_mm_per_s;
                self.follow(step, speed, context)
            }
            (&mut Phase::DeclaringIndentation { surface }, MachineEvent::Declared) => {
                self.phase = Phase::Indenting { surface };
                let speed = context.limits.motion.contact_speed_mm_per_s;
                context.move_linear(indented(surface, context), speed)
            }
            (&mut Phase::Indenting { surface }, MachineEvent::LinearAt(linear)) => {
                self.phase = Phase::Dwelling(Contact { surface, linear });
                MachineStep::Wait(Duration::from_secs_f64(context.plan.touch.dwell_s))
            }
            (&mut Phase::Dwelling(contact), MachineEvent::Waited) => {
                self.sweep(contact, RETRIES, context)
            }
            (Phase::Sweeping { sweep, .. }, MachineEvent::Readings(readings)) => {
                let step = sweep.measured(context.now, &readings, context.notes);
                self.swept(step, context)
            }
            (Phase::Retracting(outcome), MachineEvent::LinearAt(_))
                if context.clearance == Clearance::Clear =>
            {
                MachineStep::Done(TouchResult {
                    step: self.step.clone(),
                    touch: self.touch,
                    no_load: self.no_load,
                    rotary: self.rotary,
                    outcome: (**outcome).clone(),
                })
            }
            (_, event) => MachineStep::Fault(event.out_of_order("a touch")),
        }
    }

    /// Ends the touch before the probe is in the sample, because the analyzer flags its readings.
    fn unreadable(
        &mut self,
        trail: Vec<(Position<Mm>, Reading)>,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let readings: Vec<Reading> = trail.iter().map(|(_, reading)| *reading).collect();
        let Some(refusal) = flagged(&readings) else {
            return MachineStep::Fault(Fault::MissingReadings { given: 0, asked: 1 });
        };
        context.surface_not_found(trail);
        self.phase = Phase::Retracting(Box::new(TouchOutcome::Refused { contact: None, refusal }));
        context.retract()
    }

    /// Time constant of the ring-down of the free sensor, s.
    fn time_constant_s(&self) -> f64 {
        self.no_load.q / (std::f64::consts::PI * self.no_load.resonance_hz)
    }

    /// Expected position of the surface at this pose.
    fn expected(&self, context: &MachineContext<'_>) -> Position<Mm> {
        let pose = self.touch.pose;
        context.limits.geometry.surface_at(pose.direction, pose.angle)
    }

    /// Reads the impedance at the no-load resonance, where a contact changes it most.
    fn listen(&self, settle_s: f64, context: &MachineContext<'_>) -> MachineStep<TouchResult> {
        let frequency_hz = self.no_load.resonance_hz;
        let cycles = context.plan.touch.approach.cycles;
        let point = SweepPoint { frequency_hz, settle_s, cycles };
        let level = context.plan.contact_sweep.level;
        MachineStep::Do(Operation::Measure { points: vec![point], level })
    }

    /// Carries out the next step of the search.
    fn follow(
        &mut self,
        step: SearchStep,
        speed_mm_per_s: f64,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        match step {
            SearchStep::MoveTo(position) => context.move_linear(position, speed_mm_per_s),
            SearchStep::Read { is_after_contact } => {
                let mut settle_s = context.plan.touch.approach.settle_s;
                if is_after_contact {
                    settle_s = settle_s.max(AFTER_CONTACT_TIME_CONSTANTS * self.time_constant_s());
                }
                self.listen(settle_s, context)
            }
            SearchStep::Found(surface) => {
                let phase = Phase::DeclaringIndentation { surface };
                if let Phase::Searching(search) = std::mem::replace(&mut self.phase, phase) {
                    context.surface_found(surface, search.trail().to_vec());
                }
                MachineStep::Declare {
                    down_to: indented(surface, context),
                    purpose: LoweringPurpose::Indent,
                }
            }
            SearchStep::Flagged => match &self.phase {
                Phase::Searching(search) => self.unreadable(search.trail().to_vec(), context),
                _ => MachineStep::Fault(MachineEvent::Begin.out_of_order("a search")),
            },
            SearchStep::Fault(fault) => {
                if let Phase::Searching(search) = &self.phase {
                    context.surface_not_found(search.trail().to_vec());
                }
                MachineStep::Fault(fault)
            }
        }
    }

    fn sweep(
        &mut self,
        contact: Contact,
        retries_left: u32,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let request = &context.plan.contact_sweep;
        // A refused sweep is repeated without the prior, which may be wrong.
        let prior = (retries_left == RETRIES).then(|| self.stiffened(request.window));
        let (sweep, step) =
            Sweep::begin(context.now, SweepPurpose::Touch, request, prior.as_ref(), context.notes);
        self.phase = Phase::Sweeping { contact, sweep: Box::new(sweep), retries_left };
        self.swept(step, context)
    }

    /// The prior of the sensor in contact: a contact adds stiffness, so the resonance can only
    /// rise, apart from the drift since the reference.
    fn stiffened(&self, window: Window) -> Prior {
        let free_hz = self.no_load.resonance_hz;
        let min_hz = window.min_hz.max(free_hz * (1.0 - DRIFT)).min(window.max_hz);
        Prior::moved(&self.no_load, Window { min_hz, ..window })
    }

    fn swept(
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
                    FitOutcome::Accepted(loaded) => TouchOutcome::Measured { contact, loaded },
                    FitOutcome::Refused(_) if retries_left > 0 => {
                        return self.sweep(contact, retries_left - 1, context);
                    }
                    FitOutcome::Refused(refusal) => {
                        TouchOutcome::Refused { contact: Some(contact), refusal }
                    }
                };
                self.phase = Phase::Retracting(Box::new(outcome));
                context.retract()
            }
        }
    }
}

fn indented(surface: Surface, context: &MachineContext<'_>) -> Position<Mm> {
    surface.position.offset(-context.plan.touch.indentation_mm)
}
