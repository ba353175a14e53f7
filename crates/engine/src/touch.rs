//! One touch, from clear to clear.
//!
//! ```text
//! rotate ─▶ baseline ─▶ declare ─▶ search ─▶ declare ─▶ indent ─▶ dwell ─▶ sweep ─▶ check ─▶ retract ─▶ done
//!           (clear)     (intent    (down in  (intent                       │ ▲     (surface
//!                       on disk)   steps)    on disk)                      └─┘      still there)
//!                                                              once more if refused
//! ```
//!
//! Every failure ends in a [`Fault`]; the engine then stops, retracts and latches.

use std::time::Duration;

use rig_model::{
    Clearance, Deg, Impedance, Mm, PointResult, Position, Reading, RigLimits, SweepPoint,
    SweepRequest, Window,
};
use rig_protocol::{Approach, Plan, StepId, Touch};
use rig_resonance::{Bench, FitOutcome, Prior, Resonance, flagged};

use crate::{
    Contact, ContactSenseFault, Event, Fault, LoweringPurpose, Operation, RunPhase, SweepPurpose,
    TouchOutcome, TouchRefusal, TouchResult,
    contact_sense::{TEST_LINEWIDTHS, check_alive, check_free, check_shift, check_surface},
    machine::{MachineContext, MachineEvent, MachineStep},
    search::{Search, SearchStep, Surface},
    slip::{SlipCheck, SlipStep},
    sweep::{DRIFT, Sweep, SweepStep},
};

/// The baseline is read after this many time constants of the ring-down, so that the residual
/// transient (e⁻⁸ = 0.03 %) is far below any contact threshold.
const BASELINE_TIME_CONSTANTS: f64 = 8.0;

/// The reading of the self-test before it waits for this many, to e⁻³ = 5 % of the vibration at the
/// resonance, which is within what the self-test allows.
const TEST_TIME_CONSTANTS: f64 = 3.0;

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
    /// How much higher than expected the touches before found the surface of this sample, mm.
    offset_mm: Option<f64>,
    /// The window of the sweep in contact, if it is another than that of the plan.
    window: Option<Window>,
    /// The impedance of the clear probe before the search.
    baseline: Option<Impedance>,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    Rotating,
    Baseline,
    Declaring,
    Searching(Search),
    DeclaringIndentation { surface: Surface },
    Indenting { surface: Surface },
    Dwelling(Contact),
    Sweeping { contact: Contact, sweep: Box<Sweep>, retries_left: u32 },
    Checking { check: SlipCheck, contact: Contact, loaded: Box<Resonance> },
    Retracting(Box<TouchOutcome>),
}

impl TouchMachine {
    pub(crate) fn new(
        step: StepId,
        touch: Touch,
        no_load: &Resonance,
        offset_mm: Option<f64>,
        window: Option<Window>,
    ) -> Self {
        let rotary = touch.pose.direction.rotary_position(touch.pose.angle);
        let (no_load, baseline) = (*no_load, None);
        let phase = Phase::Rotating;
        Self { step, touch, no_load, rotary, offset_mm, window, baseline, phase }
    }

    pub(crate) const fn run_phase(&self) -> RunPhase {
        match self.phase {
            Phase::Rotating => RunPhase::Rotation,
            Phase::Baseline | Phase::Declaring => RunPhase::Baseline,
            Phase::Searching(_) => RunPhase::Search,
            Phase::DeclaringIndentation { .. } | Phase::Indenting { .. } => RunPhase::Indentation,
            Phase::Dwelling(_) => RunPhase::Dwell,
            Phase::Sweeping { .. } => RunPhase::Sweep,
            Phase::Checking { .. } => RunPhase::SlipCheck,
            Phase::Retracting(_) => RunPhase::Retract,
        }
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
                MachineStep::Do(listen_clear(&self.no_load, context.plan))
            }
            (Phase::Baseline, MachineEvent::Readings(readings)) => {
                self.declare_search(&readings, context)
            }
            (Phase::Declaring, MachineEvent::Declared) => {
                let Some(baseline) = self.baseline else {
                    return MachineStep::Fault(MachineEvent::Declared.out_of_order("a search"));
                };
                let approach = self.approach(context);
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
                if let Err(fault) = is_alive(search, &self.no_load, &readings) {
                    return MachineStep::Fault(Fault::ContactSense(fault));
                }
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
            (Phase::Checking { .. }, event) => self.check(&event, context),
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
        let refusal = TouchRefusal::Sweep(Box::new(refusal));
        self.phase = Phase::Retracting(Box::new(TouchOutcome::Refused { contact: None, refusal }));
        context.retract()
    }

