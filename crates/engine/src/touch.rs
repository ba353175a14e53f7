//! One touch, from clear to clear.
//!
//! ```text
//! baseline ─▶ rotate ─▶ test ─▶ declare ─▶ search ─▶ declare ─▶ indent ─▶ dwell ─▶ sweep ─▶ check ─▶ retract
//! (clear)               (clear) (intent    (down in  (intent                       │ ▲     (surface     │
//!                               on disk)   steps)    on disk)                      └─┘      still     done
//!                                                                    once more if refused   there)
//! ```
//!
//! With a measurement halfway, indent, dwell and sweep come twice: at the smaller depth, and at the full
//! one, to which the probe was declared in the beginning.
//!
//! Every failure ends in a [`Fault`]; the engine then stops, retracts and latches.

mod check;
mod descent;
mod sweep;
mod way_down;

use std::time::Duration;

use rig_model::{Clearance, Deg, Impedance, Mm, PointResult, Position, Reading, RigTime, Window};
use rig_protocol::{Approach, Pose, StepId, Touch};
use rig_resonance::{Onset, Resonance, flagged};

use self::way_down::WayDown;
use crate::{
    Contact, ContactSenseFault, Fault, Halfway, LoweringPurpose, RunPhase, TouchOutcome,
    TouchRefusal, TouchResult,
    contact_sense::{check_alive, check_depth, check_free, check_surface, may_be_drift},
    descent::Descent,
    heights::Prediction,
    listening::Decay,
    machine::{MachineContext, MachineEvent, MachineStep},
    operation::retract,
    search::{Near, Search, SearchStep, Surface},
    slip::SlipCheck,
    sweep::Sweep,
};

/// A search begins this many standard deviations and fine steps above the surface that the touches before
/// expect, so that it begins in contact in fewer than one touch in ten thousand.
const START_SIGMAS: f64 = 4.0;
const START_FINE_STEPS: f64 = 2.0;

/// A refused sweep in contact is repeated this often before the touch is refused.
const RETRIES: u32 = 1;

/// What the touches before and the plan say of a touch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outlook {
    /// How much higher than expected the touches before found the surface of this sample, mm.
    pub(crate) offset_mm: Option<f64>,
    /// Where the touches before expect the surface, if there are any.
    pub(crate) predicted: Option<Prediction>,
    /// No touch of the run has found a surface yet.
    pub(crate) is_first: bool,
    /// The pose to which the sample turns next, if no person comes near it before.
    pub(crate) next: Option<Pose>,
}

#[derive(Debug)]
pub(crate) struct TouchMachine {
    step: StepId,
    touch: Touch,
    no_load: Resonance,
    /// The rotary stage as last read back.
    rotary: Position<Deg>,
    outlook: Outlook,
    /// The window of the sweep in contact, if it is another than that of the plan.
    window: Option<Window>,
    /// The impedance of the clear probe before the search, or again in it, and when it was read.
    baseline: Option<Impedance>,
    baseline_at: RigTime,
    /// The longest integration of these readings, s.
    integration_s: f64,
    /// The linear stage as last read back in this touch, and when it last arrived from below.
    linear: Option<Position<Mm>>,
    risen: Option<RigTime>,
    /// Whether the last reading came before the vibration of the contact had decayed.
    is_early: bool,
    /// The measurement at the smaller depth, as soon as there is one.
    halfway: Option<Halfway>,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    Baseline,
    /// With the readings at the no-load resonance.
    Rotating(Vec<Reading>),
    /// From above the clear position, where a person or a homing has left the probe: the search begins there.
    ToClear(Vec<Reading>),
    Testing(Vec<Reading>),
    Declaring,
    ComingDown(WayDown),
    Searching(Search),
    Descending(Box<Descent>),
    DeclaringIndentation {
        surface: Surface,
    },
    Indenting {
        surface: Surface,
    },
    Dwelling(Contact),
    Sweeping {
        contact: Contact,
        sweep: Box<Sweep>,
        retries_left: u32,
    },
    Checking {
        check: SlipCheck,
        contact: Contact,
        measured: Box<TouchOutcome>,
    },
    Retracting {
        outcome: Box<TouchOutcome>,
        since: RigTime,
    },
}