    /// Expected position of the surface at this pose.
    fn expected(&self, context: &MachineContext<'_>) -> Position<Mm> {
        let pose = self.touch.pose;
        context.limits.geometry.surface_at(pose.direction, pose.angle)
    }

    /// Declares the search, if the readings of the clear probe are those of a free sensor.
    fn declare_search(
        &mut self,
        readings: &[Reading],
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        match check_free(&self.no_load, readings) {
            Ok(Some(baseline)) => self.baseline = Some(baseline),
            Ok(None) => {
                let here = context.limits.linear.rest_target().position();
                let trail = readings.iter().map(|reading| (here, *reading)).collect();
                return self.unreadable(trail, context);
            }
            Err(fault) => return MachineStep::Fault(Fault::ContactSense(fault)),
        }
        self.phase = Phase::Declaring;
        let down_to = Search::floor(&self.approach(context), self.expected(context));
        MachineStep::Declare { down_to, purpose: LoweringPurpose::FindSurface }
    }

    /// The approach, whose search goes no deeper than the sample may be pressed, as far as the height of
    /// its surface is known.
    fn approach(&self, context: &MachineContext<'_>) -> Approach {
        let approach = context.plan.touch.approach;
        let deepest_mm = context.limits.motion.max_indentation_mm - self.offset_mm.unwrap_or(0.0);
        Approach { give_up_below_mm: approach.give_up_below_mm.min(deepest_mm), ..approach }
    }

    /// Reads the impedance at the no-load resonance, where a contact changes it most.
    fn listen(&self, settle_s: f64, context: &MachineContext<'_>) -> MachineStep<TouchResult> {
        let points = vec![point(&self.no_load, 0.0, settle_s, context.plan)];
        MachineStep::Do(Operation::Measure { points, level: context.plan.contact_sweep.level })
    }