impl TouchMachine {
    pub(crate) fn new(
        step: StepId,
        touch: Touch,
        no_load: &Resonance,
        outlook: Outlook,
        window: Option<Window>,
    ) -> Self {
        let rotary = touch.pose.direction.rotary_position(touch.pose.angle);
        Self {
            step,
            touch,
            no_load: *no_load,
            rotary,
            outlook,
            window,
            baseline: None,
            baseline_at: RigTime::ZERO,
            integration_s: 0.0,
            halfway: None,
            linear: None,
            risen: None,
            is_early: false,
            phase: Phase::Baseline,
        }
    }

    pub(crate) const fn run_phase(&self) -> RunPhase {
        match self.phase {
            Phase::Rotating(_) | Phase::ToClear(_) => RunPhase::Rotation,
            Phase::Baseline | Phase::Testing(_) | Phase::Declaring => RunPhase::Baseline,
            Phase::ComingDown(_) | Phase::Searching(_) | Phase::Descending(_) => RunPhase::Search,
            Phase::DeclaringIndentation { .. } | Phase::Indenting { .. } => RunPhase::Indentation,
            Phase::Dwelling(_) => RunPhase::Dwell,
            Phase::Sweeping { .. } => RunPhase::Sweep,
            Phase::Checking { .. } => RunPhase::SlipCheck,
            Phase::Retracting { .. } => RunPhase::Retract,
        }
    }

    pub(crate) fn advance(
        &mut self,
        event: MachineEvent,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        match (&mut self.phase, event) {
            (Phase::Baseline, MachineEvent::Begin) => {
                MachineStep::Do(context.listening(&self.no_load).baseline())
            }
            (Phase::Baseline, MachineEvent::Readings(mut readings)) => {
                // The last one only sets the frequency of the self-test.
                let set_hz = readings.last().map(|reading| reading.frequency_hz);
                if readings.first().map(|reading| reading.frequency_hz) != set_hz {
                    readings.retain(|reading| Some(reading.frequency_hz) != set_hz);
                }
                self.phase = Phase::Rotating(readings);
                context.rotate_to(self.touch.pose)
            }
            (Phase::Rotating(free), MachineEvent::RotaryAt(read_back)) => {
                self.rotary = read_back;
                let free = std::mem::take(free);
                self.turned(free, context)
            }
            (Phase::ToClear(free), MachineEvent::LinearAt(_)) => {
                let free = std::mem::take(free);
                self.test(free, context)
            }
            (Phase::Testing(free), MachineEvent::Readings(test)) => {
                let free = std::mem::take(free);
                self.tested(&test, free, context)
            }
            (Phase::Declaring, MachineEvent::Declared) => self.search(context),
            (Phase::ComingDown(_), event) => self.coming_down(event, context),
            (Phase::Searching(search), MachineEvent::LinearAt(read_back)) => {
                let step = search.arrived(read_back);
                self.arrived(read_back, context.now);
                self.follow(step, context)
            }
            (Phase::Searching(_), MachineEvent::Readings(readings)) => {
                self.searched(&readings, context)
            }
            (Phase::Descending(_), event) => self.descending(event, context),
            (&mut Phase::DeclaringIndentation { surface }, MachineEvent::Declared) => {
                self.indent(surface, context)
            }
            (&mut Phase::Indenting { surface }, MachineEvent::LinearAt(linear)) => {
                self.arrived(linear, context.now);
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
            (Phase::Retracting { outcome, .. }, MachineEvent::LinearAt(_))
                if context.probe.clearance == Clearance::Clear =>
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

    fn turned(
        &mut self,
        free: Vec<Reading>,
        context: &MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let rest = context.limits.linear.rest_target();
        let highest = rest.position().offset(context.limits.linear.tolerance());
        if context.probe.height.is_none_or(|at| at <= highest) {
            return self.test(free, context);
        }
        self.phase = Phase::ToClear(free);
        MachineStep::Do(retract(context.limits, rest))
    }

    fn test(
        &mut self,
        free: Vec<Reading>,
        context: &MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        self.phase = Phase::Testing(free);
        MachineStep::Do(context.listening(&self.no_load).test())
    }

    /// The self-test has been read, after the baseline.
    fn tested(
        &mut self,
        test: &[Reading],
        mut baseline: Vec<Reading>,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        // The last one only sets the no-load resonance again.
        let test_hz = test.first().map(|reading| reading.frequency_hz);
        let of_test = |reading: &&Reading| Some(reading.frequency_hz) == test_hz;
        let mut readings: Vec<Reading> = test.iter().filter(of_test).copied().collect();
        if readings.last().is_none_or(|last| !is_value(last)) {
            return self.clear_unreadable(&readings, context);
        }
        readings.append(&mut baseline);
        self.declare_search(&readings, context)
    }

    /// The search is declared.
    fn search(&mut self, context: &mut MachineContext<'_>) -> MachineStep<TouchResult> {
        match self.baseline {
            Some(baseline) if self.outlook.is_first => self.come_down(baseline, context),
            _ => self.begin_search(context),
        }
    }

    /// Begins the search, by a descent if the protocol wants one.
    fn begin_search(&mut self, context: &mut MachineContext<'_>) -> MachineStep<TouchResult> {
        let Some(baseline) = self.baseline else {
            return MachineStep::Fault(MachineEvent::Declared.out_of_order("a search"));
        };
        let (approach, expected) = (self.approach(context), self.expected(context));
        if let Some(speed_mm_per_s) = approach.descent_of(self.touch.repeat) {
            return self.begin_descent((approach, speed_mm_per_s), baseline, context);
        }
        let (search, step) = match self.near(&approach, expected, context) {
            Some(near) => Search::begin_near(approach, expected, baseline, near),
            None => Search::begin(approach, expected, baseline),
        };
        self.phase = Phase::Searching(search);
        self.follow(step, context)
    }

    /// The impedance has been read in the search.
    fn searched(
        &mut self,
        readings: &[Reading],
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let is_doubtful = matches!(&self.phase, Phase::Searching(search)
            if !search.is_anew() && search.seems_to_touch(readings)
                && (search.has_crept(readings) || self.may_have_drifted(context)));
        let Phase::Searching(search) = &mut self.phase else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("a search"));
        };
        if let Err(fault) = is_alive(search, &self.no_load, readings) {
            return MachineStep::Fault(Fault::ContactSense(fault));
        }
        if std::mem::take(&mut self.is_early) && search.seems_to_touch(readings) {
            return self.listen(Decay::Whole, context);
        }
        if search.is_anew() {
            match check_free(&self.no_load, readings) {
                Ok(Some(baseline)) => {
                    (self.baseline, self.baseline_at) = (Some(baseline), context.now);
                }
                Ok(None) => {}
                Err(fault) => return MachineStep::Fault(Fault::ContactSense(fault)),
            }
        } else if is_doubtful {
            search.doubt();
        }
        let step = readings.iter().fold(SearchStep::Flagged, |_, one| search.read(*one));
        self.follow(step, context)
    }

    /// Whether the free resonance may have drifted since the impedance of the clear probe was read, by as much as a
    /// contact changes the impedance.
    fn may_have_drifted(&self, context: &MachineContext<'_>) -> bool {
        let passed_s = context.now.since(self.baseline_at).as_secs_f64();
        let moved_hz = context.drift.moves_hz(passed_s);
        may_be_drift(&self.no_load, moved_hz, context.plan.touch.approach.contact_threshold)
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
        context.surface_not_found(trail, None);
        let refusal = TouchRefusal::Sweep(Box::new(refusal));
        self.retract(TouchOutcome::Refused { contact: None, refusal }, context)
    }

    /// Ends the touch, because the analyzer flags readings of the clear probe.
    fn clear_unreadable(
        &mut self,
        readings: &[Reading],
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let rest = context.limits.linear.rest_target().position();
        let here = context.probe.height.unwrap_or(rest);
        self.unreadable(readings.iter().map(|reading| (here, *reading)).collect(), context)
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
            Ok(Some(baseline)) => {
                (self.baseline, self.baseline_at) = (Some(baseline), read_at(readings));
            }
            Ok(None) => return self.clear_unreadable(readings, context),
            Err(fault) => return MachineStep::Fault(Fault::ContactSense(fault)),
        }
        self.integration_s = readings.iter().map(|one| one.integration_s).fold(0.0, f64::max);
        self.phase = Phase::Declaring;
        let down_to = Search::floor(&self.approach(context), self.expected(context));
        MachineStep::Declare { down_to, purpose: LoweringPurpose::FindSurface }
    }