    /// Settling of a reading of a search, s.
    fn settle_s(&self, is_after_contact: bool, context: &MachineContext<'_>) -> f64 {
        let settle_s = context.plan.touch.approach.settle_s;
        let decay_s = AFTER_CONTACT_TIME_CONSTANTS * time_constant_s(&self.no_load);
        if is_after_contact { settle_s.max(decay_s) } else { settle_s }
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
                self.listen(self.settle_s(is_after_contact, context), context)
            }
            SearchStep::Found(surface) => {
                let tolerance_mm = context.limits.geometry.surface_tolerance_mm;
                let (found, expected) = (surface.position, self.expected(context));
                if let Err(fault) = check_surface(found, expected, self.offset_mm, tolerance_mm) {
                    let fault = SearchStep::Fault(Fault::ContactSense(fault));
                    return self.follow(fault, speed_mm_per_s, context);
                }
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
        let planned = context.plan.contact_sweep;
        let request = &SweepRequest { window: self.window.unwrap_or(planned.window), ..planned };
        // A refused sweep is repeated without the prior, which may be wrong.
        let prior = if retries_left == RETRIES {
            self.stiffened(request.window, context.bench)
        } else {
            Prior::anywhere(request.window, context.bench)
        };
        let (sweep, step) =
            Sweep::begin(context.now, SweepPurpose::Touch, request, Some(&prior), context.notes);
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
                    FitOutcome::Accepted(loaded) => match check_shift(&self.no_load, &loaded) {
                        Ok(()) => return self.check_slip(contact, &loaded, context),
                        Err(refusal) => TouchOutcome::Refused { contact: Some(contact), refusal },
                    },
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

    /// Looks for the surface again after an accepted sweep, if the protocol asks for it.
    fn check_slip(
        &mut self,
        contact: Contact,
        loaded: &Resonance,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let approach = context.plan.touch.approach;
        let Some(baseline) = self.baseline.filter(|_| 0.0 < approach.slip_mm) else {
            return self.retract(TouchOutcome::Measured { contact, loaded: *loaded }, context);
        };
        let (check, step) = SlipCheck::begin(contact.surface, approach, baseline);
        self.phase = Phase::Checking { check, contact, loaded: Box::new(*loaded) };
        self.follow_check(step, context)
    }

    /// Takes an event of the check of the surface.
    fn check(
        &mut self,
        event: &MachineEvent,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let step = match (&mut self.phase, event) {
            (Phase::Checking { check, .. }, MachineEvent::LinearAt(read_back)) => {
                check.arrived(*read_back)
            }
            (Phase::Checking { check, .. }, MachineEvent::Readings(readings)) => {
                let read = |_, one: &Reading| check.read(*one, &self.no_load);
                readings.iter().fold(SlipStep::Flagged, read)
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
        let Phase::Checking { check, contact, loaded } = &self.phase else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("a check of the surface"));
        };
        let RigLimits { motion, .. } = context.limits;
        let refusal = match step {
            SlipStep::Up(to) => return context.move_linear(to, motion.travel_speed_mm_per_s),
            SlipStep::Down(to) => return context.move_linear(to, motion.contact_speed_mm_per_s),
            SlipStep::Read { is_after_contact } => {
                return self.listen(self.settle_s(is_after_contact, context), context);
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
        let (contact, loaded) = (*contact, **loaded);
        context.notes.push(Event::SurfaceChecked { trail: check.trail().to_vec() });
        let outcome = match refusal {
            None => TouchOutcome::Measured { contact, loaded },
            Some(refusal) => TouchOutcome::Refused { contact: Some(contact), refusal },
        };
        self.retract(outcome, context)
    }

    fn retract(
        &mut self,
        outcome: TouchOutcome,
        context: &MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        self.phase = Phase::Retracting(Box::new(outcome));
        context.retract()
    }
}

fn time_constant_s(no_load: &Resonance) -> f64 {
    no_load.q / (std::f64::consts::PI * no_load.resonance_hz)
}

/// Reads the impedance of the clear probe below the no-load resonance, as the self-test, and then at the
/// resonance, after its vibration has decayed.
pub(crate) fn listen_clear(no_load: &Resonance, plan: &Plan) -> Operation {
    let time_constant_s = time_constant_s(no_load);
    let test_s = TEST_TIME_CONSTANTS * time_constant_s;
    let baseline_s = BASELINE_TIME_CONSTANTS * time_constant_s;
    let points =
        vec![point(no_load, TEST_LINEWIDTHS, test_s, plan), point(no_load, 0.0, baseline_s, plan)];
    Operation::Measure { points, level: plan.contact_sweep.level }
}

/// A reading this many linewidths below the no-load resonance, or at the end of the no-load window.
fn point(no_load: &Resonance, linewidths: f64, settle_s: f64, plan: &Plan) -> SweepPoint {
    let frequency_hz = no_load.resonance_hz * (1.0 - linewidths / no_load.q);
    let frequency_hz = frequency_hz.max(plan.no_load_sweep.window.min_hz);
    SweepPoint { frequency_hz, settle_s, cycles: plan.touch.approach.cycles }
}

/// Holds a reading of a search against the one before it.
fn is_alive(
    search: &Search,
    no_load: &Resonance,
    readings: &[Reading],
) -> Result<(), ContactSenseFault> {
    let before = match search.trail().last().map(|(_, last)| last.measured) {
        None => search.baseline(),
        Some(PointResult::Value(before)) => before,
        Some(_) => return Ok(()),
    };
    match readings.last().map(|last| last.measured) {
        Some(PointResult::Value(next)) => check_alive(no_load, no_load.resonance_hz, before, next),
        _ => Ok(()),
    }
}

fn indented(surface: Surface, context: &MachineContext<'_>) -> Position<Mm> {
    surface.position.offset(-context.plan.touch.indentation_mm)
}