    /// The approach, whose search goes no deeper than the sample may be pressed, as far as the height of
    /// its surface is known.
    fn approach(&self, context: &MachineContext<'_>) -> Approach {
        let approach = context.plan.touch.approach;
        let deepest_mm =
            context.limits.motion.max_indentation_mm - self.outlook.offset_mm.unwrap_or(0.0);
        Approach { give_up_below_mm: approach.give_up_below_mm.min(deepest_mm), ..approach }
    }

    /// Where the search begins, if the touches before say where the surface lies.
    fn near(
        &self,
        approach: &Approach,
        expected: Position<Mm>,
        context: &MachineContext<'_>,
    ) -> Option<Near> {
        let Prediction { above_mm, sigma_mm } = self.outlook.predicted?;
        let surface = expected.offset(above_mm);
        let margin_mm = START_FINE_STEPS * approach.fine_step_mm;
        let start = surface.offset(START_SIGMAS * sigma_mm + margin_mm);
        let floor = Search::floor(approach, expected);
        let highest =
            context.limits.highest_surface(self.touch.pose.direction, self.touch.pose.angle);
        (floor < start).then_some(Near { start, surface, sigma_mm, highest })
    }

    /// The linear stage has been read back.
    fn arrived(&mut self, read_back: Position<Mm>, now: RigTime) {
        if self.linear.is_some_and(|before| before < read_back) {
            self.risen = Some(now);
        }
        self.linear = Some(read_back);
    }

    /// When the probe left the sample on the way up that has just ended, at the latest.
    ///
    /// A drive begins a move as it ends it. With the gentlest profile, a constant jerk, the part ε of the way
    /// takes (6/32 ε)^⅓ of the time; any other is faster at the beginning.
    pub(crate) fn left_at(&self, context: &MachineContext<'_>) -> RigTime {
        let (Phase::Retracting { outcome, since }, Some(from), Some(to)) =
            (&self.phase, self.linear, context.probe.height)
        else {
            return context.now;
        };
        let pose = self.touch.pose;
        let surface = match &**outcome {
            TouchOutcome::Measured { contact, .. } => contact.surface.position,
            TouchOutcome::Refused { .. } => {
                context.limits.highest_surface(pose.direction, pose.angle)
            }
        };
        // As far above the surface as the check of it has found the probe free.
        let tolerance_mm = context.limits.linear.tolerance();
        let slip_mm = context.plan.touch.approach.slip_mm.max(tolerance_mm);
        let way_mm = (to.value() - from.value()).max(tolerance_mm);
        let part = (surface.value() + slip_mm - from.value()) / way_mm;
        let time = context.now.since(*since).mul_f64((6.0 / 32.0 * part).cbrt().clamp(0.0, 1.0));
        *since + time
    }

    /// The speed to a position: that of contact on the way down, except from the clear position.
    fn speed_mm_per_s(&self, to: Position<Mm>, context: &MachineContext<'_>) -> f64 {
        let motion = context.limits.motion;
        let is_down = self.linear.is_some_and(|here| to <= here);
        if is_down { motion.contact_speed_mm_per_s } else { motion.travel_speed_mm_per_s }
    }

    /// Reads whether the probe touches, after it has left the sample.
    fn listen(&mut self, decay: Decay, context: &MachineContext<'_>) -> MachineStep<TouchResult> {
        self.is_early = decay == Decay::Early;
        MachineStep::Do(context.listening(&self.no_load).contact(self.risen, decay))
    }

    /// Carries out the next step of the search.
    fn follow(
        &mut self,
        step: SearchStep,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        match step {
            SearchStep::MoveTo(position) => {
                context.move_linear(position, self.speed_mm_per_s(position, context))
            }
            SearchStep::Read { is_after_contact: true } => {
                let is_anew = matches!(&self.phase, Phase::Searching(search) if search.is_anew());
                self.listen(if is_anew { Decay::Whole } else { Decay::Early }, context)
            }
            SearchStep::Read { is_after_contact: false } => {
                MachineStep::Do(context.listening(&self.no_load).contact(None, Decay::Whole))
            }
            SearchStep::Found(surface) => {
                let trail = match &self.phase {
                    Phase::Searching(search) => search.trail().to_vec(),
                    _ => Vec::new(),
                };
                self.found((surface, None), trail, context)
            }
            SearchStep::Flagged => match &self.phase {
                Phase::Searching(search) => self.unreadable(search.trail().to_vec(), context),
                _ => MachineStep::Fault(MachineEvent::Begin.out_of_order("a search")),
            },
            SearchStep::Fault(fault) => {
                if let Phase::Searching(search) = &self.phase {
                    context.surface_not_found(search.trail().to_vec(), None);
                }
                MachineStep::Fault(fault)
            }
        }
    }

    /// The surface is found, unless it lies elsewhere than the touches before expect it, or too low for the touch.
    fn found(
        &mut self,
        (surface, onset): (Surface, Option<Onset>),
        trail: Vec<(Position<Mm>, Reading)>,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let tolerance_mm = context.limits.geometry.surface_tolerance_mm;
        let (found, expected) = (surface.position, self.expected(context));
        let deepest = (context.plan.touch.indentation_mm, self.touch.pose.angle);
        let is_expected = check_surface(found, expected, self.outlook.offset_mm, tolerance_mm)
            .and_then(|()| check_depth(found, expected, deepest, context.limits));
        if let Err(fault) = is_expected {
            context.surface_not_found(trail, None);
            return MachineStep::Fault(Fault::ContactSense(fault));
        }
        self.phase = Phase::DeclaringIndentation { surface };
        context.surface_found(surface, onset, trail);
        let down_to = indented(surface, context);
        MachineStep::Declare { down_to, purpose: LoweringPurpose::Indent }
    }

    /// Moves to the depth that is measured next.
    fn indent(
        &mut self,
        surface: Surface,
        context: &MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        self.phase = Phase::Indenting { surface };
        let settings = context.plan.touch;
        let halfway_mm = settings.halfway_mm.filter(|_| self.halfway.is_none());
        let depth_mm = halfway_mm.unwrap_or(settings.indentation_mm);
        let speed = context.limits.motion.contact_speed_mm_per_s;
        context.move_linear(surface.position.offset(-depth_mm), speed)
    }

    fn measured(
        &self,
        contact: Contact,
        loaded: &Resonance,
        context: &MachineContext<'_>,
    ) -> TouchOutcome {
        let drift_sigma_hz = context.drift.moved_sigma_hz(context.now);
        TouchOutcome::Measured { contact, loaded: *loaded, halfway: self.halfway, drift_sigma_hz }
    }

    fn retract(
        &mut self,
        outcome: TouchOutcome,
        context: &MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        // A person may be asked about a refused touch.
        let next = self.outlook.next.filter(|_| matches!(outcome, TouchOutcome::Measured { .. }));
        self.phase = Phase::Retracting { outcome: Box::new(outcome), since: context.now };
        context.retract(next)
    }
}

/// When the last of these readings began.
fn read_at(readings: &[Reading]) -> RigTime {
    readings.last().map_or(RigTime::ZERO, |last| last.started)
}

pub(crate) const fn is_value(reading: &Reading) -> bool {
    matches!(reading.measured, PointResult::Value(_))
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
